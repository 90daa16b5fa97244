"""Holds what the agents believe against the truth while a run goes on: ends it, and makes its result and trace."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from agent.config import MissionConfig
from agent.pilot import Pilot
from protocol.codec import decode
from protocol.messages import Cone, Exposure, Stage
from sim.frame import LocalFrames
from sim.result import ConeTrace, RunResult, Trace
from sim.scenario import Scenario

SAMPLE_TICKS = 4  # 5 Hz
LOST_ERROR_M = 20.0
LOST_ERROR_S = 10.0
LOST_NO_CONE_S = 20.0
_TRACKING = (Stage.TRACK, Stage.REACQUIRE)
Array = NDArray[np.float64]


class Believer(Protocol):
    """Whatever holds a hypothesis: a pilot, or an estimator that only listens."""

    @property
    def hypothesis(self) -> Belief | None:
        """Where the source is believed to be, if anywhere."""


class Belief(Protocol):
    """What the recorder reads of a hypothesis: mission frame, metres."""

    @property
    def position(self) -> Array:
        """(3,)."""

    @property
    def covariance(self) -> Array:
        """(3, 3)."""


class Score:
    """Errors of one estimator against the truth."""

    def __init__(self, estimator: str) -> None:
        self.estimator = estimator
        self.x0_s: float | None = None
        self.x0_error_m: float | None = None
        self.errors_m: list[float] = []
        self.nees: list[float] = []
        self.lost = False
        self._bad_since_s: float | None = None

    def note_x0(self, time_s: float, belief: Belief | None, source: tuple[float, float]) -> None:
        """Take down when the first hypothesis came, and how good it was."""
        if self.x0_s is None and belief is not None:
            self.x0_s = time_s
            self.x0_error_m = _offset(belief, source)[2]

    def sample(self, time_s: float, belief: Belief | None, source: tuple[float, float]) -> None:
        """One tracking sample; a believer without hypothesis has none."""
        if belief is None:
            return
        dx, dy, error = _offset(belief, source)
        self.errors_m.append(error)
        cov = belief.covariance
        a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
        determinant = a * c - b * b
        if determinant > 0.0:
            self.nees.append((c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant)

    def judge_by_error(self, time_s: float) -> None:
        """Lost when the newest error has been above the limit for long."""
        if not self.errors_m or self.errors_m[-1] <= LOST_ERROR_M:
            self._bad_since_s = None
        elif self._bad_since_s is None:
            self._bad_since_s = time_s
        elif time_s - self._bad_since_s >= LOST_ERROR_S:
            self.lost = True


class Recorder:
    """Watches a run."""

    def __init__(self, scenario: Scenario, mission: MissionConfig, pilots: Sequence[Pilot], frames: LocalFrames) -> None:
        self._frames = frames
        self._scenario = scenario
        self._mission = mission
        self._pilots = pilots
        self.area = Polygon(mission.area.polygon_m)
        self._fence = self.area.buffer(mission.area.fence_margin_m)
        shapely.prepare(self._fence)
        self._score = Score(mission.fusion.estimator)
        self._listeners = {name: (Score(name), fusion) for name, fusion in pilots[0].listeners.items()}
        self._search_began_s: float | None = None
        self._tracking_s = 0.0
        self._last_cone_s = 0.0
        self._cones: list[ConeTrace] = []
        self._hits = 0
        self._places: list[Array] = []  # (N, 3) at every tick
        self._airborne: list[list[bool]] = []
        self._ticks = 0
        self._time_s = 0.0
        self._rows: list[_Row] = []

    def describe(self) -> str:
        """One line for the progress display."""
        pilot = self._pilots[0]
        where = ""
        if pilot.hypothesis is not None:
            x, y = pilot.hypothesis.position[:2]
            where = f", source near ({x:.1f}, {y:.1f}) m"
        return f"{pilot.stage}{where}"

    def hear(self, drone: int, key: str, payload: bytes) -> None:
        """Listen to what a drone publishes."""
        if not key.endswith(("/cone", "/exposure")):
            return
        message = decode(payload)
        if isinstance(message, Exposure):
            self._hits += message.counts.hits
        elif isinstance(message, Cone):
            self._last_cone_s = self._time_s
            matrix, origin = self._frames.matrix[drone], self._frames.origin[drone]
            orders = sorted(message.orders, key=lambda order: -order.probability)
            self._cones.append(
                ConeTrace(
                    time_s=self._time_s,
                    drone=drone,
                    apex_m=matrix @ message.apex_m + origin,
                    axis=np.array([order.axis for order in orders]) @ matrix.T,
                    theta_rad=np.array([order.theta_rad for order in orders]),
                )
            )

    def sample(
        self, time_s: float, position: Array, velocity: Array, source: tuple[float, float] | None, in_air: Sequence[bool]
    ) -> bool:
        """Look at the world after a tick; True when the run has ended."""
        self._time_s = time_s
        self._ticks += 1
        self._places.append(position.copy())
        self._airborne.append(list(in_air))
        stages = [pilot.stage for pilot in self._pilots]
        if self._search_began_s is None and any(stage in (Stage.SURVEY, *_TRACKING) for stage in stages):
            self._search_began_s = time_s
        if source is not None:
            self._score.note_x0(time_s, self._pilots[0].hypothesis, source)
            for score, listener in self._listeners.values():
                score.note_x0(time_s, listener.hypothesis, source)
        if self._ticks % SAMPLE_TICKS == 0 and any(in_air):
            self._record(time_s, position, velocity, source, stages)
        return self._over(time_s, stages)

    def _record(
        self, time_s: float, position: Array, velocity: Array, source: tuple[float, float] | None, stages: list[Stage]
    ) -> None:
        beliefs = [pilot.hypothesis for pilot in self._pilots]
        tracking = stages[0] in _TRACKING
        if tracking:
            self._tracking_s += SAMPLE_TICKS * 0.05
        if tracking and source is not None:
            for belief in beliefs:
                self._score.sample(time_s, belief, source)
            if self._scenario.end.lost == "error":
                self._score.judge_by_error(time_s)
            for score, listener in self._listeners.values():
                score.sample(time_s, listener.hypothesis, source)
                score.judge_by_error(time_s)
        self._rows.append(_Row.of(time_s, position, velocity, source, stages, beliefs))

    def _over(self, time_s: float, stages: list[Stage]) -> bool:
        end = self._scenario.end
        if all(stage is Stage.LANDED for stage in stages):
            return True
        if self._search_began_s is None:
            return time_s > 120.0
        if stages[0] in _TRACKING and end.lost == "no-cone":
            since_s = max(self._last_cone_s, self._score.x0_s or time_s)
            if self._tracking_s > 0.0 and time_s - since_s > LOST_NO_CONE_S:
                self._score.lost = True
                return True
        if self._tracking_s >= end.track_s - 1e-9:
            return self._mission.track.duration_s is None
        return self._score.x0_s is None and time_s - self._search_began_s > end.search_s

    def result(self, seed: int, wall_s: float) -> RunResult:
        """The record of the swarm's own estimator."""
        return self._result(self._score, seed, wall_s)

    def listened(self, seed: int, wall_s: float) -> dict[str, RunResult]:
        """The records of the listening estimators."""
        return {name: self._result(score, seed, wall_s) for name, (score, _) in self._listeners.items()}

    def _result(self, score: Score, seed: int, wall_s: float) -> RunResult:
        errors = np.array(score.errors_m)
        sim_s = round(self._time_s, 6)
        return RunResult(
            scenario=self._scenario.name,
            seed=seed,
            estimator=score.estimator,
            drones=len(self._pilots),
            time_to_x0_s=None if score.x0_s is None else round(score.x0_s - (self._search_began_s or 0.0), 6),
            x0_error_m=score.x0_error_m,
            tracking_time_s=round(self._tracking_s, 6),
            lost=score.lost,
            error_median_m=float(np.median(errors)) if len(errors) else None,
            error_mean_m=float(np.mean(errors)) if len(errors) else None,
            error_p90_m=float(np.quantile(errors, 0.9)) if len(errors) else None,
            nees_mean=float(np.mean(score.nees)) if score.nees else None,
            cones=len(self._cones),
            hits=self._hits,
            min_separation_m=self._least_separation_m(),
            fence_breaches=self._fence_breaches(),
            sim_s=sim_s,
            wall_s=wall_s,
            realtime_factor=sim_s / wall_s,
        )

    def _least_separation_m(self) -> float | None:
        """Least distance of any two drones in the air, over all ticks."""
        places, airborne = np.array(self._places), np.array(self._airborne)
        least = np.inf
        for one in range(len(self._pilots)):
            for other in range(one):
                both = airborne[:, one] & airborne[:, other]
                apart = np.linalg.norm(places[both, one] - places[both, other], axis=1)
                least = min(least, float(apart.min(initial=np.inf)))
        return least if np.isfinite(least) else None

    def _fence_breaches(self) -> int:
        """How often a drone in the air went outside the fence or above the ceiling."""
        places, airborne = np.array(self._places), np.array(self._airborne)
        inside = shapely.contains_xy(self._fence, places[..., 0], places[..., 1])
        outside = airborne & (~inside | (places[..., 2] > self._mission.area.ceiling_m))
        return int(outside[0].sum() + (outside[1:] & ~outside[:-1]).sum())

    def trace(self) -> Trace:
        """The time series; raises ValueError where nobody ever flew."""
        if not self._rows:
            raise ValueError("nobody flew: there is nothing to show")
        rows = self._rows
        return Trace(
            time_s=np.array([row.time_s for row in rows]),
            position_m=np.array([row.position for row in rows]),
            velocity_mps=np.array([row.velocity for row in rows]),
            stage=np.array([[str(stage) for stage in row.stages] for row in rows]),
            source_m=np.array([row.source for row in rows]),
            hypothesis_m=np.array([row.hypothesis for row in rows]),
            sigma_m=np.array([row.sigma_m for row in rows]),
            spacing_error_deg=np.array([row.spacing_error_deg for row in rows]),
            cones=tuple(self._cones),
            area_m=np.array(self._mission.area.polygon_m, dtype=np.float64),
            drones=tuple(drone.id for drone in self._mission.drones),
        )


