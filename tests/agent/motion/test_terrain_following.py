"""The MPC tracker over uneven ground."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely

from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.tracker import Relief, Status, Tracker

LIMITS = LimitsConfig()
WIDE = Fence(shapely.box(-500.0, -500.0, 500.0, 500.0), 1.5, 60.0)
STEP_S, STEP_NS = 0.2, 200_000_000


def eastward(from_m: float, speed_mps: float) -> Reference:
    """3 m above the ground."""
    x = from_m + speed_mps * STEP_S * np.arange(31)
    return Reference(np.column_stack((x, 0.0 * x, 0.0 * x + 3.0)), np.tile((speed_mps, 0.0, 0.0), (31, 1)), STEP_S)


def flown(ground: Relief, speed_mps: float, steps: int) -> tuple[Array, set[Status]]:
    """(steps, 3) of a vehicle that follows perfectly, from x = 0 and 3 m above the ground."""
    tracker, places, statuses = Tracker(LIMITS, WIDE), [], set()
    below, ahead = ground(np.array([[0.0, 0.0], [0.1, 0.0]])).tolist()
    state = PeerState((0.0, 0.0, 3.0 + below), (speed_mps, 0.0, speed_mps * (ahead - below) / 0.1))
    tracker.reset(state.position, state.velocity)
    for step in range(steps):
        plan = tracker.plan(step * STEP_NS, state, eastward(speed_mps * STEP_S * step, speed_mps), (), ground)
        statuses.add(plan.status)
        state = tracker.state((step + 1) * STEP_NS)
        places.append(state.position)
    return np.array(places), statuses


def ramp(rise: float) -> Relief:
    return lambda places: 7.0 + rise * places[:, 0]


def ridge(height_m: float, width_m: float, at_m: float = 30.0) -> Callable[[Array], Array]:
    return lambda places: height_m * np.exp(-0.5 * ((places[:, 0] - at_m) / width_m) ** 2)


@pytest.mark.parametrize("rise", [0.3, -0.3])
def test_on_a_slope_the_height_above_ground_is_kept(rise: float) -> None:
    places, statuses = flown(ramp(rise), 4.0, 60)
    above = places[:, 2] - ramp(rise)(places[:, :2])
    assert places[-1, 0] == pytest.approx(48.0, abs=0.1)
    assert above == pytest.approx(3.0, abs=0.02)
    assert statuses == {Status.FREE}


def test_gentle_hills_are_followed() -> None:
    ground = ridge(6.0, 15.0)
    places, _ = flown(ground, 3.0, 120)
    above = places[:, 2] - ground(places[:, :2])
    assert above == pytest.approx(3.0, abs=0.2)


def test_before_a_ridge_that_is_too_steep_it_climbs_early_enough_to_keep_above_the_floor() -> None:
    """At 6.5 m/s the flank of 0.73 asks for 4.7 m/s where 2 m/s is the limit."""
    ground = ridge(6.0, 5.0)
    places, statuses = flown(ground, 6.5, 60)
    above = places[:, 2] - ground(places[:, :2])
    assert Status.CONSTRAINED in statuses
    assert np.abs(np.diff(places[:, 2])).max() / STEP_S < 1.02 * LIMITS.climb_mps
    assert above.min() > WIDE.floor_m + 0.2  # of the 0.5 m that plans keep from it
    level = places[:, 2]
    assert level[places[:, 0] < 18.0].max() > 4.0  # while the ground there is still flat: 0.3 m
    assert above[-5:] == pytest.approx(3.0, abs=0.3)


def test_the_ceiling_is_above_the_ground_too() -> None:
    low = Fence(shapely.box(-500.0, -500.0, 500.0, 500.0), 1.5, 5.0)
    tracker, state = Tracker(LIMITS, low), PeerState((0.0, 0.0, 3.0))
    for step in range(50):
        goal = Reference(np.tile([0.0, 0.0, 30.0], (31, 1)), np.zeros((31, 3)), STEP_S)
        tracker.plan(step * STEP_NS, state, goal, (), lambda places: np.full(len(places), -4.0))
        state = tracker.state((step + 1) * STEP_NS)
    assert state.position[2] == pytest.approx(0.5, abs=0.1)  # 5 m and the margin of 0.5 m above -4 m


def test_even_ground_is_flown_over_as_without_a_model() -> None:
    level: Relief = lambda places: np.zeros(len(places))  # noqa: E731
    with_model, _ = flown(level, 3.0, 30)
    tracker, state = Tracker(LIMITS, WIDE), PeerState((0.0, 0.0, 3.0), (3.0, 0.0, 0.0))
    tracker.reset(state.position, state.velocity)
    for step in range(30):
        tracker.plan(step * STEP_NS, state, eastward(3.0 * STEP_S * step, 3.0))
        state = tracker.state((step + 1) * STEP_NS)
        assert state.position == pytest.approx(with_model[step], abs=1e-9)
