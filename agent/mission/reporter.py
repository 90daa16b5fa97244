"""The regular messages of a drone: pose, frame, source estimate and status; and the outbox for everything it sends."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import TypeVar

from msgspec import UNSET, Struct

from radron.agent.frames.transform import Transform
from radron.agent.fusion.engine import Fusion
from radron.agent.fusion.estimator import Exclusion, Hypothesis
from radron.agent.navigation.peers.newest import NEWS
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codec import written
from radron.protocol.contamination import Contamination
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import key_of
from radron.protocol.message import Message
from radron.protocol.messages import MAX_SOURCES, Estimate, Frame, Pose, Source, Status

M = TypeVar("M", bound=Message)
MAX_SENT = 100  # messages that are remembered: of four seconds
_PERIODS_NS: dict[type[Message], int] = {
    Pose: 100_000_000,
    Frame: 1_000_000_000,
    Estimate: 500_000_000,
    Status: 1_000_000_000,
}


class Believed(Struct, frozen=True, eq=False):
    """The hypothesis and the map of contaminated ground, the digest of the log that they follow from, and the exclusion limit."""

    hypothesis: Hypothesis | None
    digest: str
    exclusion: Exclusion | None = None
    contamination: Contamination | None = None

    @classmethod
    def of(cls, fusion: Fusion) -> Believed:
        """Return the present estimate of a fusion."""
        outlook = fusion.outlook
        exclusion = outlook.exclusion if outlook is not None else None
        return cls(fusion.hypothesis, fusion.hypothesis_digest, exclusion, fusion.contamination)


class Outbox:
    """Messages to be sent, encoded, with their keys. Messages that the protocol refuses are counted and dropped.

    ``sent``: poses, plans and statuses of the last seconds, as their receivers read them.
    """

    def __init__(self, swarm: str, counters: Counter[str]) -> None:
        self._swarm = swarm
        self._counters = counters
        self._waiting: list[tuple[str, bytes]] = []
        self.sent: deque[Message] = deque(maxlen=MAX_SENT)

    def sendable(self, message: M) -> M | None:
        """The message as its receivers read it; None where the protocol refuses it, which is counted."""
        found = self._written(message)
        return found[1] if found is not None else None

    def put(self, message: Message) -> bytes | None:
        """Encode and queue a message. Returns its payload, or None if it cannot be sent."""
        found = self._written(message)
        if found is None:
            return None
        payload, read = found
        self._waiting.append((key_of(self._swarm, message), payload))
        if isinstance(read, NEWS):
            self.sent.append(read)
        return payload

    def _written(self, message: M) -> tuple[bytes, M] | None:
        try:
            return written(message)
        except ProtocolError:
            self._counters[f"unsendable_{type(message).__name__.lower()}"] += 1
            return None

    def take(self) -> list[tuple[str, bytes]]:
        """Everything since the last call."""
        taken, self._waiting = self._waiting, []
        return taken


class Reporter:
    """The regular messages of one drone."""

    def __init__(self, drone: str, mission_id: str, estimator: str) -> None:
        self._drone, self._mission_id, self._estimator = drone, mission_id, estimator
        self._due_ns = dict.fromkeys(_PERIODS_NS, 0)

    def hurry(self, now_ns: int) -> None:
        """Send a status with the next report: something has changed that the others must know."""
        self._due_ns[Status] = now_ns

    def due(
        self,
        now_ns: int,
        vehicle: VehicleState | None,
        frame: Transform | None,
        believed: Callable[[], Believed] | None,
        pose: Callable[[VehicleState], Pose],
        status: Callable[[], Status],
    ) -> Iterator[Message]:
        """The messages that are due now.

        Args:
            now_ns: own time, as all stamps.
            vehicle: newest telemetry.
            frame: mission <- local of its epoch; published if estimated, for operators (agents have it from their logs).
            believed: the source estimate, called only when due; None without one.
            pose: called with the telemetry, only when due.
            status: called only when due.
        """
        if vehicle is not None and self._is_due(Pose, now_ns):
            yield pose(vehicle)
        if vehicle is not None and frame is not None and frame.covariance is not None and self._is_due(Frame, now_ns):
            yield Frame(
                stamp_ns=now_ns,
                drone=self._drone,
                epoch=vehicle.epoch,
                translation_m=frame.translation,
                yaw_rad=frame.yaw_rad,
                covariance=tuple(frame.covariance.ravel().tolist()),
            )
        if believed is not None and self._is_due(Estimate, now_ns):
            yield self._estimate(now_ns, believed())
        if self._is_due(Status, now_ns):
            yield status()

    def _is_due(self, kind: type[Message], now_ns: int) -> bool:
        period_ns = _PERIODS_NS[kind]
        if now_ns < self._due_ns[kind]:
            return False
        self._due_ns[kind] = max(self._due_ns[kind] + period_ns, now_ns - now_ns % period_ns + period_ns)
        return True

    def _estimate(self, now_ns: int, believed: Believed) -> Estimate:
        hypothesis, exclusion, contamination = believed.hypothesis, believed.exclusion, believed.contamination
        sources = () if hypothesis is None else (hypothesis, *hypothesis.others)
        return Estimate(
            stamp_ns=now_ns,
            drone=self._drone,
            mission=self._mission_id,
            estimator=self._estimator,
            digest=believed.digest,
            sources=tuple(_source(one) for one in sources[:MAX_SOURCES]),
            excluded_bq=exclusion.known_bq if exclusion is not None else UNSET,
            contamination=UNSET if contamination is None else contamination,
        )


def _source(hypothesis: Hypothesis) -> Source:
    """Return the hypothesis as published."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = hypothesis.covariance.tolist()
    x, y, z = hypothesis.position.tolist()
    u, v, w = hypothesis.velocity.tolist()
    return Source(
        position_m=(x, y, z),
        covariance_m2=(xx, xy, xz, yy, yz, zz),
        velocity_mps=(u, v, w),
        nuclide=hypothesis.nuclide,
        activity_bq=hypothesis.activity_bq,
        activity_sigma_bq=hypothesis.activity_sigma_bq,
        evidence=hypothesis.evidence,
        cones=hypothesis.cones,
        lines_kev=UNSET if hypothesis.lines_kev is None else hypothesis.lines_kev,
    )
