"""A recorded pilot: its calls are recorded before, its results after each call."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

import msgspec

from radron.agent.detector.readout import Readout
from radron.agent.flight import topics
from radron.agent.flight.topics import Sink
from radron.agent.frames.swarm import SwarmFrames
from radron.agent.fusion.deferred import Told
from radron.agent.fusion.estimator import Hypothesis, Outlook
from radron.agent.mission.commanding import Verdict
from radron.agent.mission.memory import Memory
from radron.agent.pilot import Pilot, Step
from radron.agent.vehicle.interface import GnssFix, SeenDrone, VehicleState
from radron.protocol.messages import Stage, Ticket, Upload
from radron.protocol.revocations import Revocation
from radron.protocol.texts import CodedText

MOST_REFUSED = 20  # commands recorded with their reason, in each second: a flood must not fill a record

P = ParamSpec("P")
R = TypeVar("R")


class RecordedPilot:
    """A pilot program whose inputs and results are recorded, with the interface, results and exceptions of ``Pilot``.

    Each call is recorded before, its results after.
    """

    def __init__(self, pilot: Pilot, sink: Sink) -> None:
        self._pilot = pilot
        self._sink = sink
        self._told: Hypothesis | None = None
        self._told_value = topics.encode_hypothesis(None, "")
        self._second = self._refusals = 0  # of commands, in that second
        self._ahead_ns = 0

    @property
    def stage(self) -> Stage:
        """The drone's present stage of the mission."""
        return self._pilot.stage

    @property
    def frames(self) -> SwarmFrames:
        """The estimated local frames of all drones in the mission frame."""
        return self._pilot.frames

    @property
    def hypothesis(self) -> Hypothesis | None:
        """The source estimate by which the drone flies, mission frame; None before there is one."""
        return self._pilot.hypothesis

    @property
    def outlook(self) -> Outlook | None:
        """The posterior of the search while there is no source estimate; None without one."""
        return self._pilot.outlook

    @property
    def finding(self) -> CodedText | None:
        """The result of a search that has found nothing; None in all other cases."""
        return self._pilot.finding

    @property
    def digest(self) -> str:
        """Hash over the content of the observation log, 32 hex digits."""
        return self._pilot.digest

    @property
    def memory(self) -> Memory | None:
        """The state from which a restarted agent continues."""
        return self._pilot.memory

    @property
    def revocations(self) -> tuple[Revocation, ...]:
        """The members revoked during this flight (rights withdrawn)."""
        return self._pilot.revocations

    @property
    def taking(self) -> Upload | None:
        """The uploaded mission that must be fetched; None if there is none."""
        return self._pilot.taking

    @property
    def pending(self) -> bool:
        """Whether frames and source estimate still lack entries of the log."""
        return self._pilot.pending

    @property
    def counters(self) -> Counter[str]:
        """Counters of events in the pilot program, such as dropped messages, by name."""
        return self._pilot.counters

    def observe_clock(self, ahead_ns: int, now_ns: int) -> None:
        """See ``Pilot``. Only a change is recorded."""
        if ahead_ns != self._ahead_ns:
            self._ahead_ns = ahead_ns
            self._sink.write(topics.CLOCK, msgspec.json.encode(ahead_ns), now_ns)
            self._run(self._pilot.observe_clock, ahead_ns, now_ns)

    def observe_vehicle(self, state: VehicleState) -> None:
        """Record telemetry of the autopilot, and pass it to the pilot program, see ``Pilot.observe_vehicle``."""
        self._sink.write(topics.VEHICLE, topics.encode_state(state))
        self._run(self._pilot.observe_vehicle, state)

    def observe_detector(self, readout: Readout) -> list[tuple[str, bytes]]:
        """Record a readout of the camera, and pass it to the pilot program, see ``Pilot.observe_detector``."""
        self._sink.write(topics.DETECTOR, topics.encode_readout(readout))
        publications = self._run(self._pilot.observe_detector, readout)
        self._tell_publications(publications, readout.end_ns)
        return publications

    def observe_fix(self, fix: GnssFix) -> list[tuple[str, bytes]]:
        """Record a satellite position, and pass it to the pilot program, see ``Pilot.observe_fix``."""
        self._sink.write(topics.FIX, topics.encode_given(fix))
        publications = self._run(self._pilot.observe_fix, fix)
        self._tell_publications(publications, fix.stamp_ns)
        return publications

    def observe_sightings(self, seen: Sequence[SeenDrone]) -> list[tuple[str, bytes]]:
        """Record relative observations of other drones, and pass them to the pilot program, see ``Pilot.observe_sightings``."""
        if not seen:
            return []
        self._sink.write(topics.SIGHTINGS, topics.encode_given(list(seen)))
        publications = self._run(self._pilot.observe_sightings, seen)
        self._tell_publications(publications, seen[-1].stamp_ns)
        return publications

    def receive(self, key: str, payload: bytes, now_ns: int) -> Verdict | None:
        """Record a message from the radio network, and pass it to the pilot program, see ``Pilot.receive``."""
        self._sink.write(topics.MESSAGE, topics.encode_message(key, payload), now_ns)
        verdict = self._run(self._pilot.receive, key, payload, now_ns)
        if verdict is not None and (not verdict.refused or self._is_told(now_ns)):
            self._sink.write(topics.VERDICT, msgspec.json.encode(verdict), now_ns)
        return verdict

    def advance(self, now_ns: int) -> None:
        """Record the call, and let the pilot program process new log entries, see ``Pilot.advance``."""
        self._sink.write(topics.ADVANCE, b"{}", now_ns)
        self._run(self._pilot.advance, now_ns)
        self._tell_hypothesis(now_ns)

    def warn(self, problems: tuple[CodedText, ...]) -> None:
        """Record the warnings for the operator, and pass them to the pilot program, see ``Pilot.warn``."""
        self._sink.write(topics.WARN, topics.encode_texts(problems))
        self._run(self._pilot.warn, problems)

    def block(self, problems: tuple[CodedText, ...]) -> None:
        """Record problems that prevent a start, and pass them to the pilot program, see ``Pilot.block``."""
        self._sink.write(topics.BLOCK, topics.encode_texts(problems))
        self._run(self._pilot.block, problems)

    def notice(self, notices: tuple[CodedText, ...]) -> None:
        """Record notices to the operator, and pass them to the pilot program, see ``Pilot.notice``."""
        self._sink.write(topics.NOTICE, topics.encode_texts(notices))
        self._run(self._pilot.notice, notices)

    def decline(self, reason: str) -> None:
        """Record why an uploaded mission was refused, and let the pilot program report it, see ``Pilot.decline``."""
        self._sink.write(topics.DECLINE, msgspec.json.encode(reason))
        self._run(self._pilot.decline, reason)

    def answered(self, question: int, told: Told) -> None:
        """Record the time at which a slow estimator answered in another process, and pass on the answer, see ``Fusion.answered``.

        The content is not recorded, because it follows from the log.
        """
        self._sink.write(topics.ANSWERED, msgspec.json.encode(question))
        self._run(self._pilot.fusion.answered, question, told)

    def step(self, now_ns: int) -> Step:
        """Record the call, let the pilot program make one step of the flight, and record the results, see ``Pilot.step``."""
        self._sink.write(topics.STEP, b"{}", now_ns)
        step = self._run(self._pilot.step, now_ns)
        self._sink.write(topics.COMMAND, topics.encode_command(step.command), now_ns)
        self._tell_hypothesis(now_ns)
        self._tell_publications(step.publications, now_ns)
        return step

    def ticket(self, now_ns: int) -> Ticket:
        """Return the ticket for the next command, see ``Pilot.ticket``. The call has no side effects, and is not recorded."""
        return self._pilot.ticket(now_ns)

    def log_summary(self) -> bytes:
        """Return a summary of the log, see ``Pilot.log_summary``. No recorded result follows from it, and it is not recorded."""
        return self._pilot.log_summary()

    def log_answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Record a request for log entries, and let the pilot program answer it, see ``Pilot.log_answer``."""
        self._sink.write(topics.QUERY, request)
        replies = self._run(self._pilot.log_answer, request)
        size = sum(len(payload) for _, payload in replies)
        self._sink.write(topics.ANSWER, msgspec.json.encode({"entries": len(replies), "bytes": size}))
        return replies

    def _run(self, call: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return call(*args, **kwargs)
        except Exception as error:
            self._sink.write(topics.ERROR, msgspec.json.encode(f"{type(error).__name__}: {error}"))
            raise

    def _is_told(self, now_ns: int) -> bool:
        """Whether the record takes one more refused command."""
        second = now_ns // 1_000_000_000
        self._second, self._refusals = second, self._refusals + 1 if second == self._second else 1
        return self._refusals <= MOST_REFUSED

    def _tell_publications(self, publications: list[tuple[str, bytes]], now_ns: int) -> None:
        for key, payload in publications:
            self._sink.write(topics.PUBLICATION, topics.encode_message(key, payload), now_ns)

    def _tell_hypothesis(self, now_ns: int) -> None:
        hypothesis = self._pilot.hypothesis
        if hypothesis is self._told:
            return
        value, self._told = topics.encode_hypothesis(hypothesis, ""), hypothesis
        if value == self._told_value:  # computed again with the same result: in lockstep that may be the same object
            return
        self._told_value = value
        self._sink.write(topics.HYPOTHESIS, topics.encode_hypothesis(hypothesis, self._pilot.fusion.hypothesis_digest), now_ns)
