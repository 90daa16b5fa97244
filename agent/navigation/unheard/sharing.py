"""Circle around the source that a drone shares with its network component, while links to other drones are lost.

Each network component (the drones in two-way contact) has a circle of its own, around the same source. A larger ``ring`` is a
larger radius. This module gives the own circle, the circles of missing drones as obstacles, and the drones to space out with.
"""

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

ROOM_M = 3.0  # least distance between a circle and the fence
# A lost peer follows its last plan until it notices the loss; at about the same time it counts as missing here. Then it brakes
# from its speed on the circle, or on the way there. After this time along its plan it has stopped, to a metre or two.
_STOPS_NS = 1_000_000_000
_PASSES_MPS, _PASSED_M = 1.5, 8.0  # least speed of a drone that passes; farther outside of the circle it no longer counts


class _Circle(NamedTuple):
    """Circle on which the drone ``name`` flies if it is the first of its network component, in the order of the mission.

    ``ring``: number of the circle, 0 is the innermost.
    """

    name: str
    ring: int
    radius_m: float


class SharedCircle:
    """Circle of one drone, shared with the drones of its network component.

    In all methods, ``absence``: the missing drones, and the consequences for this one; None: no drone is missing.
    ``fits_hypothesis``: the radius of the innermost circle follows the accuracy of the source estimate (else it is fixed).
    """

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
        """Forget all positions, because a new local frame begins."""
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
        """Return, as obstacles, the next circle inside and the next one outside of this drone's, of the circles that missing
        drones may fly; each by its points nearest to ``ahead``. Empty while this drone crosses above all circles.

        The outer obstacle may be nearer than the next circle: a drone on its way to an inner circle climbs outside of this
        drone's circle before it crosses it.

        Args:
            absence: missing drones, the circle of this drone, and the places that it keeps free.
            now_ns: own time.
            centre: of all circles, local frame.
            ahead: (K, 3), the planned positions of this drone from now on, local frame.
            step_s: time between these positions.
            fits_hypothesis: the radius of the innermost circle follows the accuracy of the source estimate.
            climbs: this drone climbs on the spot before its way home; then the circles next to its position count.
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
            # A circle that this drone still has to cross on its way inward is no obstacle; left out below, by its radius.
            around = [one for one in circles if one.ring > absence.ring][:1]
            if within:
                clear_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis) + CLEAR_M
                climbing = _Circle(within[0].name, absence.ring, clear_m)
                around = [min([climbing, *around], key=lambda one: one.radius_m)]
            around = [one for one in around if far_m <= one.radius_m]
        found = [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=True) for one in within]
        return found + [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=False) for one in around]

    def inner(self, absence: Absence, now_ns: int, centre: Vector3, ahead: Array, step_s: float, fits: bool) -> list[PeerPlan]:
        """Return the inner obstacle of ``others``, for a drone that hovers because its own circle has no room inside the fence.

        Only circles count that are smaller than the distance of the drone from the centre by the separation. Arguments as of
        ``others``; ``fits``: its ``fits_hypothesis``.
        """
        clear_m = _far_m(ahead, centre) - self._mission.limits.separation_m
        within = [one for one in self._circles(absence, fits) if one.ring < absence.ring and one.radius_m <= clear_m]
        return [_beside(one.name, now_ns, step_s, ahead, centre, one.radius_m, inside=True) for one in within[-1:]]

    def middle(
        self, absence: Absence, now_ns: int, centre: Vector3, ahead: Array, step_s: float, radius_m: float
    ) -> list[PeerPlan]:
        """Return the middle of the circle as an obstacle to a drone on the circle or outside of it. Only while vehicles without
        their agents may hover (``Absence.stops``); else empty.

        It keeps drones from evading such a vehicle through the middle, where those of two network components would meet without
        a link. On the outer side they part. ``radius_m``: of this drone's circle; the other arguments as of ``others``.
        """
        within_m = radius_m - CLEAR_M
        if len(absence.stops) == 0 or within_m <= 0.0 or _far_m(ahead, centre) < radius_m - ON_M:
            return []
        return [_beside(absence.missing[0], now_ns, step_s, ahead, centre, within_m, inside=True)]

    def _circles(self, absence: Absence, fits_hypothesis: bool, *, kept: bool = True) -> list[_Circle]:
        """Return the circles that missing drones may fly, from the inner to the outer.

        Left out: drones behind a separation line, revoked drones that have left, and, unless ``kept``, drones that may still be
        on this drone's own circle. If all drones before the first missing one have left, it may also fly on circle 0 (``sides``).
        """
        circling = set(absence.missing) - set(absence.left) - set(absence.walls)
        circling -= set() if kept else set(absence.kept)
        rings = [(index, name) for index, name in enumerate(self._names) if name in circling]
        if rings and rings[0][0] > 0 and is_next(rings[0][0], self._names, absence.left):
            rings = [(0, rings[0][1]), *rings]
        return [_Circle(name, index, ring_radius_m(self._mission, index, fits_hypothesis)) for index, name in rings]

    def course(
        self, absence: Absence | None, far_m: float, height_m: float, fits_hypothesis: bool
    ) -> tuple[float | None, float | None]:
        """Return the radius (m) of the own circle while drones are missing, and the height (m) above the ground on the way there.

        Radius None: no drone is missing. Height None: that of the circle. ``far_m``: distance of this drone from the centre;
        ``height_m``: its height above the ground.
        """
        if absence is None:
            self._crossing.end()
            return None, None
        radius_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis)
        taken_m = [circle.radius_m for circle in self._circles(absence, fits_hypothesis, kept=False)]
        return self._crossing.course(far_m, height_m, radius_m, taken_m)

    @property
    def climbs_outside(self) -> bool:
        """Whether the drone climbs on the spot, outside of the circles that it crosses on its way inward."""
        return self._crossing.is_outside

    def lift_m(self, absence: Absence | None) -> float:
        """Return the height (m) of the own circle above the circle that all drones share while all links work."""
        return 0.0 if absence is None else ring_lift_m(self._mission, absence.ring)

    def has_room(self, absence: Absence | None, centre: Point2, fits_hypothesis: bool) -> bool:
        """Whether the own circle while drones are missing lies inside the fence, with a reserve; ``centre``: mission frame."""
        if absence is None:
            return True
        radius_m = ring_radius_m(self._mission, absence.ring, fits_hypothesis)
        inside = bool(shapely.contains_xy(self._fence, *centre))
        return inside and self._fence.exterior.distance(Point(centre)) >= radius_m + ROOM_M

    def stands(self, absence: Absence | None, centre: Point2, radius_m: float) -> bool:
        """Whether the drones on the circle stop at their places, because a vehicle without its agent may hover on the circle, and
        will leave soon.

        Without this stop they would evade it through the middle, one after the other. ``centre``: mission frame; ``radius_m``: of
        the circle.
        """
        if absence is None or len(absence.stops) == 0:
            return False
        away = np.hypot(*(absence.stops - centre).T)
        reach_m = self._mission.limits.separation_m + LEAST_MARGIN_M
        return bool((np.abs(away - radius_m) < reach_m).any())

    def is_crossed(
        self, now_ns: int, centre: Vector3, radius_m: float, others: Sequence[PeerPlan], partners: Mapping[str, PeerPlan]
    ) -> bool:
        """Whether a drone that does not circle, such as one on its way home, flies across the circle or near it.

        Circling drones stop until it has passed: otherwise it may push a drone along the circle. ``others``: plans of all drones;
        ``partners``: of the drones that share the circle; ``centre``: local frame. Drones that do not follow a plan do not count.
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
        """Return position and velocity of each drone that shares the circle, by id, local frame: the ``partners`` by their plans,
        and missing drones that may still be on the circle (``Absence.kept``) as predicted from their last plans.

        ``partners``: plans of the drones with a link that circle, too; ``centre``: position and velocity; ``stands``: all drones
        on the circle stand at present. Then a missing drone has come to rest on its last plan; else it circles on.
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
    """Return the horizontal distance (m) of the first planned position of ``ahead`` (K, 3), which is that of now, from the
    centre.
    """
    return float(np.hypot(*(ahead[0, :2] - centre[:2])))


def _beside(name: str, now_ns: int, step_s: float, ahead: Array, centre: Vector3, radius_m: float, *, inside: bool) -> PeerPlan:
    """Return the obstacle of a drone anywhere on a circle or on its far side: the points of the circle nearest to the positions
    ``ahead`` (K, 3). ``inside``: the far side is the inside of the circle; else all outside of it.
    """
    outward = ahead[:, :2] - centre[:2]
    far = np.hypot(outward[:, 0], outward[:, 1])
    outward = outward / np.maximum(far, 1e-6)[:, None]
    places, side = ahead.copy(), 1.0 if inside else -1.0
    places[:, :2] -= (far - radius_m)[:, None] * outward
    return blind_plan(name, now_ns, step_s, places, away=side * outward, radius_m=-side * radius_m)
