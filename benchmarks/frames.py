"""Measure the estimate of the drones' local frames: its cost on one core, and its accuracy after 20 s of flight.

Flights and errors of ``tests/lib/support/flights/sighted_swarm.py``: 3 m/s, sightings with errors of 2 degrees and 0.3 m, 10 %
of them false. The cost is measured for a keyframe (time at which the frames are estimated anew).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from radron.agent.frames.swarm import SwarmFrames
from radron.protocol.codec import encode
from support.flights.sighted_swarm import SECOND, Drone, Flown, Sensor, fly, settle

SECONDS, TRIALS = 40.0, 40
DRIFT = {"drift_m": 0.1, "yaw_drift_deg": 0.2}
SENSORS = {
    "direction and range": Sensor(),
    "the same at 5 Hz": Sensor(rate_hz=5.0),
    "direction": Sensor(range_m=None),
    "range": Sensor(direction_deg=None),
}


def estimated(flown: Flown) -> tuple[SwarmFrames, float, float]:
    """The frames after a flight, and the CPU time of a keyframe in ms: for taking its entries in, and for the estimate."""
    frames = SwarmFrames(flown.mission)
    begun = time.process_time()
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
    received = time.process_time()
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    keyframes = 1e-3 * len(flown.stamps_ns) * 0.1
    return frames, (received - begun) / keyframes, (time.process_time() - received) / keyframes


def costs(console: Console) -> None:
    """Time of a keyframe (one a second)."""
    table = Table(title="one keyframe, ms of one core")
    for name in ("drones", "sightings a second", "entries", "estimate"):
        table.add_column(name, justify="right")
    for count in (3, 10):
        for rate_hz in (2.0, 5.0):
            drones = [Drone("d1", origin_sigma_m=0.0, yaw_sigma_deg=0.0, **DRIFT)]
            drones += [Drone(f"d{number}", **DRIFT) for number in range(2, count + 1)]
            _, taking, estimating = estimated(fly(drones, SECONDS, 1, Sensor(rate_hz=rate_hz)))
            table.add_row(str(count), f"{rate_hz * count * (count - 1):.0f}", f"{taking:.2f}", f"{estimating:.2f}")
    console.print(table)


def accuracy(console: Console) -> None:
    """Errors of two drifting SLAMs that began with any heading, beside a drone that is known exactly."""
    table = Table(title=f"after 20 s, {TRIALS} flights of three; both drones of unknown heading")
    for name in ("sightings", "level RMS m", "height RMS m", "heading RMS deg", "90 % region holds", "not known"):
        table.add_column(name, justify="right")
    for name, sensor in SENSORS.items():
        found = []
        for seed in range(TRIALS):
            headings = np.random.default_rng(seed).uniform(-180.0, 180.0, 2)
            drones = [Drone("d1", kind="exact")]
            drones += [
                Drone(f"d{k + 2}", yaw_deg=h, reported_yaw_deg=0.0, yaw_sigma_deg=180.0, **DRIFT) for k, h in enumerate(headings)
            ]
            flown = fly(drones, 20.5, seed, sensor)
            frames, _, _ = estimated(flown)
            found += [flown.error(frames, drone, 20.0) for drone in ("d2", "d3")]
        known = [one for one in found if one is not None]
        off = np.array([error for error, _ in known])
        held = np.mean([error @ np.linalg.solve(covariance, error) < 7.78 for error, covariance in known])
        level = np.sqrt(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2))
        height, heading = np.sqrt(np.mean(off[:, 2] ** 2)), np.degrees(np.sqrt(np.mean(off[:, 3] ** 2)))
        row = (f"{level:.2f}", f"{height:.2f}", f"{heading:.2f}", f"{100.0 * held:.0f} %", str(len(found) - len(known)))
        table.add_row(name, *row)
    console.print(table)


def main() -> None:
    """Print both tables."""
    console = Console()
    costs(console)
    accuracy(console)


if __name__ == "__main__":
    main()
