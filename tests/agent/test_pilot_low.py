"""A drone that is commanded to fly on from below the floor, after a descent by its pilot, or while landing."""

from math import hypot

import pytest

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Action, Stage
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, command, fly, state, tracking


@pytest.mark.parametrize(("before", "action"), [(Action.LAND, Action.RETURN), (None, Action.RESUME)])
def test_it_flies_sideways_only_above_the_floor(before, action):
    """The drone flew 3 m/s at 0.8 m above ground, on its way home or around the source."""
    one, now_ns, place = tracking(), START_NS + 5 * SECOND, (0.0, 0.0, 3.0)
    velocity = (0.0, 0.0, 0.0)

    def flown(seconds):
        """Follows the setpoints; height and horizontal speed at each step, and the stage."""
        nonlocal now_ns, place, velocity
        for _ in range(round(seconds * SECOND / TICK_NS)):
            now_ns += TICK_NS
            one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, place, velocity_mps=velocity))
            setpoint = one.step(now_ns).command.setpoint
            if setpoint is not None:
                place, velocity = setpoint.position_m, setpoint.velocity_mps
            yield place[2], hypot(*velocity[:2]), one.stage

    list(flown(6.0))
    if before is not None:
        one.receive(*command(before, stamp_ns=now_ns), now_ns)
        list(flown(3.0))
    place, velocity = (*place[:2], 0.6), (0.0, 0.0, 0.0)
    mode = FlightMode.MANUAL if before is None else FlightMode.LAND
    fly(one, now_ns, 5.0, mode, position=place)
    now_ns += 5 * SECOND
    assert one.stage is (Stage.HOLD if before is None else Stage.LANDING)
    one.receive(*command(action, stamp_ns=now_ns), now_ns)
    flight = list(flown(4.0))
    assert max(speed for height, speed, _ in flight if height < MISSION.area.floor_m) < 0.1  # commanded to rise on the spot
    assert max(speed for _, speed, _ in flight) > 1.0
    assert flight[-1][2] in ((Stage.RETURN,) if action is Action.RETURN else (Stage.TRACK, Stage.REACQUIRE))
