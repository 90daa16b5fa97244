from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.fusion.sequences import SequenceSet

numbers = st.lists(st.integers(0, 40), max_size=40)


def set_of(several):
    held = SequenceSet()
    for number in several:
        held.add(number)
    return held


def spread(held):
    return {number for first, last in held for number in range(first, last + 1)}


@given(numbers)
def test_it_is_a_set(several):
    held = set_of(several)
    assert spread(held) == set(several)
    assert all((number in held) == (number in several) for number in range(42))


@given(numbers)
def test_ranges_are_ascending_and_do_not_touch(several):
    ranges = list(set_of(several))
    assert all(first <= last for first, last in ranges)
    assert all(right[0] > left[1] + 1 for left, right in pairwise(ranges))


@given(numbers)
def test_made_again_from_its_ranges(several):
    held = set_of(several)
    assert list(SequenceSet(reversed(list(held)))) == list(held)


@given(numbers, numbers)
def test_without(left, right):
    ranges = list(set_of(left).without(set_of(right)))
    assert spread(ranges) == set(left) - set(right)
    assert all(before[1] < after[0] for before, after in pairwise(ranges))


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 6))), st.integers(0, 40), st.integers(0, 6))
def test_ranges_are_added_whole_and_looked_up(several, first, length):
    held = SequenceSet()
    for start, more in several:
        held.add_range(start, start + more)
    numbers = {number for start, more in several for number in range(start, start + more + 1)}
    assert spread(held) == numbers
    assert all(right[0] > left[1] + 1 for left, right in pairwise(held))
    assert list(held.within(first, first + length)) == sorted(numbers & set(range(first, first + length + 1)))


@pytest.mark.parametrize("ranges", [[(1, 3), (2, 8)], [(1, 3), (4, 8)], [(1, 8), (2, 3)]])
def test_overlapping_ranges_merge(ranges):
    assert list(SequenceSet(ranges)) == [(1, 8)]


@given(st.sets(st.integers(0, 20)), st.lists(st.integers(0, 20)))
def test_discarded_numbers_are_not_held(numbers, discarded):
    held = SequenceSet()
    for number in numbers:
        held.add(number)
    for number in discarded:
        held.discard(number)
    left = SequenceSet((number, number) for number in numbers - set(discarded))
    assert list(held) == list(left)
