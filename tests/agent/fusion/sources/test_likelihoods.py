"""The likelihoods' derivatives against differences of the likelihoods, and the fit's evidence."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import observe
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import Spectra
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import Counts, PoseSample
from radron.protocol.spectrum import SpectrumBin

NS = 1_000_000_000

SOURCES = [("Cs-137", 12.0, 20.0, 3e9), ("Ir-192", 30.0, 15.0, 5e8)]


@pytest.fixture(scope="module")
def problem(among):
    """Two drones, the second off by (0.3, -0.2) m."""
    mission = among.mission_of()
    entries = among.entries_of(mission, np.random.default_rng(1), 30.0, SOURCES, bias=((0.0, 0.0), (0.3, -0.2)))
    return among.problem_of(mission, entries)


def somewhere():
    bias = np.array([(0.05, -0.1, 0.02), (-0.1, 0.1, -0.03)])
    return Solution((0, 2), np.array([(12.5, 19.6), (29.5, 15.3)]), np.array([1.0, -0.6]), 0.1, bias, 0.004, 0.05)


@pytest.mark.parametrize("number", range(13))
def test_the_gradient_is_that_of_the_value(problem, number):
    """Central differences, whose own error is of the order 1e-8 of a value of some thousands."""
    solution = somewhere()
    step = np.zeros(13)
    step[number] = 1e-5
    after, before = (problem.value(solution.moved(solution.vector + sign * step)) for sign in (1, -1))
    gradient, _ = problem._scored(solution)[1]()
    assert gradient[number] == pytest.approx((after - before) / 2e-5, rel=1e-4, abs=1e-2)


def test_the_value_of_a_fit_is_that_of_its_solution(problem):
    fitted = problem.fitted(somewhere(), 20)
    assert fitted.value == pytest.approx(problem.value(fitted.solution))
    assert fitted.value > problem.value(somewhere())


def test_places_and_activities_are_told_with_their_errors(problem):
    """All within four standard deviations, although one drone is off."""
    fitted = problem.fitted(somewhere(), 20)
    for k, (_, x, y, becquerel) in enumerate(SOURCES):
        error = [*(fitted.solution.place[k] - (x, y)), fitted.solution.log_activity[k] - np.log(becquerel / 1e9)]
        assert np.all(np.abs(error) < 4.0 * fitted.sigma_of(k))


def test_the_evidence_is_for_what_is_there(problem):
    both = problem.fitted(somewhere(), 20)
    one = problem.fitted(somewhere().without(1), 20)
    three = problem.fitted(both.solution.plus(1, np.array([5.0, 35.0]), -5.0), 20)
    assert both.evidence > one.evidence + 10.0
    assert both.evidence > three.evidence


def test_cones_tell_nothing_without_sources(problem):
    assert problem.cones.log_likelihood(Solution.nothing(2)) == 0.0


def test_what_is_left_is_fitted_as_alone(problem):
    """One source with the other as it is: better than before, and the other has not moved."""
    start = somewhere()
    solution, value = problem.fitted_alone(start, [1], problem.counts.expected(start.without(1)), 10)
    assert value > problem.counts.log_likelihood(problem.counts.expected(start))
    assert value == pytest.approx(problem.counts.log_likelihood(problem.counts.expected(solution)))
    assert np.array_equal(solution.place[0], start.place[0])


def test_expectations_stay_positive_at_any_scale(problem):
    for scale in (-0.1, 0.1):
        assert problem.counts.expected(replace(somewhere(), scale=scale)).clear.min() > 0.0


def test_what_was_counted_while_flying_by_near_a_source_weighs_less(kit, among):
    """By s^2 / d^2 of the rate, with s^2 = L^2 / 12 of a way of L = 1.5 m: 0.19 m2, which is 0.5 % at 6 m and 19 % at 1 m."""
    mission = among.mission_of()
    entries = [flown_by(kit, mission, number, away_m) for number, away_m in enumerate((1.0, 2.0, 6.0))]
    rows = Rows.none().plus([observe(entry, Transform()) for entry in entries], {"a": 0})
    model = CountModel(rows, Spectra.of(among.NUCLIDES), Ground.from_config(mission), 1)
    strong = Solution((0,), np.array([(12.0, 20.0)]), np.array([5.0]), 0.0, np.zeros((1, 3)))
    doubting = model.doubting(strong, np.array([(0.1, 0.1)]))
    relative = (1.0 / doubting.weight - 1.0 / model.weight) / rows.counts.sum(axis=1)
    assert np.sqrt(relative) == pytest.approx(1.5**2 / 12.0 / np.array([1.0, 4.0, 36.0]), rel=0.02)
    assert model.doubting(Solution.nothing(1), np.zeros((0, 2))) is model


def flown_by(kit, mission, number, away_m):
    """400 events while a camera flew 1.5 m at some distance from (12, 20) m, as high as a source there."""
    exposure = kit.exposure_entry(mission, float(number), (12.0 + away_m, 20.0, 0.0), sequence=number, duration_s=0.5)
    x, turned = exposure.poses[0].position_m[0], exposure.poses[0].quaternion
    ends = (PoseSample(offset, (x, 20.0 + aside, 0.0), turned) for offset, aside in ((0, -0.75), (NS // 2, 0.75)))
    return replace(exposure, poses=tuple(ends), spectrum=(SpectrumBin(20, 400, 0),), counts=Counts(400, 0, 0))
