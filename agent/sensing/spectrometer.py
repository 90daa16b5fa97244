"""The own ordinary detector: from its readouts to log entries, with its problems for the operator."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.responses import ResponseTable
from radron.agent.detector.channels import Channels
from radron.agent.detector.readout import Readout
from radron.agent.errors import DetectorError
from radron.agent.sensing.observer import Observer
from radron.protocol.codes import Code
from radron.protocol.entries import Entry
from radron.protocol.messages import Recognised
from radron.protocol.texts import CodedText

_SILENT_NS = 10_000_000_000  # readouts come every second or more often
MIN_LIVE_SHARE = 0.1  # of an interval; below, the rate follows from a small rest of it, and is not used


class Spectrometer:
    """Turns the readouts of this drone's ordinary detector into exposures, and watches the detector for faults."""

    recognised: Recognised | None = None  # nuclides are recognised in a camera's spectrum only

    def __init__(self, config: DetectorConfig, table: ResponseTable, observer: Observer, counters: Counter[str]) -> None:
        """Set up the processing of one detector; ``config``: section ``[detector]`` of the drone file."""
        self._channels = Channels(config, table)
        self._observer, self._counters = observer, counters
        self._newest_ns: int | None = None  # end of its last readout
        self._flaw: str | None = None

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return problems of the detector, one line each."""
        silent = self._newest_ns is not None and now_ns - self._newest_ns > _SILENT_NS
        told = [CodedText(Code.CAMERA_SILENT, "detector: it delivers nothing any more")] if silent else []
        flaws = [] if self._flaw is None else [CodedText(Code.DETECTOR_UNUSABLE, f"detector: {self._flaw}")]
        return (*told, *flaws, *self._observer.problems)

    def observe(self, readout: Readout) -> Sequence[Entry]:
        """Return the log entries that follow from a readout; an unusable one is counted, told and dropped."""
        self._newest_ns, self._flaw = readout.end_ns, None
        try:
            found = self._channels.detections(readout)
        except DetectorError as error:
            self._flaw = str(error)
            self._counters["readouts_unusable"] += 1
            return ()
        duration_s = (readout.end_ns - readout.start_ns) * 1e-9
        if found.hits and found.live_time_s < MIN_LIVE_SHARE * duration_s:
            self._flaw = f"dead for {100.0 - 100.0 * found.live_time_s / duration_s:.0f}% of the time; its counts are not used"
            self._counters["readouts_dead"] += 1
            return ()
        entries = self._observer.observe(found)
        self._counters["detections_dropped"] = self._observer.dropped
        return entries
