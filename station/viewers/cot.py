"""The swarm as Cursor on Target events (CoT 2.0, as TAK reads them): drones, each source with its region and its cordon.

The region is drawn as a polygon ("u-d-f"): clients disagree about the meaning of an ellipse's angle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from xml.etree import ElementTree

from radron.agent.config.mission import DatumConfig
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.station.picture.frame import DroneFrame, Frame, MissionFrame, SourceFrame
from radron.station.picture.numbering import numbered
from radron.station.picture.shapes import CORDON_USVPH, cordon_radius_m, region

DRONE, SPOT, POLYGON, CIRCLE = "a-f-A-M-H-Q", "b-m-p-s-m", "u-d-f", "u-d-c-c"  # friendly rotary-wing drone; marks and drawings
DRONE_STALE_S, SOURCE_STALE_S = 5.0, 15.0
REGION_POINTS = 24
_UNKNOWN = "9999999.0"  # CoT's value for an unknown height or error
_BLACK, _RED, _ORANGE, _CLEAR = "-16777216", "-65536", "-23296", "0"  # signed ARGB
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # characters that XML 1.0 cannot hold
Place = tuple[float, float, float]


class CursorOnTarget:
    """Converts the state of the swarm to Cursor on Target events, which TAK shows on its map.

    The mission must have a datum (place on Earth).
    """

    def __init__(self, datum: DatumConfig, about: MissionFrame) -> None:
        self._datum = datum
        self._prefix = f"radron.{about.swarm}.{about.id}"

    def drones(self, frame: Frame) -> Iterator[bytes]:
        """Yield an event for each drone in contact; a drone out of contact becomes stale on the receivers' maps."""
        for drone in frame.drones:
            if drone.place is not None and not drone.stale:
                yield self._drone(drone, drone.place, frame.at_ms)

    def sources(self, frame: Frame) -> Iterator[bytes]:
        """Yield events for each estimated source, its 90 % region and its cordon; nothing without an estimate."""
        for source in (frame.source, *frame.others):
            if source is not None:
                yield from self._source(source, frame.at_ms)

    def _source(self, source: SourceFrame, at_ms: int) -> Iterator[bytes]:
        yield self._mark(source, at_ms)
        outline = [(x, y, source.place[2]) for x, y in region(source, REGION_POINTS)]
        name = f"90 % region of the source{numbered(source)}"
        yield self._drawing("region", name, POLYGON, source, at_ms, outline=outline)
        radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
        if radius_m is not None:
            name = f"cordon {CORDON_USVPH:g} µSv/h at 1 m{numbered(source, ', source ')}"
            yield self._drawing("cordon", name, CIRCLE, source, at_ms, radius_m=radius_m)

    def _drone(self, drone: DroneFrame, place: Place, at_ms: int) -> bytes:
        event, detail = self._event(drone.id, DRONE, place, at_ms, DRONE_STALE_S, drone.sigma_m)
        course_deg = math.degrees(0.5 * math.pi - drone.yaw) % 360.0  # of the nose: the picture has no course over ground
        _child(detail, "contact", callsign=drone.id)
        _child(detail, "track", course=f"{course_deg:.1f}", speed=f"{drone.speed_mps:.2f}")
        if drone.battery is not None:
            _child(detail, "status", battery=str(round(100.0 * drone.battery)))
        _child(detail, "remarks").text = _text("; ".join((drone.stage, *drone.problems)))
        return _written(event)

    def _mark(self, source: SourceFrame, at_ms: int) -> bytes:
        height_sigma_m = math.sqrt(max(0.0, source.covariance_m2[5]))
        uid = f"source{numbered(source, '-')}"
        event, detail = self._event(uid, SPOT, source.place, at_ms, SOURCE_STALE_S, source.rms_m, height_sigma_m)
        _child(detail, "contact", callsign=f"source{numbered(source)} {source.nuclide}")
        _child(detail, "color", argb=_ORANGE)
        told = [source.nuclide, f"position RMS {source.rms_m:.2f} m", f"{source.cones} cones"]
        if source.activity_bq is not None:
            sigma = f" +- {source.activity_sigma_bq:.2g}" if source.activity_sigma_bq is not None else ""
            told.append(f"activity {source.activity_bq:.3g}{sigma} Bq")
        if source.dose_usvph is not None:
            told.append(f"{source.dose_usvph:.3g} µSv/h at 1 m")
        _child(detail, "remarks").text = _text("; ".join(told))
        return _written(event)

    def _drawing(
        self,
        what: str,
        name: str,
        kind: str,
        source: SourceFrame,
        at_ms: int,
        outline: list[Place] | None = None,
        radius_m: float = 0.0,
    ) -> bytes:
        event, detail = self._event(f"{what}{numbered(source, '-')}", kind, source.place, at_ms, SOURCE_STALE_S)
        if outline is None:
            shape = _child(detail, "shape")
            _child(shape, "ellipse", major=f"{radius_m:.2f}", minor=f"{radius_m:.2f}", angle="360")
        for place in outline or ():
            latitude_deg, longitude_deg, _ = geodetic_from_mission(self._datum, place)
            _child(detail, "link", point=f"{latitude_deg:.8f},{longitude_deg:.8f}")
        _child(detail, "contact", callsign=name)
        _child(detail, "strokeColor", value=_BLACK if outline is not None else _RED)
        _child(detail, "strokeWeight", value="3.0")
        _child(detail, "fillColor", value=_CLEAR)
        _child(detail, "labels_on", value="true")
        return _written(event)

    def _event(
        self,
        uid: str,
        kind: str,
        place: Place,
        at_ms: int,
        stale_s: float,
        sigma_m: float | None = None,
        height_m: float | None = None,
    ) -> tuple[ElementTree.Element, ElementTree.Element]:
        """Return an event and its detail. ``sigma_m``, ``height_m``: 1-sigma errors, horizontal and of the height."""
        event = ElementTree.Element("event", version="2.0", uid=f"{self._prefix}.{uid}", type=kind, how="m-g")
        event.set("time", _time(at_ms))
        event.set("start", _time(at_ms))
        event.set("stale", _time(at_ms + round(1e3 * stale_s)))
        latitude_deg, longitude_deg, altitude_m = geodetic_from_mission(self._datum, place)
        _child(
            event,
            "point",
            lat=f"{latitude_deg:.8f}",
            lon=f"{longitude_deg:.8f}",
            hae=f"{altitude_m:.2f}",
            ce=f"{sigma_m:.2f}" if sigma_m is not None else _UNKNOWN,
            le=f"{height_m:.2f}" if height_m is not None else _UNKNOWN,
        )
        return event, _child(event, "detail")


def _child(parent: ElementTree.Element, name: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, name, {key: _text(value) for key, value in attributes.items()})


def _text(text: str) -> str:
    return _NO_XML.sub("\ufffd", text)


def _written(event: ElementTree.Element) -> bytes:
    written: bytes = ElementTree.tostring(event, encoding="utf-8", xml_declaration=True)
    return written


def _time(at_ms: int) -> str:
    return datetime.fromtimestamp(at_ms / 1e3, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
