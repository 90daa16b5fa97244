"""A vehicle that has landed stays where it is: a position that moves there is rejected, and not used for measurements."""

import pytest

from radron.agent.frames.graph import FrameGraph
from radron.agent.localization.resting import MOVED_M
from support.flights.one_pilot import MISSION, START_NS, TICK_NS, own_pose, state

SIGMA_M = 0.1  # of this telemetry
DOWN = {"armed": False, "in_air": False}
LONG_S = 12.0


class Flight:
    """A drone's own pose in the air, with positions sliding east at some speed."""

    def __init__(self) -> None:
        self.own = own_pose("d1", FrameGraph.from_launch_layout(MISSION))
        self.now_ns, self.x_m = START_NS, 0.0
        self.after(1.0)

    def after(self, seconds: float, mps: float = 0.0, **values: object) -> bool:
        """Whether its position is trusted after so long."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.now_ns += TICK_NS
            self.x_m += mps * TICK_NS * 1e-9
            taken = self.own.take(state(self.now_ns, position=(self.x_m, 0.0, 0.0), **values))
        return taken.position_trusted

    @property
    def problems(self) -> str:
        return " ".join(self.own.problems(self.now_ns))


@pytest.fixture
def flown() -> Flight:
    return Flight()


def test_a_position_that_slides_on_the_ground_is_not_trusted_and_told(flown):
    assert flown.after(LONG_S, 1.0)  # in the air that is a motion
    assert not flown.after(LONG_S, 1.0, **DOWN)
    assert flown.own.sigma_m == pytest.approx(LONG_S, abs=0.1)
    assert "has moved by 12 m since it landed" in flown.problems


def test_what_it_slides_before_the_landing_is_confirmed_counts(flown):
    assert flown.after(1.0, 3.0, **DOWN)  # 3.0 m, but it may be in the air yet
    assert not flown.after(2.0, 0.5, **DOWN)


def test_a_position_that_wanders_by_its_error_is_trusted(flown):
    assert flown.after(LONG_S, (MOVED_M + 2.0 * SIGMA_M) / LONG_S, **DOWN)
    assert flown.problems == ""
    doubtful = Flight()
    assert doubtful.after(LONG_S, 1.0, position_sigma_m=4.0, **DOWN)


def test_once_it_flies_again_it_is_trusted(flown):
    assert not flown.after(LONG_S, 1.0, **DOWN)
    assert flown.after(0.1)
    assert flown.problems == ""
    assert flown.after(3.0, **DOWN)  # it stays at its landing place


def test_before_its_first_flight_a_vehicle_may_be_carried():
    own = own_pose("d1", FrameGraph.from_launch_layout(MISSION))
    for step in range(2):
        taken = own.take(state(START_NS + step * TICK_NS, position=(30.0 * step, 0.0, 0.0), **DOWN))
    assert taken.position_trusted


def test_after_a_jump_of_the_localisation_the_new_frame_counts(flown):
    assert flown.after(3.0, **DOWN)
    flown.x_m += 30.0
    assert flown.after(3.0, epoch=1, **DOWN)
    assert not flown.after(LONG_S, 1.0, epoch=1, **DOWN)
    flown.x_m = 0.0
    assert not flown.after(3.0, epoch=2, **DOWN)  # the start of the slide is not known in this epoch
