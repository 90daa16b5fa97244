"""Compare live flights with simulated flights in lockstep of one scenario and equal seeds, in a Markdown table.

Ten flights each take about 17 minutes:

python benchmarks/live_vs_lockstep.py --runs 10 --docs docs/live.md
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import re
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from radron.sim.live.swarm import fly_live
from radron.sim.live.view import View
from radron.sim.lockstep.flight import fly
from radron.sim.result import Flight
from radron.sim.scenario import load_scenario

SETTLED_S = 20.0  # after the beginning of the tracking, from which on the spacing counts
_BEGIN, _END = "<!-- table: benchmarks/live_vs_lockstep.py -->", "<!-- end of the table -->"


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one flight."""

    time_to_x0_s: float | None
    x0_error_m: float | None
    error_median_m: float | None
    spacing_rms_deg: float | None
    min_separation_m: float | None
    sim_s: float


ROWS = {
    "time to x0 (s)": "time_to_x0_s",
    "error of x0 (m)": "x0_error_m",
    "error, median of the flight (m)": "error_median_m",
    "spacing error, RMS (deg)": "spacing_rms_deg",
    "least separation (m)": "min_separation_m",
    "length of the flight (s)": "sim_s",
}


def figures(flight: Flight) -> Figures:
    result, trace = flight.result, flight.trace
    together = np.flatnonzero(np.isfinite(trace.spacing_error_deg).all(axis=1))
    spacing = None
    if len(together):
        settled = together[trace.time_s[together] > trace.time_s[together[0]] + SETTLED_S]
        spacing = float(np.sqrt(np.mean(trace.spacing_error_deg[settled] ** 2))) if len(settled) else None
    return Figures(result.time_to_x0_s, result.x0_error_m, result.error_median_m, spacing, result.min_separation_m, result.sim_s)


def live(scenario: str, seed: int) -> Figures:
    """Fly live, in a separate process: no Zenoh session may be open while another flight starts its processes."""
    with TemporaryDirectory(prefix="radron-") as folder:
        flight, report = asyncio.run(fly_live(load_scenario(scenario), seed, Path(folder), None, View()))
    if not report.agreed:
        print(f"seed {seed}: the agents did not agree in the end", file=sys.stderr)
    for agent in report.agents:
        print(f"{agent.drone}: {agent.failsafes} failsafes, largest gap {agent.largest_gap_s:.2f} s", file=sys.stderr)
    return figures(flight)


def lockstep(scenario: str, seed: int) -> Figures:
    return figures(fly(load_scenario(scenario), seed))


def table(flown: dict[str, list[Figures]]) -> str:
    lines = [f"| | {' | '.join(flown)} |", "|---|" + "---|" * len(flown)]
    for title, name in ROWS.items():
        cells = [_cell([getattr(flight, name) for flight in flights]) for flights in flown.values()]
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    missing = f", none in {len(values) - len(known)}" if len(known) < len(values) else ""
    return f"{np.median(known):.1f} ({min(known):.1f} to {max(known):.1f}){missing}" if known else "none"


def write(path: Path, text: str) -> None:
    """Write the table into a page, between its markers."""
    page = path.read_text(encoding="utf-8")
    marked = re.compile(f"{re.escape(_BEGIN)}.*?{re.escape(_END)}", re.DOTALL)
    if not marked.search(page):
        sys.exit(f"{path}: has no line {_BEGIN}")
    path.write_text(marked.sub(lambda _: f"{_BEGIN}\n{text}\n{_END}", page), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description="Live beside lockstep.")
    parser.add_argument("--scenario", default="paper-demo")
    parser.add_argument("--runs", type=int, default=1, help="flights of each kind, seeds 1, 2, ...")
    parser.add_argument("--docs", type=Path, help="page whose table is replaced")
    options = parser.parse_args()
    flown: dict[str, list[Figures]] = {"live": [], "lockstep": []}
    spawn = multiprocessing.get_context("spawn")
    for seed in range(1, options.runs + 1):
        for (kind, flights), one in zip(flown.items(), (live, lockstep), strict=True):
            with ProcessPoolExecutor(1, mp_context=spawn) as process:
                flights.append(process.submit(one, options.scenario, seed).result())
            print(f"seed {seed}, {kind}: {flights[-1]}", file=sys.stderr)
    runs = f"{options.runs} flights each" if options.runs > 1 else "one flight each"
    text = f"Scenario `{options.scenario}`, {runs}, seeds from 1; median (least to most).\n\n{table(flown)}"
    print(text)
    if options.docs is not None:
        write(options.docs, text)


if __name__ == "__main__":
    main()
