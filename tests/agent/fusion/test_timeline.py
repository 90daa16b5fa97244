"""The entries of a drone that count in a step of the time grid: exposures of up to three cameras, in any order of arrival."""

from itertools import permutations

from radron.agent.fusion.timeline import MAX_EXPOSURES_PS, MAX_STEP_OBSERVATIONS, Timeline
from radron.protocol.entries import EntryId


def identity(number, drone="a"):
    return EntryId("m", 1000 + number, drone, "0" * 16, number)


def test_of_the_exposures_of_a_drone_in_a_step_the_first_ones_count_whatever_order_they_come_in():
    for order in permutations(range(5)):
        timeline = Timeline(0.1)
        for number in order:
            timeline.add(7, identity(number), 0, is_exposure=True)
        assert timeline.of(7) == [identity(number) for number in range(3)]  # 0.1 s of MAX_EXPOSURES_PS, and two more


def test_other_observations_and_other_drones_count_beside_them():
    timeline = Timeline(0.1)
    for number in range(10):
        timeline.add(7, identity(number), 0, is_exposure=True)
        timeline.add(7, identity(100 + number), 0, is_exposure=False)
        timeline.add(7, identity(number, "b"), 0, is_exposure=number == 0)
    assert sum(seen.drone == "a" for seen in timeline.of(7)) == 3 + 10
    assert sum(seen.drone == "b" for seen in timeline.of(7)) == 10


def test_one_that_goes_makes_room_for_the_next_and_one_that_did_not_count_changes_nothing():
    timeline = Timeline(0.1)
    changes = [timeline.add(7, identity(number), 0, is_exposure=True) for number in range(5)]
    assert changes == [True] * 3 + [False] * 2
    assert timeline.remove(identity(4)) is None
    assert timeline.remove(identity(0)) == 7
    assert timeline.of(7) == [identity(number) for number in (1, 2, 3)]


def test_all_exposures_of_a_wide_step_count():
    timeline = Timeline(10.0)
    for number in range(10 * MAX_EXPOSURES_PS):
        timeline.add(0, identity(number), 0, is_exposure=True)
    assert len(timeline.of(0)) == 10 * MAX_EXPOSURES_PS < MAX_STEP_OBSERVATIONS
