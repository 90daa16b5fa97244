"""An agent that is restarted in flight while its autopilot holds: the origin of the hold."""

from radron.agent.shell.statestore import State, decode_state, encode_state
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.messages import Stage
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, command, fly, pilot, state

BACK_NS = START_NS + 30 * SECOND  # when the agent is there again
NEW_BOOT = "f" * 16


def restarted(one):
    """The successor of an agent that is ended now."""
    return pilot(memory=decode_state(encode_state(State(memory=one.memory))).memory, boot=NEW_BOOT)


def back(one, **vehicle):
    """The same after its first telemetry, and its first step."""
    again = restarted(one)
    again.observe_vehicle(state(BACK_NS, FlightMode.HOLD, **vehicle))
    return again, again.step(BACK_NS)


def test_a_hold_that_was_its_own_is_nobody_elses():
    """Its position could not be trusted after a jump, so it held; its agent was restarted meanwhile."""
    one, lost = pilot(), {"position_trusted": False}
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    fly(one, START_NS, 1.0, FlightMode.OFFBOARD)
    fly(one, START_NS + SECOND, 2.0, FlightMode.HOLD, **lost)
    assert one.memory.stays
    again, step = back(one)
    assert (again.stage, step.command.request) == (Stage.SURVEY, Request.OFFBOARD)
    assert set(fly(again, BACK_NS, 4.0, FlightMode.HOLD)) == {Request.OFFBOARD}  # however long that takes
    still, step = back(one, **lost)
    assert (still.stage, step.command.request) == (Stage.SURVEY, Request.HOLD)
    assert set(fly(still, BACK_NS, 4.0, FlightMode.HOLD, **lost)) == {Request.HOLD}
    assert fly(still, BACK_NS + 4 * SECOND, 1.0, FlightMode.OFFBOARD)[-1] is Request.OFFBOARD
    assert not still.memory.stays
    fly(still, BACK_NS + 5 * SECOND, 2.0, FlightMode.OFFBOARD)
    assert fly(still, BACK_NS + 7 * SECOND, 2.0, FlightMode.HOLD)[-1] is Request.RELEASE  # from then on it is again


def survives(one, now_ns):
    """The agent's successor, while its autopilot holds; None if it takes that for a pilot's hold."""
    again = restarted(one)
    return again if set(fly(again, now_ns, 1.0, FlightMode.HOLD)) == {Request.OFFBOARD} else None


def test_a_hold_for_want_of_telemetry_is_its_own_after_restarts_too():
    one, now_ns = pilot(), START_NS + 4 * SECOND
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    fly(one, START_NS, 4.0, FlightMode.OFFBOARD)
    assert survives(one, now_ns) is None  # until then a pilot's hold
    for _ in range(40):
        now_ns += TICK_NS
        request = one.step(now_ns).command.request  # no telemetry comes
    assert request is Request.HOLD
    for _ in range(3):
        one = survives(one, now_ns)
        now_ns += SECOND
        assert one is not None
    fly(one, now_ns, 3.0, FlightMode.OFFBOARD)
    assert survives(one, now_ns + 3 * SECOND) is None


def test_a_hold_that_it_has_not_left_yet_is_its_own_after_a_restart():
    """The autopilot holds after its takeoff, and after a loss of its position, until it has accepted offboard."""
    one, lost = pilot(), {"position_trusted": False}
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    fly(one, START_NS, 0.5, FlightMode.HOLD)
    assert one.stage is Stage.SURVEY
    assert survives(one, START_NS + SECOND // 2) is not None
    fly(one, START_NS + SECOND // 2, 3.5, FlightMode.OFFBOARD)
    assert survives(one, START_NS + 4 * SECOND) is None
    fly(one, START_NS + 4 * SECOND, 2.0, FlightMode.HOLD, **lost)
    fly(one, START_NS + 6 * SECOND, 0.5, FlightMode.HOLD)
    assert not one.memory.stays
    assert survives(one, START_NS + 6 * SECOND + SECOND // 2) is not None
