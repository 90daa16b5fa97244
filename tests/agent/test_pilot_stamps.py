"""Entries with stamps far away: they are in the log, because their bytes are valid, and break nothing."""

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import encode
from radron.protocol.entries import Counts, Coverage, Exposure, Fix, PoseSample, Sighting
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, command, cone_of, pilot, state

ESTIMATED = replace(
    MISSION,
    drones=tuple(replace(one, localization="rtk", origin_sigma_m=0.5, yaw_sigma_deg=5.0) for one in MISSION.drones),
)
YEAR_NS = 365 * 86_400 * SECOND
STAMPS = [0, 1, SECOND, START_NS - YEAR_NS, START_NS - 61 * SECOND, START_NS + YEAR_NS, 2**63 - 2 * SECOND]


def entries(mission, stamp_ns, sequence):
    common = {"stamp_ns": stamp_ns, "drone": "d2", "mission": mission.mission_id, "boot": "2" * 16, "epoch": 0}
    pose = PoseSample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    here = (1.0, 2.0, 3.0)
    yield replace(cone_of("d2", sequence, stamp_ns), mission=mission.mission_id)
    yield Exposure(
        **common, sequence=sequence + 1, end_ns=stamp_ns + SECOND, live_time_s=1.0, counts=Counts(5, 1, 0), poses=(pose,),
        position_sigma_m=0.1, yaw_sigma_rad=0.01,
    )  # fmt: skip
    yield Sighting(**common, sequence=sequence + 2, target="d1", position_m=here, range_m=5.0, range_sigma_m=0.1)
    yield Fix(
        **common, sequence=sequence + 3, position_m=here, latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0,
        horizontal_sigma_m=1.0, vertical_sigma_m=1.0,
    )  # fmt: skip
    yield Coverage(**common, sequence=sequence + 4, path_m=((0.0, 0.0), (5.0, 0.0)), swath_m=mission.survey.lane_spacing_m)


@pytest.mark.parametrize("mission", [MISSION, ESTIMATED], ids=["exact", "estimated"])
@pytest.mark.parametrize("first_s", [0.0, 3.0], ids=["before the start", "in flight"])
def test_stamps_far_away_break_nothing(mission, first_s):
    one = pilot(mission=mission)
    for tick in range(120):
        now_ns = START_NS + tick * TICK_NS
        if tick == round(first_s * 20):
            for number, stamp_ns in enumerate(STAMPS):
                for entry in entries(mission, stamp_ns, 10 * number):
                    one.receive(key_of(mission.swarm, entry), encode(entry), now_ns)
        mode = FlightMode.HOLD if tick < 25 else FlightMode.OFFBOARD
        one.observe_vehicle(state(now_ns, mode, armed=tick >= 20, in_air=tick >= 20))
        if tick == 20:
            one.receive(*command(mission=mission, stamp_ns=now_ns), now_ns)
        one.step(now_ns)
    assert one.stage is Stage.SURVEY
    assert len(one.fusion.log) >= 5 * len(STAMPS)
    assert one.counters["rejected_malformed"] == 0
