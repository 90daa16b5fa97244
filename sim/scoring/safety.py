"""Safety of a flight: distances between its drones, and fence breaches, by their true positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from radron.agent.config.mission import AreaConfig
from radron.protocol.messages import Stage
from radron.protocol.stages import SEARCHING
from radron.sim.geometry import Array
from radron.sim.scoring.moment import OFF_GROUND_M


class Safety:
    """Records the drones' true positions in a flight, and evaluates their distances and fence breaches at the end.

    The criteria are defined in ``RunResult``.
    """

    def __init__(self, area: AreaConfig) -> None:
        self._area = area
        self._places: list[Array] = []  # (N, 3) at every tick
        self._guided: list[list[bool]] = []

    def sample(self, position: Array, stages: Sequence[Stage]) -> None:
        """Record the true positions and mission stages of N drones at one tick (time step).

        ``position``: (N, 3), x and y in the mission frame and height above ground, metres.
        """
        self._places.append(position.copy())
        self._guided.append([stage in SEARCHING for stage in stages])

    def least_separation_m(self) -> float | None:
        """Return the smallest horizontal distance between two drones off the ground, in metres; None without two such drones."""
        places = np.array(self._places)
        airborne = places[..., 2] > OFF_GROUND_M
        least = np.inf
        for one in range(places.shape[1]):
            for other in range(one):
                both = airborne[:, one] & airborne[:, other]
                between = places[both, one, :2] - places[both, other, :2]
                least = min(least, float(np.hypot(between[:, 0], between[:, 1]).min(initial=np.inf)))
        return least if np.isfinite(least) else None

    def fence_breaches(self) -> int:
        """Return how often a drone left the fence, rose above the ceiling, or sank below the floor while following setpoints."""
        places, guided = np.array(self._places), np.array(self._guided)
        fence = Polygon(self._area.polygon_m).buffer(self._area.fence_margin_m)
        shapely.prepare(fence)
        x, y, z = places[..., 0], places[..., 1], places[..., 2]
        outside = (z > OFF_GROUND_M) & (~shapely.contains_xy(fence, x, y) | (z > self._area.ceiling_m))
        outside |= guided & (z < self._area.floor_m)
        return int(outside[0].sum() + (outside[1:] & ~outside[:-1]).sum())
