"""Base of all ``[[fault]]`` entries of a scenario: kind, targets, begin, and duration.

Times are seconds since the start of the simulation (live: since the operator's start command). Without ``for_s`` a fault is
permanent.
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
    """Base of all kinds of faults in a scenario.

    ``at_s``: begin. ``for_s``: duration; default: permanent. ``target``: the affected drone or drones; default: all.
    """

    family: ClassVar[Family]
    at_s: Second
    for_s: Duration | None = None
    target: Drones | None = None

    @property
    def end_s(self) -> float:
        """End of the fault in seconds; infinite for a permanent fault."""
        return float("inf") if self.for_s is None else self.at_s + self.for_s

    def strikes(self, drones: Sequence[str]) -> list[str]:
        """Return the ids of the drones of the mission that the fault affects."""
        if self.target is None:
            return list(drones)
        named = (self.target,) if isinstance(self.target, str) else self.target
        return [drone for drone in drones if drone in named]

    def names(self) -> tuple[str, ...]:
        """Return the ids of all drones named in the fault."""
        if self.target is None:
            return ()
        return (self.target,) if isinstance(self.target, str) else self.target

    def check(self) -> str | None:
        """Return the contradiction in the fault's values and its remedy; None if they are consistent."""
        return None
