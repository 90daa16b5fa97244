"""The faults of a live flight as orders to its processes, links and world; what cannot be played is refused."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.errors import ConfigError
from radron.protocol.codec import decode, encode
from radron.protocol.messages import Pose
from radron.sim.faults.agents import (
    Cut,
    DenseEntries,
    Disk,
    Flood,
    Freeze,
    Kill,
    Lag,
    Late,
    OldEntries,
    Partition,
    RadioRange,
    Stall,
    Throttle,
)
from radron.sim.faults.kinds import AnyFault
from radron.sim.faults.machines import (
    Battery,
    CameraDead,
    CameraNoisy,
    Disarm,
    Gust,
    MavlinkImpaired,
    MavlinkLoss,
    MotorFailure,
    PositionJump,
    Refusal,
    SatellitesLost,
    StreamLost,
    Takeover,
)
from radron.sim.faults.network import padded
from radron.sim.live.agents import Agents
from radron.sim.live.faults.flooding import FloodPlan
from radron.sim.live.faults.playable import check_playable, needs_relays
from radron.sim.live.faults.player import FaultPlayer
from radron.sim.live.places import Places
from radron.sim.live.relays.launcher import RelayProcess
from radron.sim.live.relays.linkstate import PASSING, LinkState
from radron.sim.live.view import View
from radron.sim.live.worldlink import Order, Truth, order_line, read_order
from radron.sim.live.worldprocess import WorldProcess
from radron.sim.scenario import Scenario, load_scenario
from radron.sim.vehicle.px4.faults import VehicleFault

CUT = LinkState(cut=True)


class Fakes:
    """Agents, relays and world that note the requests to them."""

    def __init__(self, folder: Path) -> None:
        self.done: list[tuple[object, ...]] = []
        self.links: dict[tuple[str, str], LinkState] = {}
        self.ended: set[str] = set()
        self._folder = folder

    async def start(self, drone: str) -> None:
        self.done.append(("start", drone))

    def signal(self, drone: str, number: int) -> None:
        self.done.append((signal.Signals(number).name, drone))

    def signal_agent(self, drone: str, number: int) -> None:
        self.done.append((signal.Signals(number).name, "agent of", drone))

    async def has_ended(self, drone: str) -> bool:
        return drone in self.ended

    def folder(self, drone: str) -> Path:
        return self._folder / drone

    def order(self, order: Order, drone: int | None = None, fault: VehicleFault | None = None) -> None:
        self.done.append((order, drone) if fault is None else (order, drone, fault))

    def impair(self, sender: str, receiver: str, state: LinkState) -> None:
        self.links[sender, receiver] = state

    def cut(self) -> set[tuple[str, str]]:
        """The directions between two agents that are cut."""
        return {ends for ends, state in self.links.items() if state == CUT}


def scenario(*faults: AnyFault) -> Scenario:
    return replace(load_scenario("paper-demo"), fault=faults)


def truth(*x: float) -> Truth:
    places = tuple((each, 0.0, 3.0) for each in x)
    return Truth(0.0, places, places, None, (), 0.0, 0)


def player(fakes: Fakes, *faults: AnyFault) -> FaultPlayer:
    agents, relays, world = cast(Agents, fakes), cast(RelayProcess, fakes), cast(WorldProcess, fakes)
    return FaultPlayer(scenario(*faults), 1, agents, relays, world, View(), Places.relayed(3))


def played(tmp_path: Path, *faults: AnyFault, times_s: Sequence[float] = (0.0, 1.0, 2.0), ended: str = "") -> Fakes:
    """Actions at these times, for three drones side by side."""
    fakes = Fakes(tmp_path)

    async def run() -> None:
        one = player(fakes, *faults)
        for time_s in times_s:
            fakes.ended = {ended} if time_s > 0.0 else set()
            one.step(time_s, truth(0.0, 10.0, 30.0))
            await asyncio.sleep(0.0)
        await one.close()

    asyncio.run(run())
    return fakes


def test_processes_are_killed_stopped_started_again_and_started_late(tmp_path: Path) -> None:
    killed = Kill(target="d1", at_s=0.5, for_s=1.0)
    assert played(tmp_path, killed, ended="d1").done == [("SIGKILL", "d1"), ("start", "d1")]
    late_too = played(tmp_path, killed, Late(target="d1", at_s=1.2)).done  # running when the kill is over
    assert late_too == [("SIGKILL", "d1"), ("start", "d1")]
    frozen = Freeze(target="d2", at_s=0.0, for_s=1.0)
    assert played(tmp_path, frozen).done == [("SIGSTOP", "agent of", "d2"), ("SIGCONT", "agent of", "d2")]
    assert played(tmp_path, frozen, ended="d2").done[-1] == ("start", "d2")
    late = Late(target="d3", at_s=2.0)
    assert played(tmp_path, late).done == [("start", "d3")]
    assert player(Fakes(tmp_path), late).late == {"d3"}


def test_orders_to_the_world_and_what_was_done(tmp_path: Path) -> None:
    satellites, camera = SatellitesLost(target="d2", at_s=0.0, for_s=1.0), CameraDead(target="d1", at_s=1.0, for_s=1.0)
    done = played(tmp_path, satellites, camera, Takeover(target="d3", at_s=2.0, mode="manual")).done
    assert done == [
        (Order.SATELLITES_OFF, 1),
        (Order.CAMERA_OFF, 0),
        (Order.SATELLITES_ON, 1),
        (Order.PILOT_MANUAL, 2),
        (Order.CAMERA_ON, 0),
    ]
    one = player(Fakes(tmp_path), camera)
    one.step(1.04, truth(0.0, 0.0, 0.0))
    assert [(each.time_s, each.what) for each in one.played] == [(1.04, "d1: no more readouts")]


@pytest.mark.parametrize(
    ("fault", "lasts"),
    [
        (Gust(at_s=0.0, for_s=1.0), False),
        (Battery(at_s=0.0, for_s=1.0, level=0.1, lies=True), False),
        (Refusal(at_s=0.0, for_s=1.0), False),
        (PositionJump(at_s=0.0, for_s=1.0, announced=True), False),
        (StreamLost(message="ODOMETRY", at_s=0.0, for_s=1.0), False),
        (Disarm(at_s=0.0), True),
        (MotorFailure(at_s=0.0), True),
    ],
)
def test_faults_of_vehicles_are_played_by_the_world(tmp_path: Path, fault: VehicleFault, lasts: bool) -> None:
    struck = replace(fault, target="d2")
    done = played(tmp_path, struck).done
    assert done == [(Order.BREAK, 1, struck), *[(Order.MEND, 1, struck)] * (not lasts)]
    assert read_order(order_line(Order.BREAK, 1, struck)) == (Order.BREAK, 1, struck)


def test_orders_without_a_fault_or_a_drone_are_read() -> None:
    assert read_order(order_line(Order.GO, None, None)) == (Order.GO, 0, None)
    assert read_order(order_line(Order.PILOT_MANUAL, 2, None)) == (Order.PILOT_MANUAL, 2, None)


def test_links_are_cut_as_the_groups_the_direction_or_the_distance_say(tmp_path: Path) -> None:
    apart = {("d1", "d3"), ("d3", "d1"), ("d2", "d3"), ("d3", "d2")}
    split = Partition(groups=(("d1", "d2"),), at_s=1.0)
    assert played(tmp_path, split, times_s=(0.0,)).cut() == set()
    assert played(tmp_path, split).cut() == apart
    assert played(tmp_path, replace(split, for_s=1.0)).cut() == set()
    assert played(tmp_path, Cut(target="d1", peers="d2", direction="send", at_s=0.0)).cut() == {("d1", "d2")}
    assert played(tmp_path, Cut(target="d1", direction="receive", at_s=0.0)).cut() == {("d2", "d1"), ("d3", "d1")}
    assert played(tmp_path, RadioRange(range_m=15.0, at_s=0.0)).cut() == apart
    delayed = played(tmp_path, Lag(target="d1", delay_s=0.1, jitter_s=0.05, at_s=0.0), Lag(delay_s=0.2, at_s=1.0)).links
    assert delayed["d1", "d3"] == LinkState(delay_s=pytest.approx(0.3), jitter_s=0.05)
    assert delayed["d2", "d3"] == LinkState(delay_s=0.2)
    assert delayed["vehicle of d1", "d1"] == PASSING
    lossy = played(tmp_path, MavlinkLoss(target="d2", probability=0.3, at_s=0.0)).links
    assert {ends for ends, state in lossy.items() if state.loss == pytest.approx(0.3)} == {
        ("vehicle of d2", "d2"),
        ("d2", "vehicle of d2"),
    }


def test_links_stand_still_or_carry_little_one_way(tmp_path: Path) -> None:
    slow = played(
        tmp_path, Throttle(target="d1", rate_kilobytes_ps=5.0, at_s=0.0), Stall(target="d1", direction="send", at_s=1.0)
    ).links
    assert slow["d1", "d2"] == LinkState(rate_bytes_ps=5000.0, frozen=True)
    assert slow["d2", "d1"] == LinkState(rate_bytes_ps=5000.0)
    assert slow["d2", "d3"] == PASSING


def test_the_mavlink_of_a_drone_is_impaired_one_way_or_both(tmp_path: Path) -> None:
    numbers = {"delay_s": 0.1, "jitter_s": 0.2, "reorder": 0.1, "held_s": 0.3, "duplicate": 0.2, "within_s": 0.4, "corrupt": 0.05}
    both = MavlinkImpaired(target="d2", at_s=0.0, **numbers)
    there, back = ("vehicle of d2", "d2"), ("d2", "vehicle of d2")
    links = played(tmp_path, both).links
    expected = {name: pytest.approx(value) for name, value in numbers.items()}
    assert msgspec.structs.asdict(links[there]) == {**msgspec.structs.asdict(PASSING), **expected}
    assert links[there] == links[back]
    assert links["vehicle of d1", "d1"] == PASSING
    deaf = played(tmp_path, MavlinkImpaired(target="d2", direction="to-agent", cut=True, at_s=0.0)).links
    assert (deaf[there].cut, deaf[back]) == (True, PASSING)
    mute = played(tmp_path, MavlinkImpaired(target="d2", direction="to-vehicle", cut=True, at_s=0.0)).links
    assert (mute[there], mute[back].cut) == (PASSING, True)


def test_files_are_torn_or_removed(tmp_path: Path) -> None:
    for folder, name in (("state", "d1.json"), ("flight", "d1-0000.mcap")):
        (tmp_path / "d1" / folder).mkdir(parents=True)
        (tmp_path / "d1" / folder / name).write_bytes(bytes(100))
    played(tmp_path, Disk(target="d1", how="state-torn", at_s=0.0))
    assert (tmp_path / "d1/state/d1.json").stat().st_size == 50
    torn, killed = Disk(target="d1", how="state-torn", at_s=0.0), Kill(target="d1", at_s=0.0, for_s=1.0)
    again = played(tmp_path, torn, killed, ended="d1")
    assert again.done[-1] == ("start", "d1")
    assert (tmp_path / "d1/state/d1.json").stat().st_size == 12  # torn again, as the restarted agent finds it
    played(tmp_path, Disk(target="d1", how="record-removed", at_s=0.0))
    assert not (tmp_path / "d1/flight").exists()


def test_what_cannot_be_played_is_refused_with_what_can() -> None:
    with pytest.raises(ConfigError, match=r"demo: fault\[1\] \(camera-noisy\): not played in a live flight, which plays kill, "):
        check_playable(scenario(Kill(at_s=0.0), CameraNoisy(at_s=0.0)), here=True)
    with pytest.raises(ConfigError, match="how = 'full' is not played in a live flight, which plays state-torn, "):
        check_playable(scenario(Disk(how="full", at_s=0.0)), here=True)
    with pytest.raises(ConfigError, match="announced = false is not played"):
        check_playable(scenario(PositionJump(at_s=0.0)), here=True)
    with pytest.raises(ConfigError, match="blind = true is not played"):
        check_playable(scenario(CameraDead(at_s=0.0, blind=True)), here=True)
    with pytest.raises(ConfigError, match="leave out --external"):
        check_playable(scenario(Kill(at_s=0.0)), here=False)
    check_playable(scenario(), here=False)
    assert needs_relays((MavlinkLoss(probability=0.1, at_s=0.0),))
    assert not needs_relays((Kill(at_s=0.0),))


def test_each_agent_dials_those_before_it_through_their_relays() -> None:
    drones = ["d1", "d2", "d3"]
    places = Places.relayed(3)
    plan = places.relay_plan(1, drones)
    assert [(each.dials, each.dialled) for each in plan.mesh] == [("d2", "d1"), ("d3", "d1"), ("d3", "d2")]
    relays = {(each.dials, each.dialled): f"tls/127.0.0.1:{each.port}" for each in plan.mesh}
    own = dict(zip(drones, places.mesh, strict=True))
    assert places.endpoints(drones, "d1") == own
    assert places.endpoints(drones, "d3") == {"d1": relays["d3", "d1"], "d2": relays["d3", "d2"], "d3": own["d3"]}
    assert [f"tls/127.0.0.1:{each.target[1]}" for each in plan.mesh] == [own["d1"], own["d1"], own["d2"]]
    assert [each.target for each in plan.mavlink] == list(places.onboard)
    assert [each.port for each in plan.mavlink] == [port for _, port in places.vehicles]
    assert Places.here(3).vehicles != ()


def test_a_padded_message_is_valid_and_as_long_as_asked() -> None:
    pose = Pose(
        drone="d1", stamp_ns=5, epoch=0, position_m=(1.0, 2.0, 3.0), quaternion=(1.0, 0.0, 0.0, 0.0),
        velocity_mps=(0.0, 0.0, 0.0), position_sigma_m=0.1, yaw_sigma_rad=0.1,
    )  # fmt: skip
    for size in (400, 4096):  # the largest pose that a receiver takes
        payload = padded(encode(pose), size)
        assert size - 10 < len(payload) <= size
        assert decode(payload) == pose
    assert padded(encode(pose), 10) == encode(pose)


def test_a_fault_that_cannot_be_played_is_told(tmp_path: Path) -> None:
    class Broken(Fakes):
        async def start(self, drone: str) -> None:
            raise OSError("no such program")

    async def run() -> list[str]:
        one = player(Broken(tmp_path), Late(target="d3", at_s=0.0))
        one.step(0.0, truth(0.0, 10.0, 30.0))
        await asyncio.gather(*one._tasks.values(), return_exceptions=True)
        await asyncio.sleep(0.0)
        return [played.what for played in one.played]

    assert asyncio.run(run()) == ["d3: the agent is started, late", "d3: late is not played: OSError('no such program')"]


def test_the_plan_of_a_flood_reaches_its_process() -> None:
    for fault in (Flood(at_s=1.0), OldEntries(at_s=1.0), DenseEntries(at_s=1.0, what="cone")):
        plan = FloodPlan("radron", "d2", "/run/identity", ("tls/127.0.0.1:7447",), fault)
        assert msgspec.json.decode(msgspec.json.encode(plan), type=FloodPlan) == plan
