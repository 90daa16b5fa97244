"""A drone's published clock error, by the time of its exposures."""

from random import Random

import pytest

from radron.agent.frames.clockerrors import ClockErrors
from radron.protocol.entries import Counts, Exposure, PoseSample

SECOND = 1_000_000_000


def exposure(at_s: float, sigma_m: float, speed_mps: float = 3.0) -> Exposure:
    poses = tuple(PoseSample(k * SECOND // 10, (0.1 * k * speed_mps, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0)) for k in range(10))
    begin_ns = round(at_s * SECOND)
    return Exposure(
        stamp_ns=begin_ns, end_ns=begin_ns + SECOND, drone="d1", mission="0" * 16, boot="1" * 16, sequence=round(at_s), epoch=0,
        live_time_s=1.0, counts=Counts(0, 0, 0), poses=poses, position_sigma_m=sigma_m, yaw_sigma_rad=0.01, clock_sigma_m=sigma_m,
    )  # fmt: skip


def at(errors: ClockErrors, *seconds: float) -> list[float]:
    return [errors.at(round(second * SECOND)) for second in seconds]


def test_the_error_is_told_with_the_exposures_at_whose_time_it_was_known():
    errors = ClockErrors()
    for one in (exposure(3.0, 6.0), exposure(2.0, 3.0), exposure(1.0, 0.0)):
        errors.add(one)
    assert at(errors, 0.5, 1.5, 2.5, 3.5, 4.5) == pytest.approx([0.0, 0.0, 1.0, 2.0, 0.0])


def test_of_one_that_hovers_it_is_at_least_what_the_told_error_makes_sure():
    errors = ClockErrors()
    errors.add(exposure(1.0, 0.5, speed_mps=0.0))
    assert at(errors, 1.5) == pytest.approx([1.0])


def test_what_all_exposures_of_a_while_later_tell_counts_for_the_time_before():
    """Until then the drone did not know that its clock had been set; an error published by one exposure says nothing."""
    errors = ClockErrors()
    for second in range(20):
        errors.add(exposure(second, 6.0 if second == 10 or second >= 14 else 0.0))
    assert at(errors, 5.5, 7.5, 9.5, 11.5, 13.5, 14.5) == pytest.approx([0.0, 0.0, 0.0, 2.0, 2.0, 2.0])


def test_an_exposure_changes_nothing_before_its_reach():
    for seed in range(20):
        rng, errors = Random(seed), ClockErrors()
        grid_ns = range(0, 20 * SECOND, SECOND // 10)
        for _ in range(40):
            begin_s, sigma_m = rng.uniform(5.0, 20.0), rng.choice((0.0, 0.0, 3.0, 6.0))
            one, before = exposure(begin_s, sigma_m), [errors.at(ns) for ns in grid_ns]
            errors.add(one)
            changed_ns = [ns for ns, told in zip(grid_ns, before, strict=True) if errors.at(ns) != told]
            assert not changed_ns or one.stamp_ns - errors.reach_ns(one) <= changed_ns[0]


def test_once_a_clock_is_right_again_its_exposures_reach_no_further_back_than_those_of_any_other():
    """Else five keyframes and more were computed again with each of them, to the end of the flight."""
    errors = ClockErrors()
    told = [exposure(second, 3.0 if second < 10 else 0.0) for second in range(20)]
    for one in told:
        errors.add(one)
    assert min(errors.reach_ns(one) for one in told[:12]) > 4 * SECOND
    assert max(errors.reach_ns(one) for one in told[12:]) == 0


def test_an_exposure_beside_others_for_the_sake_of_its_clock_error_alone_tells_nothing():
    errors = ClockErrors()
    for one in (exposure(1.0, 0.0), exposure(1.1, 60.0), exposure(2.0, 0.0), exposure(3.0, 60.0)):
        errors.add(one)
    assert at(errors, 1.05, 1.5, 2.5, 3.5) == pytest.approx([0.0, 0.0, 0.0, 20.0])


def test_what_is_taken_back_or_dropped_tells_nothing():
    errors = ClockErrors()
    told = [exposure(second, 3.0) for second in (0.9, 2.0, 3.1)]
    for one in told:
        errors.add(one)
    errors.remove(told[1])
    errors.remove(exposure(5.0, 3.0))
    errors.drop_before(2 * SECOND)
    assert at(errors, 1.5, 2.5, 3.5) == pytest.approx([0.0, 0.0, 1.0])
    errors.drop_before(5 * SECOND)
    assert at(errors, 3.5) == [0.0]
