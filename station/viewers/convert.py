"""Conversion of positions, drones, sources and counts to Foxglove's messages and to tables."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    Grid,
    PackedElementField,
    PackedElementFieldNumericType,
    Pose,
    PoseInFrame,
    PosesInFrame,
    Quaternion,
    Vector2,
    Vector3,
)

from radron.agent import geometry
from radron.agent.frames.transform import Transform
from radron.protocol import messages
from radron.protocol.entries import Exposure
from radron.protocol.spectrum import BINS, EDGES_KEV
from radron.station.picture.frame import DroneFrame, Raster, SourceFrame
from radron.station.picture.rasters import DECADE, MIN_USVPH
from radron.station.viewers.scene import moment
from radron.station.viewers.topics import BODY, LOCAL, MISSION, CountsTable, DroneTable, SourceTable, SpectrumTable

LEVEL = (1.0, 0.0, 0.0, 0.0)
_MIDDLES_KEV = tuple(round(0.5 * (low + high), 2) for low, high in pairwise(EDGES_KEV))


def posed(place: geometry.Vector3, attitude: geometry.Quaternion = LEVEL) -> Pose:
    """Return a position and an attitude (w, x, y, z) as Foxglove's pose."""
    return Pose(position=_vector(place), orientation=_quaternion(attitude))


def turned(yaw_rad: float, attitude: geometry.Quaternion) -> geometry.Quaternion:
    """Return an attitude (w, x, y, z) after a further rotation by ``yaw_rad`` about the vertical axis."""
    c, s = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    w, x, y, z = attitude
    return c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w


def transforms(drone: str, mission_from_local: Transform, pose: messages.Pose) -> FrameTransforms:
    """Return Foxglove's transforms of a drone: its local frame in the mission frame, and its body in the local frame.

    ``mission_from_local``: as estimated from the log. The pose of the body is exactly as published.
    """
    stamp, local = moment(pose.stamp_ns), LOCAL.format(drone=drone)
    place, heading = mission_from_local.translation, turned(mission_from_local.yaw_rad, LEVEL)
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=_vector(translation),
                rotation=_quaternion(rotation),
            )
            for parent, child, translation, rotation in (
                (MISSION, local, place, heading),
                (local, BODY.format(drone=drone), pose.position_m, pose.quaternion),
            )
        ]
    )


def posed_in(mission_from_local: Transform, pose: messages.Pose) -> PoseInFrame:
    """Return a drone's pose in the mission frame as Foxglove's message."""
    place, attitude = mission_from_local.apply_point(pose.position_m), turned(mission_from_local.yaw_rad, pose.quaternion)
    return PoseInFrame(timestamp=moment(pose.stamp_ns), frame_id=MISSION, pose=posed(place, attitude))


def planned(mission_from_local: Transform, plan: messages.Plan) -> PosesInFrame:
    """Return a drone's planned trajectory in the mission frame as Foxglove's message."""
    course = [posed(place) for place in mission_from_local.apply_points(plan.positions_m)]
    return PosesInFrame(timestamp=moment(plan.stamp_ns), frame_id=MISSION, poses=course)


def grid(layer: Raster, height_m: float) -> Grid:
    """Return a raster layer of the map as Foxglove's grid, with values in probability per m2 or in uSv/h.

    The values keep the 255 steps of the web page. ``height_m``: height at which the layer is drawn.
    """
    steps = np.frombuffer(base64.b64decode(layer.values), np.uint8).astype(np.float64)
    if layer.kind == "belief":
        name, values = "density_pm2", steps * layer.scale / 255.0
    else:
        name, values = "dose_usvph", np.where(steps > 0.0, MIN_USVPH * 10.0 ** (steps / DECADE), 0.0)
    return Grid(
        timestamp=moment(layer.at_ms * 1_000_000),
        frame_id=MISSION,
        pose=posed((*layer.origin, height_m)),
        column_count=layer.columns,
        cell_size=Vector2(x=layer.cell_m, y=layer.cell_m),
        row_stride=4 * layer.columns,
        cell_stride=4,
        fields=[PackedElementField(name=name, offset=0, type=PackedElementFieldNumericType.Float32)],
        data=values.astype("<f4").tobytes(),
    )


def drone_table(drone: DroneFrame) -> DroneTable:
    """Return the state of a drone as a table of numbers for Foxglove's plots."""
    hits, photopeak, coincidences = drone.rates_ps if drone.rates_ps is not None else (None, None, None)
    return DroneTable(
        stage=drone.stage,
        heard=not drone.stale,
        speed_mps=drone.speed_mps,
        battery=drone.battery,
        age_s=drone.age_s,
        sigma_m=drone.sigma_m,
        clock_s=drone.clock_s,
        apart_m=drone.apart_m,
        hits_ps=hits,
        photopeak_ps=photopeak,
        coincidences_ps=coincidences,
        recognised=drone.recognised,
        problems=drone.problems,
        notices=drone.notices,
        problem_codes=drone.problem_codes,
        notice_codes=drone.notice_codes,
    )


def counts_table(exposure: Exposure) -> CountsTable:
    """Return the photon counts of one exposure (counting interval of a camera) as a table for Foxglove's plots."""
    singles, coincident = [0] * BINS, [0] * BINS
    for each in exposure.spectrum:
        singles[each.place], coincident[each.place] = each.singles, each.coincidences
    return CountsTable(
        end_s=exposure.end_ns * 1e-9,
        live_time_s=exposure.live_time_s,
        hits=exposure.counts.hits,
        photopeak=exposure.counts.photopeak,
        coincidences=exposure.counts.coincidences,
        singles=tuple(singles),
        coincident=tuple(coincident),
    )


def spectrum_table(exposures: Iterable[Exposure]) -> SpectrumTable:
    """Return the summed spectrum of several exposures (counting intervals of a camera) as a table for Foxglove's plots."""
    counts, live_s = [0] * BINS, 0.0
    for exposure in exposures:
        live_s += exposure.live_time_s
        for each in exposure.spectrum:
            counts[each.place] += each.singles + each.coincidences
    return SpectrumTable(live_time_s=live_s, energy_kev=_MIDDLES_KEV, counts=tuple(counts))


def source_table(source: SourceFrame) -> SourceTable:
    """Return an estimated source as a table of numbers for Foxglove's plots."""
    (x, y, z), (vx, vy), (long_m, short_m, direction) = source.place, source.velocity_mps, source.region
    latitude_deg, longitude_deg = source.position_deg if source.position_deg is not None else (None, None)
    return SourceTable(
        number=source.number,
        x_m=x,
        y_m=y,
        z_m=z,
        rms_m=source.rms_m,
        covariance_m2=source.covariance_m2,
        region_long_m=long_m,
        region_short_m=short_m,
        region_direction_rad=direction,
        vx_mps=vx,
        vy_mps=vy,
        cones=source.cones,
        nuclide=source.nuclide,
        activity_bq=source.activity_bq,
        activity_sigma_bq=source.activity_sigma_bq,
        dose_usvph=source.dose_usvph,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
    )


def _vector(vector: geometry.Vector3) -> Vector3:
    x, y, z = vector
    return Vector3(x=x, y=y, z=z)


def _quaternion(quaternion: geometry.Quaternion) -> Quaternion:
    w, x, y, z = quaternion
    return Quaternion(x=x, y=y, z=z, w=w)
