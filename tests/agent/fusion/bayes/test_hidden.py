"""Unknown attenuation between source and camera: its Markov chain, and the remaining share of the counts that a track expects."""

import numpy as np
import pytest

from radron.agent.fusion.bayes import hidden
from radron.agent.fusion.bayes.response import response_of

RESPONSE = response_of("Cs-137")
DIRECT, SCATTERED = RESPONSE.parts(np.array([[2.0]]), np.array([[10.0]]), np.array([[0.9]]))
LEVELS = len(hidden.DEPTHS)


def certain(level: int) -> np.ndarray:
    return np.eye(LEVELS)[[level]]


@pytest.mark.parametrize("duration_s", [0.0, 0.5, 1e9])
def test_an_exposure_has_one_of_the_components_whatever_was_before(duration_s: float) -> None:
    before = np.vstack((np.eye(LEVELS), hidden.PRIOR))
    assert hidden.components(before, duration_s).sum(axis=1) == pytest.approx(1.0)


def test_the_level_is_forgotten_in_time() -> None:
    short, long = (hidden.levels(hidden.components(certain(3), duration_s)) for duration_s in (0.5, 1e3))
    assert short[0, 3] == pytest.approx(np.exp(-0.5 * hidden.RATE_PS), abs=0.01)
    assert long[0] == pytest.approx(hidden.PRIOR)


def test_looking_ahead_is_the_adjoint_of_the_prediction() -> None:
    """P(next | level before), averaged over the levels, is P(next) by its components."""
    rng = np.random.default_rng(1)
    chance, likelihood = rng.dirichlet(np.ones(LEVELS))[None], rng.random((1, len(hidden.DIRECT_SHARE)))
    ahead = hidden.given_level(likelihood, 0.5)
    assert np.vecdot(chance, ahead) == pytest.approx(np.vecdot(hidden.components(chance, 0.5), likelihood))


def test_of_a_clear_view_everything_is_expected_and_nothing_unsure() -> None:
    expected, variance = hidden.behind(DIRECT, SCATTERED, None)
    assert expected[0] == pytest.approx(DIRECT + SCATTERED)
    assert variance[0] == 0.0
    assert (expected > 0.0).all()
    assert (np.diff(expected[:LEVELS].sum(axis=(1, 2, 3))) < 0.0).all()  # the deeper the fewer


def test_behind_a_wall_scattered_photons_are_left_and_behind_a_hill_none() -> None:
    expected, variance = hidden.behind(DIRECT, SCATTERED, None)
    wall, hill = LEVELS - 2, LEVELS - 1
    assert expected[wall] == pytest.approx(SCATTERED + np.exp(-hidden.DEPTHS[wall]) * DIRECT)
    assert variance[wall] > 0.2**2
    assert expected[hill].sum() < 0.02 * (DIRECT + SCATTERED).sum()
