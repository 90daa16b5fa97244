"""What lost packets between the agents cost: live flights whose agents are on hosts of their own, with and without loss, in turn.

Needs root, /dev/net/tun and iproute2: the hosts are network namespaces, the packets between which pass through a relay.
Exit code 1 where an agent was ended, logs differ at the end, or a drone did not land.

Run: python benchmarks/packet_loss.py [--drones 3] [--loss 0.05] [--seconds 60] [--runs 6] [--json OUT]
About two minutes for each flight. Single flights differ by half of their error: it takes some tens to tell 1.2 from 1.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from statistics import mean

from rich.console import Console
from rich.table import Table

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support/live"))

from lossy_flight import LACKING, Flown, can_lose_packets, fly_over


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
    for run in range(options.runs):
        for loss, flights in flown.items():
            with tempfile.TemporaryDirectory(prefix="radron-loss-") as folder:
                flights.append(fly_over(Path(folder), options.drones, loss, options.seconds, seed=1 + run))
            print(f"seed {1 + run}, {100.0 * loss:g} % lost: {flights[-1]}", file=sys.stderr, flush=True)
            if options.json is not None:
                told = {str(loss): [asdict(one) for one in flights] for loss, flights in flown.items()}
                options.json.write_text(json.dumps({"packet_loss": told}, indent=1) + "\n")
    _print(flown)
    return int(any(one.ended or not one.agreed or not one.landed for flights in flown.values() for one in flights))


def _print(flown: dict[float, list[Flown]]) -> None:
    table = Table(title="Packets lost between the agents")
    table.add_column("lost")
    for head in ("flights", "error, mean of medians, m", "against none", "one log", "agents ended", "largest setpoint gap, s"):
        table.add_column(head, justify="right")
    clean_m = mean(one.error_m for one in flown[0.0])
    for loss, flights in flown.items():
        error_m = mean(one.error_m for one in flights)
        agreed, ended = sum(one.agreed for one in flights), sum(len(one.ended) for one in flights)
        gap_s = max(one.gap_s for one in flights)
        cells = (f"{len(flights)}", f"{error_m:.3f}", f"{error_m / clean_m:.2f}", f"{agreed}", f"{ended}", f"{gap_s:.2f}")
        table.add_row(f"{100.0 * loss:g} %", *cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    sys.exit(main())
