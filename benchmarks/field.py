"""Measure the estimator ``field`` on synthetic surveys: ``python benchmarks/field.py --patterns patch,nothing --surveys 3``.

Three cameras fly lanes of 5 m over a hectare for ten minutes at 3 m/s. Counts come from the simulation's photons over soil
(``common.lawns``), positions are off by 0.15 m along each axis. Printed for each survey: the total's relative error and its
number of sigmas, the median error of hot blocks, the shares of hot and of all blocks in their 90 % intervals, the L2 norm of all
blocks' errors relative to that of the truth, the least uniform contamination that can be told, and the processor time of a fit
and of a refinement.
"""

from __future__ import annotations

import time
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from shapely import box

from common.lawns import background_ps, kernel
from radron.agent.config.estimators import FieldEstimatorConfig
from radron.agent.config.mission import GroundConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.field.analysis import Analysed, Analysis
from radron.agent.fusion.field.grid import MARGIN_M, Grid
from radron.agent.fusion.field.kernel import MiniPix
from radron.agent.fusion.field.sums import Sums, rows_of
from radron.agent.fusion.observation import CountObservation
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import EntryId

Array = NDArray[np.float64]
SIDE_M, LANE_M, SPEED_MPS, STEP_S, SURVEY_S, DRONES = 100.0, 5.0, 3.0, 0.5, 600.0, 3
POINT_M, BIAS_M, BLOCK_M = 0.5, 0.15, 10.0
PATTERNS = {
    "nothing": lambda x, y: 0.0 * x,
    "uniform": lambda x, y: 1.0 + 0.0 * x,
    "patch": lambda x, y: 1.0 * ((abs(x - 43.0) < 10.0) & (abs(y - 61.0) < 10.0)),
    "gradient": lambda x, y: np.exp(-((x - 40.0) ** 2 + (y - 55.0) ** 2) / 800.0),
    "streets": lambda x, y: 1.0 * ((abs(x - 35.0) < 2.5) | (abs(y - 60.0) < 2.5)),
    "ring": lambda x, y: 1.0 * (abs(np.hypot(x - 50.0, y - 50.0) - 25.0) < 5.0),
}


def way(drone: int, height_m: float) -> Array:
    """Places (N, 3) of a drone in its third of the area."""
    start = drone * SIDE_M / DRONES
    lanes = np.arange(start + LANE_M / 3.0, start + SIDE_M / DRONES, LANE_M)
    once = [(x, y) for k, x in enumerate(lanes) for y in ((0.0, SIDE_M) if k % 2 == 0 else (SIDE_M, 0.0))]
    corners = np.array([place for k in range(9) for place in (once if k % 2 == 0 else once[::-1])])
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    there = np.arange(0.5 * STEP_S, SURVEY_S, STEP_S) * SPEED_MPS
    return np.stack([*(np.interp(there, along, corners[:, axis]) for axis in range(2)), np.full(len(there), height_m)], axis=1)


def ground_of(pattern: str, level: float) -> tuple[Array, Array]:
    """Points (N, 2) of the area, and their activity per area (N,). Uniform ground goes on for 10 m beyond the area."""
    margin_m = MARGIN_M if pattern == "uniform" else 0.0
    line = np.arange(POINT_M / 2.0 - margin_m, SIDE_M + margin_m, POINT_M)
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    return np.stack((x, y), axis=1), level * PATTERNS[pattern](x, y)


def survey(points: Array, level: Array, height_m: float, rng: np.random.Generator, camera: MiniPix) -> Sums:
    """Sums of a survey over this ground."""
    hot, rows, numbers = level > 0.0, Sums.none(2), {f"d{k}": k for k in range(DRONES)}
    for drone in range(DRONES):
        bias = np.append(rng.normal(0.0, BIAS_M, 2), 0.0)
        seen = []
        for number, place in enumerate(way(drone, height_m)):
            away = np.hypot(*(points[hot] - place[:2]).T)
            rate = background_ps(height_m) + POINT_M**2 * (level[hot] @ kernel("Cs-137", height_m, away))
            partial, full = rng.poisson(rate * STEP_S).astype(float)
            end_ns = round((number + 1) * STEP_S * 1e9)
            counts, identity = np.array([partial + full, full, 0.0]), EntryId("", end_ns, f"d{drone}", "", number)
            at = tuple((place + bias).tolist())
            seen.append(CountObservation(end_ns, end_ns, at, STEP_S, counts, 0.2, 0.02, Transform(), identity, 0))
        rows = rows.plus(rows_of(seen, numbers, lambda one: one.position[2], camera.counted))
    return rows


def judged(found: Analysed, points: Array, level: Array) -> str:
    """Errors of a fit as text."""
    inside = ((points > 0.0) & (points < SIDE_M)).all(axis=1)
    points, level = points[inside], level[inside]
    report, total = found.contamination, float(level.sum()) * POINT_M**2
    block = (points[:, 1] // BLOCK_M * report.across + points[:, 0] // BLOCK_M).astype(int)
    true = np.bincount(block, level) / np.bincount(block)
    median, low, high = report.unit_bqm2 * np.array([(one.median, one.low, one.high) for one in report.blocks], float).T
    apart = f"; L2 {np.linalg.norm(median - true) / np.linalg.norm(true):.2f}" if total else ""
    hot, held = true > 0.5 * max(true.max(), 1.0), (low - report.unit_bqm2 <= true) & (true <= high + report.unit_bqm2)
    sigma = (report.total_bq.high - report.total_bq.median) / 1.645
    error = (
        f"total {report.total_bq.median / total - 1.0:+.3f} z {(report.total_bq.median - total) / sigma:+.2f}" if total else "-"
    )
    blocks = f"{np.median(abs(median[hot] / true[hot] - 1.0)):.3f} in 90 % {held[hot].mean():.2f}" if hot.any() else "-"
    least = f"least {report.least_bqm2 / 1e3:.1f} kBq/m2"
    return f"{report.finding}: {error}; hot blocks {blocks}, all {held.mean():.2f}{apart}; {least}"


def main(
    patterns: Annotated[str, typer.Option(help=f"Of {', '.join(PATTERNS)}.")] = "nothing,uniform,patch,gradient",
    level_bqm2: float = 1e6,
    height_m: float = 5.0,
    surveys: int = 1,
) -> None:
    camera, grid = MiniPix(response_of("Cs-137", "soil")), Grid.around(box(0.0, 0.0, SIDE_M, SIDE_M))
    for pattern in patterns.split(","):
        points, level = ground_of(pattern, level_bqm2)
        for seed in range(surveys):
            sums = survey(points, level, height_m, np.random.default_rng(seed), camera)
            analysis = Analysis(grid, camera, Ground(GroundConfig()), "Cs-137", FieldEstimatorConfig())
            begin = time.process_time()
            found = analysis.anew(sums, [0.2] * DRONES)
            fitted = time.process_time()
            analysis.refined(found, sums, [0.2] * DRONES)
            times = f"fit {fitted - begin:.2f} s, refinement {time.process_time() - fitted:.2f} s, {len(sums)} sums"
            print(f"{pattern} {seed}: {judged(found, points, level)}; {times}", flush=True)


if __name__ == "__main__":
    typer.run(main)
