"""The level of the batteries that a return depends on."""

from radron.agent.vehicle.batteries import ALL, STALE_S, Batteries


def test_the_lowest_level_that_is_still_told_counts() -> None:
    """The last level of a smart battery counted for good after its bus had failed; a battery with number 1 counted nothing."""
    batteries, now_s = Batteries(), 100.0
    assert (batteries.level(now_s), batteries.problem(now_s)) == (None, None)
    batteries.take(1, 45, now_s)
    assert batteries.level(now_s) == 0.45
    batteries.take(ALL, 60, now_s + 5.0)
    assert batteries.level(now_s + 5.0) == 0.45
    assert batteries.level(now_s + STALE_S + 1.0) == 0.6
    late_s = now_s + STALE_S + 6.0
    assert batteries.level(late_s) is None
    assert batteries.problem(late_s) == "the autopilot does not tell a battery's level any more"


def test_a_battery_that_is_lost_is_told_although_the_sum_goes_on() -> None:
    batteries = Batteries()
    batteries.take(ALL, -1, 99.0)  # not known yet
    assert batteries.problem(99.0) is None
    batteries.take(0, 45, 100.0)
    batteries.take(ALL, 45, 100.0)
    assert batteries.problem(100.0) is None
    batteries.take(0, -1, 101.0)
    assert batteries.level(101.0) == 0.45
    assert batteries.problem(101.0) is not None
    batteries.take(0, 44, 102.0)
    assert batteries.problem(102.0) is None
