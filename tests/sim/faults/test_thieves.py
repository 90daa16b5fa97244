"""Thieves of a key publish the drone's messages at their own pace, changed as the fault says, and signed as the drone does."""

import msgspec
import pytest

from radron.protocol.codec import decode_from, encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Pose, Stage, Status
from radron.protocol.signing import Verifier
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.thieves import OTHER_BOOT, Thieves
from radron.sim.lockstep.members import SimulatedAuthority
from support.flights.drone_messages import at

DRONES = ("d1", "d2", "d3")
AUTHORITY = SimulatedAuthority(1)
NOW_NS = 5_000_000_000
STATUS = Status(stamp_ns=3_000_000_000, drone="d1", mission="a" * 16, boot="b" * 16, stage=Stage.HOLD)


def published(kind, now_ns=NOW_NS, second=1.0, **fault):
    """Messages of the drone, and of a thief with its key at that time."""
    entry = {"kind": "copied-key", "at_s": 0.0, "for_s": 5.0, "target": "d1"} | fault
    schedule = Schedule([msgspec.convert(entry, KINDS["copied-key"])], DRONES, 1)
    schedule.advance(second)
    thieves, message = Thieves(schedule, [AUTHORITY.trust(name) for name in DRONES]), STATUS if kind == "status" else at(kind, 3)
    thieves.overhear(0, key_of("s", message), encode(message))
    return message, [decode_from(key, payload) for _, key, payload in thieves.publish(now_ns)]


def test_a_thief_publishes_the_drone_beside_itself_ahead_of_the_time() -> None:
    true, (copy,) = published("pose", lead_s=0.09, epochs=1)
    assert (copy.drone, copy.stamp_ns, copy.epoch) == (true.drone, NOW_NS + 90_000_000, true.epoch + 1)
    assert copy.position_m == pytest.approx((true.position_m[0] + 15.0, *true.position_m[1:]))
    assert copy.velocity_mps == true.velocity_mps


def test_a_thief_can_have_the_drone_rest_on_the_ground() -> None:
    _, (copy,) = published("pose", place="ground", beside_m=0.0)
    assert (copy.position_m[2], copy.velocity_mps, copy.in_air) == (0.0, (0.0, 0.0, 0.0), False)
    _, (copy,) = published("plan", place="ground")
    assert len(copy.positions_m) == 1


@pytest.mark.parametrize(("boot", "stage"), [("same", "landed"), ("other", "return"), ("same", None)])
def test_its_statuses_are_signed_by_the_key_of_the_drone(boot, stage) -> None:
    true, (copy,) = published("status", boot=boot, stage=stage)
    assert copy.boot == (true.boot if boot == "same" else OTHER_BOOT)
    assert copy.stage == (true.stage if stage is None else Stage(stage))
    assert Verifier(AUTHORITY).accepts_status(copy)


def test_a_thief_publishes_no_measurements_and_nothing_when_it_is_over() -> None:
    assert published("cone")[1] == []
    assert published("pose", second=6.0)[1] == []


def test_a_thief_keeps_its_pace_and_a_place_that_is_frozen() -> None:
    entry = {"kind": "copied-key", "at_s": 0.0, "target": "d1", "place": "frozen", "period_s": 0.2}
    schedule = Schedule([msgspec.convert(entry, KINDS["copied-key"])], DRONES, 1)
    schedule.advance(1.0)
    thieves, told = Thieves(schedule, [AUTHORITY.trust(name) for name in DRONES]), []
    for tick in range(20):
        pose = at("pose", tick // 2)
        thieves.overhear(0, key_of("s", pose), encode(pose))
        told += [decode_from(key, payload) for _, key, payload in thieves.publish(NOW_NS + 50_000_000 * tick)]
    assert len(told) == 5
    assert all(isinstance(one, Pose) for one in told)
    assert len({one.position_m for one in told}) == 1


def test_a_drone_that_says_nothing_has_no_thief() -> None:
    schedule = Schedule([msgspec.convert({"kind": "copied-key", "at_s": 0.0}, KINDS["copied-key"])], DRONES, 1)
    schedule.advance(1.0)
    assert list(Thieves(schedule, [AUTHORITY.trust(name) for name in DRONES]).publish(NOW_NS)) == []
