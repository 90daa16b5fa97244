"""Flights in which the clock of one drone is set while it circles."""

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import Request
from radron.sim.faults.kinds import read_faults
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario
from radron.sim.scoring.moment import EPOCH_NS, Moment

SET_S, END_S = 40.0, 44.0


@pytest.mark.slow
@pytest.mark.parametrize("jump_s", [-5.0, 0.5, 5.0])
def test_a_clock_step_on_the_circle_interrupts_neither_the_flight_nor_the_link(jump_s: float) -> None:
    """After -5 s the drone had asked for a hold, and its peers had refused its poses for up to a second. After 0.5 s, taken for a
    pause, it had counted its peers as that much older.
    """
    flown, age_s, losses = set[Request](), 0.0, list[tuple[str, ...]]()

    def watch(moment: Moment) -> bool:
        nonlocal age_s
        if moment.time_s < SET_S - 1.0:
            return False
        flown.update(command.request for command in moment.commands if command is not None)
        now_ns = EPOCH_NS + round(moment.time_s * 1e9)
        for name, other in (("d2", 0), ("d1", 1)):  # d1 of d2, and back
            pilot = moment.pilots[other]
            assert pilot is not None
            pose = pilot._peers[name].pose
            assert pose is not None
            age_s = max(age_s, 1e-9 * (now_ns - pose.stamp_ns))
            absence = pilot._executive._navigator.absence
            losses.append(absence.missing if absence is not None else ())
        return moment.time_s > END_S

    clock = {"kind": "clock", "at_s": SET_S, "jump_s": jump_s, "target": "d2"}
    watched(replace(load_scenario("demo"), fault=read_faults([clock], "test")), 3, watch)
    assert flown == {Request.OFFBOARD}
    assert age_s < 0.4  # a pose each 0.1 s, and one exchange of statuses
    assert set(losses) == {()}
