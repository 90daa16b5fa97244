"""Log entry -> observation in the mission frame: what the estimators read."""

from __future__ import annotations

import math
from dataclasses import dataclass

from agent.frames.transform import Transform, Vector3
from protocol.messages import Cone, Entry

_SHORTEST_AXIS = 0.5  # a unit vector as sent; anything this short is no direction


@dataclass(frozen=True, slots=True)
class ConeObservation:
    """A Compton cone by its most probable order, mission frame.

    apex: metres. axis: unit vector; the source lies at the angle theta_rad from it, give or take sigma_rad (ARM).
    ``entry`` is the cone as published (both orders, energies), in the publisher's local frame.
    """

    stamp_ns: int
    apex: Vector3
    axis: Vector3
    theta_rad: float
    sigma_rad: float
    entry: Cone


Observation = ConeObservation


def observe(entry: Entry, mission_from_local: Transform) -> Observation | None:
    """Bring an entry into the mission frame; None if it says nothing about the source.

    That is decided by the entry's content alone, so that every agent decides alike: a cone says nothing if both of its
    orders are impossible (probability 0), or if its axis is no direction.
    """
    if isinstance(entry, Cone):
        return _observe_cone(entry, mission_from_local)
    return None


def _observe_cone(cone: Cone, mission_from_local: Transform) -> ConeObservation | None:
    first, second = cone.orders
    order = first if first.probability >= second.probability else second
    length = math.hypot(*order.axis)
    if order.probability <= 0.0 or length < _SHORTEST_AXIS:
        return None
    x, y, z = mission_from_local.rotate_direction(order.axis)
    return ConeObservation(
        stamp_ns=cone.stamp_ns,
        apex=mission_from_local.apply_point(cone.apex_m),
        axis=(x / length, y / length, z / length),
        theta_rad=order.theta_rad,
        sigma_rad=order.sigma_rad,
        entry=cone,
    )
