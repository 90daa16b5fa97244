"""The effect of known buildings on the counts that a track expects."""

import numpy as np
import pytest

from radron.agent.config.buildings import BuildingConfig, BuildingsConfig
from radron.agent.config.mission import GroundConfig
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.bayes.shielding import Shielding
from radron.agent.terrain.buildings import Buildings
from radron.agent.terrain.ground import Ground

RESPONSE = response_of("Cs-137")
WALL = BuildingConfig(footprint_m=((5.0, 0.0), (5.2, 0.0), (5.2, 10.0), (5.0, 10.0)), height_m=4.0, attenuation_per_m=10.0)
KNOWN = Buildings(BuildingsConfig(known=(WALL,)), RESPONSE.air_per_m, Ground(GroundConfig()))


def shielding(y: float, sigma_m: float) -> Shielding:
    """Of a source at (10, y), seen from (0, y) at the same height."""
    start, way, sigma = np.array([[[0.0, y, 1.0]]]), np.array([[[10.0, 0.0, 0.0]]]), np.full((1, 1, 2), sigma_m)
    return Shielding.of(KNOWN, start, way, sigma)


def test_a_wall_lets_through_what_its_thickness_does() -> None:
    behind, beside = shielding(5.0, 0.1), shielding(-5.0, 0.1)
    assert behind.share == pytest.approx(np.exp(-2.0), rel=1e-3)
    assert behind.sigma == pytest.approx(0.03 * 2.0 * np.exp(-2.0), rel=0.02)
    assert (beside.share, beside.sigma) == (1.0, 0.0)


def test_at_a_walls_end_it_is_open_what_passes() -> None:
    known, vague = shielding(-0.3, 0.1), shielding(-0.3, 1.0)  # 0.3 m beside it, where half of the way a metre is half a metre
    assert (known.share, known.sigma) == (1.0, 0.0)
    assert 0.8 < vague.share < 0.9
    assert vague.sigma == pytest.approx((1.0 - np.exp(-2.0)) / 2.0, rel=0.02)


def test_scattered_photons_come_around_the_wall() -> None:
    direct, scattered = RESPONSE.parts(np.array([[2.0]]), np.array([[10.0]]), np.array([[0.9]]))
    behind, variance = shielding(5.0, 0.0).counts(direct, scattered)
    assert behind == pytest.approx(scattered + direct * np.exp(-2.0), rel=1e-3)
    assert 0.0 < variance.item() < 0.06**2  # 3 % of a depth of 2, less the scattered part
    opaque, _ = Shielding(np.zeros((1, 1)), np.zeros((1, 1))).counts(direct, scattered)
    assert opaque == pytest.approx(scattered)
