"""The projection of the hypothesis onto a Compton cone (paper, Sec. IV-B, assumption (A3), eqs. (5) and (6))."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from radron.agent.geometry import Vector3

Rule = Literal["paper", "geometric"]
_NEGLIGIBLE_M = 1e-9


class Correction(NamedTuple):
    """The projection of a point onto a Compton cone, as the correction of an estimate.

    innovation: x_k - x_k-1, projected point minus estimate, metres. normal: unit vector of the projection's direction.
    """

    innovation: Vector3
    normal: Vector3


def project(point: Vector3, apex: Vector3, axis: Vector3, theta_rad: float, rule: Rule) -> Correction | None:
    """Project a point, the source estimate, onto the surface of a Compton cone. point, apex: metres; axis: unit vector u; one
    frame for all.

    With d = |point - apex|, v = (point - apex) / d, w = v turned by -beta in the plane of u and v (paper, eqs. (5), (6)):

        alpha = arccos(u . v),   beta = alpha - theta
        x_k = apex + w d cos(beta)     on the surface, or
        x_k = apex.

    In the code: along = d cos(alpha), across = d sin(alpha), reach = d cos(beta) = along cos(theta) + across sin(theta), height =
    d sin(beta) = across cos(theta) - along sin(theta); normal = unit vector of the outward surface normal at w, so that x_k -
    x_k-1 = -height normal on the surface, and normal = v at the apex.

    ``rule`` decides between the two cases. ``paper``: the surface if alpha < pi / 2, as printed in eq. (6). ``geometric``: the
    surface if |beta| < pi / 2. This is the nearest point, as (A3) demands. Of all rays of the surface the ray along w makes the
    smallest angle with v, |beta|. The foot of the perpendicular lies on that ray only while |beta| < pi / 2. The rules differ.
    For alpha >= pi / 2 the paper's rule pulls a point near the surface all the way to the camera. For alpha < pi / 2 with theta >
    alpha + pi / 2 its formula yields a point behind the apex, where the cone has no surface.

    On the surface itself the innovation is zero but the normal is still that of the surface: the cone confirms the point. Return
    None if u and v span no plane: the point at the apex, or on the axis (the nearest points then form a circle).
    """
    v = (point[0] - apex[0], point[1] - apex[1], point[2] - apex[2])
    distance = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if distance < _NEGLIGIBLE_M:
        return None
    along = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]  # d cos(alpha)
    off = (v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2])
    across = math.sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2])  # d sin(alpha)
    cos_theta, sin_theta = math.cos(theta_rad), math.sin(theta_rad)
    reach = along * cos_theta + across * sin_theta  # d cos(beta): from the apex to the foot, along w
    onto_surface = along > 0.0 if rule == "paper" else reach > 0.0
    if not onto_surface:
        return Correction((-v[0], -v[1], -v[2]), (v[0] / distance, v[1] / distance, v[2] / distance))
    if across < _NEGLIGIBLE_M:
        return None
    height = across * cos_theta - along * sin_theta  # d sin(beta): over the surface, outwards
    normal = (
        cos_theta * off[0] / across - sin_theta * axis[0],
        cos_theta * off[1] / across - sin_theta * axis[1],
        cos_theta * off[2] / across - sin_theta * axis[2],
    )
    return Correction((-height * normal[0], -height * normal[1], -height * normal[2]), normal)
