"""Description of sources in a scenario: a source with its motion, or several sources drawn from the seed."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct
from shapely import Polygon

from radron.agent.config.mission import Corner
from radron.agent.config.section import Degrees
from radron.agent.errors import ConfigError
from radron.sim.radiation.nuclides import NUCLIDES

MAX_COURSE_S = 36_000.0
Duration = Annotated[float, Meta(gt=0.0, le=MAX_COURSE_S)]
Activity = Annotated[float, Meta(gt=0.0, le=1e13)]
SourceHeight = Annotated[float, Meta(ge=0.0, le=100.0)]
EDGE_M = 3.0  # a wandering source turns back at this distance from the edge of the area
_MIN_AREA_SHARE = 1e-3  # least share of its bounding box that an area fills; below it, drawing a position in it takes too long


class _Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class LegTruth(_Section, frozen=True, kw_only=True):
    """A straight part of a source's path: ``for_s`` at ``speed_mps`` (0: at rest), after turning left by ``turn_deg``."""

    for_s: Duration
    speed_mps: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    turn_deg: Degrees = 0.0


class SourceTruth(_Section, frozen=True, kw_only=True):
    """A radioactive source with its motion, ``height_m`` above the ground.

    Its start is drawn from the seed unless ``start_m`` is given: in the area, or, with ``outside_m``, around the area at a
    distance between these two values.

    ``motion``: ``static``; ``circle`` around the area's centre with ``circle_radius_m`` at ``speed_mps``; ``wander``: straight
    and curved stretches inside the area, each at a speed between ``slowest`` (a fraction) of ``speed_mps`` and ``speed_mps``;
    ``legs``: one leg after the other from a heading that is drawn from the seed, then at rest, wherever that leads.
    """

    activity_bq: Activity
    nuclide: str = "Cs-137"
    motion: Literal["static", "circle", "wander", "legs"] = "static"
    speed_mps: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    slowest: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    circle_radius_m: Annotated[float, Meta(ge=0.0, le=1e5)] = 40.0
    legs: Annotated[tuple[LegTruth, ...], Meta(max_length=1000)] = ()
    start_m: Corner | None = None
    outside_m: tuple[Annotated[float, Meta(ge=0.0, le=1e3)], Annotated[float, Meta(gt=0.0, le=1e3)]] | None = None
    height_m: SourceHeight = 0.0

    def check(self, area: Polygon, where: str, name: str = "source") -> None:
        """Raise ConfigError if the source has an unknown nuclide or cannot move in this area.

        ``name``: section of the scenario with the source, for the error.
        """
        _check_nuclides((self.nuclide,), f"{where}: {name}.nuclide")
        if self.motion == "circle" and self.circle_radius_m == 0.0:
            raise ConfigError(f"{where}: {name}.motion = 'circle' needs {name}.circle_radius_m > 0; or give motion = 'static'")
        if (self.motion == "legs") != bool(self.legs):
            raise ConfigError(f"{where}: {name}.legs and {name}.motion = 'legs' need each other")
        if self.motion == "wander" and area.buffer(-EDGE_M).is_empty:
            raise ConfigError(
                f"{where}: {name}.motion = 'wander' needs an area more than {2.0 * EDGE_M:g} m wide; "
                "enlarge mission.area.polygon_m, or give motion = 'static'"
            )
        if self.outside_m is not None:
            if self.start_m is not None or self.motion in {"wander", "circle"}:
                raise ConfigError(
                    f"{where}: {name}.outside_m draws the start of a source that is static or moves in legs; leave it out"
                )
            if self.outside_m[0] >= self.outside_m[1]:
                raise ConfigError(f"{where}: {name}.outside_m: {self.outside_m[0]:g} is not below {self.outside_m[1]:g}")
        elif self.start_m is None:
            _check_room(area, where, f"{name}.start_m")


class RandomSourcesTruth(_Section, frozen=True, kw_only=True):
    """Sources at rest whose number, nuclides, activities and positions are drawn from the seed, anywhere in the area.

    The number is uniform from ``least`` to ``most``; each nuclide is one of ``nuclides``; activities are uniform in their
    logarithm, heights above the ground in metres. Two sources of one nuclide are at least ``apart_m`` from each other
    (horizontally), and two whose activities differ by more than the factor ``contrast`` at least ``contrast_apart_m``.
    """

    least: Annotated[int, Meta(ge=0, le=8)] = 0
    most: Annotated[int, Meta(ge=0, le=8)] = 6
    nuclides: Annotated[tuple[str, ...], Meta(min_length=1, max_length=32)] = ("Cs-137",)
    activity_bq: tuple[Activity, Activity]
    height_m: tuple[SourceHeight, SourceHeight] = (0.0, 0.0)
    apart_m: Annotated[float, Meta(ge=0.0, le=1e4)] = 5.0
    contrast: Annotated[float, Meta(ge=1.0, le=1e6)] = 10.0
    contrast_apart_m: Annotated[float, Meta(ge=0.0, le=1e4)] = 20.0

    def check(self, area: Polygon, where: str) -> None:
        """Raise ConfigError for unknown values, a wrong order of limits, or possibly too little room for the sources."""
        here = f"{where}: random_sources"
        _check_nuclides(self.nuclides, f"{here}.nuclides")
        ranges = {"least and most": (self.least, self.most), "activity_bq": self.activity_bq, "height_m": self.height_m}
        for key, (low, high) in ranges.items():
            if low > high:
                raise ConfigError(f"{here}.{key}: {low:g} is more than {high:g}; give the smaller one first")
        _check_room(area, where, "a [source] with start_m")
        widest_m = max(self.apart_m, self.contrast_apart_m)
        # Discs of diameter widest_m that are placed at random, one after the other, jam at 0.547 of the area.
        if self.most > 1 and 2.0 * self.most * widest_m**2 > area.area:
            raise ConfigError(f"{here}: the area of {area.area:g} m2 has no room for {self.most} sources {widest_m:g} m apart")


def _check_nuclides(nuclides: tuple[str, ...], where: str) -> None:
    for nuclide in nuclides:
        if nuclide not in NUCLIDES:
            raise ConfigError(f"{where}: unknown nuclide {nuclide!r}; known: {', '.join(NUCLIDES)}")


def _check_room(area: Polygon, where: str, instead: str) -> None:
    if area.area < _MIN_AREA_SHARE * area.envelope.area:
        raise ConfigError(f"{where}: mission.area.polygon_m is too thin to draw a place in it; give {instead}")
