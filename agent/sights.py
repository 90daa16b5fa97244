"""Where another drone is by what this one sees of it: in its own local frame, so that no other frame has to be known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot

import numpy as np
from msgspec import Struct

from agent.frames.transform import Array, Vector3
from agent.motion.reference import PeerState
from protocol.messages import Sighting

WINDOW_NS = 3_000_000_000  # older sights count no more
FEWEST = 4  # sights that must agree before they are believed
_SHARE = 0.6  # of all in the window, at least, for those that agree
_SIGMAS = 3.0
_FLOOR_M = 0.2  # sights of one sensor are wrong together, too
_SPAN_S = 0.8  # over which sights must be spread to tell a velocity


class Placed(Struct, frozen=True):
    """A place of the other drone, (3,) m in the own local frame, with 1 sigma of its horizontal distance, m."""

    stamp_ns: int
    position: Array
    sigma_m: float


class Offset(Struct, frozen=True):
    """By how much the other drone is elsewhere than expected, (3,) m in the own local frame; 1 sigma of the distance."""

    vector: Vector3
    sigma_m: float


def places(sights: Sequence[Sighting], epoch: int, now_ns: int, expected: Callable[[int], Array | None]) -> list[Placed]:
    """Where the sights of the last seconds put the other drone.

    A range without a direction is taken along the expected one, which matters little for how far apart the two are. A direction
    without a range says nothing of that.

    Args:
        sights: of one drone by this one.
        epoch: of the own frame; what was seen in another one does not count.
        now_ns: UTC.
        expected: where it should have been at a stamp, own local frame; None where nobody knows.
    """
    found = []
    for sight in sights:
        if sight.epoch != epoch or not 0 <= now_ns - sight.stamp_ns <= WINDOW_NS or sight.range_m is None:
            continue
        own, sigma_m = np.array(sight.position_m), sight.range_sigma_m or 0.0
        if sight.direction is not None:
            direction = np.array(sight.direction)
            sigma_m = hypot(sigma_m, sight.range_m * (sight.direction_sigma_rad or 0.0))
        else:
            there = expected(sight.stamp_ns)
            if there is None:
                continue
            direction = (there - own) / max(float(np.linalg.norm(there - own)), 1e-6)
        found.append(Placed(sight.stamp_ns, own + sight.range_m * direction, sigma_m))
    return found


def offset(seen: Sequence[Placed], expected: Callable[[int], Array | None]) -> Offset | None:
    """By how much most sights say that it is elsewhere than expected; None where too few agree."""
    known = [(place, there) for place in seen if (there := expected(place.stamp_ns)) is not None]
    if len(known) < FEWEST:
        return None
    apart = np.array([place.position - there for place, there in known])
    sigmas = np.array([place.sigma_m for place, _ in known])
    agree = np.hypot(*(apart - np.median(apart, axis=0))[:, :2].T) <= _SIGMAS * sigmas + _FLOOR_M
    count = int(agree.sum())
    if count < max(FEWEST, _SHARE * len(known)):
        return None
    spread_m = max(float(np.hypot(*apart[agree].std(axis=0)[:2])), float(sigmas[agree].mean()))
    x, y, z = apart[agree].mean(axis=0).tolist()
    return Offset((x, y, z), hypot(spread_m / count**0.5, _FLOOR_M))


def placed_alone(seen: Sequence[Placed], now_ns: int, speed_mps: float) -> tuple[PeerState, float] | None:
    """Position, velocity and sigma (m) of a drone of which only its speed is known besides; None while it is not sure.

    The newest sight that others bear out counts; false ones agree with none. With enough of them they tell the velocity, too.
    """
    for place in sorted(seen, key=lambda place: place.stamp_ns, reverse=True):
        agreeing = [other for other in seen if _agree(place, other, speed_mps)]
        if len(agreeing) >= FEWEST - 1:
            break
    else:
        return None
    age_s = (now_ns - place.stamp_ns) * 1e-9
    velocity = _velocity(agreeing) if speed_mps > 0.5 else None  # a drone that hovers
    x, y, z = place.position.tolist()
    unknown_mps = 0.5 if velocity is not None else speed_mps
    state = PeerState((x, y, z), velocity or (0.0, 0.0, 0.0), age_s)
    return state, place.sigma_m + unknown_mps * age_s


def _agree(one: Placed, other: Placed, speed_mps: float) -> bool:
    way_m = speed_mps * abs(one.stamp_ns - other.stamp_ns) * 1e-9
    apart_m = float(np.hypot(*(one.position - other.position)[:2]))
    return apart_m <= way_m + _SIGMAS * hypot(one.sigma_m, other.sigma_m)


def _velocity(places: Sequence[Placed]) -> Vector3 | None:
    """Horizontal velocity of a straight flight through the places: the median over all pairs (Theil and Sen), which a few false
    ones do not move.
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
