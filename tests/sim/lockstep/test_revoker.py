"""The operator's revocations, as lockstep's drones hear them."""

from types import SimpleNamespace

from radron.protocol.codec import decode
from radron.sim.faults.schedule import Schedule
from radron.sim.lockstep.members import SimulatedAuthority, SimulatedOperator
from radron.sim.lockstep.revoker import Revoker

SECOND = 1_000_000_000
NAMES = ("d1", "d2")


def test_what_a_disk_has_kept_is_told_at_the_time_by_the_drones_own_clock() -> None:
    heard = []
    pilot = SimpleNamespace(receive=lambda key, payload, now_ns: heard.append((decode(payload), now_ns)))
    operator = SimulatedOperator(SimulatedAuthority(1), "swarm", "mission")
    schedule = Schedule((), NAMES, 1)
    revoker = Revoker(schedule, NAMES, operator, lambda _: None, lambda drone, now_ns: now_ns + (0, 20 * SECOND)[drone])
    revoker.remind(1, pilot, (), 5 * SECOND)
    ((told, now_ns),) = heard
    assert (told.drone, told.stamp_ns, now_ns) == ("d2", 25 * SECOND, 25 * SECOND)
