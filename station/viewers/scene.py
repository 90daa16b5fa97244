"""The mission as shapes in Foxglove's 3D view. Each update replaces the last update of its topic, so that any second of a record
can be shown without the seconds before.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from foxglove.messages import (
    ArrowPrimitive,
    Color,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
    Vector3,
)

from radron.agent.geometry import Vector3 as Vector
from radron.agent.terrain.ground import Ground
from radron.station.picture.frame import ConeCurve, DroneFrame, MissionFrame, Point, SourceFrame
from radron.station.picture.numbering import numbered
from radron.station.picture.shapes import CORDON_USVPH, circle, cordon_radius_m, region
from radron.station.viewers.topics import BODY, MISSION

BLACK, GREY, RED, YELLOW = (0.07, 0.07, 0.07), (0.45, 0.45, 0.45), (0.64, 0.23, 0.0), (0.94, 0.89, 0.26)
# colour-blind-safe (Okabe and Ito 2008)
COLOURS = ((0.0, 0.45, 0.7), (0.84, 0.37, 0.0), (0.0, 0.62, 0.45), (0.8, 0.47, 0.65), (0.9, 0.62, 0.0), (0.34, 0.71, 0.91))
_ABOVE_M = 0.05  # height of lines above the ground
_UPRIGHT = Quaternion(w=1.0)
Colour = tuple[float, float, float]


def colour_of(index: int, drone: DroneFrame | None = None) -> Colour:
    """Return the display colour of the drone with this index; grey for a drone out of contact."""
    return GREY if drone is not None and drone.stale else COLOURS[index % len(COLOURS)]


def shade(colour: Colour, opacity: float = 1.0) -> Color:
    """Return a colour (red, green, blue from 0 to 1) with an opacity as Foxglove's colour."""
    red, green, blue = colour
    return Color(r=red, g=green, b=blue, a=opacity)


def moment(at_ns: int) -> Timestamp:
    """Return a time (nanoseconds UTC) as Foxglove's time stamp."""
    return Timestamp(*divmod(at_ns, 1_000_000_000))


class Scene:
    """Makes the shapes of one mission for Foxglove's 3D view: area, drones, sources and Compton cones."""

    def __init__(self, ground: Ground) -> None:
        self._ground = ground

    def area(self, about: MissionFrame, at_ns: int) -> SceneUpdate:
        """Return the outlines of the search area and its fence."""
        outlines = (("area", about.area, BLACK, 4.0), ("fence", about.fence, GREY, 1.0))
        return _update(at_ns, [self._outline(*each, at_ns) for each in outlines])

    def drones(self, drones: Sequence[DroneFrame], trails: Mapping[str, Sequence[Vector]], at_ns: int) -> SceneUpdate:
        """Return each drone's body with its name, in the body's own frame, and its track of the last minute."""
        entities = []
        for index, drone in enumerate(drones):
            if drone.place is None:
                continue
            colour = colour_of(index, drone)
            entities.append(_body(drone, colour, at_ns))
            entities.append(_lines(f"{drone.id} trail", [trails.get(drone.id, [])], colour, 2.0, at_ns))
        return _update(at_ns, entities)

    def sources(self, sources: Iterable[SourceFrame], at_ns: int) -> SceneUpdate:
        """Return each estimated source, its 90 % region and its cordon."""
        return _update(at_ns, [entity for source in sources for entity in self._source(source, at_ns)])

    def _source(self, source: SourceFrame, at_ns: int) -> Iterator[SceneEntity]:
        (x, y, z), number = source.place, numbered(source)
        yield SceneEntity(
            timestamp=moment(at_ns),
            frame_id=MISSION,
            id=f"source{number}",
            spheres=[SpherePrimitive(pose=_at(x, y, z), size=Vector3(x=0.6, y=0.6, z=0.6), color=shade(YELLOW))],
            texts=[_text(f"{source.nuclide}{number}", (x, y, z + 1.0), BLACK)],
        )
        yield self._outline(f"region{number}", region(source), BLACK, 3.0, at_ns)
        radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
        if radius_m is not None:
            name = f"cordon {CORDON_USVPH:g} µSv/h{number}"
            yield self._outline(name, circle(source.place, radius_m), RED, 4.0, at_ns)

    def cones(self, cones: Iterable[ConeCurve], drones: Sequence[str], at_ns: int) -> SceneUpdate:
        """Return the curves on the ground of the Compton cones of the last seconds, in the colours of their drones."""
        curves: dict[str, list[list[Vector]]] = {drone: [] for drone in drones}
        for cone in cones:
            curves[cone.drone] += [self._on_ground(curve) for curve in cone.curves]
        entities = [
            _lines(f"{drone} cones", found, colour_of(index), 1.0, at_ns)
            for index, (drone, found) in enumerate(curves.items())
            if found
        ]
        return _update(at_ns, entities)

    def _outline(self, name: str, corners: Sequence[Point], colour: Colour, width_px: float, at_ns: int) -> SceneEntity:
        return _lines(name, [self._on_ground(corners)], colour, width_px, at_ns)

    def _on_ground(self, places: Sequence[Point]) -> list[Vector]:
        return [(x, y, self._ground.height_m(x, y) + _ABOVE_M) for x, y in places]


def _update(at_ns: int, entities: list[SceneEntity]) -> SceneUpdate:
    everything = SceneEntityDeletion(timestamp=moment(at_ns), type=SceneEntityDeletionType.All)
    return SceneUpdate(deletions=[everything], entities=entities)


def _body(drone: DroneFrame, colour: Colour, at_ns: int) -> SceneEntity:
    ahead = ArrowPrimitive(
        pose=_at(0.0, 0.0, 0.0), shaft_length=0.9, shaft_diameter=0.12, head_length=0.5, head_diameter=0.35, color=shade(colour)
    )
    return SceneEntity(
        timestamp=moment(at_ns),
        frame_id=BODY.format(drone=drone.id),
        id=drone.id,
        frame_locked=True,
        arrows=[ahead],
        spheres=[SpherePrimitive(pose=_at(0.0, 0.0, 0.0), size=Vector3(x=0.7, y=0.7, z=0.3), color=shade(colour))],
        texts=[_text(f"{drone.id} {drone.stage}", (0.0, 0.0, 0.8), colour)],
    )


def _lines(name: str, lines: Sequence[Sequence[Vector]], colour: Colour, width_px: float, at_ns: int) -> SceneEntity:
    drawn = [
        LinePrimitive(
            type=LinePrimitiveLineType.LineStrip,
            pose=_at(0.0, 0.0, 0.0),
            thickness=width_px,
            scale_invariant=True,
            points=[Point3(x=x, y=y, z=z) for x, y, z in places],
            color=shade(colour),
        )
        for places in lines
        if len(places) > 1
    ]
    return SceneEntity(timestamp=moment(at_ns), frame_id=MISSION, id=name, lines=drawn)


def _text(text: str, place: Vector, colour: Colour) -> TextPrimitive:
    return TextPrimitive(pose=_at(*place), billboard=True, font_size=14.0, scale_invariant=True, color=shade(colour), text=text)


def _at(x: float, y: float, z: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=_UPRIGHT)
