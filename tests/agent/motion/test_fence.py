"""The fence and its convex pieces."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.config.mission import AreaConfig
from radron.agent.errors import ConfigError
from radron.agent.motion.fence import Fence

L_SHAPE = shapely.Polygon([(0, 0), (60, 0), (60, 20), (20, 20), (20, 60), (0, 60)])
STAR = shapely.Polygon([(0, 0), (20, 8), (40, 0), (32, 20), (40, 40), (20, 32), (0, 40), (8, 20)])


def inside(fence: Fence, x: float, y: float) -> bool:
    return fence.clearance(x, y) > 0.0


def test_an_area_is_widened_by_its_margin() -> None:
    fence = Fence.from_area(AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (0.0, 50.0)), fence_margin_m=30.0))
    assert fence.clearance(-29.0, 25.0) == pytest.approx(1.0)
    assert fence.clearance(-30.5, 25.0) == pytest.approx(-0.5)
    assert not inside(fence, -29.0, -29.0)  # the corner is round
    assert (fence.floor_m, fence.ceiling_m) == (1.5, 60.0)


def test_an_area_without_margin_keeps_its_corners_and_the_ground_shifts_heights() -> None:
    area = AreaConfig(polygon_m=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)), fence_margin_m=0.0)
    fence = Fence.from_area(area, points=[(100.0, 0.0), (110.0, 0.0), (110.0, 10.0)], ground_m=200.0)
    assert inside(fence, 109.0, 1.0)
    assert not inside(fence, 9.0, 1.0)
    assert (fence.floor_m, fence.ceiling_m) == (201.5, 260.0)


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_convex_fence_is_one_piece(clockwise: bool) -> None:
    corners = [(0, 0), (40, 0), (50, 30), (0, 40)]
    fence = Fence(shapely.Polygon(corners[::-1] if clockwise else corners), 1.0, 10.0)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-10.0, 60.0, (200, 2)).tolist():
        normals, offsets = fence.half_planes(5.0, 5.0)
        assert bool((normals @ (x, y) >= offsets).all()) == inside(fence, x, y)


@st.composite
def places_inside(draw: st.DrawFn) -> tuple[shapely.Polygon, float, float]:
    """A non-convex outline and a place inside, off its boundary."""
    outline = draw(st.sampled_from([L_SHAPE, STAR]))
    triangles = [part for part in shapely.get_parts(shapely.delaunay_triangles(outline)) if outline.covers(part)]
    a, b, c, _ = shapely.get_coordinates(draw(st.sampled_from(triangles)))
    u, v = draw(st.floats(0.01, 0.99)), draw(st.floats(0.01, 0.99))
    x, y = (a + u * (b - a) + v * (1.0 - u) * (c - a)).tolist()
    return outline, x, y


@given(places_inside())
def test_a_piece_of_a_non_convex_fence_lies_inside_and_holds_its_place(place: tuple[shapely.Polygon, float, float]) -> None:
    outline, x, y = place
    assert outline.contains(shapely.Point(x, y))
    normals, offsets = Fence(outline, 1.0, 10.0).half_planes(x, y)
    assert (normals @ (x, y) >= offsets).all()
    piece = shapely.box(-200.0, -200.0, 300.0, 300.0)
    for (nx, ny), b in zip(normals.tolist(), offsets.tolist(), strict=True):
        foot, along = np.array([nx * b, ny * b]), np.array([-ny, nx])
        inward = np.array([nx, ny])
        corners = [foot - 900 * along, foot + 900 * along, foot + 900 * (along + inward), foot + 900 * (inward - along)]
        piece = piece.intersection(shapely.Polygon(corners))
    assert piece.difference(outline.buffer(1e-3)).area < 1e-3
    assert piece.area > 0.0


def test_from_outside_the_way_leads_to_the_nearest_place_inside() -> None:
    normals, offsets = Fence(L_SHAPE, 1.0, 10.0).half_planes(-7.0, 30.0)
    assert normals == pytest.approx(np.array([[1.0, 0.0]]))
    assert offsets == pytest.approx(np.array([0.0]))


def test_a_fence_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ConfigError, match="simple polygon"):
        Fence(shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]), 1.0, 10.0)
    with pytest.raises(ConfigError, match="below ceiling_m"):
        Fence(L_SHAPE, 10.0, 10.0)
