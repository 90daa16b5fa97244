"""Sources beyond the fence, as reported to operators."""

from __future__ import annotations

from math import nan

import pytest

from radron.agent.config.beyond import bearing_beyond, outside_texts
from radron.agent.config.mission import AreaConfig

YARD = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0)))


@pytest.mark.parametrize(
    ("place", "bearing_deg"), [((100.0, 25.0), 90.0), ((25.0, 90.0), 0.0), ((-75.0, -75.0), 225.0), ((-60.0, 25.0), 270.0)]
)
def test_the_bearing_to_a_source_beyond_the_fence_is_from_the_middle_of_the_area(
    place: tuple[float, float], bearing_deg: float
) -> None:
    assert bearing_beyond(YARD, *place) == pytest.approx(bearing_deg, abs=1e-9)


@pytest.mark.parametrize("place", [(25.0, 25.0), (79.9, 25.0), (70.0, 70.0), (nan, 25.0)])
def test_a_source_within_the_fence_has_none(place: tuple[float, float]) -> None:
    assert bearing_beyond(YARD, *place) is None


def test_sources_beyond_the_fence_are_told_with_three_digits_and_others_are_not() -> None:
    assert outside_texts(YARD, [(24.5, 125.0), (25.0, 25.0), (125.0, 30.0)]) == [
        "source outside the fence, towards 000 degrees",
        "source outside the fence, towards 087 degrees",
    ]
