"""The nearest point on a Compton cone: how a cone corrects a hypothesis (paper, Sec. IV-B, Fig. 5 and eq. "projection")."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from agent.frames.transform import Vector3

Rule = Literal["paper", "geometric"]
_NEGLIGIBLE_M = 1e-9


class Correction(NamedTuple):
    """innovation: projected point minus hypothesis, metres. normal: unit vector along which it was projected."""

    innovation: Vector3
    normal: Vector3


def project(point: Vector3, apex: Vector3, axis: Vector3, theta_rad: float, rule: Rule) -> Correction | None:
    """Project a point onto the cone's surface.

    With u the axis, v the direction from apex to point, alpha = angle(u, v), beta = alpha - theta, and w = v turned by -beta in
    the plane of u and v: the projection is apex + w |point - apex| cos(beta), or the apex itself.

    Which of the two is decided by ``rule``. ``paper``: the surface if alpha < pi/2, literally. ``geometric``: the surface if
    |beta| < pi/2, which is the nearest point: of all rays of the surface the one along w makes the smallest angle with v,
    |beta|, and the foot of a perpendicular lies on that ray only while |beta| < pi/2. Where they differ: for alpha >= pi/2 the
    paper pulls a point that lies near the surface all the way to the camera; and for alpha < pi/2 with theta > alpha + pi/2 its
    formula lands on the ray's continuation behind the apex, where the cone has no surface.

    On the surface itself the innovation is zero but the normal is still that of the surface, so the cone confirms the point.
    None where there is no plane of u and v to project in: the point at the apex, or on the axis (then the nearest points form a
    full circle and favour no direction).
    """
    v = (point[0] - apex[0], point[1] - apex[1], point[2] - apex[2])
    distance = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if distance < _NEGLIGIBLE_M:
        return None
    along = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]  # |v| cos(alpha)
    off = (v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2])
    across = math.sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2])  # |v| sin(alpha)
    cos_theta, sin_theta = math.cos(theta_rad), math.sin(theta_rad)
    reach = along * cos_theta + across * sin_theta  # |v| cos(beta): of the foot, along w
    onto_surface = along > 0.0 if rule == "paper" else reach > 0.0
    if not onto_surface:
        return Correction((-v[0], -v[1], -v[2]), (v[0] / distance, v[1] / distance, v[2] / distance))
    if across < _NEGLIGIBLE_M:
        return None
    height = across * cos_theta - along * sin_theta  # |v| sin(beta): over the surface, outwards
    normal = (
        cos_theta * off[0] / across - sin_theta * axis[0],
        cos_theta * off[1] / across - sin_theta * axis[1],
        cos_theta * off[2] / across - sin_theta * axis[2],
    )
    return Correction((-height * normal[0], -height * normal[1], -height * normal[2]), normal)
