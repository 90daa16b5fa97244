"""Knowledge about one other drone, beside its newest messages (``peers.newest``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from radron.agent.geometry import Point2
from radron.agent.navigation.unheard.agentless import Course
from radron.agent.navigation.unheard.contact import Contact
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.agent.navigation.unheard.lastseen import LastSeen
from radron.agent.navigation.unheard.lines import Line
from radron.agent.navigation.unheard.wayaround import KeptPlace


@dataclass(slots=True)
class PeerBelief:
    """Knowledge about one other drone, beside its messages. All stamps in own time.

    before: its last pose from before a restart of this agent, as long as no pose has arrived since; else None.
    expected_ns: for a drone never heard, the first stamp at which this drone knew that it may fly.
    excluded_ns: for a drone never heard, the stamp at which this drone knew that it is revoked.
    obeys_ns: stamp of the first report that it obeys its revocation.
    contact: last contact of a lost or one-way link. line: the separation line that follows from it, valid or expired.
    courses: possible courses of a lost drone's vehicle from ``courses_ns`` on, its last pose or sighting; None while it is heard.
    kept: keep-out discs over its home, by place.
    seen: its last sighting while the link is lost.
    silence: after a new link, until its frame is in the log: duration of the silence, s, and its possible courses then.
    """

    before: LastNews | None = None
    expected_ns: int | None = None
    excluded_ns: int | None = None
    obeys_ns: int | None = None
    contact: Contact | None = None
    line: Line | None = None
    courses: Sequence[Course] | None = None
    courses_ns: int = 0
    kept: dict[Point2, KeptPlace] = field(default_factory=dict)
    seen: LastSeen | None = None
    silence: tuple[float, Sequence[Course]] | None = None

    def heard(self) -> None:
        """Forget the possible courses of a drone without a link: it is heard, even if it does not hear this drone."""
        self.courses = None
        self.kept.clear()

    def forget(self) -> None:
        """Forget the lost link: the link is two-way, or the drone is on the ground, or was never heard."""
        self.contact = self.line = None
        self.heard()
