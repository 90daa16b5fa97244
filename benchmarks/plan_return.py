"""How long vehicles that are near each other stay off their plans, in random missions of the campaign with faults.

`python benchmarks/plan_return.py [--seconds S] [SEED ...]` prints how much of the difference of two drones' deviations is left
after some time, by regression, of drones less than 8 m apart, and beside it what `agent/motion/steering.py` expects.
"""

from __future__ import annotations

import argparse
from itertools import combinations
from math import exp

import numpy as np

from radron.agent.motion.steering import RETURN_S
from radron.sim.campaign.faults.mission import Mission
from radron.sim.geometry import Array
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.moment import Moment

SEEDS = (1080470, 1110020, 1110021, 1110022, 1110023, 1110024)
STEP_S, NEAR_M, TIMES_S = 0.2, 8.0, (0.2, 0.4, 1.0, 2.0, 3.0, 4.0)


def flown(seed: int, seconds: float) -> Array:
    """(T, N, 4): deviation from the plan and true place of each drone, horizontal, mission frame; not a number without a plan."""
    rows: list[list[list[float]]] = []

    def look(moment: Moment) -> bool:
        if moment.time_s >= STEP_S * (len(rows) + 1):
            rows.append(
                [_deviation(moment, drone) + moment.position_m[drone, :2].tolist() for drone in range(len(moment.pilots))]
            )
        return moment.time_s > seconds

    watched(parse_scenario(Mission(seed=seed).drawn, "benchmark"), seed, look)
    return np.array(rows)


def _deviation(moment: Moment, drone: int) -> list[float]:
    pilot = moment.pilots[drone]
    reckoning = pilot.reckoning if pilot is not None else None
    if reckoning is None or reckoning.mission_from_local is None:
        return [np.nan, np.nan]
    deviation = np.array(reckoning.position_m) - reckoning.planned[0]
    found: list[float] = reckoning.mission_from_local.rotate(deviation)[:2].tolist()
    return found


def left(flights: list[Array], after: int) -> tuple[float, int]:
    """Share of the difference of two deviations that is left after so many steps, and the number of differences."""
    both, before, count = 0.0, 0.0, 0
    for flight in flights:
        for one, other in combinations(range(flight.shape[1]), 2):
            apart = flight[:, one] - flight[:, other]
            first, later = apart[:-after], apart[after:]
            used = np.isfinite(first).all(axis=1) & np.isfinite(later).all(axis=1) & (np.hypot(*first[:, 2:].T) < NEAR_M)
            both += float((first[used, :2] * later[used, :2]).sum())
            before += float((first[used, :2] ** 2).sum())
            count += int(used.sum())
    return both / before, count


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--seconds", type=float, default=40.0)
    asked = parser.parse_args()
    flights = [flown(seed, asked.seconds) for seed in asked.seeds]
    print("| after s | left | expected | differences |\n|---|---|---|---|")
    for after_s in TIMES_S:
        share, count = left(flights, round(after_s / STEP_S))
        print(f"| {after_s:g} | {share:.2f} | {exp(-((after_s / RETURN_S) ** 2)):.2f} | {count} |")


if __name__ == "__main__":
    main()
