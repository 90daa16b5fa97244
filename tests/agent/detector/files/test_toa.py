"""Hits beside the border of two periods of the chip's counter."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.detector.files.toa import MAX_APART, PERIOD, BorderRepair, joined_at_borders


def test_hits_away_from_a_border_stay() -> None:
    toa = np.array([100, 8_000, 20_000, 3 * PERIOD + 500])
    np.testing.assert_array_equal(joined_at_borders(toa), toa)


def test_an_event_on_the_border_stays_whole() -> None:
    toa = np.array([2 * PERIOD - 3, 2 * PERIOD - 1, 2 * PERIOD, 2 * PERIOD + 4])
    np.testing.assert_array_equal(joined_at_borders(toa), toa)


def test_an_event_just_behind_a_border_stays_where_no_other_fits() -> None:
    toa = np.array([2 * PERIOD + 1, 2 * PERIOD + 4, 3 * PERIOD + 8000])
    np.testing.assert_array_equal(joined_at_borders(toa), toa)


def test_a_hit_before_the_border_put_a_period_too_late_is_moved_back() -> None:
    event = np.array([3 * PERIOD - 4, 2 * PERIOD - 2, 2 * PERIOD + 3])
    np.testing.assert_array_equal(joined_at_borders(event), [2 * PERIOD - 4, 2 * PERIOD - 2, 2 * PERIOD + 3])


def test_events_beside_two_successive_borders_stay_apart() -> None:
    """The first one lies across its border; the second one before the next border, one period later but for 150 ns."""
    toa = np.array([2 * PERIOD - 2, 2 * PERIOD + 3, 3 * PERIOD - 4, 3 * PERIOD - 3])
    np.testing.assert_array_equal(joined_at_borders(toa), toa)


@given(
    border=st.integers(1, 1 << 30),
    before=st.lists(st.integers(1, MAX_APART // 2), min_size=1, max_size=4),
    after=st.lists(st.integers(0, MAX_APART // 2), min_size=1, max_size=4),
    early=st.booleans(),
)
def test_an_event_whose_part_is_misplaced_is_one_event_again(
    border: int, before: list[int], after: list[int], early: bool
) -> None:
    """Either all hits behind the border are a period early, or all before it are a period late."""
    first, second = border * PERIOD - np.array(before), border * PERIOD + np.array(after)
    toa = np.concatenate((first, second - PERIOD) if early else (first + PERIOD, second))
    joined = joined_at_borders(toa)
    assert np.ptp(joined) <= MAX_APART
    assert set(((joined - toa) // PERIOD).tolist()) <= {-1, 0, 1}


def test_the_hits_of_the_call_before_are_compared_with() -> None:
    repair = BorderRepair()
    np.testing.assert_array_equal(repair.joined(np.array([PERIOD - 4])), [PERIOD - 4])
    np.testing.assert_array_equal(repair.joined(np.array([3])), [PERIOD + 3])
    assert repair.repaired == 1
    assert len(repair.joined(np.empty(0, np.int64))) == 0
