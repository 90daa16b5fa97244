"""What lost packets between the agents cost: live flights whose agents are on hosts of their own, with and without loss, in turn.

Needs root, /dev/net/tun and iproute2: the hosts are network namespaces, with a relay for the packets between them. Exit code 1
where an agent was ended, logs differ at the end, or a drone did not land.

Run: python benchmarks/packet_loss.py [--drones 3] [--loss 0.05] [--seconds 60] [--runs 6] [--json OUT]
About two minutes for each flight. Single flights differ by half of their error: it takes some tens to tell 1.2 from 1. Two
further results scatter less. The bound of the error shows whether the drones flew and measured as well. The distance of the
flight's hypotheses from the hypotheses of the same log without delays shows the effect of late entries.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from itertools import zip_longest
from math import exp, log
from pathlib import Path
from statistics import mean, stdev

from rich.console import Console
from rich.table import Table

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from common.live_flight import flights as records
from common.undelayed import Lateness, lateness
from support.live.lossy_flight import LACKING, Flown, can_lose_packets, fly_over


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--drones", type=int, default=3)
    parser.add_argument("--loss", type=float, nargs="+", default=[0.05])
    parser.add_argument("--seconds", type=float, default=60.0, help="of tracking")
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if not can_lose_packets():
        print(f"left out: {LACKING}")
        return 0
    flown: dict[float, list[Flown]] = {loss: [] for loss in (0.0, *options.loss)}
    late: dict[float, list[Lateness]] = {loss: [] for loss in flown}
    for run in range(options.runs):
        for loss, flights in flown.items():
            with tempfile.TemporaryDirectory(prefix="radron-loss-") as folder:
                flights.append(fly_over(Path(folder), options.drones, loss, options.seconds, seed=1 + run))
                _write(options.json, flown, late)  # also if its records cannot be judged
                late[loss].append(lateness(records(Path(folder))))
            print(f"seed {1 + run}, {100.0 * loss:g} % lost: {flights[-1]}, {late[loss][-1]}", file=sys.stderr, flush=True)
            _write(options.json, flown, late)
    _print(flown, late)
    return int(any(one.ended or not one.agreed or not one.landed for flights in flown.values() for one in flights))


def _write(file: Path | None, flown: dict[float, list[Flown]], late: dict[float, list[Lateness]]) -> None:
    """The flights so far; the last may not have been judged for lateness yet."""
    told = {
        str(loss): [asdict(one) | (entries._asdict() if entries else {}) for one, entries in zip_longest(flights, late[loss])]
        for loss, flights in flown.items()
    }
    if file is not None:
        file.write_text(json.dumps({"packet_loss": told}, indent=1) + "\n")


def _print(flown: dict[float, list[Flown]], late: dict[float, list[Lateness]]) -> None:
    table = Table(title="Packets lost between the agents")
    table.add_column("")
    rows: dict[str, list[str]] = {}
    for loss, flights in flown.items():
        table.add_column(f"{100.0 * loss:g} % lost", justify="right")
        pairs = list(zip(flights, flown[0.0], strict=True))
        errors_m = [one.error_m for one in flights if one.error_m is not None]
        cells = {
            "flights": f"{len(flights)}",
            "error, mean of medians, m": f"{mean(errors_m):.3f}" if errors_m else "-",
            "error against none, pairs": _ratio([(one.error_m, clean.error_m) for one, clean in pairs]),
            "bound of the error against none, pairs": _ratio([(one.bound_m, clean.bound_m) for one, clean in pairs]),
            "entries late by, s: median / 99 % / most, worst flight": _worst([one.delays_s for one in late[loss]]),
            "hypothesis moved by that, m: median / most, worst flight": _worst([one.moved_m for one in late[loss]]),
            "entries missing at an agent at the end": f"{sum(one.missing for one in late[loss])}",
            "with one log": f"{sum(one.agreed for one in flights)}",
            "agents ended": f"{sum(len(one.ended) for one in flights)}",
            "largest setpoint gap, s": f"{max(one.gap_s for one in flights):.2f}",
        }
        for head, cell in cells.items():
            rows.setdefault(head, []).append(cell)
    for head, row in rows.items():
        table.add_row(head, *row)
    Console(width=120).print(table)


def _worst(flights: Sequence[tuple[float, ...] | None]) -> str:
    """Of each number the largest of all flights that have it."""
    told = [one for one in flights if one is not None]
    return " / ".join(f"{max(part):.3f}" for part in zip(*told, strict=True)) or "-"


def _ratio(pairs: list[tuple[float | None, float | None]]) -> str:
    """Geometric mean of the ratios of the flights with the same seeds that both have it, and its standard error as a factor."""
    logs = [log(lossy / clean) for lossy, clean in pairs if lossy is not None and clean is not None]
    if not logs:
        return "-"
    error = stdev(logs) / len(logs) ** 0.5 if len(logs) > 1 else 0.0
    return f"{exp(mean(logs)):.2f} (1 sigma {exp(mean(logs) - error):.2f} .. {exp(mean(logs) + error):.2f})"


if __name__ == "__main__":
    sys.exit(main())
