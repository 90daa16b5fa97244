"""Deviation of the vehicles from their plans, and their separation, in lockstep flights of scenarios with different drags.

`python benchmarks/tracking.py [--runs N] [--first SEED] [--drag 0.3 1.0] [--assume fixed none] [SCENARIO ...]`
prints a Markdown table.
`--assume`: beside identification in flight, `fixed`: the drone file's values for the whole flight; `none`: no drag and no lags.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from rich.console import Console
from rich.progress import track

from radron.agent.navigation.identification import ResponseEstimator
from radron.sim.lockstep.flight import fly
from radron.sim.result import RunResult
from radron.sim.scenario import load_scenario, override

SCENARIOS = ("paper-moving-swarm", "fast-2mps", "ideal-moving-swarm")
NOTHING = {"response.drag_ps": 0.0, "response.attitude_lag_s": 0.0, "response.derivative_gain": 0.0}
Job = tuple[str, float, str, int]


class _AsConfigured(ResponseEstimator):
    """Identifies nothing in flight."""

    def follow(self, vehicle: object) -> None:
        """Learn nothing."""

    def compare(self, vehicle: object, planned: object) -> None:
        """Learn nothing."""


def one(job: Job) -> RunResult:
    """Fly once."""
    name, drag_ps, assume, seed = job
    if assume != "found":
        import radron.agent.navigation.navigator  # noqa: PLC0415  only this process is to be changed

        radron.agent.navigation.navigator.ResponseEstimator = _AsConfigured  # type: ignore[misc]
    changes: dict[str, object] = {"vehicle.drag_ps": drag_ps}
    if assume == "none":
        changes |= NOTHING
    return fly(override(load_scenario(name), changes), seed).result


def row(jobs: Sequence[Job], results: Sequence[RunResult]) -> str:
    """A row of the table."""

    def rms(values: Sequence[float | None]) -> str:
        known = [value**2 for value in values if value is not None]
        return f"{np.sqrt(np.mean(known)):.2f}" if known else ""

    name, drag_ps, assume, _ = jobs[0]
    separations = [result.min_separation_m for result in results if result.min_separation_m is not None]
    times = [result.time_to_x0_s for result in results if result.time_to_x0_s is not None]
    cells = (
        name,
        f"{drag_ps:g}",
        assume,
        str(len(results)),
        rms([result.deviation_search_m for result in results]),
        rms([result.deviation_circle_m for result in results]),
        f"{max(result.deviation_most_m or 0.0 for result in results):.2f}",
        f"{min(separations):.2f}" if separations else "",
        str(sum(separation < 3.0 for separation in separations)),
        f"{np.median(times):.1f}" if times else "",
        f"{np.median([result.error_median_m or np.nan for result in results]):.2f}",
        f"{np.median([result.realtime_factor for result in results]):.0f}",
    )
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| scenario | drag 1/s | response | flights | search, RMS m | circle, RMS m | most m | separation, least m | below 3 m "
    "| time to x0 s | error m | x real time |\n" + "|---" * 12 + "|"
)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--drag", type=float, nargs="+", default=[0.3, 1.0])
    parser.add_argument("--assume", nargs="*", default=[], choices=["fixed", "none"])
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    rows = [
        [(name, drag, assume, asked.first + run) for run in range(asked.runs)]
        for name in asked.scenarios
        for drag in asked.drag
        for assume in ("found", *asked.assume)
    ]
    jobs = [job for each in rows for job in each]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(asked.workers, mp_context=context, max_tasks_per_child=1) as pool:
        flown = iter(track(pool.map(one, jobs), "flying", len(jobs), console=Console(stderr=True), transient=True))
        print(HEAD)
        for each in rows:
            print(row(each, [next(flown) for _ in each]), flush=True)


if __name__ == "__main__":
    main()
