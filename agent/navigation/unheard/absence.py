"""Consequences of lost and one-way links for one drone."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.navigation.unheard.contact import Wall
from radron.agent.navigation.unheard.wayaround import KeptPlace
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText


class Absence(Struct, frozen=True):
    """Peers without a two-way link, and the consequences for this drone; mission frame.

    missing: peers with a lost or one-way link that took part, held, or may take part. Empty while this drone returns and all
        peers without a link returned as well.
    unhearing: the one-way peers among ``missing``: heard, but without reception of this drone.
    ring: index of the circle on which this drone and its network component fly; 0 is the shared one (``sides.ring_of``).
    kept: the missing drones whose places on the circle stay free.
    walls: the separation line to each missing drone, by id; this drone keeps to its own side.
    alone: drones are missing, and no peer in two-way contact takes part.
    stops: (M, 2) m, both ends of each stretch on which a vehicle may hover before its failsafe return; one-way peers included,
        because they expect the same of this drone.
    coming_home: missing drones whose vehicles may be on a failsafe return, and not down yet.
    homes: keep-out places above which missing drones may descend; on the way home also the places where they may hover.
    left: missing drones that are revoked, obey, and have climbed from the circle.
    anywhere: missing drones without a separation line to this one, which may continue their flight at an unknown position.
    """

    missing: tuple[str, ...]
    unhearing: tuple[str, ...]
    ring: int
    kept: tuple[str, ...]
    walls: dict[str, Wall]
    alone: bool
    stops: Array
    coming_home: tuple[str, ...]
    homes: tuple[KeptPlace, ...] = ()
    left: tuple[str, ...] = ()
    anywhere: tuple[str, ...] = ()

    @property
    def unheard(self) -> tuple[str, ...]:
        """Missing drones with a lost link."""
        return tuple(name for name in self.missing if name not in self.unhearing)

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems of the links for the operator, one line each."""
        lost = [CodedText(Code.PEERS_LOST, f"does not hear {', '.join(self.unheard)} any more")] if self.unheard else []
        return (*lost, *([CodedText(Code.NOT_HEARD, f"is not heard by {', '.join(self.unhearing)}")] if self.unhearing else []))

    @property
    def may_circle(self) -> bool:
        """Whether a peer without a separation line may circle: until its vehicle must be down, if its agent is lost."""
        return any(name not in self.walls for name in self.coming_home)

    def with_homes(self, homes: Sequence[KeptPlace], moved: Transform) -> Absence:
        """Add homes as seen from another position of this drone; ``moved``: transform from there to its own position estimate."""
        others = (replace(home, place=moved.apply_point((*home.place, 0.0))[:2]) for home in homes)
        return replace(self, homes=(*self.homes, *others))
