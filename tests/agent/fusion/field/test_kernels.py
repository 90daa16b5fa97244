"""Sums, kernels and dose: against sums over fine points, and the rates of an independent study."""

import numpy as np
import pytest
from shapely import Polygon, box

from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.field.dose import dose_map, rate
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.kernel import KernelStore, MiniPix, kernels_of
from radron.agent.fusion.field.sums import Sums, row_of, rows_of

MINIPIX = MiniPix(response_of("Cs-137", "soil"))
NS = 1_000_000_000


def plane(height_m, most_m=320.0):
    """Counts per second and channel above an infinite plane of 1 Bq/m2."""
    radius = np.geomspace(0.02, most_m, 4000)
    none = np.zeros_like(radius)
    direct, scattered = MINIPIX.per_bq(radius, none, none + height_m, (none, none))
    return (2.0 * np.pi * radius * np.gradient(radius)) @ (direct + scattered)


@pytest.mark.parametrize(("height_m", "every", "full"), [(2.0, 124.0, 4.0), (5.0, 119.0, 2.9), (10.0, 116.0, 2.2)])
def test_infinite_plane_counts_as_in_an_independent_study(height_m, every, full):
    """The study leaves the camera's facing out, and the tables are fitted up to 25 m: 25 %."""
    counts = 1e6 * plane(height_m)
    assert counts.sum() == pytest.approx(every, rel=0.25)
    assert counts[1] == pytest.approx(full, rel=0.25)


def test_cells_hold_the_mean_over_their_ground(lawn):
    grid = Grid.around(box(0.0, 0.0, 40.0, 40.0))
    rows = [row_of(lawn.observation("a", 0, (20.9, 19.2, 3.0), (1, 0), 1.0), 0, 3.0, MINIPIX.counted)]
    sums = Sums.none(2).plus(rows)
    kernels = kernels_of(sums, np.array([3.0]), grid, MINIPIX)
    fine = (np.arange(10) + 0.5) / 10.0 - 0.5
    offsets = grid.cell_m * np.stack([part.ravel() for part in np.meshgrid(fine, fine)], axis=1)
    for place in ((21.0, 19.0), (24.0, 18.0), (33.0, 30.0)):
        cell = int(np.argmin(np.hypot(*(grid.centres - place).T)))
        off = grid.centres[cell] + offsets - (20.9, 19.2)
        none = np.zeros(len(off))
        wanted = MINIPIX.per_bq(off[:, 0], off[:, 1], none + 3.0, (none, none))
        for kind, kernel in zip(wanted, (kernels.direct, kernels.scattered), strict=True):
            assert kernel[0, :, cell] == pytest.approx(kind.mean(axis=0) * grid.cell_m**2, rel=0.02)


def test_stored_kernels_are_the_computed_ones(lawn):
    grid = Grid.around(box(0.0, 0.0, 20.0, 20.0))
    store = KernelStore(grid, MINIPIX)
    places = [(float(x), 5.0, 3.0) for x in range(0, 20, 2)]
    rows = [row_of(lawn.observation("a", 0, place, (1, 0), 1.0), 0, 3.0, MINIPIX.counted) for place in places]
    height = np.full(10, 3.0)
    store.of(Sums.none(2).plus(rows[::2]), height[:5])
    sums = Sums.none(2).plus(rows)
    kept, fresh = store.of(sums, height), kernels_of(sums, height, grid, MINIPIX)
    assert np.array_equal(kept.direct, fresh.direct)
    assert np.array_equal(kept.scattered, fresh.scattered)
    assert np.array_equal(kept.beyond, fresh.beyond)


def test_sums_do_not_depend_on_the_order(lawn):
    observations = lawn.survey(lambda x, y: 1e5 + 0.0 * x, times=1)
    numbers = {"a": 0, "b": 1}

    def summed(parts):
        sums = Sums.none(2)
        for part in parts:
            sums = sums.plus(rows_of(part, numbers, lambda one: one.position[2], MINIPIX.counted))
        return sums.table

    forward = summed([observations])
    other = lawn.shuffled(observations)
    assert np.array_equal(forward, summed([other[:50], other[50:51], other[51:]]))
    assert forward[:, 11:].sum() == sum(one.counts[0] for one in observations)


@pytest.mark.parametrize("height_m", [1.3, 2.0, 3.0, 5.0, 12.0])
def test_voxels_are_at_most_half_the_height(lawn, height_m):
    def key(x):
        return row_of(lawn.observation("a", 0, (x, 0.0, height_m), (1, 0), 1.0), 0, height_m, MINIPIX.counted)[:5]

    apart = 0.51 * height_m
    assert all(key(x) != key(x + apart) for x in np.arange(0.0, 5.0, 0.1))


def test_many_sums_become_those_of_larger_voxels(lawn):
    rows = rows_of(lawn.survey(lambda x, y: 0.0 * x, times=1), {"a": 0, "b": 1}, lambda one: one.position[2], MINIPIX.counted)
    sums = Sums.none(2).plus(rows)
    few = sums.limited(40)
    assert len(few) <= 40 < len(sums)
    assert np.array_equal(few.table[:, 5:].sum(axis=0), sums.table[:, 5:].sum(axis=0))
    assert np.array_equal(sums.limited().table, sums.table)
    assert len(sums.limited(1)) == 2  # a drone's own sums remain apart


def test_absurd_places_are_left_out(lawn):
    far = lawn.observation("a", 0, (5e4, 0.0, 3.0), (1, 0), 1.0)
    assert row_of(far, 0, 3.0, MINIPIX.counted) is None


def test_dose_of_a_plane_of_caesium():
    """3.08e-12 Sv/h per Bq/m2 at 1 m, 0.70 of it at 5 m and 0.58 at 10 m: ../shared/reference, transport over a bare surface."""
    radius = np.geomspace(1e-3, 1000.0, 20000)

    def at(height_m):
        return float((rate("Cs-137", np.hypot(radius, height_m)) * 2.0 * np.pi * radius) @ np.gradient(radius))

    assert at(1.0) == pytest.approx(3.08e-12, rel=0.03)
    assert at(5.0) / at(1.0) == pytest.approx(0.70, abs=0.02)
    assert at(10.0) / at(1.0) == pytest.approx(0.58, abs=0.03)


def test_dose_map_of_a_wide_field_is_the_planes():
    grid = Grid.around(box(0.0, 0.0, 200.0, 200.0))
    dose = dose_map("Cs-137", np.full(grid.size, 1e6), grid)
    middle = int(np.argmin(np.hypot(*(grid.centres - 100.0).T)))
    assert dose[middle] == pytest.approx(3.08e-6, rel=0.15)  # a sixth comes from beyond 100 m


def test_grid_covers_area_and_margin():
    area = Polygon([(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)])
    grid = Grid.around(area)
    assert grid.inside_m2.sum() == pytest.approx(area.area, rel=1e-6)
    number, across, up = grid.blocks(10.0)
    assert (across, up) == (10, 10)
    assert np.bincount(number[number >= 0], grid.inside_m2[number >= 0])[0] == pytest.approx(100.0)
    assert Grid.around(box(0.0, 0.0, 1000.0, 500.0)).columns <= 96
