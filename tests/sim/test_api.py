"""The Python interface: a flight with its posteriors, a comparison, figures, and errors of a call."""

import msgspec
import numpy as np
import pytest

from radron.agent.errors import ConfigError
from radron.sim import api
from radron.sim.lockstep.flight import fly

SHORT = {"end.track_s": 4, "drones": 2}


@pytest.fixture(scope="module")
def flight():
    return api.fly(api.load("ideal-static-swarm", SHORT), seed=4, listen=["paper"], every_s=0.5)


def test_the_flight_is_that_of_the_command(flight):
    untimed = {"wall_s": 0.0, "realtime_factor": 0.0}
    plain = fly(api.load("ideal-static-swarm", SHORT), 4, listen=["paper"])
    assert msgspec.structs.replace(flight.result, **untimed) == msgspec.structs.replace(plain.result, **untimed)
    np.testing.assert_array_equal(flight.trace.hypothesis_m, plain.trace.hypothesis_m)


def test_a_search_is_a_grid_over_the_area_and_around_it_and_a_track_a_gaussian_sum(flight):
    posteriors = flight.posteriors["bayes"]
    kinds = [posterior.kind for posterior in posteriors]
    assert kinds == sorted(kinds)  # first the grid, then the sum
    assert set(kinds) == {"grid", "sum"}
    for posterior in posteriors:
        count = len(posterior.weight)
        assert posterior.position_m.shape == (count, 2)
        assert posterior.covariance_m2.shape == (count, 2, 2)
        assert posterior.weight.sum() == pytest.approx(1.0 - posterior.none)
    first = posteriors[0]
    inside = ((first.position_m >= 0.0) & (first.position_m <= 100.0)).all(axis=1)
    assert first.weight[inside].sum() > 0.8 * first.weight.sum()
    assert (np.abs(first.position_m - 50.0) < 50.0 + 30.0 + 60.0).all()  # the fence's margin, and as far beyond as is searched
    assert posteriors[-1].rms_m < 0.2 * first.rms_m


def test_the_times_are_those_of_the_trace(flight):
    times = [posterior.time_s for posterior in flight.posteriors["bayes"]]
    assert times == sorted(times)
    assert np.diff(times) == pytest.approx(0.5, abs=0.31)  # at the track's begin, times are the hypothesis's: a hold ago
    assert times[-1] == pytest.approx(flight.trace.time_s[-1], abs=1.0)


@pytest.mark.slow
def test_mean_and_covariance_are_those_that_the_swarm_flies_by():
    """Both are taken down each second, at the same moments. The covariance is wider only where the modes of motion differ."""
    flight = api.fly(api.load("ideal-static-swarm", {**SHORT, "end.track_s": 20}), seed=4, every_s=1.0)
    trace, sums = flight.trace, [posterior for posterior in flight.posteriors["bayes"] if posterior.kind == "sum"]
    same = [int(np.argmin(np.abs(trace.time_s - posterior.time_s))) for posterior in sums]
    np.testing.assert_allclose(trace.time_s[same], [posterior.time_s for posterior in sums], atol=1e-6)
    rms_m = np.array([posterior.rms_m for posterior in sums])
    away_m = trace.hypothesis_m[same, 0, :2] - [posterior.mean_m for posterior in sums]
    assert (np.hypot(*away_m.T) <= 1e-2 * rms_m).all()
    wider = np.sqrt(np.trace(trace.covariance_m2[same], axis1=1, axis2=2)) / rms_m
    assert (wider > 0.99).all()
    assert (wider < 1.01).mean() > 0.5


def test_the_moments_of_a_mixture():
    two = np.array([[0.0, 0.0], [4.0, 0.0]])
    posterior = api.Posterior(0.0, "sum", two, np.array([0.3, 0.1]), np.array([np.eye(2), np.eye(2)]), none=0.6)
    np.testing.assert_allclose(posterior.mean_m, (1.0, 0.0))
    np.testing.assert_allclose(posterior.covariance, [[1.0 + 3.0, 0.0], [0.0, 1.0]])
    assert posterior.rms_m == pytest.approx(5.0**0.5)


def test_an_estimator_that_tells_no_more_is_one_gaussian(flight):
    assert {posterior.kind for posterior in flight.posteriors["paper"]} == {"gaussian"}
    assert all(len(posterior.weight) == 1 for posterior in flight.posteriors["paper"])


def test_two_estimators_are_compared_on_one_flight(flight):
    compared = api.compare(flight)
    assert list(compared) == ["bayes", "paper"]
    assert compared["bayes"]["error_median_m"] == flight.result.error_median_m
    assert compared["paper"]["error_median_m"] == flight.listened["paper"].error_median_m


def test_figures_and_files_are_those_of_the_command(flight, tmp_path):
    assert set(api.figures(flight)) == {"map", "spacing", "error", "posterior"}
    written = {path.name for path in api.save(flight, tmp_path / "new")}
    assert written == {"result.json", "result-paper.json", "map.png", "spacing.png", "error.png", "posterior.png"}
    assert api.summary(flight).startswith("Source estimate: (")


def test_what_is_wrong_with_a_call_is_said():
    assert "demo" in api.scenarios()
    with pytest.raises(ConfigError, match="unknown scenario 'dmeo'"):
        api.load("dmeo")
    with pytest.raises(ConfigError, match=r"there is no 'mission\.radius'"):
        api.load("demo", {"mission.radius": 3})
    with pytest.raises(ConfigError, match="unknown estimator 'kalman'"):
        api.fly("demo", estimator="kalman")
    with pytest.raises(ConfigError, match="give a seed of 0 or more"):
        api.fly("demo", seed=-1)
