"""The centre of the circle, with a hypothesis that is old, moves, or is wrong."""

from __future__ import annotations

import pytest

from radron.agent.config.mission import AreaConfig
from radron.agent.motion.leading import Leading

SECOND = 1_000_000_000
AREA = AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)), fence_margin_m=30.0)


def leading(most_mps: float = 3.8) -> Leading:
    return Leading(AREA, most_mps, room_m=15.0)


def test_a_source_that_moves_is_led_by_the_age_of_the_hypothesis() -> None:
    place, velocity = leading().centre(10 * SECOND, 10 * SECOND - SECOND // 2, (50.0, 50.0), (3.0, -1.0))
    assert place == pytest.approx((51.5, 49.5))
    assert velocity == pytest.approx((3.0, -1.0))


def test_an_old_hypothesis_is_not_carried_on_for_ever() -> None:
    place, _ = leading().centre(60 * SECOND, 10 * SECOND, (50.0, 50.0), (2.0, 0.0))
    assert place == pytest.approx((52.0, 50.0))


def test_no_source_is_faster_than_can_be_followed() -> None:
    _, velocity = leading().centre(SECOND, SECOND, (50.0, 50.0), (30.0, 40.0))
    assert velocity == pytest.approx((0.6 * 3.8, 0.8 * 3.8))


def test_a_velocity_that_jumps_for_a_moment_hardly_moves_the_circle_and_one_that_lasts_does() -> None:
    one = leading()
    one.centre(0, 0, (50.0, 50.0), (0.0, 0.0))
    _, jump = one.centre(SECOND // 20, 0, (50.0, 50.0), (3.0, 0.0))
    assert jump[0] < 0.3
    for tick in range(2, 60):
        _, velocity = one.centre(tick * SECOND // 20, tick * SECOND // 20, (50.0, 50.0), (3.0, 0.0))
    assert velocity[0] == pytest.approx(3.0, abs=0.1)


def test_a_hypothesis_that_jumps_takes_the_circle_along_in_time() -> None:
    """Neighbours that all turn at once at full speed come too near to each other."""
    one = leading()
    one.centre(0, 0, (50.0, 50.0), (0.0, 0.0))
    ways = []
    for tick in range(1, 101):
        (x, _), _ = one.centre(tick * SECOND // 20, tick * SECOND // 20, (62.0, 50.0), (0.0, 0.0))
        ways.append(x)
    assert ways[19] <= 50.0 + 4.0 + 1e-9
    assert ways[-1] == pytest.approx(62.0, abs=0.1)


def test_a_steady_source_is_not_followed_late() -> None:
    """Told every half a second: the centre is where the source is all the time."""
    one = leading()
    for tick in range(200):
        now_ns = tick * SECOND // 20
        known_ns = now_ns - now_ns % (SECOND // 2)
        (x, _), _ = one.centre(now_ns, known_ns, (10.0 + 2.0 * known_ns / SECOND, 50.0), (2.0, 0.0))
        assert x == pytest.approx(10.0 + 2.0 * now_ns / SECOND, abs=1e-6)


def test_after_a_pause_nothing_is_left_of_the_old_velocity() -> None:
    one = leading()
    one.centre(0, 0, (50.0, 50.0), (3.0, 0.0))
    _, velocity = one.centre(60 * SECOND, 60 * SECOND, (50.0, 50.0), (0.0, 1.0))
    assert velocity == pytest.approx((0.0, 1.0))


def test_the_circle_stays_inside_the_fence_whatever_the_hypothesis() -> None:
    place, velocity = leading().centre(SECOND, SECOND, (130.0, 50.0), (2.0, 0.0))
    assert place == pytest.approx((115.0, 50.0), abs=0.1)  # 12 m of radius and 3 m of room from the fence at 130 m
    assert velocity == (0.0, 0.0)
