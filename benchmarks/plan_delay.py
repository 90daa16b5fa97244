"""How near two drones come that meet by late plans: the price of plans that are no promises (docs/design/separation.md).

`python benchmarks/plan_delay.py [--runs N] [--seed S] [DELAY ...]` prints the least distances of encounters
(`tests/lib/support/flights/encounter.py`), with steady references, and with references that jump.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from radron.agent.config.mission import LimitsConfig

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from support.flights.encounter import least_m

DELAYS_S, JUMPS = (0.06, 0.26, 0.46, 0.86), 0.05


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("delays", nargs="*", type=float, default=DELAYS_S)
    parser.add_argument("--runs", type=int, default=70)
    parser.add_argument("--seed", type=int, default=100)
    asked = parser.parse_args()
    wanted_m = LimitsConfig().separation_m
    print("| delay (s) | references jump | least (m) | below 3 m |\n|---|---|---|---|")
    for delay_s in asked.delays:
        for turns in (0.0, JUMPS):
            found = [least_m(seed, delay_s, turns) for seed in range(asked.seed, asked.seed + asked.runs)]
            print(
                f"| {delay_s:g} | {turns:.0%} | {min(found):.2f} | {sum(one < wanted_m for one in found)} of {asked.runs} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
