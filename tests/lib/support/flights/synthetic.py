"""Synthetic flights: quick, with known numbers, and importable by worker processes, which take the path over."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radron.sim.campaign.workers import Job
from radron.sim.result import ConeTrace, RunResult, Trace
from radron.sim.sweep import Case

SOURCE_M = np.array([60.0, 45.0, 0.0])


@dataclass(frozen=True, slots=True)
class Flight:
    result: RunResult
    trace: Trace
    listened: dict[str, RunResult]


def case(name: str = "near", **point: float) -> Case:
    return Case(name, {"name": name, **point}, tuple(point.items()))  # type: ignore[arg-type]  # fakes do not open the scenario


def synthetic_result(name: str, seed: int, radius_m: float = 12.0, drones: int = 3, estimator: str = "paper") -> RunResult:
    """Deterministic in its arguments; every seventh run never finds the source."""
    rng = np.random.default_rng([seed, len(name), int(10 * radius_m)])
    found = seed % 7 != 6
    error = float(rng.lognormal(0.5, 0.4) * radius_m / 12.0)
    nees = float(np.random.default_rng([seed, len(name)]).chisquare(2))
    wall_s = time.perf_counter()
    return RunResult(
        scenario=name,
        seed=seed,
        estimator=estimator,
        drones=drones,
        time_to_x0_s=float(rng.lognormal(3.6, 0.4)) if found else None,
        x0_error_m=2.0 * error if found else None,
        tracking_time_s=180.0 if found else 0.0,
        lost=not found,
        error_median_m=error if found else None,
        error_mean_m=1.2 * error if found else None,
        error_p90_m=2.0 * error if found else None,
        nees_mean=2.1 if found else None,
        cones=int(rng.integers(100, 200)),
        hits=4000,
        min_separation_m=float(rng.uniform(4.0, 9.0)) if drones > 1 else None,
        fence_breaches=0,
        sim_s=250.0,
        wall_s=wall_s,
        realtime_factor=250.0 / wall_s,
        error_relative_median_m=0.9 * error if found else None,
        x0_rms_m=2.5 * error if found else None,
        error_sample_m=1.1 * error if found else None,
        nees_sample=nees if found else None,
        region=1.0 - float(np.exp(-0.5 * nees)) if found else None,
        bound_median_m=error / (1.2 + 0.02 * seed) if found else None,
        bound_relative_median_m=0.8 * error if found else None,
    )


def fly_synthetic(job: Job) -> RunResult:
    point = dict(job.case.point)
    return synthetic_result(job.case.name, job.seed, float(point.get("radius_m", 12.0)))


def fly_failing(job: Job) -> RunResult:
    """Seed 2 fails."""
    if job.seed == 2:
        raise RuntimeError("the rotor fell off\nand more")
    return fly_synthetic(job)


def fly_dying(job: Job) -> RunResult:
    """Seed 2 takes its process with it."""
    if job.seed == 2:
        os._exit(9)
    return fly_synthetic(job)


def fly_threads(job: Job) -> RunResult:
    """Fails unless set to compute with one thread."""
    assert os.environ["OMP_NUM_THREADS"] == "1"
    return fly_synthetic(job)


def fly_pausing(job: Job) -> RunResult:
    """Leaves its process id beside the flag file that the scenario names, and goes on once the flag is there (not for seed 0)."""
    flag = Path(job.case.scenario["flag"])  # type: ignore[index]
    (flag.parent / f"{os.getpid()}.pid").touch()
    while job.seed > 0 and not flag.exists():
        time.sleep(0.01)
    return fly_synthetic(job)


def synthetic_flight(drones: int = 3, moving: bool = False, steps: bool = False, found: bool = True, seed: int = 1) -> Flight:
    """A survey of 40 s from the south edge, then a circle around the source; ``steps``: a hypothesis that jumps every 60 s."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(1.0, 280.0 if steps else 160.0, 0.2)
    count = len(time_s)
    source = np.tile(SOURCE_M, (count, 1))
    if moving:
        source[:, 0] = 50.0 + 40.0 * np.cos(time_s / 40.0)
        source[:, 1] = 50.0 + 40.0 * np.sin(time_s / 40.0)
    tracking = (time_s > 40.0) & found
    hypothesis = np.full((count, 3), np.nan)
    decay = np.exp(-(time_s - 40.0) / 15.0)
    hypothesis[tracking] = (source + np.outer(8.0 * decay, [1.0, -0.6, 0.0]))[tracking]
    wobble = np.cumsum(rng.normal(0.0, 0.08, (count, 2)), axis=0)
    hypothesis[:, :2] += wobble - wobble.mean(axis=0)
    if steps:
        corner = np.array([[50.0, 50.0], [60.0, 50.0], [60.0, 60.0], [50.0, 60.0], [50.0, 50.0]])
        hypothesis[tracking] = 0.0
        hypothesis[tracking, :2] = corner[(time_s[tracking] // 60.0).astype(int)]
        source[:] = np.nan
    position = np.zeros((count, drones, 3))
    position[:, :, 2] = np.minimum(3.0, time_s)[:, None]
    spacing = np.full((count, drones), np.nan)
    for k in range(drones):
        lane = 50.0 + 6.0 * (k - (drones - 1) / 2.0)
        position[:, k, 0] = lane + 0.8 * (k - 1) * time_s
        position[:, k, 1] = 2.0 + 2.0 * time_s * (1 - 0.4 * (k == 1))
        angle = 0.25 * time_s + 2.0 * np.pi * k / drones
        circle = 12.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        position[tracking, k, :2] = (hypothesis[:, :2] + circle)[tracking]
        since = (time_s - 40.0) % 60.0 if not steps else time_s % 60.0
        spacing[tracking, k] = (40.0 * np.exp(-since / 4.0) * np.cos(since / 3.0 + k) + rng.normal(0.0, 0.7, count))[tracking]
    velocity = np.gradient(position, 0.2, axis=0).clip(-6.0, 6.0)
    stage = np.where(tracking, "track", np.where(time_s < 4.0, "takeoff", "survey"))
    stamps = np.sort(rng.uniform(10.0, time_s[-1], 0 if steps else 120))
    cones = tuple(_cone(rng, float(stamp), position, time_s, source) for stamp in stamps)
    trace = Trace(
        time_s=time_s,
        position_m=position,
        velocity_mps=velocity,
        stage=np.repeat(stage[:, None], drones, axis=1),
        source_m=source,
        hypothesis_m=np.repeat(hypothesis[:, None], drones, axis=1),
        sigma_m=np.where(tracking, 1.5 + 10.0 * decay, np.nan),
        covariance_m2=np.where(tracking, (1.5 + 10.0 * decay) ** 2, np.nan)[:, None, None] * np.array([[0.7, 0.3], [0.3, 0.3]]),
        activity_bq=np.where(tracking, 3e9 * (1.0 + 0.5 * decay), np.nan),
        activity_sigma_bq=np.where(tracking, 3e9 * (0.05 + 0.5 * decay), np.nan),
        evidence=np.where(tracking, 20.0 + time_s, np.nan),
        bound_m=np.where(np.isfinite(source[:, 0]), 5.0 / np.sqrt(time_s), np.nan),
        own_error_m=np.where(tracking & np.isfinite(source[:, 0]), 0.3 + decay, np.nan),
        own_bound_m=np.where(np.isfinite(source[:, 0]), 2.0 / np.sqrt(time_s), np.nan),
        spacing_error_deg=spacing,
        cones=cones,
        area_m=np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]]),
        drones=tuple(f"d{k + 1}" for k in range(drones)),
        judged=np.zeros(count, dtype=np.intp),
        source_bq=None if steps else 3e9,
    )
    return Flight(synthetic_result("near", seed if found else 6, drones=drones), trace, {})


def _cone(rng: np.random.Generator, time_s: float, position: np.ndarray, times: np.ndarray, source: np.ndarray) -> ConeTrace:
    """A cone; its first order contains the source but for 5 degrees."""
    drone = int(rng.integers(position.shape[1]))
    now = int(np.searchsorted(times, time_s))
    apex = position[now, drone]
    towards = source[now] - apex
    towards /= np.linalg.norm(towards)
    theta = np.array([rng.uniform(0.4, 1.2), rng.uniform(0.4, 1.2)])
    side = np.cross(towards, rng.normal(size=3))
    side /= np.linalg.norm(side)
    axis = np.cos(theta)[:, None] * towards + np.sin(theta)[:, None] * side
    return ConeTrace(time_s, drone, apex, axis, theta + rng.normal(0.0, 0.09, 2))
