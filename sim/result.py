"""Results of a simulated flight: one record for the statistics, and a trace for the figures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.protocol.messages import Source as Found


class RunResult(Struct, frozen=True, kw_only=True):
    """Scores of one simulated flight.

    Errors are horizontal, over all tracking samples, lost runs included. The truth is the simulation's; of several sources, the
    true source is the one nearest to the estimate.

    time_to_x0_s: time of the first estimate (x0) since the beginning of the search; 0 if it came during the climb.

    Safety is judged by true positions at every tick (20 Hz):

        min_separation_m: smallest horizontal distance between two drones off the ground, including climbs and landings;
            None if there never were two (a single drone).
        fence_breaches: number of times that a drone off the ground left the area with its margin or rose above the ceiling, or
            that a drone that follows setpoints (survey, track, reacquire) sank below the floor.

        Off the ground is more than 0.5 m above it. There is no tolerance.

    Horizontal deviations of the vehicles from their plans, by the drones' own poses and plans (None without any):

        deviation_search_m, deviation_circle_m: RMS in the survey, and while tracking, including the approach to the circle.
        deviation_most_m: the largest deviation in both.

    Stated uncertainty against the truth:

        error_relative_median_m: like error_median_m, but in each vehicle's own localisation, by which it flies: its position of
            the source against the true one plus the vehicle's position error; None where the position errors are unknown.
        x0_rms_m: horizontal RMS of the posterior at the time of the first estimate.
        error_sample_m, nees_sample, region: error, normalised squared error and region of the first drone at one time of the
            flight, half-way through the scenario's tracking time (of a flight that ends before: its last tracking sample).
            region: probability of the smallest region of the posterior, as a Gaussian, that contains the truth: at most 0.9
            where the truth is in the 90 % region.
        bound_median_m, bound_relative_median_m: smallest possible error_median_m and error_relative_median_m for the
            trajectories flown (``radron.sim.scoring.bound``).

    Estimated local frames, of the first drone (None, or empty, if all are exact):

        best_position_error_m: median error, while tracking, of the drone with the best localisation, against the mission
            frame at the start. Frame errors are horizontal errors of the drones' positions.
        frames_known_s: first time at which all frames were known, since the start of the simulation.
        frame_error_median_m: over all drones and the tracking, where the frame is known.
        suspects: drones suspected of a wrong localisation for more than half of the tracking, separated by commas.
        recovery_s: time from the first localisation event of the scenario until the estimate's error was last above 3 m (twice
            its median before, if that is more); at most 60; None without event.

    All sources of the first drone's last estimate against all true sources at that time, matched one to one
    (``radron.sim.scoring.sourcescore``); None if the source's position is given, and for an estimator that only listens:

        sources_true, sources_found: numbers of true and of estimated sources. number_right: both are equal and all are matched.
        false_sources: estimated sources without a match. nuclides_right: matches with the right nuclide.
        matched_error_median_m, matched_error_p90_m, height_error_median_m: of the matches, horizontal, and of the estimated
            heights. activity_error_median: relative.
        in_region_90: share of the matches whose truth is in the 90 % region of the estimate, a Gaussian over the plane.

    The first drone's last map of contaminated ground against the true ground (``radron.sim.scoring.groundscore``); None without
    a map, and for an estimator that only listens; amounts of an area without contamination of the map's nuclide are None:

        decision: what is there by the map; decision_right: whether it is. With contaminated ground, hot spots count as true
            sources: false_sources counts points told where none is.
        total_error: relative error of the area's activity; total_in_90: the true one is in the stated 90 % interval.
        block_error_median: median relative error of the blocks above half of the highest true one; blocks_in_90: share of these
            whose truth is in the stated 90 % interval.
        dose_error_median: relative error of the highest dose rate 1 m above the ground.
        map_first_s: time of the first map since the beginning of the search.

    A flight that finds nothing:

        nothing_found: the mission's result: no source, or none that is strong enough (for an estimator that only listens:
            it excludes the activities of the mission's search).
        finding, finding_code: this result, as reported by the first drone, and its code; empty for an estimator that only
            listens.
        excluded_bq: a source of this activity or more would have been found anywhere in the area, at the time of that result,
            else at the end; None with an estimate of one source, or without exclusion. Of a search for several sources
            of unknown nuclides: for the nuclide that is hardest to find, beside the found sources.
        excluded_nuclides_bq: this activity at the end for each nuclide, of such a search; only nuclides with an exclusion.
        false_hypothesis: there was an estimate although there is no source.

    ``wall_s`` and ``realtime_factor`` are the only fields that differ between two flights with equal seeds.
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
    finding: str = ""
    finding_code: str = ""
    excluded_bq: float | None = None
    excluded_nuclides_bq: dict[str, float] | None = None
    false_hypothesis: bool = False
    best_position_error_m: float | None = None
    frames_known_s: float | None = None
    frame_error_median_m: float | None = None
    suspects: str = ""
    recovery_s: float | None = None
    deviation_search_m: float | None = None
    deviation_circle_m: float | None = None
    deviation_most_m: float | None = None
    sources_true: int | None = None
    sources_found: int | None = None
    number_right: bool | None = None
    false_sources: int | None = None
    nuclides_right: int | None = None
    matched_error_median_m: float | None = None
    matched_error_p90_m: float | None = None
    activity_error_median: float | None = None
    in_region_90: float | None = None
    height_error_median_m: float | None = None
    decision: str | None = None
    decision_right: bool | None = None
    total_error: float | None = None
    total_in_90: bool | None = None
    block_error_median: float | None = None
    blocks_in_90: float | None = None
    dose_error_median: float | None = None
    map_first_s: float | None = None


