"""What follows for one drone from the silence of others."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from agent.frames.transform import Transform
from agent.geometry import Array
from agent.navigation.unheard.contact import Wall
from agent.navigation.unheard.wayaround import KeptPlace


class Absence(Struct, frozen=True):
    """Which drones are out of contact with this one, and what that means for it; mission frame.

    missing: drones that took part, held, or may take part, and are not heard, or do not hear this one. None where this drone
        returns, and only others that returned, too, are not heard.
    unhearing: of these, those that are heard.
    ring: index of the circle on which this drone flies, with those in contact with it; 0 is the shared one (``sides.ring_of``).
    kept: the missing drones whose places on the circle stay free.
    walls: the line to which this drone keeps on its side, by the drone beyond.
    alone: some are missing, and none of those in contact takes part.
    stops: (M, 2) m, both ends of each stretch on which a vehicle may hover before it flies home without its agent; also of the
        unhearing, as they reckon with the same of this drone.
    coming_home: missing drones whose vehicles may be on their way home without their agents, and not down yet.
    homes: places that are kept clear of, as others may come down there; on the way home also those where others may hover.
    left: missing drones that are revoked, obey, and have climbed from the circle.
    anywhere: missing drones that no line parts from this one: they may fly on, nobody knows where.
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
        """Those that are not heard."""
        return tuple(name for name in self.missing if name not in self.unhearing)

    @property
    def may_circle(self) -> bool:
        """Whether one may circle with no line between it and this drone: until its vehicle must be down, if its agent is gone."""
        return any(name not in self.walls for name in self.coming_home)

    def with_homes(self, homes: Sequence[KeptPlace], moved: Transform) -> Absence:
        """With these, too, as they lie if this drone is elsewhere; ``moved``: from there to where it takes itself to be."""
        others = (replace(home, place=moved.apply_point((*home.place, 0.0))[:2]) for home in homes)
        return replace(self, homes=(*self.homes, *others))
