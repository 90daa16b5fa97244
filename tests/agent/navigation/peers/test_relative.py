"""A drone's position from the sightings of another drone."""

import numpy as np
import pytest

from radron.agent.navigation.peers.relative import WINDOW_NS, offset, placed_alone, places
from radron.protocol.entries import Sighting

SECOND = 1_000_000_000
OWN = np.array([1.0, 2.0, 3.0])


def sight(stamp_s, place, epoch=0, own=OWN, sensor="both"):
    """An observer's sighting of a drone at a place, from ``own``; in the observer's local frame."""
    way = np.array(place) - own
    distance = float(np.linalg.norm(way))
    return Sighting(
        stamp_ns=round(stamp_s * SECOND), drone="a", mission="0" * 16, boot="1" * 16, sequence=1, epoch=epoch, target="b",
        position_m=tuple(own.tolist()),
        direction=None if sensor == "range" else tuple((way / distance).tolist()),
        direction_sigma_rad=None if sensor == "range" else 0.035,
        range_m=None if sensor == "direction" else distance,
        range_sigma_m=None if sensor == "direction" else 0.3,
    )  # fmt: skip


def flight(stamp_s):
    """Along x at 4 m/s."""
    return np.array([10.0 + 4.0 * stamp_s, 5.0, 3.0])


def expected(stamp_ns):
    return flight(stamp_ns / SECOND)


def noisy(seed=1, shift=(0.0, 0.0, 0.0), rate_hz=5.0, false=0.1, sensor="both"):
    rng, found = np.random.default_rng(seed), []
    for stamp_s in np.arange(0.0, 3.0, 1.0 / rate_hz):
        place = flight(stamp_s) + shift + rng.normal(0.0, (0.35, 0.35, 0.35))
        if rng.random() < false:
            place = rng.uniform(-30.0, 30.0, 3)
        found.append(sight(stamp_s, place, sensor=sensor))
    return found


def nowhere(_):
    return None


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (12.0, -16.0, 0.0)])
def test_how_far_it_is_from_where_it_should_be_false_sights_or_not(seed, shift):
    found = offset(places(noisy(seed, shift), 0, 3 * SECOND, expected), expected)
    apart_m = np.hypot(*(np.array(found.vector) - shift)[:2])
    assert apart_m < 0.5  # 15 sights of 0.35 m on each axis: 0.13 m on the average
    assert 0.2 <= found.sigma_m < 0.5


def test_ranges_alone_tell_how_far_away_it_is():
    found = offset(places(noisy(shift=(5.0, 0.0, 0.0), false=0.0, sensor="range"), 0, 3 * SECOND, expected), expected)
    assert found.vector[0] == pytest.approx(5.0, abs=0.5)  # seen along x
    assert places(noisy(sensor="range"), 0, 3 * SECOND, nowhere) == []
    assert places(noisy(sensor="direction"), 0, 3 * SECOND, expected) == []


def test_too_few_or_sights_that_contradict_each_other_tell_nothing():
    assert offset(places(noisy(rate_hz=1.0), 0, 3 * SECOND, expected), expected) is None
    assert offset(places(noisy(false=0.95), 0, 3 * SECOND, expected), expected) is None


def test_what_was_seen_long_ago_or_in_another_frame_does_not_count():
    sights = noisy()
    assert places(sights, 1, 3 * SECOND, expected) == []
    assert places(sights, 0, 3 * SECOND + 2 * WINDOW_NS, expected) == []


@pytest.mark.parametrize("seed", range(20))
def test_alone_they_give_place_and_velocity(seed):
    now_ns = 3 * SECOND
    state, sigma_m = placed_alone(places(noisy(seed), 0, now_ns, nowhere), now_ns, speed_mps=4.0)
    there = np.array(state.position) + state.age_s * np.array(state.velocity)
    assert np.hypot(*(there - flight(3.0))[:2]) < 3.0 * sigma_m
    assert sigma_m < 1.2
    assert state.velocity[:2] == pytest.approx((4.0, 0.0), abs=1.0)


def test_a_false_sight_alone_is_not_believed():
    sights = [sight(0.1 * k, flight(0.1 * k)) for k in range(4)] + [sight(0.5, (-20.0, 20.0, 3.0))]
    state, _ = placed_alone(places(sights, 0, SECOND // 2, nowhere), SECOND // 2, speed_mps=4.0)
    assert state.position == pytest.approx(flight(0.3).tolist())
    assert placed_alone(places(sights[-1:], 0, SECOND, nowhere), SECOND, speed_mps=4.0) is None


def test_what_hovers_has_no_velocity():
    state, sigma_m = placed_alone(
        places([sight(0.2 * k, flight(0.0)) for k in range(12)], 0, 3 * SECOND, nowhere), 3 * SECOND, 0.1
    )
    assert state.velocity == (0.0, 0.0, 0.0)
    assert sigma_m < 0.7


@pytest.mark.parametrize("speed_mps", [0.2, 2.0])
@pytest.mark.parametrize("seed", range(20))
def test_one_that_has_become_faster_since_its_last_pose_is_where_it_is_seen(seed, speed_mps):
    """With the speed of its last pose alone only sightings from before it flew faster agreed."""
    now_ns, rng = 3 * SECOND, np.random.default_rng(seed)

    def way(stamp_s):
        """At rest at first; then it accelerates to 6 m/s within 1.5 s."""
        late_s = max(0.0, stamp_s - 0.75)
        return 2.0 * min(late_s, 1.5) ** 2 + 6.0 * max(0.0, late_s - 1.5)

    sights = []
    for stamp_s in np.arange(0.0, 3.0, 0.2):
        place = np.array([10.0 + way(stamp_s), 5.0, 3.0]) + rng.normal(0.0, (0.35, 0.35, 0.35))
        sights.append(sight(stamp_s, rng.uniform(-30.0, 30.0, 3) if rng.random() < 0.1 else place))
    state, sigma_m = placed_alone(places(sights, 0, now_ns, nowhere), now_ns, speed_mps, former=True)
    there = np.array(state.position) + state.age_s * np.array(state.velocity)
    assert np.hypot(*(there - (10.0 + way(3.0), 5.0, 3.0))[:2]) < 2.5
    assert sigma_m < 1.2


@pytest.mark.parametrize("seed", range(20))
def test_one_that_hovers_seems_to_fly_hardly_where_only_a_former_speed_of_it_is_known(seed):
    rng, now_ns = np.random.default_rng(seed), 3 * SECOND
    sights = [sight(0.2 * k, flight(0.0) + rng.normal(0.0, (0.35, 0.35, 0.35))) for k in range(15)]
    state, _ = placed_alone(places(sights, 0, now_ns, nowhere), now_ns, 6.0, former=True)
    assert np.hypot(*state.velocity[:2]) < 0.8
    assert np.hypot(*(np.array(state.position) - flight(0.0))[:2]) < 1.5
