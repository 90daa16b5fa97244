"""Circle of one drone around the source: centre, radius and height, and the reference on it, in the drone's local frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, cos, hypot, sin

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.geometry import Array
from radron.agent.localization.ownpose import LocalFrame
from radron.agent.motion.encirclement import Encirclement
from radron.agent.motion.leading import Leading
from radron.agent.motion.orbit import Orbit, second_height_m
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import DOUBT_SIGMAS, LEAST_MARGIN_M, PeerPlan, margin_m
from radron.agent.navigation.focus import is_in_second_half
from radron.agent.navigation.moment import HORIZON, STEP_S, Centre, Moment
from radron.agent.navigation.neighbours import Neighbour
from radron.agent.navigation.ownground import OwnGround
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import Circle
from radron.agent.navigation.unheard.sharing import ROOM_M, SharedCircle
from radron.protocol.messages import Stage
from radron.protocol.stages import CIRCLING

_SPEED_SHARE = 0.85  # share of the speed limit for the speed on the circle and that of the source together


class Circling:
    """Circle of one drone around the source, shared with the peers that it hears.

    In all methods, ``absence``: the missing drones, and the consequences for this one; None: no drone is missing.
    """

    def __init__(self, mission: MissionConfig, drone: str, ground: OwnGround) -> None:
        """``drone``: the own id."""
        self._config, self._id, self._ground = mission, drone, ground
        self._orbit = Orbit(mission.encirclement, mission.area.floor_m)
        self._second_m = second_height_m(mission)
        most_mps = _SPEED_SHARE * mission.limits.speed_mps - mission.encirclement.speed_mps
        self._leading = Leading(mission.area, most_mps, mission.encirclement.radius_m + ROOM_M)
        self._encirclement = Encirclement(mission.encirclement, mission.limits)
        self._shared = SharedCircle(mission, drone)

    def begin(self) -> None:
        """Forget all positions of a former flight or local frame."""
        self._shared.begin()

    def centre(self, moment: Moment, frame: LocalFrame | None) -> Centre | None:
        """Return the centre of the circle; None without a source estimate, or while the local frame (``frame``) is not known."""
        hypothesis = moment.hypothesis
        if hypothesis is None or frame is None:
            return None
        x, y, z = hypothesis.sight_of(self._id).position.tolist()
        u, v, w = hypothesis.velocity.tolist()
        if hypothesis.evidence is not None:  # only an estimator that gives an evidence also gives a velocity
            (x, y), (u, v) = self._leading.centre(moment.now_ns, hypothesis.stamp_ns, (x, y), (u, v))
        to_local = frame.local_from_mission
        return Centre(to_local.apply_point((x, y, z)), to_local.rotate_direction((u, v, w)), ((x, y), (u, v)))

    def circle(self, moment: Moment, centre: Centre | None) -> Circle | None:
        """Return the present circle of this drone, mission frame; None if it does not track, or without a ``centre``."""
        if centre is None or moment.stage not in CIRCLING:
            return None
        radius_m = self._orbit.radius_m if self._fits(moment) else self._config.encirclement.radius_m
        return Circle(*centre.in_mission, radius_m, self._config.encirclement.speed_mps)

    def has_room(self, moment: Moment, centre: Centre | None, absence: Absence | None) -> bool:
        """Whether the circle of this drone while drones are missing lies inside the fence. True if no drone is missing, or this
        one does not track.
        """
        circle = self.circle(moment, centre)
        return circle is None or self._shared.has_room(absence, circle.centre, self._fits(moment))

    def reference(
        self,
        moment: Moment,
        state: PeerState,
        centre: Centre,
        partners: Sequence[Neighbour],
        deviation_m: float,
        absence: Absence | None,
        others: Sequence[PeerPlan],
    ) -> tuple[Reference, list[PeerPlan]]:
        """Return the reference on the circle from ``state`` on, and, as obstacles, the missing drones whose places on the circle
        stay free.

        With the law ``smooth`` and an estimator that gives a posterior, the circle is as narrow as the posterior allows.
        Otherwise it is the configured one, and widens while the source is searched again. Arguments as of ``Guidance.reference``.
        """
        x, y, _ = centre.position
        far_m = hypot(state.position[0] - x, state.position[1] - y)
        ring_m, over_m = self._shared.course(absence, far_m, moment.vehicle.height_m, self._fits(moment))
        radius_m, height_m = self._size_m(moment, absence, ring_m)
        heard = {partner.id: partner.plan for partner in partners}
        stands = self._shared.stands(absence, centre.in_mission[0], radius_m)
        stands = stands or self._shared.is_crossed(moment.now_ns, centre.position, radius_m, others, heard)
        places = self._shared.places(moment.now_ns, heard, absence, (centre.position, centre.velocity), radius_m, stands)
        unheard = ((name, place) for name, place in places.items() if name not in heard)
        kept = [PeerPlan.from_pose(name, moment.now_ns, place, blind=True) for name, place in unheard]
        if self._shared.climbs_outside and ring_m is not None and over_m is not None:
            return self._still(state, centre, ring_m, self._ground.level_m(moment.vehicle) + over_m), kept
        reference = self._encirclement.reference(
            self._ground.above_level(state, moment.vehicle),
            places,
            self._id,
            center=(x, y, self._ground.level_m(moment.vehicle)),
            center_velocity=centre.velocity,
            radius_m=radius_m,
            height_m=over_m or height_m,
            doubt_m=self._doubt_m(moment, heard, deviation_m),
            stands=stands,
        )
        return reference, kept

    def hover(self, moment: Moment, state: PeerState, centre: Centre, absence: Absence | None, z_m: float) -> Reference:
        """Return a hold at the nearest point of the circle, at the local height ``z_m``."""
        (x, y, _), (cx, cy, _) = state.position, centre.position
        ring_m, _ = self._shared.course(absence, hypot(x - cx, y - cy), moment.vehicle.height_m, self._fits(moment))
        radius_m, _ = self._size_m(moment, absence, ring_m)
        return self._still(state, centre, radius_m, z_m)

    @staticmethod
    def _still(state: PeerState, centre: Centre, radius_m: float, z_m: float) -> Reference:
        """Return a hold at the nearest point of a circle with this radius, at the local height ``z_m``.

        A drone climbs there before a crossing, and not at its place between the others on the circle: on its way there it would
        fly low and fast past hovering drones without a link to it.
        """
        (x, y, _), (cx, cy, _) = state.position, centre.position
        angle = atan2(y - cy, x - cx)
        place = (cx + radius_m * cos(angle), cy + radius_m * sin(angle))
        return Reference(np.tile((*place, z_m), (HORIZON + 1, 1)), np.zeros((HORIZON + 1, 3)), STEP_S)

    def circles_of_others(
        self,
        moment: Moment,
        centre: Centre | None,
        absence: Absence | None,
        ahead: Callable[[], Array],
        *,
        climbs: bool,
        has_room: bool,
    ) -> list[PeerPlan]:
        """Return, as obstacles, the neighbouring circles that missing drones may fly, and the middle of the own circle while
        vehicles may hover on it (``SharedCircle.others``, ``middle``). Empty if this drone neither tracks nor ``climbs``.

        ``ahead``: returns this drone's planned positions (K, 3), local frame; ``climbs``: it climbs on the spot before its way
        home; ``has_room``: its circle lies inside the fence.
        """
        circle = self.circle(moment, centre)
        if absence is None or centre is None or (circle is None and not climbs):
            return []
        now_ns, at, way, fits = moment.now_ns, centre.position, ahead(), self._fits(moment)
        found = [] if circle is None else self._shared.middle(absence, now_ns, at, way, STEP_S, circle.radius_m)
        if not has_room:
            return found + self._shared.inner(absence, now_ns, at, way, STEP_S, fits)
        return found + self._shared.others(absence, now_ns, at, way, STEP_S, fits, climbs=climbs)

    def _size_m(self, moment: Moment, absence: Absence | None, ring_m: float | None) -> tuple[float, float]:
        """Return radius and height (m) above the ground of the circle. ``ring_m``: the radius while drones are missing, else
        None.
        """
        config, hypothesis = self._config.encirclement, moment.hypothesis
        lift_m, lost = self._shared.lift_m(absence), moment.stage is Stage.REACQUIRE
        if self._fits(moment) and hypothesis is not None:
            rms_m, least_m = hypothesis.sight_of(self._id).rms_m, self._least_m(moment, hypothesis, absence)
            self._orbit.update(moment.now_ns, rms_m, hypothesis.activity_bq, lost, ring_m, lift_m, least_m)
            return self._orbit.radius_m, self._orbit.height_m
        widened_m = config.radius_m + (self._config.track.widening_mps * moment.stage_s if lost else 0.0)
        return widened_m if ring_m is None else ring_m, config.height_m + lift_m

    def _doubt_m(self, moment: Moment, partners: dict[str, PeerPlan], deviation_m: float) -> float:
        """Return by how much (m) the drones on the circle keep more distance, because of position uncertainty and deviations from
        plans.
        """
        widest_m = max((margin_m(deviation_m, plan.deviation_m) for plan in partners.values()), default=0.0)
        doubt_m = max(0.0, widest_m - LEAST_MARGIN_M)
        if self._fits(moment):
            doubt_m += DOUBT_SIGMAS * max((plan.sigma_m for plan in partners.values()), default=0.0)
        return doubt_m

    def _least_m(self, moment: Moment, source: Hypothesis, absence: Absence | None) -> float:
        """Return the least height (m) above the ground: greater in the second half of each turn around a source of unknown
        height. 0 otherwise, and while drones are missing, because then the heights separate the network components.
        """
        if self._second_m is None or absence is not None or moment.stage is not Stage.TRACK:
            return 0.0
        return self._second_m if is_in_second_half(source, self._config) else 0.0

    def _fits(self, moment: Moment) -> bool:
        """Whether the circle's radius follows the accuracy of the source estimate: law ``smooth``, and an estimator that gives
        it.
        """
        return (
            self._config.encirclement.law == "smooth" and moment.hypothesis is not None and moment.hypothesis.evidence is not None
        )
