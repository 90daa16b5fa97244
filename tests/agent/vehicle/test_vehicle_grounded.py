"""One faulty or forged packet ends no flight: a landing is confirmed by more reports and by the vehicle's motion."""

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.grounded import CONFIRM_NS, MOVING_MPS, STILL_NS, Grounded
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, started, state

DOWN = {"armed": False, "in_air": False}
FAST = (2.0 * MOVING_MPS, 0.0, 0.0)


class Flight:
    """A vehicle in the air, and its estimated landed state."""

    def __init__(self) -> None:
        self.grounded = Grounded()
        self.now_ns = START_NS
        assert self.after(0.5) == (True, True)

    def after(self, seconds: float, **values: object) -> tuple[bool, bool]:
        """Armed and in the air, after so long with the same telemetry."""
        taken = None
        for _ in range(round(seconds * SECOND / TICK_NS)):
            self.now_ns += TICK_NS
            taken = self.grounded.take(state(self.now_ns, **values))
        assert taken is not None
        return taken.armed, taken.in_air

    @property
    def problem(self) -> str:
        return str(self.grounded.problem(self.now_ns))


@pytest.fixture
def flying() -> Flight:
    return Flight()


def test_low_and_still_it_is_down_after_two_more_heartbeats(flying: Flight) -> None:
    low = {"position": (0.0, 0.0, 0.2)}
    assert flying.after(0.9 * CONFIRM_NS / SECOND, **low, **DOWN) == (True, True)
    assert flying.after(0.3, **low, **DOWN) == (False, False)
    assert flying.problem == "None"


def test_high_and_still_it_takes_longer_as_the_height_may_be_wrong(flying: Flight) -> None:
    assert flying.after(0.9 * STILL_NS / SECOND, **DOWN) == (True, True)
    assert "not believed" in flying.problem
    assert flying.after(1.0, **DOWN) == (False, False)


def test_one_that_moves_is_never_down_unless_its_position_is_not_trusted(flying: Flight) -> None:
    assert flying.after(30.0, velocity_mps=FAST, **DOWN) == (True, True)
    assert "flies by its position" in flying.problem
    assert flying.after(1.1 * CONFIRM_NS / SECOND, velocity_mps=FAST, position_trusted=False, **DOWN) == (False, False)


def test_on_the_ground_from_the_beginning_nothing_is_held_back() -> None:
    told = state(START_NS, **DOWN)
    grounded = Grounded()
    assert grounded.take(told) is told
    armed = replace(told, stamp_ns=START_NS + TICK_NS, armed=True)
    assert grounded.take(armed) is armed


@pytest.mark.parametrize("ticks", [2, 30])
def test_the_mission_of_a_flying_drone_goes_on(ticks: int) -> None:
    one = started()
    for tick in range(1, 80):
        now_ns = START_NS + tick * TICK_NS
        forged = DOWN if 10 <= tick < 10 + ticks else {}
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, velocity_mps=FAST, **forged))
        one.step(now_ns)
        assert one.stage is Stage.SURVEY


def test_vehicle_that_is_taken_to_fly_is_as_healthy_as_it_was(flying: Flight) -> None:
    """Just disarmed, PX4 is not ready to arm in the mode of its landing: that is no failsafe in flight."""
    down = flying.grounded.take(state(flying.now_ns + TICK_NS, **DOWN, healthy=False))
    assert (down.armed, down.in_air, down.healthy) == (True, True, True)
    failing = Grounded()
    failing.take(state(START_NS, healthy=False))
    assert not failing.take(state(START_NS + TICK_NS, **DOWN, healthy=True)).healthy
    flying.after(STILL_NS / SECOND + 0.1, **DOWN, healthy=False)
    assert not flying.grounded.take(state(flying.now_ns + TICK_NS, **DOWN, healthy=False)).healthy
