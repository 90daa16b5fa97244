import numpy as np
import pytest

from sim.localization import Localization, LocalizationTruth


def test_errors_have_the_given_size_and_memory():
    truth = LocalizationTruth(horizontal_m=0.2, vertical_m=0.1, yaw_deg=2.0, correlation_s=5.0, velocity_mps=0.05)
    localization = Localization(truth, 400, 1.0, np.random.default_rng(2))
    first = localization.position_error_m.copy()
    assert np.hypot(*first[:, :2].T).std() < 0.2
    assert np.sqrt(np.mean(first[:, :2] ** 2)) == pytest.approx(0.2 / 2**0.5, rel=0.1)
    assert first[:, 2].std() == pytest.approx(0.1, rel=0.15)
    assert localization.yaw_error_rad.std() == pytest.approx(np.deg2rad(2.0), rel=0.15)
    for _ in range(5):
        localization.step()
    then = localization.position_error_m
    assert np.corrcoef(first[:, 0], then[:, 0])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.12)
    assert np.sqrt(np.mean(then[:, :2] ** 2)) == pytest.approx(0.2 / 2**0.5, rel=0.1)
    assert localization.velocity_error_mps.std() == pytest.approx(0.05, rel=0.1)


def test_tilt_wanders_slowly_and_half_of_the_heights_variance_is_white():
    truth = LocalizationTruth(tilt_deg=0.5, height_m=0.05, correlation_s=1e6)
    localization = Localization(truth, 2000, 0.05, np.random.default_rng(3))
    tilt, height = localization.tilt_error, localization.height_error_m
    assert tilt[:, :2].std() == pytest.approx(np.deg2rad(0.5), rel=0.05)
    assert not tilt[:, 2].any()
    assert height.std() == pytest.approx(0.05, rel=0.07)
    localization.step()
    np.testing.assert_allclose(localization.tilt_error, tilt, atol=1e-4)
    assert np.corrcoef(height, localization.height_error_m)[0, 1] == pytest.approx(0.5, abs=0.07)
