"""The circle that one drone shares with those that it hears: its radius and its places while others are not heard."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, sin

import numpy as np
import shapely
from shapely import Point, Polygon

from agent.config.mission import MissionConfig
from agent.geometry import Array, Point2, Vector3
from agent.motion.orbit import ring_radius_m
from agent.motion.reference import PeerState
from agent.motion.separation import PeerPlan
from agent.navigation.silent import Absence, blind_plan

_ROOM_M = 3.0  # between a circle and the fence


class SharedCircle:
    """Circle of one drone. ``has_room``: the one that is its own while others are not heard lies inside the fence."""

    def __init__(self, mission: MissionConfig) -> None:
        self._mission = mission
        self._names = [member.id for member in mission.drones]
        self._fence = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m)
        shapely.prepare(self._fence)
        self._angles: dict[str, tuple[int, float]] = {}  # where each was on the circle when it was last heard
        self.has_room = True

    def begin(self) -> None:
        """The local frame is another one."""
        self._angles.clear()

    def others(
        self, absence: Absence, now_ns: int, centre: Vector3, ahead: Array, step_s: float, fits_hypothesis: bool
    ) -> list[PeerPlan]:
        """The next circles inside and outside of the own one that missing drones may fly on, where nearest to the own plan.

        ``ahead``: (K, 3), the own planned positions, ``step_s`` apart, local frame as the ``centre``.
        """
        circling = set(absence.missing) - set(absence.walls)  # the others are kept apart from by lines
        rings = [(index, name) for index, name in enumerate(self._names) if name in circling]
        within = [one for one in rings if one[0] < absence.ring][-1:]
        around = [one for one in rings if one[0] > absence.ring][:1]
        outward = ahead[:, :2] - centre[:2]
        far = np.hypot(outward[:, 0], outward[:, 1])
        outward = outward / np.maximum(far, 1e-6)[:, None]
        found = []
        for side, (index, name) in [(1.0, one) for one in within] + [(-1.0, one) for one in around]:
            radius_m = ring_radius_m(self._mission, index, fits_hypothesis)
            if side < 0.0 and far[0] > radius_m:
                continue  # this drone is on its way in
            places = ahead.copy()
            places[:, :2] -= (far - radius_m)[:, None] * outward
            found.append(blind_plan(name, now_ns, step_s, places, away=side * outward))
        return found

    def ring_m(self, absence: Absence | None, centre: Point2, fits_hypothesis: bool) -> float | None:
        """The radius that keeps clear of those that are not heard; None while all are heard. ``centre``: mission frame."""
        self.has_room = True
        if absence is None:
            return None
        radius_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis)
        inside = shapely.contains_xy(self._fence, *centre)
        self.has_room = inside and self._fence.exterior.distance(Point(centre)) >= radius_m + _ROOM_M
        return radius_m

    def places(
        self,
        now_ns: int,
        partners: Mapping[str, PeerState],
        absence: Absence | None,
        centre: tuple[Vector3, Vector3],
        radius_m: float,
    ) -> dict[str, PeerState]:
        """The drones among which the circle is divided: those that are heard, and those that are missing but whose place is kept.

        ``centre``: its position and velocity, local frame as all positions.
        """
        (x, y, z), (u, v, _) = centre
        for name, state in partners.items():
            self._angles[name] = now_ns, atan2(state.position[1] - y, state.position[0] - x)
        found = dict(partners)
        speed_mps = self._mission.encirclement.speed_mps
        for name in absence.kept if absence is not None else ():
            if name not in self._angles:
                continue
            since_ns, angle = self._angles[name]
            angle += (now_ns - since_ns) * 1e-9 * speed_mps / radius_m
            c, s = cos(angle), sin(angle)
            found[name] = PeerState((x + radius_m * c, y + radius_m * s, z), (u - speed_mps * s, v + speed_mps * c, 0.0))
        return found
