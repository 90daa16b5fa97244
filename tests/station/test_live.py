"""The station beside a live swarm."""

import asyncio
import time

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.protocol.mesh.session import MeshConfig
from radron.station.hub import Hub
from radron.station.live import SHOW_S, follow
from radron.station.picture.picture import Picture
from radron.station.picture.swarmlog import SwarmLog
from support.live.agents import free_ports

MISSION = MissionConfig(
    name="m", area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))), drones=(DroneInMission(id="d1"),)
)


class BusyLog(SwarmLog):
    """Has always work left. ``slices``: of it."""

    slices = 0

    def advance(self, now_ns):
        self.slices += 1

    @property
    def pending(self):
        return True


def test_work_that_is_left_is_done_between_the_frames_and_makes_no_more_of_them():
    hub = Hub(Picture(MISSION, None), replay=False)
    hub.picture.log = log = BusyLog(MISSION, None)
    shown_s = []
    hub.show = lambda now_ns: shown_s.append(time.monotonic())

    async def run():
        following = asyncio.create_task(follow(hub, MeshConfig(listen=f"tcp/127.0.0.1:{free_ports(1)[0]}")))
        while len(shown_s) < 6:
            assert not following.done()
            await asyncio.sleep(0.01)
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)

    asyncio.run(run())
    assert shown_s[-1] - shown_s[0] > 4.0 * SHOW_S  # five intervals; one may be made up for
    assert log.slices > 2 * len(shown_s)
