"""Replay of a recorded flight by the same pilot code, to verify that every result is identical, bit for bit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
from msgspec import Struct

from radron.agent.errors import FlightRecordError, RadronError
from radron.agent.flight import topics
from radron.agent.flight.reader import FlightRecord, RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.signatures import RecordedSignatures
from radron.agent.fusion.deferred import Deferred, Folder, Told
from radron.agent.pilot import Pilot
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Authority

Answer = Callable[[int], Told]  # to a question of the estimator
_SHOWN = 200  # characters of a result in a report


class Difference(Struct, frozen=True, kw_only=True):
    """The first result of a replay that differs from the recorded one, with both as text.

    time_s: time after the beginning of the flight.
    """

    time_s: float
    log_ns: int
    topic: str
    recorded: str
    replayed: str


class ReplayReport(Struct, frozen=True, kw_only=True):
    """The result of a replay, in which the pilot program repeats a recorded flight.

    ``calls``, ``compared``, ``differing``: numbers by topic. ``truncated``: the records end where the process was killed.
    ``flaw``: why the flight could not be read to its end; it was compared up to there.
    """

    drone: str
    boot: str
    files: int
    duration_s: float
    calls: dict[str, int]
    compared: dict[str, int]
    differing: dict[str, int]
    first: Difference | None
    truncated: bool
    flaw: str | None
    versions: dict[str, str]

    @property
    def identical(self) -> bool:
        """Whether the replay reproduced every recorded result of the flight, bit for bit."""
        return not self.differing and self.flaw is None


def replay(path: Path, progress: Callable[[float], None] | None = None) -> ReplayReport:
    """Repeat a recorded flight with a new pilot program, call by call, and compare every result.

    Args:
        path: any file of the flight, or a folder with one flight.
        progress: called regularly with the share done, 0 to 1.

    Raises:
        FlightRecordError: the flight cannot be replayed.
    """
    flight = RecordedFlight(path)
    signatures = _signatures(flight)
    flight.header.check_tables(flight.files[0])
    with TemporaryDirectory() as folder:
        heard = _Received()
        trust = signatures.trust if signatures is not None else None
        flown = flight.header.pilot(Path(folder), trust)
        pilot, answer = RecordedPilot(flown, heard), _in_place(flown)
        comparison = _Comparison()
        for count, (call, results, is_last) in enumerate(flight.calls()):
            heard.results.clear()
            comparison.calls[call.topic] += 1
            if signatures is not None:
                signatures.offer(results)
            error = _repeat(pilot, answer, call)
            comparison.compare(call, results, heard.results, error, is_last)
            if progress is not None and count % 500 == 0:
                progress(flight.read_bytes / max(1, flight.size_bytes))
    return ReplayReport(
        drone=flight.header.drone.id,
        boot=flight.header.boot,
        files=len(flight.files),
        duration_s=comparison.duration_s,
        calls=dict(comparison.calls),
        compared=dict(comparison.compared),
        differing=dict(comparison.differing),
        first=comparison.first,
        truncated=flight.truncated,
        flaw=flight.flaw,
        versions=flight.header.versions,
    )


def _signatures(flight: RecordedFlight) -> RecordedSignatures | None:
    """Return the signatures of the replay; None for a flight without certificates."""
    header = flight.header
    if not header.certificate:
        return None
    try:
        return RecordedSignatures(header.certificate, Authority.read(header.authority.encode()))
    except ProtocolError as error:
        raise FlightRecordError(f"{flight.files[0]}: the certificate of {header.drone.id} in the record {error}") from None


def _in_place(pilot: Pilot) -> Answer:
    """Computes here what another process computed in flight."""
    estimator = pilot.fusion.estimator
    if not isinstance(estimator, Deferred):
        return _not_asked
    folder = Folder(estimator.estimator)
    return lambda question: folder.answer(estimator, question)


def _not_asked(question: int) -> Told:
    raise ValueError(f"the estimator has not asked question {question}")


class _Received:
    """Collects the results of the call that is being repeated."""

    def __init__(self) -> None:
        self.results: list[tuple[str, bytes]] = []

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        """Keep a result."""
        if topic.startswith(topics.OUT):
            self.results.append((topic, data))


class _Comparison:
    """Counts of compared and differing results, and the first difference."""

    def __init__(self) -> None:
        self.calls: Counter[str] = Counter()
        self.compared: Counter[str] = Counter()
        self.differing: Counter[str] = Counter()
        self.first: Difference | None = None
        self._began_ns: int | None = None
        self._now_ns = 0

    @property
    def duration_s(self) -> float:
        """Time from the first call to the last one."""
        return (self._now_ns - self._began_ns) * 1e-9 if self._began_ns is not None else 0.0

    def compare(
        self,
        call: FlightRecord,
        recorded: list[tuple[str, bytes]],
        replayed: list[tuple[str, bytes]],
        error: str | None,
        is_last: bool,
    ) -> None:
        """Compare the results of a call with the recorded ones. The results of the last call may have been cut off."""
        self._now_ns = call.publish_ns
        if self._began_ns is None:
            self._began_ns = call.publish_ns
        if error is not None:
            self._differ(call, call.topic, call.data, error.encode())
        length = len(recorded) if is_last else max(len(recorded), len(replayed))
        for place in range(length):
            was = recorded[place] if place < len(recorded) else ("", b"nothing")
            now = replayed[place] if place < len(replayed) else ("", b"nothing")
            topic = was[0] or now[0]
            self.compared[topic] += 1
            if was != now:
                self._differ(call, topic, was[1], now[1])

    def _differ(self, call: FlightRecord, topic: str, recorded: bytes, replayed: bytes) -> None:
        self.differing[topic] += 1
        if self.first is None:
            self.first = Difference(
                time_s=self.duration_s,
                log_ns=call.log_ns,
                topic=topic,
                recorded=_shown(recorded),
                replayed=_shown(replayed),
            )


def _repeat(pilot: RecordedPilot, answer: Answer, call: FlightRecord) -> str | None:
    """Repeat a call. Returns why it cannot be made, or None; an exception of the pilot itself is among its results."""
    try:
        action = _action(pilot, answer, call)
    except (RadronError, msgspec.MsgspecError, ValueError, TypeError) as error:
        return f"the record cannot be read: {error}"
    try:
        action()
    except Exception:  # recorded as a result, as in flight
        return None
    return None


def _action(pilot: RecordedPilot, answer: Answer, call: FlightRecord) -> Callable[[], object]:
    """The call that a record stands for."""
    topic, data, now_ns = call.topic, call.data, call.log_ns
    match topic:
        case topics.VEHICLE:
            state = topics.decode_state(data)
            return lambda: pilot.observe_vehicle(state)
        case topics.DETECTOR:
            readout = topics.decode_readout(data)
            return lambda: pilot.observe_detector(readout)
        case topics.FIX:
            fix = topics.decode_fix(data)
            return lambda: pilot.observe_fix(fix)
        case topics.SIGHTINGS:
            seen = topics.decode_sightings(data)
            return lambda: pilot.observe_sightings(seen)
        case topics.MESSAGE:
            key, payload = topics.decode_message(data)
            return lambda: pilot.receive(key, payload, now_ns)
        case topics.QUERY:
            return lambda: pilot.log_answer(data)
        case topics.WARN | topics.BLOCK | topics.NOTICE:
            texts = topics.decode_texts(data)
            tell = {topics.WARN: pilot.warn, topics.BLOCK: pilot.block, topics.NOTICE: pilot.notice}[topic]
            return lambda: tell(texts)
        case topics.ANSWERED:
            question = msgspec.json.decode(data, type=int)
            told = answer(question)
            return lambda: pilot.answered(question, told)
        case topics.CLOCK:
            ahead_ns = msgspec.json.decode(data, type=int)
            return lambda: pilot.observe_clock(ahead_ns, now_ns)
        case topics.DECLINE:
            reason = msgspec.json.decode(data, type=str)
            return lambda: pilot.decline(reason)
        case topics.ADVANCE:
            return lambda: pilot.advance(now_ns)
        case topics.STEP:
            return lambda: pilot.step(now_ns)
    raise ValueError(f"unknown topic {topic!r}")


def _shown(data: bytes) -> str:
    text = data.decode("utf-8", errors="replace") if data[:1] in (b"{", b"n", b'"') else repr(data)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
