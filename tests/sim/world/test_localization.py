import numpy as np
import pytest

from radron.sim.world.localization import Localization, LocalizationTruth


def test_errors_have_the_given_size_and_memory():
    truth = LocalizationTruth(
        horizontal_m=0.0, vertical_m=0.0, wander_m=0.2, drift_m=0.1, drift_s=5.0, yaw_deg=2.0, correlation_s=5.0
    )
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


@pytest.mark.parametrize("step_s", [0.01, 0.05, 0.5])
def test_errors_of_position_and_velocity_belong_together(step_s):
    """Of second order: smooth, and the velocity's is not the derivative of the position's."""
    truth = LocalizationTruth(drift_m=0.0, filter_s=2.0)
    localization = Localization(truth, 1500, step_s, np.random.default_rng(7))
    first = localization.position_error_m.copy()
    speeds = localization.velocity_error_mps.copy()
    assert np.sqrt(np.mean(first[:, :2] ** 2)) == pytest.approx(0.25 / 2**0.5, rel=0.05)
    assert first[:, 2].std() == pytest.approx(0.2, rel=0.06)
    assert speeds[:, :2].std() == pytest.approx(0.25, rel=0.05)
    assert speeds[:, 2].std() == pytest.approx(0.16, rel=0.06)
    for _ in range(round(2.0 / step_s)):
        localization.step()
    then = localization.position_error_m
    assert then.std(axis=0) == pytest.approx(first.std(axis=0), rel=0.08)
    for axis in range(3):
        assert np.corrcoef(first[:, axis], then[:, axis])[0, 1] == pytest.approx(2.0 * np.exp(-1.0), abs=0.06)
        assert np.corrcoef(first[:, axis], speeds[:, axis])[0, 1] == pytest.approx(1.0 / np.hypot(1.0, 0.85 / 2.0), abs=0.02)


def test_heights_drift_slowly():
    localization = Localization(LocalizationTruth(drift_m=1.0, vertical_m=0.0), 500, 1.0, np.random.default_rng(8))
    first = localization.position_error_m[:, 2].copy()
    for _ in range(30):
        localization.step()
    assert first.std() == pytest.approx(1.0, rel=0.1)
    assert np.corrcoef(first, localization.position_error_m[:, 2])[0, 1] == pytest.approx(np.exp(-0.5), abs=0.1)
    assert localization.position_sigma_m[1] == pytest.approx(1.0)


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
    sizes = ("horizontal_m", "vertical_m", "velocity_mps", "climb_mps", "drift_m", "height_m", "yaw_deg", "tilt_deg")
    nothing = dict.fromkeys(sizes, 0.0)
    localization = Localization(LocalizationTruth(**nothing), 3, 0.05, np.random.default_rng(6))
    for _ in range(3):
        localization.step()
        for error in ("position_error_m", "velocity_error_mps", "yaw_error_rad", "tilt_error", "height_error_m"):
            assert not getattr(localization, error).any()
    assert (*localization.position_sigma_m, localization.yaw_sigma_rad) == (0.0, 0.0, 0.0)
