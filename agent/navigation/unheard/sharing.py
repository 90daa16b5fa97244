"""Circle that a drone shares with the peers it hears: its radius and its places while other links are lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Point, Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Array, Point2, Vector3
from radron.agent.motion.orbit import ring_lift_m, ring_radius_m
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import LEAST_MARGIN_M, PeerPlan
from radron.agent.navigation.peers.placing import blind_plan
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import ON_M
from radron.agent.navigation.unheard.crossing import CLEAR_M, Crossing
from radron.agent.navigation.unheard.sides import is_next

ROOM_M = 3.0  # between a circle and the fence
# A lost peer follows its plan until it notices the loss. At the same time it ceases to count here. Then it brakes from its speed
# on the circle, or on the way there: within this time, to a metre or two.
_STOPS_NS = 1_000_000_000
_PASSES_MPS, _PASSED_M = 1.5, 8.0  # speed of passing traffic; distance outside the circle beyond which traffic is ignored


class _Circle(NamedTuple):
    """Circle on which a missing drone may fly, if it is the first of its network component."""

    name: str
    ring: int
    radius_m: float


class SharedCircle:
    """Shared circle, from the view of one drone."""

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        """``drone``: the own id."""
        self._mission = mission
        self._crossing = Crossing(mission, drone)
        self._names = [member.id for member in mission.drones]
        self._fence = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m)
        shapely.prepare(self._fence)
        # The last plan of each peer with a link, with the time and the centre then.
        self._heard: dict[str, tuple[int, PeerPlan, Vector3]] = {}

    def begin(self) -> None:
        """Begin anew in another local frame."""
        self._heard.clear()
        self._crossing.end()

    def others(
        self,
        absence: Absence,
        now_ns: int,
        centre: Vector3,
        ahead: Array,
        step_s: float,
        fits_hypothesis: bool,
        *,
        climbs: bool = False,
    ) -> list[PeerPlan]:
        """Return the next circles inside and outside of the own one on which missing drones may fly, nearest to the own plan.

        A drone that belongs on a circle inside may still be outside, and climb there before it crosses.

        ``ahead``: (K, 3), the own planned positions, ``step_s`` apart, local frame as the ``centre``; ``climbs``: this drone
        climbs before its way home, and no circle is its own any more.
        """
        if self._crossing.is_over and not climbs:
            return []
        far_m = _far_m(ahead, centre)
        if self._crossing.climbs or climbs:
            circles = self._circles(absence, fits_hypothesis, kept=False)
            within = [one for one in circles if one.radius_m < far_m][-1:]
            around = [one for one in circles if one.radius_m >= far_m][:1]
        else:
            circles = self._circles(absence, fits_hypothesis)
            within = [one for one in circles if one.ring < absence.ring][-1:]
            # A drone outside of such a circle is on the way in.
            around = [one for one in circles if one.ring > absence.ring][:1]
            if within:
                clear_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis) + CLEAR_M
                climbing = _Circle(within[0].name, absence.ring, clear_m)
                around = [min([climbing, *around], key=lambda one: one.radius_m)]
            around = [one for one in around if far_m <= one.radius_m]
        found = [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=True) for one in within]
        return found + [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=False) for one in around]

    def inner(self, absence: Absence, now_ns: int, centre: Vector3, ahead: Array, step_s: float, fits: bool) -> list[PeerPlan]:
        """Return the inner circle of ``others``, for a drone clear of it that hovers, because its own circle has no room."""
        clear_m = _far_m(ahead, centre) - self._mission.limits.separation_m
        within = [one for one in self._circles(absence, fits) if one.ring < absence.ring and one.radius_m <= clear_m]
        return [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=True) for one in within[-1:]]

    def middle(
        self, absence: Absence, now_ns: int, centre: Vector3, ahead: Array, step_s: float, radius_m: float
    ) -> list[PeerPlan]:
        """Return the middle of the circle as an obstacle to a drone on it or outside, while vehicles without agents may hover
        there.

        Through the middle, two network components would meet around those vehicles, unexpected by either; outward they part.
        ``radius_m``: of the shared circle; the other arguments as in ``others``.
        """
        within_m = radius_m - CLEAR_M
        if len(absence.stops) == 0 or within_m <= 0.0 or _far_m(ahead, centre) < radius_m - ON_M:
            return []
        return [_beside(absence.missing[0], now_ns, step_s, ahead, centre, within_m, inside=True)]

    def _circles(self, absence: Absence, fits_hypothesis: bool, *, kept: bool = True) -> list[_Circle]:
        """Return the circles of missing drones, from the inner to the outer; ``kept``: with the drones of kept places.

        The first missing drone may fly on the shared circle as well if all drones before it have left (``sides``).
        """
        circling = set(absence.missing) - set(absence.left) - set(absence.walls)  # separation lines part this drone from the last
        circling -= set() if kept else set(absence.kept)
        rings = [(index, name) for index, name in enumerate(self._names) if name in circling]
        if rings and rings[0][0] > 0 and is_next(rings[0][0], self._names, absence.left):
            rings = [(0, rings[0][1]), *rings]
        return [_Circle(name, index, ring_radius_m(self._mission, index, fits_hypothesis)) for index, name in rings]

    def course(
        self, absence: Absence | None, far_m: float, height_m: float, fits_hypothesis: bool
    ) -> tuple[float | None, float | None]:
        """Return the radius and the height above ground that keep clear of missing drones; None: no constraint.

        ``far_m``: the own distance from the circle's centre; ``height_m``: the own height above ground.
        """
        if absence is None:
            self._crossing.end()
            return None, None
        radius_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis)
        taken_m = [circle.radius_m for circle in self._circles(absence, fits_hypothesis, kept=False)]
        return self._crossing.course(far_m, height_m, radius_m, taken_m)

    @property
    def climbs_outside(self) -> bool:
        """Whether the drone climbs, before it crosses, outside of all circles."""
        return self._crossing.is_outside

    def lift_m(self, absence: Absence | None) -> float:
        """Return the lift of the own circle, in m above the circle shared by all drones."""
        return 0.0 if absence is None else ring_lift_m(self._mission, absence.ring)

    def has_room(self, absence: Absence | None, centre: Point2, fits_hypothesis: bool) -> bool:
        """Whether the circle that keeps clear of missing drones lies inside the fence; ``centre``: mission frame."""
        if absence is None:
            return True
        radius_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis)
        inside = bool(shapely.contains_xy(self._fence, *centre))
        return inside and self._fence.exterior.distance(Point(centre)) >= radius_m + ROOM_M

    def stands(self, absence: Absence | None, centre: Point2, radius_m: float) -> bool:
        """Whether the drones on the circle stop, evenly spaced: a vehicle without its agent may hover on it, and leaves soon.

        Without the stop they would evade it through the middle, one after the other. ``centre``: mission frame.
        """
        if absence is None or len(absence.stops) == 0:
            return False
        away = np.hypot(*(absence.stops - centre).T)
        reach_m = self._mission.limits.separation_m + LEAST_MARGIN_M
        return bool((np.abs(away - radius_m) < reach_m).any())

    def is_crossed(
        self, now_ns: int, centre: Vector3, radius_m: float, others: Sequence[PeerPlan], partners: Mapping[str, PeerPlan]
    ) -> bool:
        """Whether other drones that follow their plans, but do not circle too, fly across the circle or near it, on their way
        home.

        Circling drones stop until crossing traffic has passed: otherwise that traffic may carry a drone along.
        """
        for plan in others:
            (x, y, _), (u, v, _) = (state := plan.state(now_ns)).position, state.velocity
            near = hypot(x - centre[0], y - centre[1]) < radius_m + _PASSED_M
            if near and hypot(u, v) > _PASSES_MPS and not plan.blind and plan.id not in partners:
                return True
        return False

    def places(
        self,
        now_ns: int,
        partners: Mapping[str, PeerPlan],
        absence: Absence | None,
        centre: tuple[Vector3, Vector3],
        radius_m: float,
        stands: bool = False,
    ) -> dict[str, PeerState]:
        """Return the drones that share the circle: the heard ones, and the missing ones with a kept place.

        ``centre``: position and velocity, local frame as all positions; ``stands``: all drones on the circle stand at present,
        and missing drones have come to rest as far along their plans as they got.
        """
        (x, y, z), (u, v, _) = centre
        for name, plan in partners.items():
            self._heard[name] = now_ns, plan, centre[0]
        found = {name: plan.state(now_ns) for name, plan in partners.items()}
        speed_mps = 0.0 if stands else self._mission.encirclement.speed_mps
        for name in absence.kept if absence is not None else ():
            if name not in self._heard:
                continue
            since_ns, plan, (then_x, then_y, _) = self._heard[name]
            last_x, last_y, _ = plan.state(since_ns + (_STOPS_NS if stands else 0)).position
            angle = atan2(last_y - then_y, last_x - then_x) + (now_ns - since_ns) * 1e-9 * speed_mps / radius_m
            c, s = cos(angle), sin(angle)
            found[name] = PeerState((x + radius_m * c, y + radius_m * s, z), (u - speed_mps * s, v + speed_mps * c, 0.0))
        return found


def _far_m(ahead: Array, centre: Vector3) -> float:
    """Horizontal distance from the centre now, at the first of the planned positions (K, 3)."""
    return float(np.hypot(*(ahead[0, :2] - centre[:2])))


def _beside(name: str, now_ns: int, step_s: float, ahead: Array, centre: Vector3, radius_m: float, *, inside: bool) -> PeerPlan:
    """Return a plan anywhere on a circle or beyond it, nearest to positions ``ahead`` (K, 3); ``inside``: beyond is inside."""
    outward = ahead[:, :2] - centre[:2]
    far = np.hypot(outward[:, 0], outward[:, 1])
    outward = outward / np.maximum(far, 1e-6)[:, None]
    places, side = ahead.copy(), 1.0 if inside else -1.0
    places[:, :2] -= (far - radius_m)[:, None] * outward
    return blind_plan(name, now_ns, step_s, places, away=side * outward, radius_m=-side * radius_m)
