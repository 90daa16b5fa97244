import numpy as np
import pytest

from radron.agent.frames.consistency import Tally, agreeing, verdict, without


def tallies(good, bad, count=3):
    """Four keyframes of five sightings by each of a pair (observer, target), good and bad ones."""
    believed, seen = np.zeros((count, count)), np.zeros((count, count))
    for pair in good:
        believed[pair], seen[pair] = 4.5, 5.0
    for pair in bad:
        believed[pair], seen[pair] = 0.2, 5.0
    return [Tally(believed, seen)] * 4


def both(*pairs):
    return [pair for a, b in pairs for pair in ((a, b), (b, a))]


@pytest.mark.parametrize("liar", range(3))
def test_the_one_with_whom_nobody_agrees(liar):
    a, b = (drone for drone in range(3) if drone != liar)
    found = verdict(tallies(both((a, b)), both((a, liar), (b, liar))))
    assert found.faulty_drone() == liar
    assert found.agree[a, b]


def test_of_two_it_cannot_be_told():
    found = verdict(tallies([], both((0, 1)), count=2))
    assert found.faulty_drone() is None
    assert found.conflicts() == [(0, 1)]


def test_one_that_only_one_sees_is_told_by_whom_the_other_one_knows():
    assert verdict(tallies(both((0, 1)), both((0, 2)))).faulty_drone() == 2


def test_of_ten_two_lie():
    liars = (3, 7)
    pairs = [(a, b) for a in range(10) for b in range(a)]
    wrong = [pair for pair in pairs if set(pair) & set(liars)]
    found = verdict(tallies(both(*(set(pairs) - set(wrong))), both(*wrong), count=10))
    assert found.faulty_drone() in liars


def test_a_bad_camera_is_no_wrong_frame():
    found = verdict(tallies([(0, 1), (1, 0), (0, 2), (1, 2)], [(2, 0), (2, 1)]))
    assert found.faulty_drone() is None
    assert found.conflicts() == []
    assert found.blind.tolist() == [False, False, True]


def test_all_agree():
    found = verdict(tallies(both((0, 1), (0, 2), (1, 2)), []))
    assert found.faulty_drone() is None
    assert found.agree.sum() == 6


def test_few_sightings_contradict_nobody():
    seen = np.array([[0.0, 2.0], [1.0, 0.0]])
    found = verdict([Tally(np.zeros((2, 2)), seen)] * 2)
    assert found.conflicts() == []


def test_who_is_confirmed_in_a_keyframe():
    one = tallies(both((0, 1)), both((0, 2), (1, 2)))[0]
    assert agreeing(one).tolist() == [True, True, False]
    assert agreeing(without(one, 0)).tolist() == [False, False, False]
