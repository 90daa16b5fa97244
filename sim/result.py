"""What a simulated flight yields: one flat record for the statistics, and a trace for the figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray


class RunResult(Struct, frozen=True, kw_only=True):
    """One flight. Errors are horizontal, over all tracking samples, lost runs included; truth is the simulation's.

    time_to_x0_s: from the beginning of the search; 0 where it was declared on the way up.

    Safety is judged by true positions at every tick (20 Hz):
        min_separation_m: least horizontal distance of any two drones that are off the ground, climbs and landings included;
            None where no two ever were (a single drone).
        fence_breaches: how often a drone off the ground left the area with its margin or rose above the ceiling, or one that
            follows setpoints (survey, track, reacquire) sank below the floor.
        Off the ground is more than 0.5 m above it. There is no tolerance.

    What the estimator claims against what is true:
        error_relative_median_m: as error_median_m, but of where each vehicle's own localisation puts the source, which is what it
            flies to, against the source as that localisation would see it (the truth and the vehicle's position error);
            None where the position errors are not known.
        x0_rms_m: horizontal RMS of the posterior when x0 was declared.
        error_sample_m, nees_sample, region: of the first drone at one instant of the run, half-way through the tracking that the
            scenario asks for (of a run that ends before: its last tracking sample). region: probability of the smallest region
            of the posterior, as a Gaussian, that holds the truth: at most 0.9 where the truth is in the 90 % region.
        bound_median_m, bound_relative_median_m: what error_median_m and error_relative_median_m could be at best for the
            trajectories flown (``sim.bound``).

    Of frames that are estimated, as the first drone has them (None, or empty, where all are exact):
        best_position_error_m: median while tracking of the error of the drone whose own localisation is the best, against the
            mission frame as it lay at the start. Errors of frames are of the drones' places, horizontal.
        frames_known_s: when all frames were known first, since the start of the simulation.
        frame_error_median_m: over all drones and the tracking, where the frame is known.
        suspects: drones that were suspected for more than half of the tracking, separated by commas.
        recovery_s: how long after the first event of the scenario's localisation the hypothesis' error was above 3 m (twice its
            median before, where that is more) for the last time; 60 where that took longer or never ended; None without event.

    Of a flight that finds nothing:
        nothing_found: what the mission says in the end: no source, or none that is strong enough (of an estimator that only
            listened: it excludes what the mission is after).
        excluded_bq: a source of this activity or more would have been found, wherever in the area, as known when the mission said
            that there was nothing, else in the end; None where there is a hypothesis, or nothing is excluded.
        false_hypothesis: there was a hypothesis although there is no source.

    ``wall_s`` and ``realtime_factor`` are the only fields that differ between two runs of one seed.
    """

    scenario: str
    seed: int
    estimator: str
    drones: int
    time_to_x0_s: float | None
    x0_error_m: float | None
    tracking_time_s: float
    lost: bool
    error_median_m: float | None
    error_mean_m: float | None
    error_p90_m: float | None
    nees_mean: float | None
    cones: int
    hits: int
    min_separation_m: float | None
    fence_breaches: int
    sim_s: float
    wall_s: float
    realtime_factor: float
    error_relative_median_m: float | None = None
    x0_rms_m: float | None = None
    error_sample_m: float | None = None
    nees_sample: float | None = None
    region: float | None = None
    bound_median_m: float | None = None
    bound_relative_median_m: float | None = None
    nothing_found: bool = False
    excluded_bq: float | None = None
    false_hypothesis: bool = False
    best_position_error_m: float | None = None
    frames_known_s: float | None = None
    frame_error_median_m: float | None = None
    suspects: str = ""
    recovery_s: float | None = None


@dataclass(frozen=True, slots=True)
class ConeTrace:
    """A cone that was published, in the mission frame, most probable order first. axis: (2, 3), theta_rad: (2,)."""

    time_s: float
    drone: int
    apex_m: NDArray[np.float64]
    axis: NDArray[np.float64]
    theta_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Trace:
    """Time series of one flight, sampled at a fixed rate from the takeoff of the first drone on. Mission frame ENU, metres.

    time_s: (T,) since the start of the simulation.
    position_m, velocity_mps: (T, N, 3), true.
    stage: (T, N) of protocol Stage strings.
    source_m: (T, 3), true; NaN where there is no source.
    hypothesis_m: (T, N, 3) of each drone, NaN where it has none.
    covariance_m2: (T, 2, 2) of the first drone's posterior, NaN where it has none; sigma_m: (T,) its RMS.
    activity_bq, activity_sigma_bq, evidence: (T,) of the first drone's hypothesis, NaN where the estimator does not know.
    bound_m: (T,) least median error for the trajectories flown so far (``sim.bound``), NaN where there is no source.
    own_error_m, own_bound_m: (T,) error in the first vehicle's own frame, NaN where it is not known; what it could be at best.
    source_bq: true activity, None where there is no source.
    spacing_error_deg: (T, N), signed deviation from 360/N of the gap to the next drone, counter-clockwise around the hypothesis;
    NaN before tracking.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]
    stage: NDArray[np.str_]
    source_m: NDArray[np.float64]
    hypothesis_m: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    activity_bq: NDArray[np.float64]
    activity_sigma_bq: NDArray[np.float64]
    evidence: NDArray[np.float64]
    bound_m: NDArray[np.float64]
    own_error_m: NDArray[np.float64]
    own_bound_m: NDArray[np.float64]
    spacing_error_deg: NDArray[np.float64]
    cones: tuple[ConeTrace, ...]
    area_m: NDArray[np.float64]  # (P, 2) corners of the searched area
    drones: tuple[str, ...]
    source_bq: float | None = None


@dataclass(frozen=True, slots=True)
class Flight:
    """A finished flight. ``listened``: results of the estimators that heard the same cones but did not fly."""

    result: RunResult
    trace: Trace
    listened: dict[str, RunResult]
