"""Messages of the other drones: verified, their stamps converted to own time."""

from __future__ import annotations

from collections.abc import Collection

from msgspec.structs import replace

from radron.agent.fusion.proofs import Proofs
from radron.agent.localization.clocks import Clocks
from radron.agent.mission.problems import TWIN_NS, Problems
from radron.agent.mission.revoking import Revoking
from radron.agent.navigation.peers.newest import FUTURE_NS, NEWS, OLDEST_NS, Peers, is_present
from radron.protocol.message import Message
from radron.protocol.messages import AnyDroneMessage, Estimate, Frame, Plan, Pose, Status

_FOR_ONLOOKERS = (Frame, Estimate)  # every agent derives these from its own log


class News:
    """``pressing``: a status needs an immediate answer by this drone's own status."""

    def __init__(
        self,
        drone: str,
        boot: str,
        peers: Peers,
        clocks: Clocks,
        proofs: Proofs,
        revoking: Revoking,
        problems: Problems,
        sent: Collection[Message],
    ) -> None:
        """``sent``: this drone's own messages of the last seconds."""
        self._id, self._boot = drone, boot
        self._peers, self._clocks, self._proofs = peers, clocks, proofs
        self._revoking, self._problems, self._sent = revoking, problems, sent
        self._began_ns = 0
        self.pressing = False

    def step(self, now_ns: int) -> None:
        """The agent makes a step."""
        self._began_ns = self._began_ns or now_ns

    def hear(self, message: AnyDroneMessage, now_ns: int) -> str | None:
        """Take a message that is no log entry. Returns why it was dropped, or None."""
        self.pressing = False
        stamp_ns = self._clocks.utc.own_ns(message.stamp_ns)
        if message.drone in self._revoking.names:
            return "revoked"
        if isinstance(message, Status) and not self._proofs.is_signed(message, now_ns):
            return "unsigned_status"
        if message.drone == self._id:
            if self._is_of_twin(message, stamp_ns, now_ns):
                self.pressing = not self._problems.has_twin(now_ns)
                self._problems.hear_twin(now_ns)
            return "own_id"
        if isinstance(message, Status):
            self.pressing = self._clocks.hear(message, now_ns)  # however old its stamp seems
            if message.disowns is True and abs(now_ns - stamp_ns) < TWIN_NS:
                self.pressing = self.pressing or not self._peers.are_two(message.drone, now_ns)
                self._peers.disowned(message.drone, now_ns)
        if isinstance(message, _FOR_ONLOOKERS):
            return None
        return self._receive(message, stamp_ns, now_ns) if isinstance(message, NEWS) else "unused"

    def _receive(self, message: Pose | Plan | Status, stamp_ns: int, now_ns: int) -> str | None:
        """Take a message at its own time. Its stamp by the own clock, ``stamp_ns``, is kept if plainly of now: the sender's clock
        is right again, after a late status of before, or before the next status.

        Of two senders under one id, one may have forged the difference of the clocks, so that the messages of the other would be
        stale, or of the future. Then both readings count.
        """
        here, were_two = self._clocks.in_own_time(message), self._peers.are_two(message.drone, now_ns)
        is_other, is_now = here.stamp_ns != stamp_ns, is_present(stamp_ns, now_ns)
        is_far = abs(here.stamp_ns - stamp_ns) > OLDEST_NS + FUTURE_NS  # at most one of the two is of now
        plain = replace(message, stamp_ns=stamp_ns) if is_other and is_now else here
        readings = [plain if is_far else here, *([plain] if were_two and is_other and is_now else [])]
        dropped = [self._peers.receive(one, now_ns, ahead_ns=message.stamp_ns - one.stamp_ns) for one in readings]
        self.pressing = self.pressing or (not were_two and self._peers.are_two(message.drone, now_ns))
        return dropped[0]

    def _is_of_twin(self, message: AnyDroneMessage, stamp_ns: int, now_ns: int) -> bool:
        """Whether a message under the own id has another sender: of another boot, or of now and never sent."""
        if isinstance(message, Status) and message.boot != self._boot:
            return abs(now_ns - stamp_ns) < TWIN_NS
        is_new = self._began_ns <= stamp_ns and is_present(stamp_ns, now_ns)
        return isinstance(message, NEWS) and is_new and message not in self._sent
