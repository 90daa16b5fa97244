"""Another drone as an obstacle in the own local frame (a ``PeerPlan``), by its messages or by this drone's sightings of it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import dist, hypot, inf, sqrt

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.peers.newest import OLDEST_NS, Peer
from radron.agent.navigation.peers.relative import placed_alone, places
from radron.protocol.entries import Sighting
from radron.protocol.messages import Plan, Pose

WORST_SIGMA_M = 5.0  # larger position uncertainties count as this: else one drone could drive the swarm off its circle
SIGMAS = 3.0
_DOUBT_SIGMAS, _MOST_DOUBT_M = 2.0, 1.0  # addition to the least separation if frames are estimated: so many sigma, at most so far
_POSE_GAP_NS = 500_000_000  # no position is interpolated over a longer gap between poses


def placed_by_sightings(
    name: str, sightings: Sequence[Sighting], speed_mps: float, epoch: int, now_ns: int, *, former: bool = False
) -> PeerPlan | None:
    """Return another drone as an obstacle by this drone's sightings of it alone; None if these do not give its position.

    ``speed_mps``: its present speed; with ``former``, an upper bound, because its speed is only known from before the sightings.
    ``epoch``: of the own local frame; sightings of other epochs do not count.
    """
    seen = places(sightings, epoch, now_ns, _nowhere)
    alone = placed_alone(seen, now_ns, speed_mps, former=former)
    return None if alone is None else held(name, now_ns, *alone)


def speed_of_mps(pose: Pose) -> float:
    """Return the horizontal speed (m/s) at a pose, which is the same in every frame."""
    return hypot(*pose.velocity_mps[:2])


def contradicts(seen: PeerPlan, told: PeerPlan, sigma_m: float) -> bool:
    """Whether the position by sightings contradicts the position by pose and frame: they differ by more than 3 sigma. Then the
    frame is wrong. ``sigma_m``: 1 sigma of the latter position.
    """
    (x, y, _), (told_x, told_y, _) = seen.positions[0], told.positions[0]
    return hypot(x - told_x, y - told_y) > SIGMAS * hypot(min(sigma_m, WORST_SIGMA_M), seen.sigma_m)


def expected(peer: Peer, epoch: int, local_from_theirs: Transform, stamp_ns: int) -> Vector3 | None:
    """Return the position of a drone at a stamp in the own local frame, interpolated between its poses; None in a gap between
    poses, or if they are not of this ``epoch``.
    """
    poses = peer.poses
    place = bisect_right(poses, stamp_ns, key=_stamp)
    before, after = poses[max(place - 1, 0)], poses[min(place, len(poses) - 1)]
    if before.epoch != epoch or after.epoch != epoch:
        return None
    if abs(stamp_ns - before.stamp_ns) > _POSE_GAP_NS:
        return None
    span_ns = after.stamp_ns - before.stamp_ns
    x, y, z = before.position_m
    if span_ns <= 0 or place == 0:
        elapsed_s, (u, v, w) = (stamp_ns - before.stamp_ns) * 1e-9, before.velocity_mps
        return local_from_theirs.apply_point((x + elapsed_s * u, y + elapsed_s * v, z + elapsed_s * w))
    share, (u, v, w) = (stamp_ns - before.stamp_ns) / span_ns, after.position_m
    rest = 1.0 - share
    return local_from_theirs.apply_point((rest * x + share * u, rest * y + share * v, rest * z + share * w))


def bare(transform: Transform) -> Transform:
    """Return the transform without its covariance, whose propagation costs more time than the transform itself."""
    return Transform(transform.yaw_rad, transform.translation)


def sigma_of_m(pose: Pose, mission_from_theirs: Transform) -> float:
    """Return the 1 sigma (m) of a drone's position in the mission frame: by the covariance of its frame, or the published one of
    its localisation if that is larger, as after a loss of satellites.
    """
    return max(mission_from_theirs.sigmas_at(pose.position_m)[0], pose.position_sigma_m)


def sigma_of_either_m(pose: Pose, mission_from_theirs: Transform, otherwise: Transform | None) -> float:
    """Return the 1 sigma (m) of a drone's position; with two position hypotheses, that of each one alone.

    ``otherwise``: its frame by the alternative position hypothesis, which trusts its localisation after a jump; None without
    a jump.
    """
    sigma_m, place = sigma_of_m(pose, mission_from_theirs), pose.position_m
    if otherwise is None:
        return sigma_m
    return unexplained_m(sigma_m, dist(mission_from_theirs.apply_point(place)[:2], otherwise.apply_point(place)[:2]))


def unexplained_m(sigma_m: float, doubt_m: float) -> float:
    """Return the 1 sigma (m) of one position hypothesis. The published ``sigma_m`` of a drone with two hypotheses, ``doubt_m``
    apart, also includes their distance, which is removed here.
    """
    return sqrt(max(0.0, sigma_m**2 - 0.5 * doubt_m**2))


def blind(name: str, pose: Pose, local_from_theirs: Transform, now_ns: int) -> PeerPlan:
    """Return the obstacle of a drone that flies on from its pose at constant velocity, and gives no way."""
    state = PeerState(
        local_from_theirs.apply_point(pose.position_m),
        local_from_theirs.rotate_direction(pose.velocity_mps),
        age_s=(now_ns - pose.stamp_ns) * 1e-9,
    )
    return PeerPlan.from_pose(name, now_ns, state, blind=True)


def planned(name: str, plan: Plan, local_from_theirs: Transform, sigma_m: float, now_ns: int) -> PeerPlan:
    """Return the obstacle of a drone that follows its last plan for two seconds, then stops, and gives no way."""
    ahead = local_from_theirs.apply_points(plan.positions_m)
    way = PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, sigma_m, blind=True)
    return way if now_ns - plan.stamp_ns <= OLDEST_NS else way.ended(OLDEST_NS)


def held(name: str, now_ns: int, state: PeerState, sigma_m: float) -> PeerPlan:
    """Return the obstacle of a drone with this position and velocity, and the uncertainty (1 sigma, m) of its position."""
    return PeerPlan.from_pose(name, now_ns, state, min(sigma_m, WORST_SIGMA_M), doubt_m(sigma_m))


def doubt_m(sigma_m: float) -> float:
    """Return by how much (m) the minimum separation grows for a position with this 1 sigma."""
    return min(_DOUBT_SIGMAS * sigma_m, _MOST_DOUBT_M)


def _stamp(pose: Pose) -> int:
    return pose.stamp_ns


def _nowhere(_: int) -> None:
    """Return None: no position is expected."""


def blind_plan(
    name: str,
    now_ns: int,
    step_s: float,
    places: Array,
    sigma_m: float = 0.0,
    away: Array | None = None,
    radius_m: float = inf,
) -> PeerPlan:
    """Return the obstacle of a drone that gives no way, at ``places`` (K, 3), ``step_s`` apart from now on, own local frame.

    ``away``: (K, 2) unit vectors, if the places are only the nearest points of a line or circle beyond which the drone may be
    anywhere. They point to this drone's side; ``radius_m``: of the circle, infinite for a line (see ``PeerPlan``).
    """
    flat = list(map(tuple, places.tolist()))
    return PeerPlan(name, now_ns, step_s, flat, sigma_m, blind=True, away=away, radius_m=radius_m)
