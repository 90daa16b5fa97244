"""Measure the motion planner: cost of replanning on one core, and how fast the swarm stabilises under both flocking laws.

The stabilisation is tested as in the paper's Sec. VI-A, in closed loop with lagging vehicles, localisation noise and late
messages (``tests/lib/support/flights/closed_loop.py``): five drones, the source estimate moved by 10 m every 60 s.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from radron.agent.config.mission import EncirclementConfig
from radron.agent.motion.encirclement import Encirclement
from radron.agent.motion.tracker import Status, Tracker

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from support.flights.closed_loop import TICK_NS, Flight, Swarm, encircle, scattered

SEEDS, STEPS, PERIOD_S, SETTLED_S = 4, 2, 60.0, 30.0
LAWS = {
    "smooth": EncirclementConfig(),
    "smooth, poses": EncirclementConfig(),
    "paper, 0.05 rad": EncirclementConfig(law="paper", bias_rad=0.05),
    "paper, 0.3 rad": EncirclementConfig(law="paper", bias_rad=0.3),
}
TRIPLE = np.array([[15.0, 0.0], [-5.0, 12.0], [-4.0, -13.0]])


def timed(function: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    """The same function, which records the duration of each call in ms."""

    def call(*args: Any, **named: Any) -> Any:
        begun = time.perf_counter()
        result = function(*args, **named)
        spent.append(1e3 * (time.perf_counter() - begun))
        return result

    return call


def costs(console: Console) -> None:
    """Time of one replan of one of three drones, and of one setpoint."""
    planning: list[float] = []
    circling: list[float] = []
    plan, reference = Tracker.plan, Encirclement.reference
    Tracker.plan, Encirclement.reference = timed(plan, planning), timed(reference, circling)  # type: ignore[method-assign]
    try:
        swarm = Swarm(np.random.default_rng(0), TRIPLE)
        flights = [swarm.fly(20.0, encircle(center)) for center in ((0.0, 0.0), (7.0, 7.0), (-3.0, 7.0), (7.0, 7.0))]
    finally:
        Tracker.plan, Encirclement.reference = plan, reference  # type: ignore[method-assign]
    status = np.array([status for flight in flights for status in flight.statuses])
    spent, now_ns, rounds = np.array(planning), swarm.tick * TICK_NS, 20_000
    begun = time.perf_counter()
    for _ in range(rounds):
        swarm.trackers[0].sample(now_ns)
    sampling = 1e6 * (time.perf_counter() - begun) / rounds
    table = Table("", "median", "90 %", "share", title="One drone of three, ms")
    for name, values in (
        ("reference", np.array(circling)),
        ("plan, free", spent[status == Status.FREE]),
        ("plan, OSQP", spent[status != Status.FREE]),
    ):
        share = "" if name == "reference" else f"{100.0 * len(values) / len(spent):.1f} %"
        table.add_row(name, f"{np.median(values):.3f}", f"{np.percentile(values, 90):.3f}", share)
    console.print(table)
    console.print(f"setpoint: {sampling:.1f} us")


def stabilisation(console: Console) -> None:
    """Settling times, remaining motion and distances of both laws."""
    title = f"Seconds until every gap is within 5 degrees: worst from any start, median and worst of {SEEDS * STEPS} steps"
    columns = ("start", "median", "worst", "RMS deg", "speed m/s", "nearest m")
    table = Table("law", *columns, title=title)
    for name, config in LAWS.items():
        begun, moved, still, closest = [], [], [], []
        for seed in range(SEEDS):
            rng = np.random.default_rng(seed)
            swarm, center = Swarm(rng, scattered(rng), poses_only="poses" in name), np.zeros(2)
            for step in range(STEPS + 1):
                if step > 0:
                    heading = rng.uniform(0.0, 2.0 * np.pi)
                    center = center + 10.0 * np.array([np.cos(heading), np.sin(heading)])
                flight: Flight = swarm.fly(PERIOD_S, encircle((float(center[0]), float(center[1])), config=config))
                (moved if step > 0 else begun).append(flight.settling_s(center))
                settled = flight.after(SETTLED_S)
                still.append((np.mean(settled.gap_errors_deg(center) ** 2), settled.speeds().mean(), settled.speeds().std()))
                closest.append(flight.closest_m())
        squared, speed, spread = np.mean(still, axis=0)
        table.add_row(
            name,
            _seconds(max(begun)),
            _seconds(float(np.median(moved))),
            _seconds(max(moved)),
            f"{np.sqrt(squared):.2f}",
            f"{speed:.2f} ± {spread:.2f}",
            f"{min(closest):.1f}",
        )
    console.print(table)


def _seconds(value: float) -> str:
    return f"{value:.1f}" if value < PERIOD_S else "never"


if __name__ == "__main__":
    output = Console()
    costs(output)
    stabilisation(output)
