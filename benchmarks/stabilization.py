"""Stabilisation of the swarm after each 10 m step of the hypothesis: settling time and remaining motion with both flocking laws.

`python benchmarks/stabilization.py [--seeds N] [--exact] [--figure FILE]`: flies the scenario ``stabilization`` in lockstep (lag
of the vehicles, localisation noise, radio delay) and prints a table; with ``--figure`` draws one flight of each, side by side.
``--exact``: poses without error, to see the laws alone; with errors the vehicles wander about their positions on the circle.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure

from radron.sim.figures.spacing import WITHIN_DEG
from radron.sim.figures.style import dress, drone_colour, new_figure, save
from radron.sim.lockstep.flight import fly
from radron.sim.result import Flight
from radron.sim.scenario import load_scenario
from radron.sim.scoring.statistics import hypothesis_steps, settling_times

LAWS = ("smooth", "paper")
SETTLED_S = 20.0  # time after a step at which only the law's unrest and the noise are left


def measure(flight: Flight) -> tuple[list[float], list[float], list[float]]:
    """Settling times (s) of the steps; settled spacing errors (deg) and settled speeds (m/s)."""
    trace = flight.trace
    steps = hypothesis_steps(trace.time_s, trace.hypothesis_m[:, 0], 5.0)
    times = settling_times(trace.time_s, trace.spacing_error_deg, steps, WITHIN_DEG).tolist()
    since = trace.time_s[:, None] - np.concatenate(([trace.time_s[0]], steps))
    calm = np.where(since >= 0.0, since, np.inf).min(axis=1) > SETTLED_S
    speed = np.hypot(trace.velocity_mps[calm, :, 0], trace.velocity_mps[calm, :, 1])
    return times, trace.spacing_error_deg[calm].ravel().tolist(), speed.ravel().tolist()


def draw(flights: dict[str, Flight]) -> Figure:
    """Speed and spacing error of one flight with each law, like the paper's figure."""
    figure = new_figure(10.0, 6.0)
    panels = figure.subplots(2, len(flights), sharex=True, sharey="row")
    for column, (law, flight) in enumerate(flights.items()):
        trace = flight.trace
        steps = hypothesis_steps(trace.time_s, trace.hypothesis_m[:, 0], 5.0)
        speed = np.linalg.norm(trace.velocity_mps[:, :, :2], axis=2)
        for drone in range(len(trace.drones)):
            panels[0, column].plot(trace.time_s, speed[:, drone], color=drone_colour(drone), linewidth=0.8)
            panels[1, column].plot(
                trace.time_s, np.abs(trace.spacing_error_deg[:, drone]), color=drone_colour(drone), linewidth=0.8
            )
        for panel in panels[:, column]:
            for step in steps:
                panel.axvline(step, color="#333333", linewidth=0.8, linestyle=(0, (4, 3)))
        panels[1, column].axhspan(0.0, WITHIN_DEG, color="#009E73", alpha=0.15, linewidth=0)
        dress(panels[0, column], f"{law} law", "", "ground speed (m/s)" if column == 0 else "")
        dress(panels[1, column], "", "time (s)", "spacing error (deg)" if column == 0 else "")
        panels[1, column].set_ylim(0.0, 75.0)
    return figure


def main() -> None:
    """Fly, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    scenario = load_scenario("stabilization")
    if arguments.exact:
        scenario = msgspec.structs.replace(scenario, localization=load_scenario("ideal-static-swarm").localization)
    speed_mps = scenario.mission.encirclement.speed_mps
    shown: dict[str, Flight] = {}
    print("law     steps  settled within 5 deg: median, worst   RMS when settled   speed: mean, RMS off v, 95 %   nearest")
    for law in LAWS:
        times: list[float] = []
        errors: list[float] = []
        speeds: list[float] = []
        nearest = np.inf
        for seed in range(1, arguments.seeds + 1):
            print(f"\r{law}, seed {seed} of {arguments.seeds} ...", end="", file=sys.stderr, flush=True)
            flight = fly(scenario, seed, law=law)
            shown.setdefault(law, flight)
            found = measure(flight)
            times += found[0]
            errors += found[1]
            speeds += found[2]
            nearest = min(nearest, flight.result.min_separation_m or np.inf)
        print("\r", end="", file=sys.stderr)
        off = np.abs(np.array(speeds) / speed_mps - 1.0) * 100.0
        print(
            f"{law:7} {len(times):5}  {np.median(times):18.1f} s {np.max(times):7.1f} s"
            f" {np.sqrt(np.mean(np.square(errors))):17.2f} deg {np.mean(speeds):10.2f} m/s {np.sqrt(np.mean(off**2)):5.1f} %"
            f" {np.quantile(off, 0.95):5.1f} % {nearest:9.1f} m"
        )
    if arguments.figure is not None:
        save(draw(shown), arguments.figure)


if __name__ == "__main__":
    main()
