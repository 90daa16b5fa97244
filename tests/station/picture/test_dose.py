import numpy as np
import pytest

from radron.agent.detector.lines import GAMMAS
from radron.station.picture.dose import CONSTANTS, expected_usvph, rate_usvph

# ICRP Publication 74, Table A.21: photon energy (MeV), H*(10) per fluence (pSv cm2).
ENERGY_MEV = (0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0)
COEFFICIENT = (0.64, 0.55, 0.51, 0.53, 0.61, 0.89, 1.20, 1.80, 2.38, 2.93, 3.44, 4.38, 5.20, 6.90, 8.60)


@pytest.mark.parametrize("nuclide", sorted(GAMMAS))
def test_the_constants_follow_from_the_lines_and_the_conversion_coefficients(nuclide):
    log_energy, log_coefficient = np.log(ENERGY_MEV), np.log(COEFFICIENT)
    psv_cm2 = sum(
        share * np.exp(np.interp(np.log(1e-3 * line_kev), log_energy, log_coefficient)) for line_kev, share in GAMMAS[nuclide]
    )
    per_s_and_bq = psv_cm2 / (4.0 * np.pi * 100.0**2)  # pSv/s at 1 m
    assert CONSTANTS[nuclide] == pytest.approx(per_s_and_bq * 3600.0 * 1e-6 * 1e6, rel=0.01)  # uSv/h of a MBq


@pytest.mark.parametrize(("nuclide", "published"), [("Cs-137", 0.0927), ("Co-60", 0.354), ("Ir-192", 0.139)])
def test_the_constants_are_near_the_published_ones(nuclide, published):
    assert CONSTANTS[nuclide] == pytest.approx(published, rel=0.05)


def test_a_known_source_gives_the_inverse_square_at_a_metre_above_the_ground():
    places = np.array([[0.0, 0.0], [3.0, 4.0]])
    rates = expected_usvph("Cs-137", np.zeros((1, 2)), np.array([1e9]), places)
    assert rates == pytest.approx([90.9, 90.9 / 26.0])
    assert rate_usvph("Cs-137", 1e9, distance_m=2.0) == pytest.approx(90.9 / 4.0)


def test_possible_sources_add_up_by_their_probabilities():
    sources, activities = np.array([[0.0, 0.0], [10.0, 0.0]]), 0.5 * np.array([1e9, 1e9])
    (middle,) = expected_usvph("Co-60", sources, activities, np.array([[5.0, 0.0]]))
    assert middle == pytest.approx(348.2 / 26.0)


def test_an_unknown_nuclide_has_no_dose_rate():
    assert rate_usvph("Tc-99m", 1e9) is None
    assert expected_usvph("Tc-99m", np.zeros((1, 2)), np.ones(1), np.zeros((1, 2))) is None
