"""The posterior Cramer-Rao bound of a flight."""

from __future__ import annotations

import time

import numpy as np
import pytest
from msgspec.structs import replace

from radron.sim.radiation.truth import CameraTruth
from radron.sim.scoring.bound import Bound, bound_of, median_error
from radron.sim.scoring.coneinformation import cone_information
from radron.sim.scoring.information import camera_of
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.sourcetruth import SourceTruth

IDEAL = LocalizationTruth(horizontal_m=0.0, vertical_m=0.0, height_m=0.0, yaw_deg=0.0, tilt_deg=0.0)
BIASED = replace(IDEAL, bias_m=1.0, bias_yaw_deg=3.0)
AREA_M = (100.0, 100.0)


def circled(
    vehicles: int, moving: bool, radius_m: float = 12.0, errors: LocalizationTruth = IDEAL, activity_bq: float = 3e9
) -> Bound:
    """180 s around the source at 3 m/s and 3 m of height, evenly spaced; a moving source circles at 1 m/s."""
    time_s = np.arange(0.2, 180.1, 0.2)
    place = np.tile([50.0, 50.0, 0.0], (len(time_s), 1))
    if moving:
        place[:, :2] += 40.0 * np.stack((np.cos(time_s / 40.0), np.sin(time_s / 40.0)), axis=1)
    phase = 3.0 / radius_m * time_s[:, None] + 2.0 * np.pi * np.arange(vehicles) / vehicles
    position = place[:, None] + np.stack((radius_m * np.cos(phase), radius_m * np.sin(phase), np.full(phase.shape, 3.0)), axis=2)
    kind = SourceTruth(activity_bq=activity_bq, motion="circle" if moving else "static", speed_mps=float(moving))
    return bound_of(kind, CameraTruth(), 15, errors, AREA_M, time_s, position, place)


def medians(bound: Bound) -> tuple[float | None, float | None]:
    everywhere = np.full(bound.time_s.shape, True)
    return bound.median_m(everywhere), bound.own_median_m(everywhere)


FLIGHTS = [(1, False), (3, False), (1, True), (3, True)]


@pytest.mark.parametrize(
    ("radius_m", "published"), [(12.0, (0.20, 0.11, 1.20, 0.80)), (6.0, (0.06, 0.03, 0.48, 0.32))], ids=["12 m", "6 m"]
)
def test_it_agrees_with_the_reference_for_exact_poses(radius_m: float, published: tuple[float, ...]) -> None:
    """Ours: 0.213, 0.123, 1.33, 0.75 m and 0.064, 0.037, 0.49, 0.28 m.

    The reference has its own camera model, an Ornstein-Uhlenbeck velocity of 0.8 m/s (the circle's: 0.71), and a search before
    the tracking; the reference gives two digits, and at 0.03 the last digit alone is worth 15 %. Hence a fifth is required,
    with half of that last digit.
    """
    found = [medians(circled(vehicles, moving, radius_m))[0] for vehicles, moving in FLIGHTS]
    for ours, theirs in zip(found, published, strict=True):
        assert ours == pytest.approx(theirs, abs=0.2 * theirs + 0.005)


def test_it_agrees_with_the_reference_for_biased_poses() -> None:
    """In the true frame and in the vehicles' own; ours: 1.20, 0.69, 1.81, 1.02 and 0.21, 0.21, 1.35, 0.78 m."""
    found = [medians(circled(vehicles, moving, errors=BIASED)) for vehicles, moving in FLIGHTS]
    assert [true for true, _ in found] == pytest.approx([1.20, 0.70, 1.88, 1.02], rel=0.05)
    assert [own for _, own in found] == pytest.approx([0.19, 0.19, 1.41, 0.78], rel=0.15)


def test_biases_that_all_vehicles_share_in_their_mean_cannot_be_seen() -> None:
    """The floor without any noise: the median length of a Gaussian error of sigma / sqrt(N) along each axis."""
    for vehicles in (1, 3):
        true, _ = medians(circled(vehicles, False, 6.0, BIASED, activity_bq=1e13))
        assert true == pytest.approx(1.1774 / vehicles**0.5, rel=1e-3)


