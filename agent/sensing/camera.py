"""The own camera: from its readouts to log entries, with its problems for the operator."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from radron.agent.config.mission import MissionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration, load_flight_calibration
from radron.agent.detector.readout import Readout
from radron.agent.detector.repeats import Repeats
from radron.agent.detector.spectroscopy.nuclidewatch import NuclideWatch
from radron.agent.sensing.observer import Observer
from radron.protocol.codes import Code
from radron.protocol.entries import Entry
from radron.protocol.messages import Recognised
from radron.protocol.texts import CodedText

_SILENT_NS = 10_000_000_000  # readouts come five times a second


class Camera:
    """Turns the readouts of this drone's camera (pixel hits of one interval) into log entries, and watches the camera for faults.

    A readout passes the filter for repeated readouts, the detection chain, which finds Compton cones and counts, the recognition
    of the nuclide in the spectrum, and the observer that makes log entries of the detections.
    """

    def __init__(self, mission: MissionConfig, calibration: str | None, observer: Observer, counters: Counter[str]) -> None:
        """Set up the camera's processing. ``calibration``: the camera's folder or file; None: the nominal camera.

        Raises:
            DetectorError: the calibration cannot be read.
        """
        constants = load_flight_calibration(Path(calibration)) if calibration else Calibration.nominal()
        self._watch = NuclideWatch(mission.nuclide)
        self._repeats = Repeats()
        self._chain = DetectorChain(mission.detection, mission.nuclide, constants, self._watch.add)
        self._observer, self._counters = observer, counters
        self._newest_ns: int | None = None  # end of its last readout
        self._is_silent = False

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return problems of the camera, or of its view, one line each. Before a flight its driver reports a missing camera."""
        if self._newest_ns is not None:
            self._is_silent = self._is_silent or now_ns - self._newest_ns > _SILENT_NS
        told = (CodedText(Code.CAMERA_SILENT, "camera: it delivers nothing any more"),) if self._is_silent else ()
        seen = (self._chain.noise, self._chain.dead_blocks, self._observer, self._watch)
        return (*told, *self._repeats.problems, *(line for one in seen for line in one.problems))

    @property
    def recognised(self) -> Recognised | None:
        """The nuclide recognised in the camera's spectrum; None if no nuclide stands out."""
        return self._watch.message

    def observe(self, readout: Readout) -> Sequence[Entry]:
        """Return the log entries (cones and counts) that follow from a readout of the camera."""
        self._newest_ns, self._is_silent = readout.end_ns, False
        entries = self._observer.observe(self._chain.process(self._repeats.without(readout)))
        self._watch.look(readout.end_ns)
        self._chain.scale = self._watch.scale
        self._counters["pixel_hits_lost"] = self._chain.lost_hits
        self._counters["pixel_hits_repaired"] = self._chain.repaired_hits
        self._counters["pixel_hits_of_noise"] = self._chain.noise.masked_hits
        self._counters["detections_dropped"] = self._observer.dropped
        self._counters["cones_withheld"] = self._observer.withheld
        if self._repeats.readouts:
            self._counters["readouts_repeated"] = self._repeats.readouts
        return entries
