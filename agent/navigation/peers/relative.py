"""Position of another drone in the own local frame, from this drone's sightings of it, without any other frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot
from statistics import median

import numpy as np
from msgspec import Struct

from radron.agent.geometry import Vector3
from radron.agent.motion.reference import PeerState
from radron.protocol.entries import Sighting

WINDOW_NS = 3_000_000_000  # older sightings are not used
FEWEST = 4  # so many sightings must agree before they are used
_SHARE = 0.6  # and at least this share of all sightings in the window
_SIGMAS = 3.0
_FLOOR_M = 0.2  # error that all sightings of one sensor have in common
_SPAN_S = 0.8  # sightings give a velocity if they span at least this time
_CHANGE_MPS = 3.0  # error of the mean velocity in the window at its end, half of the vehicle's change of velocity in that time
_NEAR_NS = 1_200_000_000  # sightings farther apart in time than this do not confirm each other: a false one may fit by chance
UNKNOWN_MPS = 0.5  # growth of the error (1 sigma) of a position with known velocity
_STILL: Vector3 = (0.0, 0.0, 0.0)


class Placed(Struct, frozen=True):
    """Position of the other drone by one sighting, m in the own local frame, with the 1 sigma of the horizontal position, m."""

    stamp_ns: int
    position: Vector3
    sigma_m: float


class Offset(Struct, frozen=True):
    """Observed minus expected position of another drone, m in the own local frame; ``sigma_m``: 1 sigma of its length."""

    vector: Vector3
    sigma_m: float


def places(sightings: Sequence[Sighting], epoch: int, now_ns: int, expected: Callable[[int], Vector3 | None]) -> list[Placed]:
    """Return the positions of another drone, one for each sighting of the last 3 s that has a range.

    A sighting with a range alone is given the direction to the expected position: an error of the direction changes the distance
    between the two drones little. A sighting with a direction alone is not used.

    Args:
        sightings: of one drone by this one.
        epoch: of the own frame; sightings of another epoch are not used.
        now_ns: own time.
        expected: expected position at a stamp, own local frame; None if it is not known.
    """
    found = []
    for sighting in sightings:
        if sighting.epoch != epoch or not 0 <= now_ns - sighting.stamp_ns <= WINDOW_NS or sighting.range_m is None:
            continue
        (x, y, z), range_m, sigma_m = sighting.position_m, sighting.range_m, sighting.range_sigma_m or 0.0
        if sighting.direction is not None:
            direction = sighting.direction
            sigma_m = hypot(sigma_m, range_m * (sighting.direction_sigma_rad or 0.0))
        else:
            there = expected(sighting.stamp_ns)
            if there is None:
                continue
            direction = _towards(there, sighting.position_m)
        u, v, w = direction
        found.append(Placed(sighting.stamp_ns, (x + range_m * u, y + range_m * v, z + range_m * w), sigma_m))
    return found


def _towards(there: Vector3, here: Vector3) -> Vector3:
    way = np.subtract(there, here)
    x, y, z = (way / max(float(np.linalg.norm(way)), 1e-6)).tolist()
    return x, y, z


def offset(seen: Sequence[Placed], expected: Callable[[int], Vector3 | None]) -> Offset | None:
    """Return the mean offset of another drone from its expected positions, by the sightings that agree; None if fewer than 4 or
    than 60 % of them agree.

    ``seen``: positions by sightings; ``expected``: returns the expected position at a stamp, None if it is not known.
    """
    known = [(one.position, there, one.sigma_m) for one in seen if (there := expected(one.stamp_ns)) is not None]
    if len(known) < FEWEST:
        return None
    apart = [(x - u, y - v, z - w) for (x, y, z), (u, v, w), _ in known]
    # Without NumPy's median and std, which would take as long as all the rest for a dozen values.
    middle = [median(along) for along in zip(*apart, strict=True)]
    vectors, sigmas = np.array(apart), np.array([sigma_m for _, _, sigma_m in known])
    agree = np.hypot(*(vectors - middle)[:, :2].T) <= _SIGMAS * sigmas + _FLOOR_M
    agreeing = vectors[agree]
    count = len(agreeing)
    if count < max(FEWEST, _SHARE * len(known)):
        return None
    mean = agreeing.sum(axis=0) / count
    u, v, _ = np.sqrt(np.square(agreeing - mean).sum(axis=0) / count).tolist()  # standard deviations
    spread_m = max(float(np.hypot(u, v)), float(sigmas[agree].sum()) / count)
    x, y, z = mean.tolist()
    return Offset((x, y, z), hypot(spread_m / count**0.5, _FLOOR_M))


def placed_alone(
    seen: Sequence[Placed], now_ns: int, speed_mps: float, *, former: bool = False
) -> tuple[PeerState, float] | None:
    """Return the motion of a drone at its newest confirmed sighting, and the 1 sigma (m) of its position now; None if no sighting
    is confirmed.

    A sighting is confirmed if three others fit it, for a drone that moves at up to ``speed_mps``; false sightings fit no others.
    Enough sightings also give the velocity.

    With ``former``, ``speed_mps`` is only an upper bound, because the speed is known from before the sightings. Then the
    sightings have to fit a straight flight, that of their majority; ``speed_mps`` applies if they are too few to give one. A
    speed from before would be wrong here: at 2 m/s, the sightings of a drone at 6 m/s would not confirm each other, and the
    position would lag by 7 m.
    """
    straight = _velocity(seen) if former else None
    slack_mps, near_ns = (speed_mps, WINDOW_NS) if straight is None else (_CHANGE_MPS, _NEAR_NS)
    for place in sorted(seen, key=lambda place: place.stamp_ns, reverse=True):
        agreeing = [other for other in seen if _agree(place, other, straight or _STILL, slack_mps)]
        if sum(abs(other.stamp_ns - place.stamp_ns) <= near_ns for other in agreeing) >= FEWEST - 1:
            break
    else:
        return None
    age_s = (now_ns - place.stamp_ns) * 1e-9
    velocity = straight
    if straight is not None or speed_mps > 0.5:  # otherwise the drone hovers
        velocity = _velocity(agreeing) or straight
    unknown_mps = UNKNOWN_MPS if velocity is not None else speed_mps
    state = PeerState(place.position, velocity or _STILL, age_s)
    return state, place.sigma_m + unknown_mps * age_s


def _agree(one: Placed, other: Placed, velocity: Vector3, slack_mps: float) -> bool:
    """Whether both positions may be of one drone, which flies at this velocity, give or take ``slack_mps``."""
    elapsed_s = (other.stamp_ns - one.stamp_ns) * 1e-9
    (x, y, _), (u, v, _) = one.position, other.position
    apart_m = hypot(x + elapsed_s * velocity[0] - u, y + elapsed_s * velocity[1] - v)
    return apart_m <= slack_mps * abs(elapsed_s) + _SIGMAS * hypot(one.sigma_m, other.sigma_m)


def _velocity(places: Sequence[Placed]) -> Vector3 | None:
    """Return the horizontal velocity (m/s) of a straight flight through the positions; None if they are too few, or span too
    short a time. It is the median over all pairs (Theil-Sen estimator), so a few false positions do not matter.
    """
    times = np.array([place.stamp_ns - places[0].stamp_ns for place in places]) * 1e-9
    if len(places) < 2 * FEWEST or np.ptp(times) < _SPAN_S:
        return None
    flat = np.array([place.position[:2] for place in places])
    first, last = np.triu_indices(len(places), 1)
    elapsed = times[last] - times[first]
    apart = np.abs(elapsed) > 0.5 * _SPAN_S
    u, v = np.median((flat[last] - flat[first])[apart] / elapsed[apart, None], axis=0).tolist()
    return u, v, 0.0
