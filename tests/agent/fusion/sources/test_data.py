"""Sums over exposures: of whatever parts and in whatever order they are made, they are the same."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import CountObservation
from radron.agent.fusion.sources.data import Rows
from radron.protocol.entries import EntryId
from radron.protocol.spectrum import SpectrumBin

DRONES = {"a": 0, "b": 1}
NS = 1_000_000_000


def exposure(number, drone="a", place=(1.2345, 2.0, 3.0), live_s=0.5, bins=((3, 2, 1),), hits=4, facing=(0.28, 0.96), way_m=0.0):
    spectrum = tuple(SpectrumBin(*one) for one in bins)
    counts = np.array([hits, 0.0, 0.0])
    identity = EntryId("m", number, drone, "boot", number)
    sigmas, stamps = (0.1, 0.01), (number * NS, number * NS)
    return CountObservation(*stamps, place, live_s, counts, *sigmas, Transform(), identity, 0, spectrum, facing, way_m)


def test_a_place_that_no_drone_can_be_at_counts_nothing():
    """A minute there did not fit into 64 bits, and ended whatever computed it."""
    far = exposure(1, place=(2e5, 0.0, 0.0), live_s=60.0)
    assert len(Rows.none().plus([far], DRONES)) == 0
    assert len(Rows.none().plus([exposure(1, place=(9e4, 0.0, 0.0), live_s=60.0)], DRONES)) == 1


EXPOSURES = st.lists(
    st.builds(
        exposure,
        number=st.integers(0, 10**6),
        drone=st.sampled_from(("a", "b")),
        place=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(1.0, 2.0)),
        live_s=st.floats(0.01, 60.0),
        bins=st.lists(st.tuples(st.integers(0, 31), st.integers(0, 99), st.integers(0, 9)), max_size=2, unique_by=lambda b: b[0]),
        hits=st.just(0),
        facing=st.floats(-np.pi, np.pi).map(lambda angle: (math.cos(angle), math.sin(angle))),
        way_m=st.floats(0.0, 20.0),
    ),
    min_size=1,
    max_size=12,
)


@settings(max_examples=30)
@given(EXPOSURES, st.randoms(use_true_random=False), st.integers(0, 12))
def test_order_and_parts_do_not_matter(exposures, random, cut):
    whole = Rows.none().plus(exposures, DRONES)
    mixed = random.sample(exposures, len(exposures))
    parts = Rows.none().plus(mixed[:cut], DRONES).plus(mixed[cut:], DRONES)
    assert whole.table.tobytes() == parts.table.tobytes()


def test_a_voxel_holds_what_its_exposures_told():
    rows = Rows.none().plus([exposure(1), exposure(2, place=(1.4, 2.3, 3.2), bins=((3, 1, 0), (31, 0, 5)))], DRONES)
    assert len(rows) == 1
    assert rows.live_s.tolist() == [1.0]
    assert rows.place[0] == pytest.approx((1.317, 2.15, 3.1), abs=1e-3)  # rounded to millimetres
    assert (rows.counts[0, 3], rows.counts[0, 31], rows.counts.sum()) == (4.0, 5.0, 9.0)


def test_the_headings_of_a_voxel_count_by_live_time():
    rows = Rows.none().plus([exposure(1, facing=(1.0, 0.0)), exposure(2, facing=(0.0, -1.0), live_s=1.5)], DRONES)
    assert rows.facing[0] == pytest.approx((0.25, -0.75), abs=1e-6)


def test_a_voxel_tells_how_far_from_its_place_was_measured():
    """Mean squares: of a straight way its length squared over 12; between exposures by live time."""
    still = Rows.none().plus([exposure(1)], DRONES)
    assert still.spread_m2[0] == pytest.approx(0.0, abs=1e-5)
    flown = Rows.none().plus([exposure(1, way_m=3.0)], DRONES)
    assert flown.spread_m2[0] == pytest.approx(0.75, abs=1e-5)
    two = Rows.none().plus([exposure(1, place=(1.1, 2.1, 3.1)), exposure(2, place=(1.3, 2.1, 3.1), live_s=1.5)], DRONES)
    assert two.spread_m2[0] == pytest.approx(0.25 * 0.15**2 + 0.75 * 0.05**2, abs=1e-5)


def test_drones_and_voxels_are_kept_apart():
    rows = Rows.none().plus([exposure(1, "b"), exposure(2), exposure(3, place=(-0.1, 2.0, 3.0))], DRONES)
    assert rows.drone.tolist() == [0, 0, 1]


def test_an_exposure_without_spectrum_tells_nothing_if_there_were_hits():
    assert len(Rows.none().plus([exposure(1, bins=(), hits=50)], DRONES)) == 0
    assert len(Rows.none().plus([exposure(1, bins=(), hits=0)], DRONES)) == 1


def test_in_which_of_the_two_softest_bins_an_event_is_does_not_matter():
    """Between them lies the peak of Am-241, from where some of its charge moves it to the other side."""
    above, below = (Rows.none().plus([exposure(1, bins=((e, 9, 0), (2, 4, 0)))], DRONES).counts for e in (1, 0))
    assert np.array_equal(above, below)
    assert (above.sum(), above[0, 2]) == (13.0, 4.0)


def test_a_single_exposure_is_the_sum_of_one():
    one = exposure(7, "b")
    assert np.array_equal(Rows.single(one, 1).table, Rows.none().plus([one], DRONES).table)
    assert len(Rows.single(exposure(7, bins=(), hits=9), 0)) == 0
