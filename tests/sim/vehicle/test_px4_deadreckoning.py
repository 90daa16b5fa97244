"""A filter without satellites continues as recorded of PX4's."""

import numpy as np
import pytest

from radron.sim.vehicle.px4.filter.deadreckoning import DeadReckoning
from radron.sim.vehicle.px4.parameters import Parameters

STEP_S = 0.02


def blind(seconds, seed=1, timeout_us=5_000_000, armed=True):
    """Fly without satellites for a duration, and return the announcements."""
    announced = []
    filter_ = DeadReckoning(Parameters(1, {"EKF2_NOAID_TOUT": timeout_us}), STEP_S, np.random.default_rng(seed), announced.append)
    for _ in range(round(seconds / STEP_S)):
        filter_.step(False, armed)
    return filter_, announced


def aided(filter_, seconds):
    """The jumps in so long with satellites."""
    found = [filter_.step(True, True) for _ in range(round(seconds / STEP_S))]
    return [jump for jump in found if jump is not None]


def test_it_goes_wrong_by_metres_and_claims_one():
    errors = [float(np.linalg.norm(blind(7.0, seed)[0].error_m)) for seed in range(40)]
    assert 1.0 < np.median(errors) < 10.0  # recorded: 0.8, 4, 8 and 15 m
    assert 6.0 < max(errors) < 16.0
    assert blind(5.0)[0].reported_sigma_m == pytest.approx(1.4, abs=0.2)  # recorded: 1.24 and 1.52 m
    assert 60.0 < max(np.linalg.norm(blind(20.0, seed)[0].error_m) for seed in range(40)) < 100.0  # recorded: 99 m


def test_how_long_it_goes_on_is_a_parameter():
    for timeout_s in (1.0, 5.0):
        assert blind(timeout_s + 0.2, timeout_us=timeout_s * 1e6)[0].known
        assert not blind(timeout_s + 0.3, timeout_us=timeout_s * 1e6)[0].known


def test_after_seconds_it_slides_back_and_after_many_it_jumps_and_counts():
    soon, _ = blind(3.0)
    assert aided(soon, 6.0) == []
    assert np.linalg.norm(soon.error_m) < 0.05
    assert (soon.known, soon.resets) == (True, 0)
    late, announced = blind(20.0)
    wrong = late.error_m.copy()
    jumps = aided(late, 3.0)
    assert len(jumps) == 1
    assert np.linalg.norm(jumps[0] + wrong) < 12.0  # drifts on for a second
    assert (late.known, late.resets, len(announced)) == (True, 4, 2)


def test_one_that_stands_disarmed_notices_that_it_does():
    still, _ = blind(20.0, armed=False)
    assert (still.still, still.resets) == (True, 2)
    assert not still.velocity_mps.any()
