"""The scatter factor of the ground and the source's height, as a track fits them by its counts."""

import numpy as np
import pytest

from radron.agent.config.mission import GroundConfig
from radron.agent.fusion.bayes.exposed import Exposed
from radron.agent.fusion.bayes.mixture import Mixture
from radron.agent.fusion.bayes.motion import ACTIVITY, BIAS, HEIGHT, SCATTER, Motion
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.bayes.sight import Scene
from radron.agent.fusion.bayes.soil import HEIGHT_SIGMA_M, IMAGE_DEPTH, SCATTER_SIGMA
from radron.agent.fusion.bayes.spectrum import Contrast, soil_share
from radron.agent.fusion.facing import Facing
from radron.agent.terrain.ground import Ground

SCENE = Scene(response_of("Cs-137", "soil"), Ground(GroundConfig()))
LOG_ACTIVITY = np.log(3.0)
MOTION = Motion(
    velocity_variance=np.array([0.0]),
    velocity_s=np.array([1e9]),
    switching_ps=np.zeros((1, 1)),
    bias_drift=np.zeros(BIAS),
    ground_variance=np.array([SCATTER_SIGMA, HEIGHT_SIGMA_M]) ** 2,
)


def tracked(scatter: float, height_m: float, direct: float = 1.0) -> Mixture:
    """A track after 600 exposures (0.5 s) by one camera around 3 GBq, drawn with a scatter factor, a height, and the share of
    the direct photons that pass what lies upon the source.
    """
    rng, one, response, soil = np.random.default_rng(1), np.ones(1), SCENE.response, SCENE.response.over_soil
    track = Mixture.of_sites(
        0.0, np.ones((1, 1)), 0 * one, 0 * one, one, LOG_ACTIVITY - 0.2 * one, 0.5 * one, MOTION, np.full(BIAS, 1e-8)
    )
    for k in range(600):
        place = np.array([*((5.0 + k % 7) * np.array([np.cos(0.1 * k), np.sin(0.1 * k)])), 2.5 + k % 3])
        distance = np.sqrt(place[:2] @ place[:2] + (place[2] - height_m) ** 2)
        fluence = response.flux(distance) * np.exp(LOG_ACTIVITY) * 0.5
        facing = Facing.of(-place[0], -place[1], distance, 1.0, 0.0).cosine()
        below = place[2] + IMAGE_DEPTH * height_m
        image = np.sqrt(place[:2] @ place[:2] + below**2)
        turned = Facing.of(-place[0], -place[1], image, 1.0, 0.0).cosine()
        by_soil = scatter * soil.by_soil(fluence * (distance / image) ** 2, below / image, turned)
        straight, scattered = response.parts(fluence, distance, facing, by_soil)
        background = 0.5 * response.background_ps
        counts = rng.poisson(direct * straight + scattered + background).astype(float)
        exposed = Exposed(0, tuple(place.tolist()), 0.5, counts, background, 0, (1.0, 0.0))
        after = track.after_counts(track.fit(SCENE, exposed, 0.0))
        track = track if after is None else after[0]
    return track


@pytest.mark.parametrize(("scatter", "height_m"), [(1.0, 0.0), (0.6, 0.0), (1.5, 0.0), (0.8, 1.0), (1.5, 1.0)])
def test_activity_scatter_factor_and_height_are_fitted(scatter, height_m):
    """With a fixed factor of 1 and the source on the ground, the activity is up to 35 % off."""
    mean, covariance = tracked(scatter, height_m).moments()
    truth = {ACTIVITY: LOG_ACTIVITY, SCATTER: np.log(scatter), HEIGHT: height_m, 0: 0.0, 1: 0.0}
    for place, true in truth.items():
        assert abs(mean[place] - true) < 3.0 * np.sqrt(covariance[place, place])
    assert mean[ACTIVITY] == pytest.approx(LOG_ACTIVITY, abs=0.05)
    assert covariance[SCATTER, SCATTER] < 0.06**2
    assert covariance[HEIGHT, HEIGHT] < 0.25**2  # without a cone


def test_a_buried_source_has_its_surface_equivalent_activity():
    """By the full-energy channel: without it, the scattered photons pull the activity up."""
    mean, _ = tracked(1.0, 0.0, direct=0.8).moments()
    assert mean[ACTIVITY] == pytest.approx(LOG_ACTIVITY + np.log(0.8), abs=0.07)
    assert mean[SCATTER] > 0.15  # the scattered photons, not attenuated, are not taken for activity


def test_the_contrast_is_the_slope_of_the_likelihood_where_the_rate_fits():
    straight, by_soil, none = np.array([12.0, 4.0]), np.array([20.0, 0.1]), np.full(2, 1e-12)
    counts = np.array([29.1, 7.0])  # as many as expected
    one = np.ones((1, 1, 1))
    contrast, _ = Contrast.of(counts, (straight + by_soil)[None, None], none, by_soil[None, None], one, 0.0 * one[..., None])

    def log_likelihood(q: float) -> float:
        expected = straight + np.exp(q) * by_soil
        return float(counts @ np.log(expected) - expected.sum())

    slope = (log_likelihood(1e-5) - log_likelihood(-1e-5)) / 2e-5
    assert contrast.score[0] == pytest.approx(slope, rel=1e-5)
    assert soil_share(by_soil, straight + by_soil, none) == pytest.approx(20.1 / 36.1)
    apart = by_soil / (straight + by_soil) - 20.1 / 36.1
    assert contrast.information[0] == pytest.approx((straight + by_soil) @ apart**2)


def test_a_track_over_nothing_has_no_states_of_the_ground():
    one = np.ones(1)
    bare = Motion(MOTION.velocity_variance, MOTION.velocity_s, MOTION.switching_ps, MOTION.bias_drift)
    track = Mixture.of_sites(0.0, np.ones((1, 1)), one, one, one, one, one, bare, np.zeros(3 * BIAS))
    assert track.mean.shape[-1] == 5 + 3 * BIAS
