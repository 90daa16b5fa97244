"""What the other drones tell of themselves: verified, at its time by the own clock."""

from __future__ import annotations

from agent.fusion.proofs import Proofs
from agent.localization.clocks import Clocks
from agent.mission.problems import TWIN_NS, Problems
from agent.mission.revoking import Revoking
from agent.navigation.peers.newest import FUTURE_NS, NEWS, OLDEST_NS, Peers, is_present
from protocol.messages import AnyDroneMessage, Estimate, Frame, Status

_FOR_ONLOOKERS = (Frame, Estimate)  # every agent derives these from its own log


class News:
    """``pressing``: a status tells something that this drone's own status should answer at once."""

    def __init__(
        self, drone: str, boot: str, peers: Peers, clocks: Clocks, proofs: Proofs, revoking: Revoking, problems: Problems
    ) -> None:
        self._id, self._boot = drone, boot
        self._peers, self._clocks, self._proofs = peers, clocks, proofs
        self._revoking, self._problems = revoking, problems
        self.pressing = self._runs = False

    def step(self, now_ns: int) -> None:
        """The agent makes a step."""
        self.keep_time(now_ns)
        self._runs = True

    def keep_time(self, now_ns: int) -> None:
        """Look at the own clock, before it is used: what is known of the others stays as old as it is when it is set."""
        self._peers.keep_time(now_ns, runs=self._runs)
        self._clocks.keep_time(self._peers.set_ns)

    def hear(self, message: AnyDroneMessage, now_ns: int) -> str | None:
        """Take a message that is no log entry. Returns why it was dropped, or None."""
        self.pressing = False
        self.keep_time(now_ns)
        if message.drone in self._revoking.names:
            return "revoked"
        if isinstance(message, Status) and not self._proofs.is_signed(message, now_ns):
            return "unsigned_status"
        if message.drone == self._id:
            if isinstance(message, Status) and message.boot != self._boot and abs(now_ns - message.stamp_ns) < TWIN_NS:
                self._problems.hear_twin(now_ns)
            return "own_id"
        if isinstance(message, Status):
            self.pressing = self._clocks.hear(message, now_ns)  # however old its stamp seems
        if isinstance(message, _FOR_ONLOOKERS):
            return None
        if isinstance(message, NEWS):
            here = self._clocks.by_own_clock(message)
            is_far = abs(here.stamp_ns - message.stamp_ns) > OLDEST_NS + FUTURE_NS  # so that only one of the two can be of now
            if is_far and is_present(message.stamp_ns, now_ns):
                here = message  # its clock is right again: a late status of before has told otherwise, or none has come yet
            return self._peers.receive(here, now_ns, ahead_ns=message.stamp_ns - here.stamp_ns)
        return "unused"
