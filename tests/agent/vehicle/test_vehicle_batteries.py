"""The level of the batteries that a return depends on."""

from agent.vehicle.batteries import ALL, STALE_S, Batteries


def test_the_lowest_level_that_is_still_told_counts() -> None:
    """Of a smart battery whose bus had failed the last level counted for good; one with number 1 counted nothing."""
    batteries, now_s = Batteries(), 100.0
    assert (batteries.level(now_s), batteries.problem(now_s)) == (None, None)
    batteries.take(1, 45, now_s)
    assert batteries.level(now_s) == 0.45
    batteries.take(ALL, 60, now_s + 5.0)
    assert batteries.level(now_s + 5.0) == 0.45
    assert batteries.level(now_s + STALE_S + 1.0) == 0.6
    late_s = now_s + STALE_S + 6.0
    assert batteries.level(late_s) is None
    assert "has not told the battery" in str(batteries.problem(late_s))
    batteries.take(ALL, -1, late_s)
    assert batteries.level(late_s) is None
