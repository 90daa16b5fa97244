"""Compares the agents' estimates with the truth during a run: decides on its end, and makes its result and trace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType

import numpy as np
from msgspec.structs import asdict, replace
from shapely import Polygon

from radron.protocol.messages import AnyMessage, Pose, Stage
from radron.protocol.stages import CIRCLING, SEARCHING
from radron.sim.faults.told import told_faults
from radron.sim.geometry import Array
from radron.sim.result import RunResult, SourceTrace, Trace
from radron.sim.scenario import Scenario
from radron.sim.scoring.believers import Agent, Believer, excluded_nuclides_bq, open_places
from radron.sim.scoring.bound import Bound, bound_of
from radron.sim.scoring.framescore import FrameScore
from radron.sim.scoring.groundscore import GroundScore, score_ground
from radron.sim.scoring.heard import Heard
from radron.sim.scoring.moment import OFF_GROUND_M
from radron.sim.scoring.safety import Safety
from radron.sim.scoring.samples import Row
from radron.sim.scoring.score import Score, error_m, own_error_m
from radron.sim.scoring.sourcescore import SourceScore, score_sources
from radron.sim.world.contamination import Contaminated, contaminated_ground
from radron.sim.world.frame import LocalFrames
from radron.sim.world.sources import Source
from radron.sim.world.streams import streams
from radron.sim.world.terrain import Terrain

SAMPLE_TICKS = 4  # 5 Hz
MAX_START_S = 120.0  # without a search: the drones do not start at all
LOST_NO_CONE_S = 20.0
NOT_SCORED = SourceScore()


class Recorder:
    """Observes a simulated flight: compares the agents' estimates with the truth, decides on the end, and makes the results."""

    def __init__(
        self,
        scenario: Scenario,
        agents: Sequence[Agent],
        frames: LocalFrames,
        tick_s: float,
        listeners: Mapping[str, Believer] = MappingProxyType({}),
        known: FrameScore | None = None,
    ) -> None:
        """Start the record of a flight.

        Args:
            scenario: scenario of the flight.
            agents: agents of the mission's drones.
            frames: the vehicles' true local frames.
            tick_s: interval of the samples.
            listeners: estimators without influence on the flight, by name.
            known: score of the estimated local frames; None: all frames are exact.
        """
        self._sample_s = SAMPLE_TICKS * tick_s
        self._known = known
        self._scenario = scenario
        self._mission = mission = scenario.mission
        self._agents = agents
        self._first = 0  # the drone that represents the swarm by its stage and estimate
        self.area = Polygon(mission.area.polygon_m)
        self._safety = Safety(mission.area)
        self._terrain = Terrain(scenario.terrain)
        drones = [drone.id for drone in mission.drones]
        middle_s = (mission.track.duration_s or scenario.end.track_s) / 2.0
        self._score = Score(mission.fusion.estimator, drones, middle_s)
        self._listeners = {name: (Score(name, drones, middle_s), fusion) for name, fusion in listeners.items()}
        self._estimated = mission.fusion.estimator != "given"
        self._search_began_s: float | None = None
        self._excluded_bq: float | None = None  # at the end of the first drone's search without a find
        self._tracking_s = 0.0
        self._sampled_s: float | None = None
        self._heard = Heard(frames, mission.one_nuclide)
        self._ticks = 0
        self._time_s = 0.0
        self._rows: list[Row] = []
        self._sources: Sequence[Source] = ()

    def describe(self) -> str:
        """Return one line of text on the state of the flight, for the progress display."""
        first = self._agents[self._first]
        where = ""
        if first.hypothesis is not None:
            x, y = first.hypothesis.position[:2]
            where = f", source near ({x:.1f}, {y:.1f}) m"
        return f"{first.stage}{where}"

    def take(self, drone: int, message: AnyMessage) -> None:
        """Record a drone's message, at the time of sending."""
        judged = drone == self._first
        self._heard.take(self._time_s, drone, message, self._agents[drone].stage, judged)
        if isinstance(message, Pose) and self._known is not None:
            self._known.hear(drone, message.epoch)

    def sample(
        self,
        time_s: float,
        position: Array,
        velocity: Array,
        sources: Sequence[Source],
        position_error: Array | None = None,
    ) -> bool:
        """Record the state of the world after a tick (time step); return True if the flight is to end.

        position, velocity: (N, 3), true, of N drones. position_error: (N, 3), measured minus true; None if unknown.
        """
        self._time_s = time_s
        self._ticks += 1
        self._sources = sources
        self._choose_first()
        judged = self._judged()
        source = None if judged is None else judged.place_m[:2]
        stages = [agent.stage for agent in self._agents]
        above = self._terrain.above_ground(position)
        self._safety.sample(above, stages)
        self._record_finding()
        if self._search_began_s is None and any(stage in SEARCHING for stage in stages):
            self._search_began_s = time_s
        if source is not None or self._estimated:
            self._score.record_x0(time_s, self._agents[self._first].hypothesis, source)
        for score, listener in self._listeners.values():
            score.record_x0(time_s, listener.hypothesis, source)
        if self._ticks % SAMPLE_TICKS == 0 and above[:, 2].max() > OFF_GROUND_M:
            self._record(time_s, position, velocity, judged, position_error, stages)
        return self._over(time_s, stages)

    def _choose_first(self) -> None:
        """Choose the drone that represents the swarm: the first drone while its agent lives, then the first with a live agent."""
        if not self._agents[self._first].alive:
            self._first = next((place for place, agent in enumerate(self._agents) if agent.alive), self._first)

    def _judged(self) -> Source | None:
        """Return the true source nearest to the hypothesis; None without a source."""
        belief = self._agents[self._first].hypothesis
        if belief is None or not self._sources:
            return self._sources[0] if self._sources else None
        return min(self._sources, key=lambda source: error_m(belief, source.place_m[:2]))

    def _record(
        self,
        time_s: float,
        position: Array,
        velocity: Array,
        judged: Source | None,
        position_error: Array | None,
        stages: list[Stage],
    ) -> None:
        source = None if judged is None else judged.place_m[:2]
        beliefs = [agent.hypothesis for agent in self._agents]
        tracking = stages[self._first] in CIRCLING
        since_s = self._sample_s if self._sampled_s is None else time_s - self._sampled_s
        self._sampled_s = time_s
        if tracking:
            self._tracking_s += max(1, round(since_s / self._sample_s)) * self._sample_s  # live, a busy machine drops samples
        if self._known is not None and position_error is not None:
            position_error = self._known.sample(time_s, tracking, position, position_error)
        if tracking and source is not None:
            self._score.sample(self._tracking_s, beliefs, source, position_error, self._first)
            if self._scenario.end.lost == "error":
                self._score.check_lost(time_s)
            for score, listener in self._listeners.values():
                score.sample(self._tracking_s, [listener.hypothesis] * len(beliefs), source, position_error)
                score.check_lost(time_s)
        row = Row.of(time_s, position, velocity, None if judged is None else judged.place_m, stages, beliefs, self._first)
        first = beliefs[self._first]
        if self._known is not None and source is not None:
            self._known.follow(time_s, None if first is None else error_m(first, source))
        if first is not None and source is not None and position_error is not None:
            row.own_error_m = own_error_m(first, self._mission.drones[self._first].id, source, position_error[self._first])
        self._rows.append(row)

    def _record_finding(self) -> None:
        """Record the exclusion limits at the end of the first drone's search without a source; a later find clears them."""
        first = self._agents[self._first]
        if first.finding is None:
            self._excluded_bq = None
        elif self._excluded_bq is None:
            self._excluded_bq = _excluded_bq(first)

    def _over(self, time_s: float, stages: list[Stage]) -> bool:
        end = self._scenario.end
        if all(stage is Stage.LANDED for stage in stages):
            return True
        if self._search_began_s is None:
            return time_s > MAX_START_S
        if time_s - self._search_began_s > end.longest_s(self._mission):
            return True
        if stages[self._first] in CIRCLING and end.lost == "no-cone":
            since_s = max(self._heard.last_cone_s, self._score.x0_s or time_s)
            if self._tracking_s > 0.0 and time_s - since_s > LOST_NO_CONE_S:
                self._score.lost = True
                return True
        if self._tracking_s >= end.track_s - 1e-9:
            return self._mission.track.duration_s is None
        return self._score.x0_s is None and time_s - self._search_began_s > end.search_s

    def result(self, seed: int, wall_s: float) -> RunResult:
        """Return the scores of the flight for the swarm's own estimator."""
        first = self._agents[self._first]
        excluded_bq = self._excluded_bq or _excluded_bq(first)
        by_nuclide = excluded_nuclides_bq(first)
        ground = contaminated_ground(self._scenario, streams(seed, len(self._agents)))
        spots = [spot for part in ground for spot in part.spots]
        sources, found = self._source_score(spots), first.finding
        result = self._result(self._score, found is not None, excluded_bq, seed, wall_s, sources, by_nuclide)
        told = {} if found is None else {"finding": str(found), "finding_code": found.code}
        return replace(result, **told, **asdict(self._ground_score(ground)))

    def listened(self, seed: int, wall_s: float) -> dict[str, RunResult]:
        """Return the scores of the estimators without influence on the flight, by name."""
        return {
            name: self._result(score, self._enough(_excluded_bq(fusion)), _excluded_bq(fusion), seed, wall_s)
            for name, (score, fusion) in self._listeners.items()
        }

    def _enough(self, excluded_bq: float | None) -> bool:
        """Return whether all activities of the mission's search are excluded."""
        least_bq = self._mission.survey.least_activity_bq
        return least_bq is not None and excluded_bq is not None and excluded_bq <= least_bq

    def _ground_score(self, ground: Sequence[Contaminated]) -> GroundScore:
        """Score the last map of contaminated ground against the true one."""
        kind = "soil" if self._scenario.ground is None else self._scenario.ground.kind
        score = score_ground(ground, bool(self._sources), self.area, kind, self._heard.contamination)
        first_s, began_s = self._heard.map_first_s, self._search_began_s or 0.0
        return replace(score, map_first_s=None if first_s is None else max(0.0, round(first_s - began_s, 6)))

    def _source_score(self, spots: Sequence[Source]) -> SourceScore:
        """Score all sources of the last estimate, if that still holds, against all true ones and hot spots of the ground."""
        if not self._estimated:
            return NOT_SCORED
        held = self._agents[self._first].hypothesis is not None and self._heard.estimates
        return score_sources([*self._sources, *spots], self._heard.estimates[-1].sources if held else ())

    def _result(
        self, score: Score, nothing_found: bool, excluded_bq: float | None, seed: int, wall_s: float,
        sources: SourceScore = NOT_SCORED, excluded_nuclides_bq: dict[str, float] | None = None,
    ) -> RunResult:  # fmt: skip
        errors = np.array(score.errors_m)
        bound_m, bound_relative_m = self._bounds_m()
        sampled = score.sampled
        sim_s = round(self._time_s, 6)
        return RunResult(
            scenario=self._scenario.name,
            seed=seed,
            estimator=score.estimator,
            drones=len(self._agents),
            time_to_x0_s=None if score.x0_s is None else max(0.0, round(score.x0_s - (self._search_began_s or 0.0), 6)),
            x0_error_m=score.x0_error_m,
            tracking_time_s=round(self._tracking_s, 6),
            lost=score.lost,
            error_median_m=float(np.median(errors)) if len(errors) else None,
            error_mean_m=float(np.mean(errors)) if len(errors) else None,
            error_p90_m=float(np.quantile(errors, 0.9)) if len(errors) else None,
            nees_mean=float(np.mean(score.nees)) if score.nees else None,
            cones=len(self._heard.cones),
            hits=self._heard.hits,
            min_separation_m=self._safety.least_separation_m(),
            fence_breaches=self._safety.fence_breaches(),
            deviation_search_m=self._heard.following.rms_m("search"),
            deviation_circle_m=self._heard.following.rms_m("circle"),
            deviation_most_m=self._heard.following.most_m,
            sim_s=sim_s,
            wall_s=wall_s,
            realtime_factor=sim_s / wall_s,
            error_relative_median_m=float(np.median(score.relative_m)) if score.relative_m else None,
            x0_rms_m=score.x0_rms_m,
            error_sample_m=sampled.error_m if sampled is not None else None,
            nees_sample=sampled.nees if sampled is not None else None,
            region=sampled.region if sampled is not None else None,
            bound_median_m=bound_m,
            bound_relative_median_m=bound_relative_m,
            nothing_found=nothing_found,
            excluded_bq=excluded_bq,
            excluded_nuclides_bq=excluded_nuclides_bq,
            false_hypothesis=not self._sources and score.x0_s is not None,
            best_position_error_m=self._known.best_position_error_m if self._known is not None else None,
            frames_known_s=self._known.known_s if self._known is not None else None,
            frame_error_median_m=self._known.error_median_m if self._known is not None else None,
            suspects=self._known.suspects if self._known is not None else "",
            recovery_s=self._known.recovery_s if self._known is not None else None,
            **asdict(sources),
        )

    @cached_property
    def _bound(self) -> Bound | None:
        """Return the bound of the flown trajectories, after the run; None without a source, and with several."""
        truth, (west, south, east, north) = self._scenario, self.area.bounds
        rows = [row for row in self._rows if not np.isnan(row.source[0])]
        if truth.source is None or len(self._sources) != 1 or truth.contamination or not rows:
            return None
        return bound_of(
            truth.source,
            truth.camera,
            self._mission.detection.minimum_pixels,
            truth.localization,
            (east - west, north - south),
            np.array([row.time_s for row in rows]),
            np.array([row.position for row in rows]),
            np.array([row.source for row in rows]),
        )

    def _bounds_m(self) -> tuple[float | None, float | None]:
        """Return the medians of the bound while tracking, in the true frame and in the vehicles' own frames, m."""
        bound = self._bound
        if bound is None:
            return None, None
        times = [row.time_s for row in self._rows if row.stages[row.first] in CIRCLING]
        during = np.isin(bound.time_s, times)
        return bound.median_m(during), bound.own_median_m(during)

    def trace(self) -> Trace:
        """Return the time series of the flight.

        Raises:
            ValueError: no drone ever flew.
        """
        if not self._rows:
            raise ValueError("no drone flew: there is nothing to show")
        rows, source = self._rows, self._judged()
        names = tuple(drone.id for drone in self._mission.drones)
        time_s = np.array([row.time_s for row in rows])
        bound, unknown = self._bound, np.full(time_s.shape, np.nan)
        return Trace(
            time_s=time_s,
            position_m=np.array([row.position for row in rows]),
            velocity_mps=np.array([row.velocity for row in rows]),
            stage=np.array([[str(stage) for stage in row.stages] for row in rows]),
            source_m=np.array([row.source for row in rows]),
            hypothesis_m=np.array([row.hypothesis for row in rows]),
            sigma_m=np.array([row.sigma_m for row in rows]),
            covariance_m2=np.array([row.covariance for row in rows]),
            activity_bq=np.array([row.activity_bq for row in rows]),
            activity_sigma_bq=np.array([row.activity_sigma_bq for row in rows]),
            evidence=np.array([row.evidence for row in rows]),
            bound_m=unknown if bound is None else bound.over(time_s),
            own_error_m=np.array([row.own_error_m for row in rows]),
            own_bound_m=unknown if bound is None else bound.own_over(time_s),
            spacing_error_deg=np.array([row.spacing_error_deg for row in rows]),
            cones=tuple(self._heard.cones),
            area_m=np.array(self._mission.area.polygon_m, dtype=np.float64),
            drones=names,
            judged=np.array([row.first for row in rows]),
            faults=told_faults(self._scenario.fault, names, float(time_s[-1])),
            source_bq=None if source is None else source.activity_bq,
            truths=tuple(SourceTrace(each.nuclide, each.activity_bq, each.place_m) for each in self._sources),
            estimates=tuple(self._heard.estimates),
            **open_places(self._agents[self._first]),
        )


def _excluded_bq(believer: Believer) -> float | None:
    outlook = believer.outlook
    return outlook.excluded_bq if outlook is not None else None
