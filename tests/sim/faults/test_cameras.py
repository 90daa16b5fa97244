"""Faulty cameras: what their readouts are like, with the physics of the pixels kept."""

import numpy as np
import pytest

from radron.agent.detector.readout import SENSOR_PIXELS, TICK_NS, PixelHits, Readout
from radron.sim.faults.base import Fault
from radron.sim.faults.cameras import CameraFaults, amplified, time_over_threshold
from radron.sim.faults.machines import CameraDead, CameraGain, CameraNoisy, CameraStuck
from radron.sim.faults.schedule import Schedule
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.truth import CameraTruth

TRUTH = CameraTruth()
CALIBRATION = PixelCalibration.draw(TRUTH, np.random.default_rng(1))
START_NS, SPAN_NS = 1_000_000_000, 200_000_000


def faulty(*faults: Fault, seed: int = 1) -> CameraFaults:
    schedule = Schedule(list(faults), ["d1", "d2"], seed)
    schedule.advance(max(fault.at_s for fault in faults))
    return CameraFaults(schedule, TRUTH, [CALIBRATION, CALIBRATION])


def readout(start_ns: int = START_NS, energy_kev: float = 60.0) -> Readout:
    """Five hits of one energy, 10 ms from each other."""
    tick = ((start_ns + 10_000_000 * np.arange(5)) * 16) // 25
    index = np.array([10, 500, 3000, 40_000, 65_535])
    tot = time_over_threshold(np.full(5, energy_kev), index, CALIBRATION)
    return Readout(start_ns, start_ns + SPAN_NS, 0, 0.2, PixelHits(tick, index.astype(np.uint16), tot.astype(np.uint16)))


def test_a_dead_camera_delivers_nothing_and_the_others_are_well() -> None:
    faults, healthy = faulty(CameraDead(at_s=0.0, target="d1")), readout()
    assert faults.spoil(0, healthy) is None
    assert faults.spoil(1, healthy) is healthy


def test_noise_has_the_rate_and_the_energy_of_the_fault() -> None:
    noisy = CameraNoisy(at_s=0.0, pixels=20, rate_hz=1000.0, energy_kev=30.0)
    faults = faulty(noisy)
    before = readout()
    spoilt = [faults.spoil(0, before) for _ in range(20)]
    added = [one.hits for one in spoilt if one is not None]
    counts = np.array([len(hits) - 5 for hits in added])
    # 4000 hits in a readout less 0.2 % for the time in which pixels are busy; four sigmas of the mean of 20
    assert counts.mean() == pytest.approx(4000 * 0.998, abs=4.0 * (4000 / 20) ** 0.5)
    pixels = {int(i) for hits in added for i in hits.index} - {int(i) for i in before.hits.index}
    assert len(pixels) == 20  # the same ones in all readouts
    tot = int(time_over_threshold(np.array([30.0]), np.array([0]), CALIBRATION)[0])
    for hits in added:
        noise = hits.take(~np.isin(hits.index, before.hits.index))
        assert (noise.tot == tot).all()
        assert noise.tick.min() * TICK_NS >= START_NS
        assert noise.tick.max() * TICK_NS < START_NS + SPAN_NS
        ends = hits.tick + 16 * hits.tot.astype(np.int64)
        assert (np.diff(ends) >= 0).all()  # delivered when their pulses are over
        for pixel in pixels:  # a pixel is not hit again while it is busy
            ticks = np.sort(noise.tick[noise.index == pixel])
            assert (np.diff(ticks) * TICK_NS >= 25.0 * tot + TRUTH.dead_time_ns - 2 * TICK_NS).all()


def test_half_a_column_is_noisy_from_an_edge_to_the_middle() -> None:
    spoilt = faulty(CameraNoisy(at_s=0.0, rate_hz=1000.0, column=True)).spoil(0, readout())
    assert spoilt is not None
    pixels, counts = np.unique(spoilt.hits.index, return_counts=True)
    noisy = pixels[counts > 20]
    rows, columns = np.divmod(noisy.astype(int), SENSOR_PIXELS)
    assert len(noisy) == 128
    assert len(set(columns)) == 1
    assert rows.min() in (0, 128)
    assert rows.max() - rows.min() == 127


def test_more_noise_than_the_readout_takes_is_lost() -> None:
    """Time until the bandwidth is used up: the live time is its share of all hits."""
    spoilt = faulty(CameraNoisy(at_s=0.0, pixels=4096, rate_hz=1e5)).spoil(0, readout())
    assert spoilt is not None
    assert len(spoilt.hits) == round(0.2 * TRUTH.max_hits_per_s)
    assert spoilt.lost_hits > 50 * len(spoilt.hits)
    assert spoilt.live_time_s == pytest.approx(0.2 * len(spoilt.hits) / (len(spoilt.hits) + spoilt.lost_hits))


def test_a_stuck_camera_repeats_its_first_readout() -> None:
    faults, first = faulty(CameraStuck(at_s=0.0)), readout()
    same = faults.spoil(0, first)
    assert same is not None
    assert (same.hits.tick == first.hits.tick).all()
    later = readout(START_NS + 3 * SPAN_NS, energy_kev=200.0)
    again = faults.spoil(0, later)
    assert again is not None
    assert (again.start_ns, again.end_ns) == (later.start_ns, later.end_ns)
    assert (again.hits.tot == first.hits.tot).all()
    assert (again.hits.tick - first.hits.tick == 3 * SPAN_NS * 16 // 25).all()


def test_a_stuck_camera_repeats_its_noise_too() -> None:
    faults = faulty(CameraStuck(at_s=0.0), CameraNoisy(at_s=0.0, pixels=20, rate_hz=1000.0))
    first, again = faults.spoil(0, readout()), faults.spoil(0, readout(START_NS + SPAN_NS))
    assert first is not None
    assert again is not None
    assert len(first.hits) > 3000
    assert (again.hits.index == first.hits.index).all()
    assert (again.hits.tick - first.hits.tick == SPAN_NS * 16 // 25).all()


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.3])
def test_a_wrong_gain_scales_the_charge(factor: float) -> None:
    spoilt = faulty(CameraGain(at_s=0.0, factor=factor)).spoil(0, readout(energy_kev=60.0))
    assert spoilt is not None
    expected = time_over_threshold(np.full(5, 60.0 * factor), spoilt.hits.index.astype(np.int64), CALIBRATION)
    assert np.abs(spoilt.hits.tot.astype(int) - expected).max() <= 1  # the counts before were rounded


@pytest.mark.parametrize(("time_s", "factor"), [(20.0, 1.0), (170.0, 1.025), (620.0, 1.1), (900.0, 1.1)])
def test_a_gain_drifts_linearly_to_its_factor(time_s: float, factor: float) -> None:
    schedule = Schedule([CameraGain(at_s=20.0, factor=1.1, over_s=600.0)], ["d1"], 1)
    schedule.advance(time_s)
    spoilt = CameraFaults(schedule, TRUTH, [CALIBRATION]).spoil(0, readout(energy_kev=300.0))
    assert spoilt is not None
    expected = time_over_threshold(np.full(5, 300.0 * factor), spoilt.hits.index.astype(np.int64), CALIBRATION)
    assert np.abs(spoilt.hits.tot.astype(int) - expected).max() <= 1  # the counts before were rounded


def test_charge_below_the_threshold_is_no_hit() -> None:
    assert len(amplified(readout(energy_kev=20.0).hits, 0.05, CALIBRATION)) == 0
