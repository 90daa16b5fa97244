"""The own entries stamped by a wrong clock."""

import pytest

from radron.agent.owntime import Utc
from radron.agent.sensing.numbering import Numbering

SECOND = 1_000_000_000
TICKS = 20


def told(jumps, seconds, right=lambda second: True):
    """The numbers reported as wrongly stamped; a number is given at each tick. ``jumps``: steps of the clock (s), by second;
    ``right``: whether the clock is known to be right then.
    """
    utc = Utc()
    numbering, found = Numbering(utc), []
    for tick in range(seconds * TICKS):
        now_ns = 1000 * SECOND + tick * SECOND // TICKS
        if tick % TICKS == 0 and (step_s := jumps.get(tick // TICKS)):
            utc.ahead_ns += round(step_s * SECOND)
            numbering.clock_step(round(step_s * SECOND), now_ns)
        numbering.note(now_ns)
        if right(tick / TICKS) and (wrong := numbering.wrong()) is not None:
            found.append(wrong)
        assert next(numbering) == tick + 1
    return found


@pytest.mark.parametrize("ahead_s", [26.6, 5.0, 2.1])
def test_all_that_was_stamped_while_the_clock_was_ahead(ahead_s):
    """Also what carries stamps that have come again before the clock was set back."""
    found = told({10: ahead_s, 25: -ahead_s}, 40, right=lambda second: not 10 <= second < 26)
    assert found == [(10 * TICKS + 1, 25 * TICKS)]


def test_each_step_ahead_is_undone_once():
    """Two of them, one in the other; and one more step back is of a clock that was right."""
    right = lambda second: second < 10 or second > 41  # noqa: E731
    assert told({10: 5.0, 20: 3.0, 30: -3.0, 40: -5.0}, 60, right) == [(10 * TICKS + 1, 40 * TICKS)]
    first, second = told({10: 5.0, 25: -5.0, 50: -5.0}, 60)
    assert first == (10 * TICKS + 1, 25 * TICKS)
    assert second[0] == pytest.approx(45 * TICKS + 1, abs=TICKS)


def test_where_the_clock_was_never_set_ahead_what_carries_later_stamps():
    (wrong,) = told({30: -8.0}, 40)
    assert wrong[0] == pytest.approx(22 * TICKS + 1, abs=TICKS)
    assert wrong[1] == 30 * TICKS


def test_nothing_once_the_time_has_come_again():
    """Set back wrongly: while the clock is known to be wrong nothing is reported, and then the earlier stamps are right."""
    assert told({30: -8.0}, 60, right=lambda second: second < 30 or second >= 38) == []
    assert told({30: -8.0, 35: 8.0}, 60, right=lambda second: second < 30 or second >= 35) == []


def test_of_a_clock_that_is_set_back_twice():
    (wrong,) = told({30: -5.0, 31: -5.0}, 60, right=lambda second: second < 30 or second > 32)
    assert wrong[0] == pytest.approx(21 * TICKS + 1, abs=TICKS)
    assert wrong[1] == 31 * TICKS


def test_nothing_is_told_of_a_clock_that_runs():
    assert told({10: 0.5, 20: -0.5, 25: 30.0}, 40) == []
