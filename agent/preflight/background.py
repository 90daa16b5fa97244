"""The camera's check on the bench: natural background, and noisy pixels."""

from __future__ import annotations

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import Readout
from radron.agent.detector.repeats import Repeats
from radron.agent.vehicle.interface import Finding

MEASURE_S = 10.0  # the background gives an event or two a second
MOST_NOISY = 100  # of 65,536 pixels; more are a defect


class Background:
    """Checks a camera on the bench: it counts the natural background for ``MEASURE_S`` as in flight, and its noisy pixels."""

    def __init__(self, config: DetectionConfig) -> None:
        self._chain = DetectorChain(config, None, Calibration.nominal())
        self._repeats = Repeats()
        self._live_s = 0.0
        self._events = self._hits = 0

    def take(self, readout: Readout) -> Finding:
        """Return the preflight finding on the camera after one more readout (pixel hits of one interval)."""
        if readout.counts is not None:
            return self._counted(readout.live_time_s, int(readout.counts.sum()))
        found = self._chain.process(self._repeats.without(readout))
        if self._repeats.problems:
            return Finding("camera", "failed", f"{self._repeats.problems[0].removeprefix('camera: ')}: restart it")
        self._live_s += found.live_time_s
        self._events += found.hits
        self._hits += len(readout.hits)
        if self._live_s < MEASURE_S:
            return Finding("camera", "not yet", f"answers; counting the background, {self._live_s:.0f} of {MEASURE_S:.0f} s")
        rate = f"{self._events / self._live_s:.1f} events a second"
        noisy = f"{self._chain.noise.pixels} noisy pixels"
        if self._events == 0:
            seen = f"answers, but has seen no event in {self._live_s:.0f} s, not even background ({noisy})"
            return Finding("camera", "failed", f"{seen}: check the bias voltage (detector.bias_v), cable and sensor")
        if self._chain.noise.pixels > MOST_NOISY:
            return Finding("camera", "failed", f"{rate}, {noisy}: warm it up, equalise its thresholds, or replace it")
        return Finding("camera", "ok", f"sees background: {rate} in {self._live_s:.0f} s, {noisy}")

    def _counted(self, live_time_s: float, counts: int) -> Finding:
        """The finding on an ordinary detector."""
        self._live_s += live_time_s
        self._events += counts
        if self._live_s < MEASURE_S:
            return Finding("camera", "not yet", f"answers; counting the background, {self._live_s:.0f} of {MEASURE_S:.0f} s")
        if self._events == 0:
            seen = f"answers, but has counted nothing in {self._live_s:.0f} s, not even background"
            return Finding("camera", "failed", f"{seen}: check the detector's high voltage and cable")
        return Finding(
            "camera", "ok", f"sees background: {self._events / self._live_s:.1f} counts a second in {self._live_s:.0f} s"
        )
