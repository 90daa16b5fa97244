"""Measure what the estimator ``sources`` costs a late agent: ``python -m benchmarks.catching_up [--auto] [--unknown Co-60]``.

Six sources of five nuclides are measured as in ``several_sources --real`` for ten minutes. The measurements are processed as by
an agent that gets the whole log at once: all moves (steps of the estimator), and a refinement at the end. ``--auto``: cones are
made for the lines of all nuclides, not only of Cs-137; ``--unknown``: also with ``--auto``, but without these nuclides among the
candidates. Prints processor times in total, and of the moves that first report a source of an unknown nuclide.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
import typer
from several_sources import DRONES, LANES_S, NS, SIDE_M, Placed, Tally, Truth, judge, may_lie_beside, observed
from shapely import Polygon

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis
from radron.agent.fusion.observation import Observation
from radron.agent.fusion.sources.handover import FollowingEstimator
from radron.agent.fusion.sources.spectra import KNOWN

NUCLIDES = ("Cs-137", "Ir-192", "Co-60", "I-131", "Na-22", "Cs-137")


def placed(seed: int) -> list[Placed]:
    """A source of each of NUCLIDES, 0.3 to 6 GBq."""
    rng, found = np.random.default_rng(seed), list[Placed]()
    while len(found) < len(NUCLIDES):
        one = Placed(NUCLIDES[len(found)], rng.uniform(5.0, SIDE_M - 5.0, 2), 3e8 * 20.0 ** rng.uniform())
        if all(may_lie_beside(one, other) for other in found):
            found.append(one)
    return found


class Costs(NamedTuple):
    """Processor times of the moves, of the moves that report an unknown nuclide, and of a refinement at the end."""

    moving_s: list[float]
    coming_s: list[float]
    refining_s: float


def fold(estimator: FollowingEstimator, grid_ns: int, seen: Sequence[Observation]) -> tuple[Hypothesis | None, Costs]:
    """Return the final hypothesis, and its costs."""
    by_step: dict[int, list[Observation]] = {}
    for one in seen:
        by_step.setdefault(one.stamp_ns // grid_ns, []).append(one)
    state, moving_s, coming_s = estimator.initial(None), list[float](), list[float]()
    for index, observations in sorted(by_step.items()):
        step = GridStep(index, index * grid_ns, (index + 1) * grid_ns)
        before, start = state.rest, time.process_time()
        state = estimator.step(state, step, observations)
        if state.rest.moved > before.moved:
            moving_s.append(time.process_time() - start)
            if len(state.rest.unknown) > len(before.unknown):
                coming_s.append(moving_s[-1])
    start = time.process_time()
    told = estimator.hypothesis(state, step)
    return told, Costs(moving_s, coming_s, time.process_time() - start)


def main(
    seconds: Annotated[float, typer.Option(help="Length of the flight.")] = 600.0,
    seed: Annotated[int, typer.Option(help="Of places and activities.")] = 911001,
    auto: Annotated[bool, typer.Option("--auto", help="All nuclides of the library are candidates.")] = False,
    unknown: Annotated[str, typer.Option(help="Nuclides that are no candidates, comma-separated.")] = "",
) -> None:
    square = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
    drones = tuple(DroneInMission(id=f"d{k + 1}") for k in range(DRONES))
    area = AreaConfig(polygon_m=square)
    candidates = tuple(name for name in KNOWN if name not in unknown.split(","))
    mission = MissionConfig(name="several", drones=drones, area=area, nuclide=candidates if auto or unknown else "")
    sources, tally = placed(seed), Tally()
    seen = observed(seed, sources, Truth.real(), (seconds - LANES_S) / len(sources), mission.nuclide)
    start = time.process_time()
    grid_ns = round(mission.fusion.bayes.grid_s * NS)
    estimate, costs = fold(FollowingEstimator(mission, Polygon(square)), grid_ns, seen)
    took_s = time.process_time() - start
    judge(sources, estimate, tally)
    half_s, most_s = np.median(costs.moving_s), max(costs.moving_s)
    coming_s = ", ".join(f"{one:.2f}" for one in costs.coming_s)
    print(
        f"{len(seen)} observations in {took_s:.1f} s: {len(costs.moving_s)} times with moves, {half_s:.2f} s in the median, "
        f"{most_s:.2f} s at most, and a refinement, {1e3 * costs.refining_s:.0f} ms\n"
        f"{len(sources)} sources, found {len(tally.error_m)}, of the right nuclide {tally.nuclides}, false {tally.false}, "
        f"error {np.median(tally.error_m):.2f} m in the median and {max(tally.error_m):.2f} m at most"
        + (f"\nwith unknown nuclides that come: {coming_s} s" if coming_s else "")
    )


if __name__ == "__main__":
    typer.run(main)
