"""Sources behind unknown attenuation: the rows that notice it, and their statement then."""

import numpy as np
import pytest

from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.hidden import Cells, Expected
from radron.agent.fusion.sources.solution import Solution
from support.flights.fusions import fusion_of

SOURCE = ("Cs-137", 18.0, 22.0, 3e9)
WALL_X_M, WALL_Y_M, WALL_HEIGHT_M = 15.0, (20.0, 32.0), 2.5


def wall(camera, source):
    """Share that passes a wall of concrete north and south, 0.2 m thick, 3 m west of the source."""
    along = (WALL_X_M - camera[0]) / (source[0] - camera[0])
    if not 0.0 < along < 1.0:
        return 1.0
    _, y, z = camera + along * (source - camera)
    return 0.03 if WALL_Y_M[0] < y < WALL_Y_M[1] and z < WALL_HEIGHT_M else 1.0


def entries_behind(among, mission, passing, seconds=40.0):
    return among.entries_of(mission, np.random.default_rng(6), seconds, [SOURCE], passing=passing)


CLEAR = np.repeat([[60.0, 20.0]], 16, axis=1) / 16.0
DIRECT = np.repeat([[40.0, 16.0]], 16, axis=1) / 16.0
EACH_BIN = np.eye(32)


def seen(*rows, apart=0, of=1.0):
    """Rows of two halves of the spectrum: ``of`` times 60 and 20 counts are expected, 40 and 16 of them straight from a source.

    apart: voxels between two rows.
    """
    counts = np.array([np.repeat(row, 16) for row in rows]) / 16.0
    table = np.zeros((len(rows), 43), np.int64)
    table[:, 1] = apart * np.arange(len(rows))
    table[:, 11] = counts.sum(axis=1)
    clear, direct = (np.repeat(of * part, len(rows), axis=0) for part in (CLEAR, DIRECT))
    return Cells(Rows(table)).views(counts, np.ones(len(rows)), Expected(clear, direct, 0.1 * clear))


def test_a_row_as_expected_says_as_much_as_without_walls():
    one = seen((60.0, 20.0))
    assert one.hidden[0] < 0.01
    assert np.abs(one.along(EACH_BIN, 0.0 * EACH_BIN)).max() < 0.01
    assert one.information[0] > 0.9


def test_a_row_far_below_pulls_no_more_and_tells_little():
    one = seen((26.0, 7.0))
    assert one.hidden[0] > 0.99
    assert abs(one.along(DIRECT, DIRECT)[0, 0]) < 2.0  # by the logarithm of the rate; with a clear view -33
    assert one.information[0] < 0.05
    assert one.mean.sum() == pytest.approx(33.0, rel=0.05)


@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.95, 1.0), (1.0, 0.95)])
def test_what_is_hidden_does_not_tell_how_strong_a_source_is(weights):
    """Rows of one cell weigh differently if one row sees the source ten times as strong: the stronger, the better the row was."""
    counts = np.array([np.repeat((8.0, 2.0), 16), np.repeat((3.0, 1.0), 16)]) / 16.0
    cells = Cells(Rows(np.zeros((2, 42), np.int64)))
    likelihood = []
    for of in (1e2, 1e4, 1e6):
        clear, direct = (of * np.vstack((part, 0.1 * part)) for part in (CLEAR, DIRECT))
        likelihood.append(cells.views(counts, np.array(weights), Expected(clear, direct, 0.1 * clear)).log_likelihood)
    assert likelihood == pytest.approx([likelihood[0]] * 3, abs=1e-3)


def test_a_row_without_any_count_is_hidden_and_still_expects_some():
    """A camera that is blind, or right behind a wall: its expected counts are the divisor in births and in exclusion limits."""
    one = seen((0.0, 0.0))
    assert one.hidden[0] > 0.99
    assert one.mean.min() > 0.0
    assert one.mean.sum() < 5.0
    assert np.isfinite(one.along(CLEAR, DIRECT)).all()


def test_too_many_counts_are_not_hidden():
    one = seen((100.0, 35.0))
    assert one.hidden[0] < 0.01
    assert one.along(DIRECT, 0.0 * DIRECT)[0, 0] > 30.0


def test_rows_of_few_counts_tell_together_if_they_are_near_each_other():
    """Of nine counts expected in each, three come: one row might do so by chance."""
    few = [(2.0, 1.0)] * 6
    assert seen(few[0], of=0.11).hidden[0] < 0.5
    assert seen(*few, of=0.11).hidden.min() > 0.9
    assert seen(*few, of=0.11, apart=20).hidden.max() < 0.5


def test_a_row_that_counts_nothing_of_a_source_does_not_notice_walls():
    one = seen((0.5, 0.1), of=0.01)
    assert one.hidden[0] == 0.0
    by_bin = np.repeat([(0.5 / 0.6 - 1.0, 0.1 / 0.2 - 1.0)], 16, axis=1)
    assert one.along(EACH_BIN, EACH_BIN) == pytest.approx(by_bin)


@pytest.fixture(scope="module")
def problem(among):
    mission = among.mission_of()
    return among.problem_of(mission, entries_behind(among, mission, wall))


@pytest.mark.parametrize("number", range(10))
def test_the_gradient_is_that_of_the_value(problem, number):
    """Central differences; the gradient leaves out that cells notice a source by degrees, which matters little."""
    solution = Solution((0,), np.array([(18.3, 21.8)]), np.array([1.0]), 0.1, np.array([(0.05, -0.1, 0.02), (-0.1, 0.1, 0.03)]))
    assert problem.counts.views(problem.counts.expected(solution)).hidden.max() > 0.9
    step = np.zeros(10)
    step[number] = 1e-5
    after, before = (problem.value(solution.moved(solution.vector + sign * step)) for sign in (1, -1))
    gradient, _ = problem._scored(solution)[1]()
    assert gradient[number] == pytest.approx((after - before) / 2e-5, rel=1e-3, abs=0.05)


def test_a_source_behind_a_wall_is_one_source_where_it_is(among, estimated):
    """Within four standard deviations, or 5 cm more."""
    mission = among.mission_of(moved_s=20.0)
    hypothesis = estimated(mission, entries_behind(among, mission, wall), 42.0)
    assert hypothesis.others == ()
    sigma_m = np.sqrt(np.diag(hypothesis.covariance)[:2])
    assert np.all(np.abs(hypothesis.position[:2] - SOURCE[1:3]) < 4.0 * sigma_m + 0.05)
    assert hypothesis.rms_m < 0.3
    assert hypothesis.activity_bq == pytest.approx(SOURCE[3], rel=0.15)


@pytest.mark.parametrize(("seed", "bq"), [(3, 1e10), (6, 1e10), (2, 5e10), (6, 5e10)])
def test_a_strong_source_is_not_found_far_too_strong_and_hidden_everywhere(kit, among, seed, bq):
    """From none, in one fit of 30 s: steps towards it went too far, 6 to 60 times, and nothing made it weaker again."""
    mission, rng = among.mission_of(moved_s=30.0), np.random.default_rng(seed)
    place = rng.uniform(5.0, 35.0, 2).tolist()
    fusion = fusion_of(mission)
    kit.feed(fusion, among.entries_of(mission, rng, 32.0, [("Cs-137", *place, bq)]))
    told = kit.settle(fusion, kit.T0_NS + 32_000_000_000)
    assert told.activity_bq == pytest.approx(bq, rel=0.1)
    assert told.position[:2] == pytest.approx(place, abs=0.3)
    assert told.others == ()
