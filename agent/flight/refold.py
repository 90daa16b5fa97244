"""The log of an older flight folded by today's estimator: a partial replay for a record whose pilot is gone.

A record of another version of the protocol cannot be replayed call by call: this pilot neither reads nor writes its messages. But
its log entries are still read, and the hypothesis is a function of them. So each recorded hypothesis is compared with that of
today's estimator by the same log. The comparison shows whether an old result still stands, not that the old program was right.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median

import msgspec
from msgspec import Struct

from agent.errors import FlightRecordError
from agent.flight import topics
from agent.flight.former import FORMER, FormerCommand, read_message
from agent.flight.reader import UNFINISHED, RecordedCall, RecordedFlight
from agent.fusion.registry import estimator_named
from agent.mission.worldmodel import WorldModel
from protocol.entries import Entry
from protocol.errors import ProtocolError
from protocol.messages import Action, Status


class Told(Struct, frozen=True):
    """A recorded hypothesis, as far as it is compared; mission frame."""

    position_m: tuple[float, float, float]
    covariance_m2: tuple[tuple[float, float, float], ...]
    digest: str


class Refolded(Struct, frozen=True, kw_only=True):
    """The comparison of one record.

    ``recorded``: number of hypotheses in it. ``same_log``: of these, with the same digest of the log here; only these are
    compared. ``identical``: of the compared ones, with the same bits of position and covariance. ``differences_m``: horizontal,
    of the others, infinite if today's estimator has no hypothesis by that log.
    """

    drone: str
    protocol: int
    radron: str
    duration_s: float
    entries: int
    recorded: int
    same_log: int
    identical: int
    differences_m: tuple[float, ...]
    flaw: str | None
    truncated: bool

    @property
    def stands(self) -> bool:
        """Whether every recorded hypothesis was made again with the same bits."""
        return self.recorded == self.identical > 0 and self.flaw is None


def refold(path: Path, progress: Callable[[float], None] | None = None) -> Refolded:
    """Fold the log of a record of the former protocol.

    Args:
        path: any file of the flight, or a folder with one flight.
        progress: called regularly with the share done, 0 to 1.

    Raises:
        FlightRecordError: it is no such record, cannot be read, or holds no log entry of its mission.
    """
    flight = RecordedFlight(path)
    flight.header.check_protocol(flight.files[0], "replay", (FORMER,))
    fold, began_ns, now_ns = _Fold(flight), 0, 0
    for count, call in enumerate(flight.calls()):
        now_ns = call.record.publish_ns
        began_ns = began_ns or now_ns
        try:
            fold.repeat(call)
        except (msgspec.MsgspecError, ValueError, TypeError) as error:
            raise FlightRecordError(f"{flight.files[0]}: a record cannot be read: {error}") from None
        if progress is not None and count % 500 == 0:
            progress(flight.read_bytes / max(1, flight.size_bytes))
    if not fold.entries:
        raise FlightRecordError(f"{flight.files[0]}: holds no log entries of mission {flight.header.mission.mission_id}")
    return Refolded(
        drone=flight.header.drone.id,
        protocol=flight.header.protocol,
        radron=flight.header.versions.get("radron", "unknown"),
        duration_s=(now_ns - began_ns) * 1e-9,
        entries=fold.entries,
        recorded=fold.recorded,
        same_log=fold.identical + len(fold.differences_m),
        identical=fold.identical,
        differences_m=tuple(fold.differences_m),
        flaw=flight.flaw,
        truncated=flight.truncated,
    )


def sentence(found: Refolded) -> str:
    """The result in a few sentences."""
    text = (
        f"{found.drone}, {found.duration_s:.1f} s, recorded by radron {found.radron} with version {found.protocol} of the"
        " protocol: its calls are not replayed, which needs that radron; its log was folded by this one's estimator."
        f" {found.same_log} of {found.recorded} recorded hypotheses have a log that is here too ({found.entries} entries)"
    )
    if found.same_log:
        text += f"; of these {found.identical} are made again, bit for bit"
    if found.differences_m:
        text += f", {len(found.differences_m)} differ: by {median(found.differences_m):.3g} m in the median"
        text += f", {max(found.differences_m):.3g} m at most"
    if found.truncated:
        text += f" ({UNFINISHED})"
    return text if found.flaw is None else f"{text}. Read up to there only: {found.flaw}"


class _Fold:
    """The log as the record fills it, and the comparison with each hypothesis in it."""

    def __init__(self, flight: RecordedFlight) -> None:
        self._world = WorldModel(flight.header.mission, (), estimator_named, judges_exposures=False)
        self._started_ns = 0
        self.recorded = self.identical = 0
        self.differences_m: list[float] = []

    @property
    def entries(self) -> int:
        return len(self._world.fusion.log)

    def repeat(self, call: RecordedCall) -> None:
        """Take the messages of a call, the own ones too, and compare the hypothesis that it led to."""
        now_ns = call.record.log_ns
        if call.record.topic == topics.MESSAGE:
            self._take(call.record.data, now_ns)
        told = [data for topic, data in call.results if topic == topics.HYPOTHESIS and data != b"null"]
        for data in told:
            self._compare(msgspec.json.decode(data, type=Told), now_ns)
        for topic, data in call.results:
            if topic == topics.PUBLICATION:
                self._take(data, now_ns)

    def _take(self, data: bytes, now_ns: int) -> None:
        key, payload = topics.decode_message(data)
        try:
            message = read_message(key, payload)
        except ProtocolError:  # as in flight, it did not count
            return
        if isinstance(message, Entry):
            self._world.take(message, payload, now_ns)
        elif isinstance(message, FormerCommand) and message.action is Action.START:
            self._start(message.stamp_ns)
        elif isinstance(message, Status) and message.started_ns is not None:
            self._start(message.started_ns)

    def _start(self, stamp_ns: int) -> None:
        if stamp_ns > self._started_ns:
            self._started_ns = stamp_ns
            self._world.start(stamp_ns)

    def _compare(self, told: Told, now_ns: int) -> None:
        self.recorded += 1
        fusion = self._world.fusion
        if fusion.digest != told.digest:
            return
        self._world.advance(now_ns)
        while self._world.pending:
            self._world.advance(now_ns)
        made = fusion.hypothesis
        if made is None:
            self.differences_m.append(float("inf"))
        elif (made.position.tolist(), made.covariance.tolist()) == (
            list(told.position_m),
            [list(row) for row in told.covariance_m2],
        ):
            self.identical += 1
        else:
            x, y = made.position[:2] - told.position_m[:2]
            self.differences_m.append(float((x * x + y * y) ** 0.5))
