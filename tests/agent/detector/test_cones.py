import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from radron.agent.detector.cones import Line, compton_edge_kev, cone_event, klein_nishina_recoil
from radron.agent.detector.lines import LINES_KEV, lines_of
from radron.agent.detector.sensor import attenuation_per_mm
from radron.agent.errors import ConfigError

CS = Line.of(661.66)


def test_the_limits_of_cs137_are_those_of_the_paper():
    assert CS.maximum_electron_kev == pytest.approx(477.0, abs=0.5)
    assert CS.minimum_photon_kev == pytest.approx(174.0, abs=0.5)
    assert Line.of(661.66, 400.0, 100.0) == Line(661.66, 400.0, 100.0)


@pytest.mark.parametrize("degrees", [20.0, 60.0, 90.0, 150.0])
def test_the_opening_angle_is_the_scattering_angle(degrees):
    photon = 661.66 / (1.0 + 661.66 / 510.99895 * (1.0 - np.cos(np.deg2rad(degrees))))
    cone = cone_event(7, (661.66 - photon, photon), (3.0, 0.0, 4.0), CS)
    assert cone.stamp_ns == 7
    assert np.rad2deg(cone.theta_rad[0]) == pytest.approx(degrees, abs=0.01)
    np.testing.assert_allclose(cone.axis, [[0.6, 0.0, 0.8], [-0.6, 0.0, -0.8]])
    assert cone.separation_mm == pytest.approx(5.0)


def test_swapping_the_clusters_swaps_the_readings():
    one = cone_event(0, (300.0, 350.0), (1.0, -2.0, 0.5), CS)
    two = cone_event(0, (350.0, 300.0), (-1.0, 2.0, -0.5), CS)
    for name in ("axis", "theta_rad", "sigma_rad", "probability"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name)[::-1])
    assert one.energies_kev == pytest.approx(two.energies_kev[::-1])


@given(st.floats(20.0, 640.0), st.floats(-60.0, 60.0), st.floats(0.1, 15.0))
def test_every_cone_is_sound(energy, residual, distance):
    cone = cone_event(0, (energy, max(661.66 - energy + residual, 5.0)), (distance, 0.0, 0.1), CS)
    assert sum(cone.energies_kev) == pytest.approx(661.66)
    assert cone.probability.sum() == pytest.approx(1.0)
    assert (cone.probability >= 0.0).all()
    assert ((cone.theta_rad >= 0.0) & (cone.theta_rad <= np.pi)).all()
    assert ((cone.sigma_rad >= 0.02) & (cone.sigma_rad < 0.36)).all()
    np.testing.assert_allclose(np.linalg.norm(cone.axis, axis=1), 1.0)


def test_the_residual_goes_where_the_noise_is():
    cone = cone_event(0, (60.0, 661.66 - 60.0 - 20.0), (2.0, 0.0, 0.0), CS)
    shift = np.subtract(cone.energies_kev, (60.0, 581.66))
    variances = [2.5**2 + (0.02 * energy) ** 2 for energy in (60.0, 581.66)]
    np.testing.assert_allclose(shift, 20.0 * np.array(variances) / sum(variances))
    assert cone.energy_sigmas_kev[0] ** 2 == pytest.approx(variances[0] * variances[1] / sum(variances))


def test_an_electron_far_beyond_the_edge_is_improbable():
    cone = cone_event(0, (600.0, 61.66), (2.0, 0.0, 0.0), CS)
    assert cone.probability[0] < 0.1
    assert cone.theta_rad[0] == pytest.approx(np.deg2rad(152.0), abs=0.05)  # the photon went back, seldom straight


def test_a_nearer_pair_is_less_certain():
    sigmas = [cone_event(0, (300.0, 361.66), (distance, 0.0, 0.0), CS).sigma_rad[0] for distance in (0.3, 1.0, 3.0, 10.0)]
    assert (np.diff(sigmas) < 0.0).all()


@pytest.mark.parametrize("energy", [511.0, 661.66, 1332.49])
def test_the_recoil_spectrum_has_the_mean_of_klein_nishina_by_angle(energy):
    def by_angle(cosine):
        ratio = 1.0 / (1.0 + energy / 510.99895 * (1.0 - cosine))
        return ratio * ratio * (ratio + 1.0 / ratio - (1.0 - cosine * cosine)), energy * (1.0 - ratio)

    expected = quad(lambda c: np.prod(by_angle(c)), -1, 1)[0] / quad(lambda c: by_angle(c)[0], -1, 1)[0]
    edge = compton_edge_kev(energy)
    mean = (
        quad(lambda t: t * klein_nishina_recoil(energy, t), 0, edge)[0]
        / quad(lambda t: klein_nishina_recoil(energy, t), 0, edge)[0]
    )
    assert mean == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("energy", [25.0, 30.0, 45.0, 120.0, 250.0, 450.0, 661.66])
def test_attenuation_agrees_with_xraylib(energy):
    xraylib = pytest.importorskip("xraylib")
    photo, total = attenuation_per_mm(energy)
    assert photo == pytest.approx(0.585 * xraylib.CS_Photo_CP("CdTe", energy), rel=0.03)
    assert total == pytest.approx(0.585 * xraylib.CS_Total_CP("CdTe", energy), rel=0.03)


def test_lines():
    for nuclide in ("Cs-137", "Co-60", "Am-241", "Ir-192", "I-131", "Ba-133", "Na-22", "Eu-152", "K-40"):
        assert lines_of(nuclide) == LINES_KEV[nuclide]
    with pytest.raises(ConfigError, match=r"'Cs137' is not known; known: .*Cs-137"):
        lines_of("Cs137")
