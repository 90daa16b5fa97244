from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.imaging import DirectionScan
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError

SECOND = 1_000_000_000
CLOCK_NS = 1_700_000_000 * SECOND + 333


def new_chain(**changes):
    return DetectorChain(DetectionConfig(**changes), "Cs-137", Calibration.nominal())


def only(hits, end_ns=10_000_000):
    return Readout(0, end_ns, 0, end_ns * 1e-9, hits)


def test_a_coincidence_becomes_a_cone(blob, make_hits):
    hits = make_hits([blob(1000.0, (-1.1, 0.55, 0.5), 300.0, 9), blob(1000.0, (1.1, -0.55, 1.5), 361.66, 11)])
    found = new_chain().process(only(hits))
    assert (found.hits, found.photopeak, found.coincidences, len(found.cones)) == (2, 1, 1, 1)
    assert (found.start_ns, found.end_ns) == (0, 10_000_000)
    assert found.live_time_s == pytest.approx(0.01)
    cone = found.cones[0]
    separation = np.array([-2.2, 1.1, -1.0])  # cluster 1, the earlier, minus cluster 2; the later one is further from the rear
    assert cone.separation_mm == pytest.approx(np.linalg.norm(separation), abs=0.06)
    np.testing.assert_allclose(cone.axis[0], separation / np.linalg.norm(separation), atol=0.03)
    np.testing.assert_allclose(cone.energies_kev, [300.0, 361.66], atol=3.0)
    assert cone.stamp_ns == pytest.approx(1000.0 + 0.25 * 86.0, abs=2.0)


@pytest.mark.parametrize(
    ("first", "second", "counts"),
    [
        ((300.0, 9), (200.0, 9), (2, 0, 1, 0)),  # not the line's energy
        ((300.0, 2), (361.66, 3), (2, 1, 1, 0)),  # too few hits
        ((300.0, 3), (361.66, 3), (2, 1, 1, 1)),
        ((60.0, 6), (601.66, 12), (2, 1, 1, 1)),  # the lower one can only be the electron
        ((661.66, 20), None, (1, 1, 0, 0)),
        ((4.5, 1), None, (0, 0, 0, 0)),  # below the threshold
    ],
)
def test_selection(blob, make_hits, first, second, counts):
    blobs = [blob(1000.0, (-1.1, 0.0, 0.5), *first)]
    if second is not None:
        blobs.append(blob(1000.0, (1.1, 0.0, 0.5), *second))
    found = new_chain().process(only(make_hits(blobs)))
    assert (found.hits, found.photopeak, found.coincidences, len(found.cones)) == counts


def test_limits_of_the_configuration_take_precedence(blob, make_hits):
    hits = make_hits([blob(1000.0, (-1.1, 0.0, 0.5), 300.0, 9), blob(1000.0, (1.1, 0.0, 0.5), 361.66, 9)])
    assert len(new_chain(maximum_electron_kev=250.0).process(only(hits)).cones) == 0
    assert len(new_chain(minimum_photon_kev=400.0).process(only(hits)).cones) == 0


def test_an_unknown_nuclide():
    with pytest.raises(ConfigError, match="'Xx-1' is not known"):
        DetectorChain(DetectionConfig(), "Xx-1", Calibration.nominal())