def test_counts_and_cones_from_all_around_tell_more_over_time() -> None:
    """A source at rest: the squared error falls as one over time, once a turn is complete."""
    bound = circled(1, False)
    errors = median_error(bound.true)
    assert np.all(np.diff(errors) <= 0.0)
    assert errors[-1] / errors[len(errors) // 2 - 1] == pytest.approx(2.0**-0.5, rel=0.05)


def test_a_moving_sources_bound_stays() -> None:
    errors = median_error(circled(3, True).true)
    assert errors[90:].max() / errors[90:].min() < 1.3


def test_far_away_nothing_is_learnt_but_what_was_known() -> None:
    bound = circled(1, False, radius_m=5000.0)
    assert bound.true[-1] == pytest.approx(np.eye(2) * 100.0**2 / 12.0, rel=1e-3)


def test_the_median_of_a_gaussian_error() -> None:
    rng = np.random.default_rng(1)
    for covariance in ([[4.0, 0.0], [0.0, 4.0]], [[4.0, 1.5], [1.5, 1.0]], [[9.0, 0.0], [0.0, 1e-6]]):
        drawn = np.linalg.norm(rng.multivariate_normal([0.0, 0.0], covariance, 200_000), axis=1)
        assert median_error(np.array(covariance)) == pytest.approx(np.median(drawn), rel=0.01)


def test_rates_are_those_of_the_reference() -> None:
    """A camera at 3 GBq and 12 m: 20 hits/s and 0.67 cones/s; ours: 19.2 unscattered, and 0.66."""
    camera = camera_of(CameraTruth(), "Cs-137", 15)
    photons = 3e9 / (4e6 * np.pi * 12.0**2) * np.exp(-camera.air_per_m * 12.0)
    assert (camera.full_mm2 + camera.other_mm2) * photons == pytest.approx(20.0, rel=0.05)
    assert camera.cones_mm2 * photons == pytest.approx(0.67, rel=0.05)
    assert camera.full_ps == pytest.approx(0.03, rel=0.3)


def test_the_information_of_the_counts_is_that_of_poisson_counts() -> None:
    """By finite differences of the expected counts: (dS/dz)^2 / (S + B) for each channel."""
    camera = camera_of(CameraTruth(), "Cs-137", 15)

    def expected(distance_m: float, log_activity: float) -> np.ndarray:
        photons = np.exp(log_activity) / (4e6 * np.pi * distance_m**2) * np.exp(-camera.air_per_m * distance_m)
        area = camera.full_mm2 + camera.other_mm2
        scattered = area * (camera.scatter_near + camera.scatter_air * camera.air_per_m * distance_m)
        return photons * np.array([camera.full_mm2, camera.other_mm2 + scattered])

    here = np.array([15.0, np.log(1e8)])
    steps = 1e-5 * np.eye(2) * here
    gradient = np.array([(expected(*(here + h)) - expected(*(here - h))) / (2.0 * h.sum()) for h in steps])  # (2, channels)
    total = expected(*here) + np.array([camera.full_ps, camera.other_ps])
    fisher = gradient @ np.diag(1.0 / total) @ gradient.T
    found = camera.counts(1e8, np.array([15.0]))
    assert [float(part[0]) for part in found] == pytest.approx([fisher[0, 0], fisher[0, 1], fisher[1, 1]], rel=1e-6)


def test_a_cone_tells_less_the_less_sure_it_is() -> None:
    sure, *unsure, lost = cone_information(661.657, [0.0, 0.12, 0.5, 0.999])
    assert sure > unsure[0] > unsure[1] > lost
    assert lost < 1e-3 * sure
    # A right reading, of 6.3 degrees for 68 % (reference), would give 83; two readings, one of them wrong, give less.
    assert 30.0 < sure < 1.0 / np.radians(6.3) ** 2


def test_it_takes_no_time_worth_mentioning() -> None:
    circled(3, True, errors=replace(BIASED, horizontal_m=0.13, yaw_deg=1.0))
    began = time.process_time()
    circled(3, True, errors=replace(BIASED, horizontal_m=0.13, yaw_deg=1.0))
    assert time.process_time() - began < 0.3
