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


def test_biases_are_constant_and_come_on_top_of_what_wanders():
    def positions(**biases):
        localization = Localization(LocalizationTruth(correlation_s=5.0, **biases), 500, 0.05, np.random.default_rng(4))
        course = []
        for _ in range(3):
            course.append(np.column_stack((localization.position_error_m, localization.yaw_error_rad)))
            for _ in range(100):
                localization.step()
        return np.array(course), localization.height_error_m

    (without, height), (biased, same_height) = positions(), positions(bias_m=1.0, bias_yaw_deg=3.0)
    bias = biased - without
    np.testing.assert_allclose(bias[1:], bias[:1].repeat(2, axis=0), atol=1e-12)
    np.testing.assert_array_equal(height, same_height)
    assert bias[0, :, :2].std(axis=0) == pytest.approx([1.0, 1.0], rel=0.1)
    assert abs(np.corrcoef(bias[0, :, 0], bias[0, :, 1])[0, 1]) < 0.13  # three sigmas
    assert not bias[0, :, 2].any()
    assert bias[0, :, 3].std() == pytest.approx(np.deg2rad(3.0), rel=0.1)


def test_the_autopilot_knows_of_its_biases():
    localization = Localization(
        LocalizationTruth(horizontal_m=0.3, yaw_deg=4.0, bias_m=0.4 / 2**0.5, bias_yaw_deg=3.0), 1, 0.05, np.random.default_rng(5)
    )
    assert localization.position_sigma_m[0] == pytest.approx(0.5)
    assert localization.yaw_sigma_rad == pytest.approx(np.deg2rad(5.0))


def test_ideal_poses_are_exact():
    nothing = dict.fromkeys(("horizontal_m", "vertical_m", "height_m", "yaw_deg", "tilt_deg", "velocity_mps"), 0.0)
    localization = Localization(LocalizationTruth(**nothing), 3, 0.05, np.random.default_rng(6))
    for _ in range(3):
        localization.step()
        for error in ("position_error_m", "velocity_error_mps", "yaw_error_rad", "tilt_error", "height_error_m"):
            assert not getattr(localization, error).any()
    assert (*localization.position_sigma_m, localization.yaw_sigma_rad) == (0.0, 0.0, 0.0)
