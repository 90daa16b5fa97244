"""Random missions without their faults: the swarm, its area, the source, and the kinds of localisation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from radron.sim.campaign.faults.course import Course

_DATUM = {"latitude_deg": 47.397742, "longitude_deg": 8.545594, "altitude_m": 488.0}
PACE_MPS = 0.8  # of the fastest source: the swarm circles at 3 m/s
_APART_M = (5.0, 7.0)  # between the launch places
_DEALT = (("gnss", False), ("slam", True))  # kind after the first drone's, and whether the heading is unknown
_IDEAL = ("horizontal_m", "vertical_m", "height_m", "yaw_deg", "tilt_deg", "velocity_mps", "climb_mps", "drift_m")


def draw_mission(
    rng: np.random.Generator,
    name: str,
    course: Course,
    *,
    estimated: bool | None = None,
    dealt: bool = False,
    alone: bool = False,
) -> dict[str, Any]:
    """Return a random scenario without faults, as the content of a scenario file.

    ``estimated``: whether the drones' local frames have to be estimated; None: random. ``dealt``: then each kind of localisation
    occurs, also with an unknown heading. ``alone``: then all fly by satellites, without a base or sightings of other drones.
    """
    width_m, depth_m = (round(float(side)) for side in rng.uniform(*course.side_m, 2))
    count = int(rng.integers(3, course.most_drones + 1))
    places = _launch_places(rng, count, width_m, depth_m)
    drawn = bool(rng.random() < 0.25)
    estimated = drawn if estimated is None else estimated
    drones = [{"id": f"d{k + 1}", "origin_m": place} for k, place in enumerate(places)]
    document: dict[str, Any] = {
        "name": name,
        "description": f"Random mission: {count} drones in {width_m} x {depth_m} m",
        "mission": {
            "name": name,
            "drones": drones,
            "area": {"polygon_m": _outline(rng, width_m, depth_m), "fence_margin_m": round(float(rng.uniform(*course.margin_m)))},
            "survey": {"strategy": "information" if rng.random() < 0.75 else "lanes", "duration_s": course.search_s},
            "encirclement": {
                "radius_m": round(float(rng.uniform(9.0, 13.0)), 1),
                "speed_mps": round(float(rng.uniform(2.0, 3.5)), 1),
            },
            "fusion": {"estimator": "bayes"},
            "track": {"duration_s": round(float(rng.uniform(*course.track_s)))},
        },
        "source": _source(rng, width_m, depth_m),
        "vehicle": {"gust_mps2": 0.1},
        "camera": {"background_hits_per_s": 1.5, "scatter_near": 0.2, "scatter_air": 0.8},
        "end": {"search_s": course.end_s, "track_s": course.end_s},
    }
    if estimated:
        _estimate_frames(rng, document, dealt=dealt, alone=alone)
    elif rng.random() < 0.6:
        document["localization"] = dict.fromkeys(_IDEAL, 0.0)
    return document


def _launch_places(rng: np.random.Generator, count: int, width_m: float, depth_m: float) -> list[list[float]]:
    """Place the drones in rows beside the south edge."""
    apart_m = float(rng.uniform(*_APART_M))
    columns = count if rng.random() < 0.6 else math.ceil(count / 2)
    while (columns - 1) * apart_m > width_m - 4.0:
        columns -= 1
    west = 2.0 + float(rng.uniform(0.0, width_m - 4.0 - (columns - 1) * apart_m))
    return [[round(west + k % columns * apart_m, 2), round(2.0 + k // columns * apart_m, 2), 0.0] for k in range(count)]


def _outline(rng: np.random.Generator, width_m: float, depth_m: float) -> list[list[float]]:
    """Return a rectangle, or a rectangle without a corner, as fields are."""
    corners = [[0.0, 0.0], [width_m, 0.0], [width_m, depth_m], [0.0, depth_m]]
    if rng.random() < 0.3:
        cut = round(float(rng.uniform(0.2, 0.5)), 2)
        corners[2:3] = [[width_m, depth_m * (1.0 - cut)], [width_m * (1.0 - cut), depth_m]]
    return [[round(x, 2), round(y, 2)] for x, y in corners]


def _source(rng: np.random.Generator, width_m: float, depth_m: float) -> dict[str, Any]:
    source: dict[str, Any] = {"activity_bq": float(f"{10.0 ** rng.uniform(9.3, 10.0):.2g}")}
    motion = str(rng.choice(["static", "wander", "circle"], p=[0.6, 0.25, 0.15]))
    if motion != "static":
        source |= {"motion": motion, "speed_mps": round(float(rng.uniform(0.2, PACE_MPS)), 2)}
    if motion == "circle":
        source["circle_radius_m"] = round(0.25 * min(width_m, depth_m), 1)
    return source


def _estimate_frames(rng: np.random.Generator, document: dict[str, Any], *, dealt: bool, alone: bool) -> None:
    """Give each drone its own kind of localisation, and sightings of the others; or ``alone`` (``draw_mission``)."""
    vehicles = {}
    for k, drone in enumerate(document["mission"]["drones"]):
        kind = "rtk" if k == 0 else str(rng.choice(["gnss", "rtk", "slam"], p=[0.2, 0.5, 0.3]))
        lost = bool(kind == "slam" and rng.random() < 0.5)
        if dealt and 0 < k <= len(_DEALT):
            kind, lost = _DEALT[k - 1]
        if alone:
            kind, lost = "gnss", False
        heading_deg = 180.0 if lost else 5.0
        drone |= {"localization": kind, "origin_sigma_m": 2.0, "yaw_sigma_deg": heading_deg}
        vehicles[drone["id"]] = {"kind": kind, "origin_m": 1.0} | ({"yaw_deg": heading_deg} if kind == "slam" else {})
    document["mission"]["datum"] = _DATUM
    if not alone:
        document["sightings"] = {"sensor": str(rng.choice(["both", "direction"]))}
    document["localization"] = dict.fromkeys(_IDEAL, 0.0) | {"vehicles": vehicles}
