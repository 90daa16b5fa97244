"""Base of all ``[[fault]]`` entries of a scenario: a kind, the drones it strikes, when, and for how long.

Times are seconds since the start of the simulation (live: since the operator's start command). Without ``for_s`` a fault stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, Struct

Family = Literal["process", "network", "liar", "camera", "clock", "pose", "thrust", "vehicle", "disk"]
Second = Annotated[float, Meta(ge=0.0, le=36_000.0)]
Duration = Annotated[float, Meta(gt=0.0, le=36_000.0)]
Probability = Annotated[float, Meta(gt=0.0, le=1.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Delay = Annotated[float, Meta(ge=0.0, le=60.0)]
Metres = Annotated[float, Meta(gt=0.0, le=1000.0)]
Drones = (
    str | tuple[str, ...]
)  # no DroneId: msgspec 0.22 corrupts memory over a union of types with patterns; names are checked on load


class Fault(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of all kinds. ``target``: one drone or several; all if it is not given. ``for_s``: not given, it stays for good."""

    family: ClassVar[Family]
    at_s: Second
    for_s: Duration | None = None
    target: Drones | None = None

    @property
    def end_s(self) -> float:
        """When it is over; infinite for one that stays."""
        return float("inf") if self.for_s is None else self.at_s + self.for_s

    def strikes(self, drones: Sequence[str]) -> list[str]:
        """The drones that it strikes, of those of the mission."""
        if self.target is None:
            return list(drones)
        named = (self.target,) if isinstance(self.target, str) else self.target
        return [drone for drone in drones if drone in named]

    def names(self) -> tuple[str, ...]:
        """All drones named in it."""
        if self.target is None:
            return ()
        return (self.target,) if isinstance(self.target, str) else self.target

    def check(self) -> str | None:
        """What contradicts itself in it, and what to give instead; None where nothing does."""
        return None
