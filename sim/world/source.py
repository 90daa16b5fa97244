"""The true path of the radioactive source as a function of time, drawn from the run's seed."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, radians, sin

import numpy as np
from shapely import Point, Polygon

from radron.sim.world.sourcetruth import EDGE_M, SourceTruth

Place = tuple[float, float]
Path = Callable[[float], Place]  # time in seconds -> x, y in the mission frame
STRETCH_S = (4.0, 12.0)  # duration of a stretch of constant speed and curvature of a wandering source
TURN_RPS = 0.3  # limit of a curved stretch
_WANDER_STEP_S = 0.1


def source_path(source: SourceTruth, area: Polygon, duration_s: float, rng: np.random.Generator) -> Path:
    """Return the horizontal path of a source, as a function of time from 0 to ``duration_s``."""
    if source.motion == "circle":
        return _circle(source, area, rng)
    start = source.start_m or (anywhere(area, rng) if source.outside_m is None else outside(area, source.outside_m, rng))
    if source.motion == "legs":
        return _legs(source, start, rng)
    if source.motion == "static" or source.speed_mps == 0.0:
        return lambda time_s: start
    return _wander(source, area, start, duration_s, rng)


def anywhere(area: Polygon, rng: np.random.Generator) -> Place:
    """Return a random position in the area, uniformly distributed."""
    west, south, east, north = area.bounds
    while True:
        x, y = float(rng.uniform(west, east)), float(rng.uniform(south, north))
        if area.contains(Point(x, y)):
            return x, y


def outside(area: Polygon, between_m: Place, rng: np.random.Generator) -> Place:
    """Return a random position outside the area, uniformly distributed, whose distance to it lies between two limits (m)."""
    least_m, most_m = between_m
    west, south, east, north = area.bounds
    while True:
        x, y = float(rng.uniform(west - most_m, east + most_m)), float(rng.uniform(south - most_m, north + most_m))
        if least_m <= area.distance(Point(x, y)) <= most_m and not area.contains(Point(x, y)):
            return x, y


def _circle(source: SourceTruth, area: Polygon, rng: np.random.Generator) -> Path:
    centre, radius = area.centroid, source.circle_radius_m
    phase = float(rng.uniform(0.0, 2.0 * pi))
    rate = source.speed_mps / radius

    def place(time_s: float) -> Place:
        angle = phase + rate * time_s
        return centre.x + radius * cos(angle), centre.y + radius * sin(angle)

    return place


def _legs(source: SourceTruth, start: Place, rng: np.random.Generator) -> Path:
    """Leg after leg from a drawn heading; at rest after the last one."""
    heading = float(rng.uniform(0.0, 2.0 * pi))
    times_s, places = [0.0], [start]
    for leg in source.legs:
        heading += radians(leg.turn_deg)
        length_m, (x, y) = leg.speed_mps * leg.for_s, places[-1]
        times_s.append(times_s[-1] + leg.for_s)
        places.append((x + length_m * cos(heading), y + length_m * sin(heading)))
    xs, ys = zip(*places, strict=True)
    return lambda time_s: (float(np.interp(time_s, times_s, xs)), float(np.interp(time_s, times_s, ys)))


def _wander(source: SourceTruth, area: Polygon, start: Place, duration_s: float, rng: np.random.Generator) -> Path:
    """Straight and curved stretches, each with its own speed; turns back to the middle at the area's edge."""
    inner = area.buffer(-EDGE_M)
    middle = inner.representative_point()
    steps = int(duration_s / _WANDER_STEP_S) + 2
    track = np.empty((steps, 2))
    x, y = start
    heading = float(rng.uniform(0.0, 2.0 * pi))
    speed = turn = left_s = 0.0
    for step in range(steps):
        track[step] = x, y
        if left_s <= 0.0:
            left_s = float(rng.uniform(*STRETCH_S))
            speed = source.speed_mps * float(rng.uniform(source.slowest, 1.0))
            turn = 0.0 if rng.random() < 0.5 else float(rng.uniform(-TURN_RPS, TURN_RPS))
        if not inner.contains(Point(x, y)):
            inward = float(np.arctan2(middle.y - y, middle.x - x))
            error = (inward - heading + pi) % (2.0 * pi) - pi
            heading += float(np.clip(error, -0.15, 0.15))
        else:
            heading += turn * _WANDER_STEP_S
        x += speed * cos(heading) * _WANDER_STEP_S
        y += speed * sin(heading) * _WANDER_STEP_S
        left_s -= _WANDER_STEP_S

    def place(time_s: float) -> Place:
        position = min(max(time_s / _WANDER_STEP_S, 0.0), steps - 1.001)
        before = int(position)
        part = position - before
        (xb, yb), (xa, ya) = track[before].tolist(), track[before + 1].tolist()
        return xb + part * (xa - xb), yb + part * (ya - yb)

    return place