def stream(rng, make_compton_event, blob, count=60, spacing_ns=30_000):
    """Events at random times, coincidences and single ones."""
    blobs = []
    for time in np.sort(rng.uniform(200.0, count * spacing_ns, count)):
        pair = make_compton_event(rng, (0.0, 0.6, 0.8), time) if rng.random() < 0.7 else None
        blobs += pair or [blob(time, (*rng.uniform(-6, 6, 2), 1.0), rng.uniform(20.0, 660.0), 5)]
    return blobs, count * spacing_ns


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), cuts=st.lists(st.floats(0.0, 1.0), max_size=40), near=st.booleans())
def test_the_result_does_not_depend_on_how_the_stream_is_cut(
    seed, cuts, near, make_compton_event, blob, make_hits, make_readouts
):
    rng = np.random.default_rng(seed)
    blobs, length = stream(rng, make_compton_event, blob)
    hits = make_hits(blobs)
    if near:  # cuts right through events
        places = [int(hits.tick[int(cut * (len(hits) - 1))] * 25 // 16) + 1 for cut in cuts]
    else:
        places = [int(cut * length) for cut in cuts]
    edges = [CLOCK_NS + place for place in (0, *sorted(places), length + 1000)]
    whole_chain, cut_chain = new_chain(), new_chain()
    whole = [*map(whole_chain.process, make_readouts(hits, [edges[0], edges[-1]], CLOCK_NS)), whole_chain.flush()]
    parts = [*map(cut_chain.process, make_readouts(hits, edges, CLOCK_NS)), cut_chain.flush()]

    assert parts[0].start_ns == edges[0]
    assert parts[-1].end_ns == edges[-1]
    for before, after in pairwise(parts):
        assert before.end_ns == after.start_ns
        assert before.end_ns >= before.start_ns
    for part in parts:
        assert part.live_time_s == pytest.approx((part.end_ns - part.start_ns) * 1e-9)
        assert all(part.start_ns <= cone.stamp_ns < part.end_ns for cone in part.cones)
    for name in ("hits", "photopeak", "coincidences"):
        assert sum(getattr(part, name) for part in parts) == sum(getattr(part, name) for part in whole)
    expected = [cone for part in whole for cone in part.cones]
    found = [cone for part in parts for cone in part.cones]
    assert [cone.stamp_ns for cone in found] == [cone.stamp_ns for cone in expected]
    np.testing.assert_allclose([cone.theta_rad for cone in found], [cone.theta_rad for cone in expected])


def test_dead_time_is_shared_with_what_is_held_back(blob, make_hits):
    chain = new_chain()
    hits = make_hits([blob(999_950.0, (0.0, 0.0, 0.0), 100.0, 3)])  # 50 ns before the end: its event may go on
    first = chain.process(Readout(0, 1_000_000, 0, 0.5e-3, hits))
    second = chain.process(Readout(1_000_000, 2_000_000, 0, 1.0e-3, make_hits([])))
    assert first.hits == 0
    assert second.hits == 1
    assert first.end_ns == second.start_ns < 1_000_000
    assert first.live_time_s + second.live_time_s == pytest.approx(1.5e-3)
    assert second.end_ns == 2_000_000


def test_hits_that_never_pause_are_not_held_back_for_ever():
    chain = new_chain()
    ticks = np.arange(0, 3_200_000, 16)  # a hit each 25 ns for 5 ms, spread over the sensor
    index = (np.arange(len(ticks)) * 7919 % 65536).astype(np.uint16)
    hits = PixelHits(ticks, index, np.full(len(ticks), 60, np.uint16))
    found = chain.process(Readout(0, 5_000_000, 0, 5e-3, hits))
    assert found.end_ns >= 4_000_000 - 10
    assert found.hits > 0
    assert chain.flush().hits > 0


def test_late_hits_are_counted_when_they_come(blob, make_hits):
    chain = new_chain()
    chain.process(Readout(0, 1_000_000, 0, 1e-3, make_hits([])))
    late = chain.process(Readout(1_000_000, 2_000_000, 0, 1e-3, make_hits([blob(900_000.0, (0, 0, 1.0), 100.0, 3)])))
    assert late.hits == 1


def test_lost_hits_are_summed(make_hits):
    chain = new_chain()
    for start in (0, 1000):
        chain.process(Readout(start, start + 1000, 0, 1e-6, make_hits([]), lost_hits=4))
    assert chain.lost_hits == 8


def test_hits_of_a_clock_far_ahead_are_not_kept(blob, make_hits):
    chain = new_chain()
    ahead = make_hits([blob(3.6e12, (0, 0, 1.0), 100.0, 3)])
    for start in (0, 1_000_000, 2_000_000):
        chain.process(Readout(start, start + 1_000_000, 0, 1e-3, ahead))
    assert chain.lost_hits == 9
    assert chain.flush().hits == 0


@pytest.mark.parametrize("count", [4, 4000])
def test_hits_without_energy_are_lost_and_do_no_harm(count):
    """c = 0 and t = 0 are accepted in a calibration; counts below b then mean no energy."""
    flat = np.zeros(65536)
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.of(flat + 1.6, flat + 24.0, flat, flat))
    ticks = np.arange(count) * 160
    hits = PixelHits(ticks, (np.arange(count) % 65536).astype(np.uint16), np.full(count, 3, np.uint16))
    found = chain.process(only(hits))
    assert (found.hits, chain.lost_hits) == (0, count)


def scanned(rng, make_compton_event, make_hits, source_of):
    """The cones of 200 coincidences from the directions that ``source_of(rng)`` gives, and their scan."""
    blobs = []
    time = 1000.0
    while len(blobs) < 400:
        pair = make_compton_event(rng, source_of(rng), time)
        if pair:
            blobs += pair
            time += 20_000.0
    found = new_chain().process(only(make_hits(blobs), int(time) + 1000))
    assert len(found.cones) > 150
    scan = DirectionScan()
    scan.add(found.cones)
    return found.cones, scan


@pytest.mark.parametrize("source", [(0.0, 0.0, 1.0), (0.0, 0.6, -0.8), (1.0, 0.0, 0.0)])
def test_the_direction_of_a_source_is_recovered(source, make_compton_event, make_hits):
    cones, scan = scanned(np.random.default_rng(11), make_compton_event, make_hits, lambda rng: source)
    best = scan.best()
    assert best is not None
    assert best.cones == len(cones)
    off = np.rad2deg(np.arccos(np.clip(best.unit @ np.array(source), -1, 1)))
    assert off < 2.0
    assert np.rad2deg(best.sigma_rad) < 2.0


def test_no_direction_without_a_cone():
    assert DirectionScan().best() is None


def test_no_direction_where_the_cones_agree_on_none(make_compton_event, make_hits):
    def anywhere(rng):
        source = rng.normal(size=3)
        return source / np.linalg.norm(source)

    _, scan = scanned(np.random.default_rng(12), make_compton_event, make_hits, anywhere)
    assert scan.best() is None
