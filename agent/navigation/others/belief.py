"""Knowledge about one other drone beside its messages (``peers.newest``): the only owner of it."""

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
    """Knowledge about one other drone.

    before: its last pose from before a restart of this agent, without a pose since.
    expected_ns: first stamp at which the drone, never heard, may fly.
    excluded_ns: begin of its revocation, as known here, if it was never heard.
    obeys_ns: first report of its obedience to a revocation.
    contact: last contact of a lost or one-way link. line: the separation line that follows, valid or expired.
    courses: possible failsafe courses of a lost drone's vehicle, since ``courses_ns``: its last pose or sighting; None: heard.
    kept: keep-out discs over its home.
    seen: its last sighting without a link.
    silence: after a new link, the length of the silence before, s, and the failsafe courses then, until its frame is known.
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
        """Forget the places of a drone without a pose: it is heard, even if it does not receive this drone."""
        self.courses = None
        self.kept.clear()

    def forget(self) -> None:
        """Forget the lost link: it is a two-way one, or the drone is on the ground, or was never heard."""
        self.contact = self.line = None
        self.heard()
