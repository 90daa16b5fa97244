"""Drift time from coincidences."""

import numpy as np

from radron.agent.calibration.depth import depth_differences, fit_drift

AHEAD = [np.array((0.0, 0.0, 1.0))]


def drawn(rng, drift_ns, count):
    """Time differences of pairs with depths of the assumed distribution."""
    shape = depth_differences(661.66, AHEAD[0])
    place = rng.choice(len(shape), count, p=shape)
    depth = (place + rng.random(count)) / len(shape)
    return drift_ns * depth * rng.choice((-1.0, 1.0), count) + rng.normal(0.0, 3.0, count)


def test_the_drift_time_is_found_within_its_uncertainty():
    rng = np.random.default_rng(2)
    for drift_ns in (60.0, 86.0, 130.0):
        found = fit_drift(drawn(rng, drift_ns, 2000), 661.66, AHEAD)
        assert abs(found.drift_ns - drift_ns) < 2.0 * found.sigma_ns
        assert found.sigma_ns < 0.05 * drift_ns


def test_few_coincidences_tell_nothing():
    assert fit_drift(np.zeros(20), 661.66, AHEAD) is None
