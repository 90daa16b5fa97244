"""Missing drones, without a two-way link, and the consequences for the flight of one drone."""

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
    """Missing drones, which have no two-way link to this drone, and the consequences for its flight; mission frame.

    missing: ids of drones with a lost or one-way link, or never heard, that may search, track or hold. Empty if this drone
        returns, and the only drones without a link were returning, too, at the last contact.
    unhearing: the one-way peers among ``missing``: this drone hears them, but they do not hear it.
    ring: number of the circle for this drone and its network component; 0 is the innermost, which all drones share while
        all links work (``sides.ring_of``).
    kept: missing drones that may still be on the same circle as this drone; their places on it stay free.
    walls: valid separation line to each missing drone, by id. This drone keeps to its own side.
    alone: drones are missing, and no peer with a two-way link searches or tracks.
    stops: (M, 2) m, both ends of each stretch on which a vehicle without its agent may hover before its failsafe return.
        Includes the stops of one-way peers, because they expect such a stop of this drone.
    coming_home: missing drones whose vehicles may be on a failsafe return, and need not have landed yet.
    homes: keep-out discs over the homes where missing drones may descend, and over places where vehicles may hover for good.
    left: missing drones that are revoked and reported 15 s ago or earlier that they obey: they no longer circle.
    anywhere: missing drones without a separation line to this one that may still fly, at an unknown position.
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
        """Missing drones that this drone does not hear: with a lost link, or never heard."""
        return tuple(name for name in self.missing if name not in self.unhearing)

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems for the operator: peers that this drone does not hear, and peers that do not hear it."""
        lost = [CodedText(Code.PEERS_LOST, f"does not hear {', '.join(self.unheard)} any more")] if self.unheard else []
        return (*lost, *([CodedText(Code.NOT_HEARD, f"is not heard by {', '.join(self.unhearing)}")] if self.unhearing else []))

    @property
    def may_circle(self) -> bool:
        """Whether a missing drone without a separation line may fly on a circle: its vehicle need not have landed yet."""
        return any(name not in self.walls for name in self.coming_home)

    def with_homes(self, homes: Sequence[KeptPlace], moved: Transform) -> Absence:
        """Return this with further keep-out discs, for this drone's alternative position hypothesis. ``moved``: transform of
        the discs from the mission frame by that hypothesis to the mission frame by the own position estimate.
        """
        others = (replace(home, place=moved.apply_point((*home.place, 0.0))[:2]) for home in homes)
        return replace(self, homes=(*self.homes, *others))
