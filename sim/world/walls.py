"""Concrete walls between sources and cameras, and the path length of a straight line through them.

The walls stop photons, not vehicles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from radron.agent.config.mission import Corner
from radron.agent.errors import ConfigError
from radron.sim.geometry import Array

_PARALLEL = 1e-12  # stands for a zero component along an axis: the line is then between a wall's faces everywhere, or nowhere


class WallTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An upright concrete wall on the ground. ``from_m``, ``to_m``: ends of its centre line, mission frame."""

    from_m: Corner
    to_m: Corner
    thickness_m: Annotated[float, Meta(gt=0.0, le=100.0)] = 0.2
    height_m: Annotated[float, Meta(gt=0.0, le=1000.0)] = 2.5

    def check(self, where: str) -> None:
        """Raise ConfigError if the wall has no length."""
        if self.from_m == self.to_m:
            raise ConfigError(f"{where}: walls: from_m and to_m are both {list(self.from_m)}; give two different ends")


class Walls:
    """All walls of a scenario, for the attenuation of photons on a straight line."""

    def __init__(self, walls: Sequence[WallTruth]) -> None:
        ends = np.array([(wall.from_m, wall.to_m) for wall in walls]).reshape(-1, 2, 2)
        size = np.array([(wall.thickness_m, wall.height_m) for wall in walls]).reshape(-1, 2)
        along = ends[:, 1] - ends[:, 0]
        length = np.hypot(along[:, 0], along[:, 1])
        x, y = along.T / length
        none = np.zeros_like(x)
        self._turn = np.stack((x, y, none, -y, x, none, none, none, none + 1.0), axis=-1).reshape(-1, 3, 3)
        self._middle = np.column_stack((ends.mean(axis=1), 0.5 * size[:, 1]))
        self._half = 0.5 * np.column_stack((length, size))

    def concrete_m(self, start: Array, end: Array) -> float:
        """Return the length of concrete on the straight line between two points (3,) of the mission frame.

        Overlapping walls all count.
        """
        way = end - start
        place = np.einsum("wij,wj->wi", self._turn, start - self._middle)
        ways = self._turn @ way
        ways = np.where(ways == 0.0, _PARALLEL, ways)
        middle, half = -place / ways, self._half / np.abs(ways)
        enters = np.maximum((middle - half).max(axis=1), 0.0)
        leaves = np.minimum((middle + half).min(axis=1), 1.0)
        return float(np.maximum(leaves - enters, 0.0).sum() * np.linalg.norm(way))
