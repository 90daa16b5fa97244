"""Scores of an estimate of contaminated ground, by told maps whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Polygon

from radron.protocol.contamination import Block, Contamination, Finding, Range
from radron.sim.radiation.ground.area import AreaSource
from radron.sim.radiation.ground.dose import ambient_dose_svph, dose_at
from radron.sim.scoring.groundscore import GroundScore, block_means, right_findings, score_ground
from radron.sim.world.contamination import Contaminated
from radron.sim.world.sources import Source

AREA = Polygon([(0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (0.0, 20.0)])
AXIS = np.arange(-9.5, 60.0, 1.0)


def ground(
    west: float, south: float, east: float, north: float, level_bqm2: float = 1e6, nuclide: str = "Cs-137"
) -> Contaminated:
    x, y = (places.ravel() for places in np.meshgrid(AXIS, AXIS))
    kept = (x > west) & (x < east) & (y > south) & (y < north)
    return Contaminated("patch", AreaSource(nuclide, x[kept], y[kept], np.full(int(kept.sum()), 1e6), 1.0))


def told(median: list[float], width: float = 0.3, finding: Finding = Finding.AREA, total_bq: float = 3e8) -> Contamination:
    """A map of 4 x 2 blocks of 10 m. median: in MBq/m2. width: of half the interval, relative."""
    blocks = [Block(*(round(20.0 * level * (1.0 + sign * width)) for sign in (0.0, -1.0, 1.0))) for level in median]
    return Contamination(
        nuclide="Cs-137",
        finding=finding,
        evidences={},
        total_bq=Range(total_bq, 0.8 * total_bq, 1.2 * total_bq),
        least_bqm2=1e4,
        corner_m=(0.0, 0.0),
        block_m=10.0,
        across=4,
        unit_bqm2=5e4,
        blocks=tuple(blocks),
        highest_bqm2=Range(1e6, 0.0, 2e6),
        highest_m=(5.0, 5.0, 0.0),
        dose_svph=Range(1e-6, 0.0, 1e-5),
        dose_m=(5.0, 5.0, 0.0),
    )


PATCH = ground(0.0, 0.0, 20.0, 15.0)  # of the eight blocks two are full, and two half
TRUTH = [1.0, 1.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]


def score(estimate: Contamination | None, *parts: Contaminated, has_sources: bool = False) -> GroundScore:
    return score_ground(parts, has_sources, AREA, "soil", estimate)


def test_the_true_map_has_no_error() -> None:
    found = score(told(TRUTH), PATCH)
    assert (found.total_error, found.total_in_90) == (pytest.approx(0.0), True)
    assert (found.block_error_median, found.blocks_in_90) == (pytest.approx(0.0), 1.0)
    assert (found.decision, found.decision_right) == ("area", True)


def test_errors_of_total_and_of_hot_blocks() -> None:
    """The half blocks are not above half of the highest one, so that their errors do not count."""
    found = score(told([1.2, 0.6, 0.0, 0.0, 5.0, 5.0, 0.0, 0.0], width=0.2, total_bq=4.5e8), PATCH)
    assert found.total_error == pytest.approx(0.5)
    assert found.total_in_90 is False
    assert found.block_error_median == pytest.approx(0.3)
    assert found.blocks_in_90 == 0.5


def test_the_total_is_of_the_area_alone() -> None:
    means, scored = block_means([ground(-10.0, -10.0, 60.0, 60.0)], AREA, told(TRUTH))
    assert means.tolist() == pytest.approx([1e6] * 8)
    assert scored.all()
    assert score(told([1.0] * 8, total_bq=8e8), ground(-10.0, -10.0, 60.0, 60.0)).total_error == pytest.approx(0.0)


def test_blocks_outside_the_area_do_not_count() -> None:
    shifted = replace(told(TRUTH), corner_m=(-6.0, 0.0))
    means, scored = block_means([PATCH], AREA, shifted)
    assert scored.tolist() == [False, True, True, True] * 2
    assert means[1] == pytest.approx(1e6)


SPOTS = Contaminated("spots", ground(4.0, 4.0, 6.0, 6.0).source, (Source("Cs-137", 4e6, (5.0, 5.0, 0.0)),))
WIDE = ground(-10.0, -10.0, 60.0, 60.0)


@pytest.mark.parametrize(
    ("parts", "has_sources", "right"),
    [
        ((), False, {Finding.NOTHING}),
        ((), True, {Finding.POINTS}),
        ((SPOTS,), False, {Finding.POINTS}),
        ((PATCH,), False, {Finding.AREA, Finding.EXTENDED}),
        ((WIDE,), False, {Finding.AREA}),
        ((WIDE, SPOTS), False, {Finding.AREA_AND_SPOTS}),
        ((WIDE,), True, {Finding.AREA_AND_SPOTS}),
    ],
)
def test_right_decisions(parts: tuple[Contaminated, ...], has_sources: bool, right: set[Finding]) -> None:
    assert right_findings(parts, has_sources) == right


def test_without_an_estimate_or_contamination_there_is_little_to_score() -> None:
    assert score(None, PATCH) == GroundScore()
    nothing = score(told([0.0] * 8, finding=Finding.NOTHING))
    assert nothing == GroundScore(decision="nothing", decision_right=True)
    assert score(told(TRUTH), ground(0.0, 0.0, 20.0, 15.0, nuclide="Co-60")).total_error is None


def test_dose_rate_above_a_plane_of_caesium() -> None:
    """3.08e-12 Sv/h per Bq/m2 at 1 m, and 0.80 of it at 3 m: independent Monte Carlo."""
    axis = np.arange(-299.0, 300.0, 2.0)
    x, y = (places.ravel() for places in np.meshgrid(axis, axis))
    plane = AreaSource("Cs-137", x, y, np.full(len(x), 4.0), 2.0)
    fine = np.arange(-9.875, 10.0, 0.25)
    u, v = (places.ravel() for places in np.meshgrid(fine, fine))
    near = AreaSource("Cs-137", u, v, np.full(len(u), 0.0625), 0.25)
    kept = (abs(x) > 10.0) | (abs(y) > 10.0)
    far = replace(plane, x_m=x[kept], y_m=y[kept], activity_bq=plane.activity_bq[kept])
    one_m, three_m = (dose_at([near, far], "soil", 0.0, 0.0, height_m) for height_m in (1.0, 3.0))
    assert one_m == pytest.approx(3.08e-12, rel=0.05)
    assert three_m / one_m == pytest.approx(0.80, abs=0.04)


def test_highest_dose_rate_is_above_the_contaminated_part() -> None:
    highest = ambient_dose_svph([PATCH.source], "soil", AREA)
    assert highest == pytest.approx(dose_at([PATCH.source], "soil", 10.0, 7.5), rel=0.1)
    assert highest > 4.0 * dose_at([PATCH.source], "soil", 30.0, 7.5)
