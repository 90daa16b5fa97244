"""Geographic positions (WGS84) for Foxglove's map, in missions with a datum (place on Earth)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

from foxglove.messages import GeoJson, LocationFix, LocationFixPositionCovarianceType

from radron.agent.config.mission import DatumConfig
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.agent.frames.transform import Transform
from radron.protocol.messages import Pose
from radron.station.picture.frame import DroneFrame, MissionFrame, Point, SourceFrame
from radron.station.picture.numbering import numbered
from radron.station.picture.shapes import circle, cordon_radius_m, region
from radron.station.viewers.scene import colour_of, moment, shade
from radron.station.viewers.topics import MISSION

_BLACK, _RED = "#111111", "#a33b00"


class OnEarth:
    """Converts positions of one mission to geographic messages for Foxglove's map."""

    def __init__(self, datum: DatumConfig, about: MissionFrame) -> None:
        self._datum, self._about = datum, about

    def fix(self, drone: DroneFrame, mission_from_local: Transform, pose: Pose) -> LocationFix:
        """Return a drone's geographic position as Foxglove's message."""
        variance = pose.position_sigma_m**2
        place = mission_from_local.apply_point(pose.position_m)
        latitude_deg, longitude_deg, altitude_m = geodetic_from_mission(self._datum, place)
        return LocationFix(
            timestamp=moment(pose.stamp_ns),
            frame_id=MISSION,
            latitude=latitude_deg,
            longitude=longitude_deg,
            altitude=altitude_m,
            position_covariance=[variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance],
            position_covariance_type=LocationFixPositionCovarianceType.Approximated,
            color=shade(colour_of(self._about.drones.index(drone.id), drone)),
        )

    def source_fix(self, source: SourceFrame, at_ns: int) -> LocationFix:
        """Return an estimated source's geographic position, with its error covariance, as Foxglove's message."""
        xx, xy, xz, yy, yz, zz = source.covariance_m2
        latitude_deg, longitude_deg, altitude_m = geodetic_from_mission(self._datum, source.place)
        if source.position_deg is not None:  # not rounded
            latitude_deg, longitude_deg = source.position_deg
        return LocationFix(
            timestamp=moment(at_ns),
            frame_id=MISSION,
            latitude=latitude_deg,
            longitude=longitude_deg,
            altitude=altitude_m,
            position_covariance=[xx, xy, xz, xy, yy, yz, xz, yz, zz],
            position_covariance_type=LocationFixPositionCovarianceType.Known,
        )

    def outlines(self, sources: Iterable[SourceFrame]) -> GeoJson:
        """Return the search area, and each source with its 90 % region and its cordon, as outlines for Foxglove's map."""
        outlines: list[tuple[str, str, Sequence[Point]]] = [("area", _BLACK, self._about.area)]
        for source in sources:
            outlines.append((f"source{numbered(source)}", _BLACK, [source.place[:2]]))
            outlines.append((f"region{numbered(source)}", _BLACK, region(source)))
            radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
            if radius_m is not None:
                outlines.append((f"cordon{numbered(source)}", _RED, circle(source.place, radius_m)))
        features = [
            {
                "type": "Feature",
                "properties": {"name": name, "style": {"color": colour}},
                "geometry": self._geometry(points),
            }
            for name, colour, points in outlines
        ]
        return GeoJson(geojson=json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False))

    def _geometry(self, points: Sequence[Point]) -> dict[str, object]:
        coordinates = [self._lonlat(point) for point in points]
        return (
            {"type": "LineString", "coordinates": coordinates}
            if len(points) > 1
            else {"type": "Point", "coordinates": coordinates[0]}
        )

    def _lonlat(self, point: Point) -> tuple[float, float]:
        latitude_deg, longitude_deg, _ = geodetic_from_mission(self._datum, (*point, 0.0))
        return longitude_deg, latitude_deg
