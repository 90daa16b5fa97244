"""Description of contaminated ground in a scenario: nuclide, level, and patterns of size and place drawn from the seed."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct
from shapely import Polygon

from radron.agent.errors import ConfigError
from radron.sim.radiation.nuclides import NUCLIDES

PatternKind = Literal["uniform", "patch", "gradient", "streets", "spots", "l", "ring", "blobs", "plume"]
Size = Annotated[float, Meta(gt=0.0, le=1e3)]


class ContaminationTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contaminated flat ground in and around the area; several of them add up.

    level_bqm2: the highest activity per area, Bq/m2. patterns: one of these is drawn from the seed. size_m: limits of the size,
    which is drawn from the seed as place and direction are:

    - ``uniform``: the whole area and ``margin_m`` around it, without a size.
    - ``patch``: a square of this side. ``l``: two bars of this length, a third of it wide. ``ring``: of this diameter, a quarter
      of it wide.
    - ``gradient``: a Gaussian whose standard deviation is half of this. ``blobs``: two of them, the second at 0.6 of the level.
      ``plume``: Gaussian across the wind, widening downwind; as long as this to a fifth of the level.
    - ``streets``: two straight streets of this width that cross in the area.
    - ``spots``: discs of this diameter, from ``count[0]`` to ``count[1]`` of them.
    """

    nuclide: str = "Cs-137"
    level_bqm2: Annotated[float, Meta(gt=0.0, le=1e12)]
    patterns: Annotated[tuple[PatternKind, ...], Meta(min_length=1, max_length=9)]
    size_m: tuple[Size, Size] = (20.0, 20.0)
    margin_m: Annotated[float, Meta(ge=0.0, le=500.0)] = 0.0
    count: tuple[Annotated[int, Meta(ge=1, le=8)], Annotated[int, Meta(ge=1, le=8)]] = (1, 1)

    def check(self, area: Polygon, where: str) -> None:
        """Raise ConfigError for an unknown nuclide, limits in the wrong order, or a pattern that does not fit into the area.

        ``where``: file and key, for the error.
        """
        if self.nuclide not in NUCLIDES:
            raise ConfigError(f"{where}.nuclide: unknown nuclide {self.nuclide!r}; known: {', '.join(NUCLIDES)}")
        for key, (low, high) in {"size_m": self.size_m, "count": self.count}.items():
            if low > high:
                raise ConfigError(f"{where}.{key}: {low:g} is more than {high:g}; give the smaller one first")
        whole = {"uniform", "streets"}  # need no room around their middle
        if set(self.patterns) - whole and area.buffer(-0.5 * self.size_m[1]).is_empty:
            raise ConfigError(f"{where}.size_m: a pattern of {self.size_m[1]:g} m does not fit into the area; give a smaller one")