class _Row:
    """One sample of the trace."""

    __slots__ = ("hypothesis", "position", "sigma_m", "source", "spacing_error_deg", "stages", "time_s", "velocity")

    def __init__(self, time_s: float, position: Array, velocity: Array, stages: list[Stage]) -> None:
        self.time_s = time_s
        self.position = position.copy()
        self.velocity = velocity.copy()
        self.stages = stages
        self.source = np.full(3, np.nan)
        self.hypothesis = np.full(position.shape, np.nan)
        self.sigma_m = np.nan
        self.spacing_error_deg = np.full(len(position), np.nan)

    @staticmethod
    def of(
        time_s: float, position: Array, velocity: Array, source: tuple[float, float] | None, stages: list[Stage],
        beliefs: Sequence[Belief | None],
    ) -> _Row:  # fmt: skip
        row = _Row(time_s, position, velocity, stages)
        if source is not None:
            row.source[:] = (*source, 0.0)
        for drone, belief in enumerate(beliefs):
            if belief is not None:
                row.hypothesis[drone] = belief.position
        first = beliefs[0]
        if first is not None:
            cov = first.covariance
            row.sigma_m = float(np.sqrt(max(0.0, cov[0, 0] + cov[1, 1])))
        if first is not None and all(stage in _TRACKING for stage in stages):
            row.spacing_error_deg[:] = spacing_error_deg(position, first.position)
        return row


def spacing_error_deg(position: Array, centre: Array) -> Array:
    """(N,): each drone's gap to the next one counter-clockwise around ``centre``, less the uniform gap, degrees."""
    angle = np.degrees(np.arctan2(position[:, 1] - centre[1], position[:, 0] - centre[0]))
    count = len(angle)
    order = np.argsort(angle, kind="stable")
    gaps = np.diff(angle[order], append=angle[order[0]] + 360.0)
    error = np.empty(count)
    error[order] = gaps - 360.0 / count
    return error


def _offset(belief: Belief, source: tuple[float, float]) -> tuple[float, float, float]:
    dx, dy = float(belief.position[0]) - source[0], float(belief.position[1]) - source[1]
    return dx, dy, (dx * dx + dy * dy) ** 0.5
