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
    """Drones of the mission that took part, held, or may take part, and are not heard or do not hear this one, and what follows
    for it.

    Also where this drone returns, and only drones that did so, too, are not heard: then none is ``missing``.

    ``missing``: all of these; ``unhearing``: those that are heard, but do not hear this one; ``ring``: which of the circles apart
    from each other this drone flies on, and those that it hears and that hear it (``sides.ring_of``); ``kept``: whose place on
    the circle is kept;
    ``walls``: what this drone keeps behind, by the drone beyond; ``alone``: it shares the mission with no drone that it hears;
    ``stops``: (M, 2), where the vehicles hover that are about to leave for home, if their agents are gone: both ends of each
    stretch; of those that do not hear this one, too, as they reckon with the same of it. ``coming_home``: those that may be on
    their way home then, and not down yet. ``homes``: those that are kept clear of, as others may come down there. ``left``: those
    of the missing that are revoked, obey, and have climbed from the circle. ``anywhere``: those not heard that took part,
    held, or may have, and that no line parts from this drone: they may fly on, nobody knows where.
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