@dataclass(frozen=True, slots=True)
class ConeTrace:
    """A Compton cone that a drone has published in a flight, in the mission frame.

    A cone has two possible readings (which of two clusters of pixels was the recoil electron), the more probable one first.
    ``apex_m``: (3,) position of the camera. ``axis``: (2, 3) unit vector of each reading. ``theta_rad``: (2,) opening angle of
    each reading.
    """

    time_s: float
    drone: int
    apex_m: NDArray[np.float64]
    axis: NDArray[np.float64]
    theta_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FaultTrace:
    """A fault that was injected in a simulated flight.

    ``label``: its name. ``drones``: indices of the affected drones. ``begin_s``, ``end_s``: times within the flight.
    """

    label: str
    drones: tuple[int, ...]
    begin_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class SourceTrace:
    """A true radioactive source of a simulated flight. ``place_m``: position in the mission frame, at the end of the flight."""

    nuclide: str
    activity_bq: float
    place_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class EstimateTrace:
    """An estimate of the sources that was published in a flight, with its time."""

    time_s: float
    sources: tuple[Found, ...]


@dataclass(frozen=True, slots=True)
class Trace:
    """Time series of one simulated flight, sampled at a fixed rate from the takeoff of the first drone on.

    Coordinates are in the mission frame (ENU), metres. T samples, N drones. The "first drone" is drone 0, or the first one whose
    agent (onboard software) still lives; ``judged`` tells which drone this is at each time.

    Attributes:
        time_s: (T,) time since the start of the simulation.
        position_m, velocity_mps: (T, N, 3) true values.
        stage: (T, N) strings of the protocol's ``Stage``.
        source_m: (T, 3) true position of the source; NaN without a source; of several, the source nearest to the first drone's
            estimate.
        hypothesis_m: (T, N, 3) source position estimated by each drone, NaN without an estimate.
        covariance_m2: (T, 2, 2) of the first drone's posterior, NaN without one.
        sigma_m: (T,) RMS of that posterior.
        activity_bq, activity_sigma_bq, evidence: (T,) of the first drone's estimate, NaN where the estimator does not give them.
        bound_m: (T,) smallest possible median error for the trajectories flown so far (``radron.sim.scoring.bound``), NaN without
            a source, and with several.
        own_error_m, own_bound_m: (T,) error in the first vehicle's own local frame, NaN where unknown; and its bound.
        spacing_error_deg: (T, N) deviation of the gap to the next drone on the circle from 360 degrees / n, of the n drones (two
            or more) that track at a time; the gap is counted counter-clockwise around the estimate; NaN for other drones.
        cones: all published cones.
        area_m: (P, 2) corners of the searched area.
        drones: ids of the drones.
        judged: (T,) index of the drone that is called the first one.
        faults: injected faults.
        source_bq: true activity of the source that is nearest to the estimate at the end, None without one.
        truths: all true sources.
        estimates: as the first drone published them, each source with its nuclide.
        left_m: (C, 2) places where a search for several sources has not excluded a further one at the end.
        glare_m: (C, 2) places beside found sources that outshine a further one.
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
    judged: NDArray[np.intp]
    faults: tuple[FaultTrace, ...] = ()
    source_bq: float | None = None
    truths: tuple[SourceTrace, ...] = ()
    estimates: tuple[EstimateTrace, ...] = ()
    left_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    glare_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))

    @property
    def estimate_m(self) -> NDArray[np.float64]:
        """(T, 3) source position estimated by the first drone (drone 0, or the first one whose agent still lives)."""
        return self.hypothesis_m[np.arange(len(self.judged)), self.judged]

    @property
    def swarm_stage(self) -> NDArray[np.str_]:
        """(T,) mission stage of the first drone, which represents the swarm."""
        return self.stage[np.arange(len(self.judged)), self.judged]


@dataclass(frozen=True, slots=True)
class Flight:
    """A finished simulated flight with its scores and time series.

    ``listened``: scores of the estimators that received the same cones, but did not determine where to fly, by name.
    """

    result: RunResult
    trace: Trace
    listened: dict[str, RunResult]
