"""A token bucket: what may be done at once, and over time."""

import pytest

from radron.protocol.bucket import Bucket


def test_what_it_holds_is_taken_at_once_and_then_as_much_as_it_gains() -> None:
    bucket = Bucket(rate=2.0, burst=5.0, now_s=100.0)
    assert [bucket.take(100.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert [bucket.take(101.0) for _ in range(4)] == [True, True, False, False]
    assert bucket.left(1000.0) == pytest.approx(5.0)


def test_a_debt_has_to_be_gained_first_and_a_clock_that_is_set_back_gains_nothing() -> None:
    bucket = Bucket(rate=1.0, burst=5.0, now_s=100.0)
    bucket.charge(8.0)
    assert bucket.left(100.0) == pytest.approx(-3.0)
    assert not bucket.take(103.5)
    assert bucket.left(50.0) == pytest.approx(0.5)
    assert bucket.take(51.0)
