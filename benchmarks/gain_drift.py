"""Measure what a drift of a camera's gain costs: ``python -m benchmarks.gain_drift --seeds 20 --out DIR`` (resumable).

Ten minutes of ``ideal-static-swarm`` are flown, with two estimates of one log: as flown, and with a drift of one camera's gain.
The camera's readouts also pass a second, drifting camera on this vehicle. Paths, photons and other cameras are equal, so the
difference is due to the drift alone. Two flights, one with the drift (``mismatch-drift``), also differ by their photons: the
median error of a flight scatters by half of its mean, and the ratio of the means of 20 and 20 by 0.17.

Printed for each seed: median horizontal error and activity error without and with the drift, the median distance of both
estimates, the nuclide that the drifting camera recognises, and the time from a gain error of 4 % to its report.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median
from typing import Annotated, Any

import numpy as np
import typer
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.readout import Readout
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.fusion.registry import estimator_named
from radron.agent.mission.worldmodel import WorldModel
from radron.agent.pilot import Pilot
from radron.agent.sensing.camera import Camera
from radron.agent.sensing.observer import Observer
from radron.protocol.codec import encode
from radron.protocol.codes import Code
from radron.protocol.entries import Entry, Exposure
from radron.sim.faults.cameras import amplified
from radron.sim.lockstep.flight import watched
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.truth import CameraTruth
from radron.sim.runfile import write_text
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.moment import EPOCH_NS, Moment
from radron.sim.scoring.score import error_m

DRIFTING, RISE, OVER_S = "d2", 0.1, 600.0
TOLD_FROM = 0.04
SECOND_NS = 1_000_000_000
CALIBRATION = PixelCalibration.draw(CameraTruth(), np.random.default_rng(1))  # nominal, as that of the scenario's cameras


def rise(time_s: float) -> float:
    """The gain less 1."""
    return RISE * min(1.0, time_s / OVER_S)


class DriftingPilot(Pilot):
    """A pilot with a second camera of drifting gain. The second camera's entries are kept, not sent."""

    def __init__(self, mission: MissionConfig, drone: DroneConfig, boot: str, *args: Any, **options: Any) -> None:
        super().__init__(mission, drone, boot, *args, **options)
        observer = Observer(drone, mission, boot, self._own.history, itertools.count(1 << 30), self._own.carried, self._utc)
        self.second = Camera(mission, drone.calibration, observer, Counter())
        self.entries, self.told_s = list[Entry](), float("nan")

    def observe_detector(self, readout: Readout) -> list[tuple[str, bytes]]:
        """As ``Pilot``; by both cameras."""
        time_s = 1e-9 * (readout.end_ns - EPOCH_NS)
        self.entries += self.second.observe(replace(readout, hits=amplified(readout.hits, 1.0 + rise(time_s), CALIBRATION)))
        if np.isnan(self.told_s) and any(problem.code == Code.CAMERA_GAIN for problem in self.second.problems(readout.end_ns)):
            self.told_s = time_s
        return super().observe_detector(readout)


class Flown:
    """A flight: hypotheses by second, without and with the drift."""

    def __init__(self, seed: int) -> None:
        self.pilots: dict[str, Pilot] = {}
        self.without: dict[int, Hypothesis] = {}
        self.source, self.started_ns = (0.0, 0.0), 0
        scenario = override(load_scenario("ideal-static-swarm"), {"end.track_s": OVER_S, "end.after_s": OVER_S + 30.0})
        assert scenario.source is not None
        self.activity_bq = scenario.source.activity_bq
        watched(scenario, seed, self._watch, self._pilot)

    def _pilot(self, mission: MissionConfig, drone: DroneConfig, *args: Any, **options: Any) -> Pilot:
        kind = DriftingPilot if drone.id == DRIFTING else Pilot
        self.mission, self.pilots[drone.id] = mission, kind(mission, drone, *args, **options)
        return self.pilots[drone.id]

    def _watch(self, moment: Moment) -> bool:
        first = moment.pilots[0]
        if first is not None and moment.source is not None and first.fusion.hypothesis is not None:
            self.source, self.started_ns = moment.source, first._executive.started_ns or self.started_ns
            self.without.setdefault(round(moment.time_s), first.fusion.hypothesis)
        return moment.time_s > OVER_S

    def with_drift(self, drifting: Sequence[Entry]) -> dict[int, Hypothesis]:
        """Hypotheses by second of the log with these entries in place of the right camera's."""
        log = next(pilot for name, pilot in self.pilots.items() if name != DRIFTING).fusion.log
        others = [entry for entry in (record.entry for record in log) if entry.drone != DRIFTING]
        world = WorldModel(self.mission, (), estimator_named)
        world.start(self.started_ns)
        found: dict[int, Hypothesis] = {}
        for second, arrived in itertools.groupby(sorted((*others, *drifting), key=_end_ns), _second):
            for entry in arrived:
                world.take(entry, encode(entry), _end_ns(entry))
            world.advance(EPOCH_NS + second * SECOND_NS)
            while world.pending:
                world.advance(EPOCH_NS + second * SECOND_NS)
            if world.fusion.hypothesis is not None:
                found[second] = world.fusion.hypothesis
        return found

    def result(self) -> dict[str, Any]:
        """One line."""
        drifting = self.pilots[DRIFTING]
        assert isinstance(drifting, DriftingPilot)
        found, recognised = self.with_drift(drifting.entries), drifting.second.recognised
        seconds = sorted(self.without.keys() & found.keys())
        pairs = [(self.without[second], found[second]) for second in seconds]
        passed_s = next(second for second in range(round(OVER_S)) if rise(second) >= TOLD_FROM)
        return {
            "without_cm": median(100.0 * error_m(before, self.source) for before, _ in pairs),
            "with_cm": median(100.0 * error_m(after, self.source) for _, after in pairs),
            "apart_cm": median(100.0 * float(np.hypot(*(after.position - before.position)[:2])) for before, after in pairs),
            "activity_without": median(before.activity_bq or 0.0 for before, _ in pairs) / self.activity_bq - 1.0,
            "activity_with": median(after.activity_bq or 0.0 for _, after in pairs) / self.activity_bq - 1.0,
            "nuclide": None if recognised is None else recognised.nuclide,
            "told_after_s": drifting.told_s - passed_s,
        }


def _end_ns(entry: Entry) -> int:
    return entry.end_ns if isinstance(entry, Exposure) else entry.stamp_ns


def _second(entry: Entry) -> int:
    return -(-(_end_ns(entry) - EPOCH_NS) // SECOND_NS)


def main(
    seeds: Annotated[int, typer.Option(help="Seeds 1 to this.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; rerun to resume.")] = None,
) -> None:
    """Fly, and print the results and their means."""
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    results = []
    for seed in range(1, seeds + 1):
        path = None if out is None else out / f"{seed}.json"
        if path is not None and path.exists():
            result = json.loads(path.read_text())
        else:
            result = Flown(seed).result()
            if path is not None:
                write_text(path, json.dumps(result))
        results.append(result)
        print(seed, *(f"{key}={value:.3f}" if isinstance(value, float) else f"{key}={value}" for key, value in result.items()))
    before, after = mean(each["without_cm"] for each in results), mean(each["with_cm"] for each in results)
    print(f"mean of {len(results)}: {before:.2f} cm without, {after:.2f} cm with the drift; ratio {after / before:.2f}")


if __name__ == "__main__":
    typer.run(main)
