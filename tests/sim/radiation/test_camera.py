import math

import numpy as np
import pytest
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import Readout
from radron.agent.errors import ConfigError
from radron.sim.radiation import emission
from radron.sim.radiation.beam import BeamCamera
from radron.sim.radiation.camera import Camera, CameraTruth, SourceView
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.timepix3 import energies_kev
from support.sensors.partial_bank import ALONE, POLAR_DEG, direction, partial_bank, regroup

SECOND = 1_000_000_000
CLOCK = 1_700_000_000_123_456_789


@pytest.fixture(autouse=True)
def _small_bank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name))


def source(distance_m: float = 12.0, activity_bq: float = 3e9, turn: float = 0.3) -> SourceView:
    return SourceView(direction(POLAR_DEG, turn), distance_m, activity_bq)


def expose(camera: Camera, seconds: float, *views: SourceView, clock: int = 0) -> list[Readout]:
    step = SECOND // 10
    return [camera.expose(clock + k * step, clock + (k + 1) * step, views) for k in range(round(10 * seconds))]


def events_per_s(camera: Camera, seconds: float, *views: SourceView) -> float:
    return (len(regroup(expose(camera, seconds, *views)).first) - 1) / seconds


@pytest.mark.slow
def test_readouts_are_gap_free_and_hold_their_hits() -> None:
    camera = Camera(CameraTruth(), "Cs-137", np.random.default_rng(1), CLOCK)
    start, end = CLOCK + 7, CLOCK + 7 + SECOND // 10
    for _ in range(200):
        readout = camera.expose(start, end, [source(3.0)])
        assert (readout.start_ns, readout.end_ns, readout.clock_ns) == (start, end, CLOCK)
        assert readout.live_time_s == pytest.approx(0.1)
        stamps = CLOCK + readout.hits.tick * 25 / 16
        assert ((stamps >= start) & (stamps < end)).all()
        assert len(readout.hits) > 0
        start, end = end, end + SECOND // 10


def test_rate_at_12_m() -> None:
    """Reference: 20 hits/s at 12 m from 3 GBq."""
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(2), 0)
    rate = events_per_s(camera, 300.0, source())
    assert rate == pytest.approx(20.0, rel=0.06)


@pytest.mark.slow
def test_counts_are_poisson() -> None:
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(3), 0)
    counts = [len(regroup([readout]).first) - 1 if len(readout.hits) else 0 for readout in expose(camera, 200.0, source())]
    assert np.var(counts) / np.mean(counts) == pytest.approx(1.0, abs=0.1)


def test_inverse_square_and_air() -> None:
    rates = [
        events_per_s(Camera(ALONE, "Cs-137", np.random.default_rng(4), 0), 100.0, source(d, activity))
        for d, activity in ((6.0, 3e9), (60.0, 3e11))
    ]
    assert rates[0] / rates[1] == pytest.approx(math.exp(air_attenuation_per_m(661.657) * 54.0), rel=0.06)


def test_scatter_adds_to_the_direct_photons() -> None:
    quiet = CameraTruth(background_hits_per_s=0.0)
    with_scatter, without = (
        events_per_s(Camera(t, "Cs-137", np.random.default_rng(5), 0), 200.0, source()) for t in (quiet, ALONE)
    )
    assert with_scatter / without == pytest.approx(1.2 + 0.8 * 0.00934 * 12.0, rel=0.06)


def test_background_alone() -> None:
    camera = Camera(CameraTruth(), "Cs-137", np.random.default_rng(6), 0)
    assert events_per_s(camera, 1000.0) == pytest.approx(1.5, rel=0.1)


def test_two_sources_add_up() -> None:
    camera = Camera(ALONE, "Cs-137", np.random.default_rng(7), 0)
    assert events_per_s(camera, 200.0, source(), source(turn=4.0, activity_bq=6e9)) == pytest.approx(60.0, rel=0.06)


@pytest.mark.slow
def test_weaker_lines_are_thinned_by_the_air() -> None:
    """Ba-133: far away the 81 keV line arrives weakened more than that of 356 keV; bank and full transport agree."""
    rng = np.random.default_rng(9)

    def soft(readouts: list[Readout], seconds: float) -> tuple[float, float]:
        events = regroup(readouts)
        sums = np.add.reduceat(energies_kev(events.pixels), events.first[:-1])
        return len(sums) / seconds, float(np.mean(sums < 90.0))

    def from_bank(distance_m: float, activity_bq: float) -> tuple[float, float]:
        camera = Camera(ALONE, "Ba-133", rng, 0)
        views = [[source(distance_m, activity_bq, rng.uniform(0.0, 6.28))] for _ in range(300)]
        step = SECOND // 10
        return soft([camera.expose(k * step, (k + 1) * step, view) for k, view in enumerate(views)], 30.0)

    far = from_bank(100.0, 1e12)
    beam = BeamCamera(ALONE, "Ba-133", source(100.0, 1e12), rng, 0)
    exact = soft([beam.expose(k * SECOND, (k + 1) * SECOND) for k in range(30)], 30.0)
    assert far[0] == pytest.approx(exact[0], rel=0.08)
    assert far[1] == pytest.approx(exact[1], abs=0.035)
    assert from_bank(10.0, 1e10)[1] > far[1] + 0.09


def test_the_same_seed_gives_the_same_hits() -> None:
    runs = [expose(Camera(CameraTruth(), "Cs-137", np.random.default_rng(10), 0), 20.0, source(3.0)) for _ in range(2)]
    for one, other in zip(*runs, strict=True):
        assert np.array_equal(one.hits.tick, other.hits.tick)
        assert np.array_equal(one.hits.index, other.hits.index)
        assert np.array_equal(one.hits.tot, other.hits.tot)


def test_a_source_close_by() -> None:
    """1 m from 3 GBq: over 3000 events/s of some eight pixels."""
    readout = Camera(CameraTruth(), "Cs-137", np.random.default_rng(11), 0).expose(0, SECOND, [source(1.0)])
    assert 20_000 < len(readout.hits) < 50_000
    assert readout.lost_hits == 0


def test_too_many_hits_are_lost_and_reported() -> None:
    truth = CameraTruth(max_hits_per_s=10_000.0)
    readout = Camera(truth, "Cs-137", np.random.default_rng(12), 0).expose(0, SECOND, [source(1.0)])
    assert len(readout.hits) == 10_000
    assert readout.lost_hits > 10_000
    assert readout.live_time_s == pytest.approx(10_000 / (10_000 + readout.lost_hits))


def test_an_unknown_nuclide() -> None:
    with pytest.raises(ConfigError, match="known are"):
        Camera(CameraTruth(), "Xx-1", np.random.default_rng(1), 0)


@pytest.mark.slow
def test_a_flight_hardly_meets_an_event_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three minutes in front of a source: an estimator would take repeated events for a property of the source."""
    monkeypatch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name, 25.0))
    camera = Camera(CameraTruth(), "Cs-137", np.random.default_rng(4), 0)
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    ahead = SourceView(direction(25.0, 0.3), 7.0, 3e9)
    cones = [cone for readout in expose(camera, 180.0, ahead) for cone in chain.process(readout).cones]
    assert len(cones) > 400
    assert len({(cone.energies_kev, cone.separation_mm) for cone in cones}) > 0.85 * len(cones)


def test_a_camera_sees_sources_of_two_nuclides_each_by_its_own_lines() -> None:
    """Their hits add up; above the lines of Ba-133 there are lines of Cs-137 alone."""
    seen = [SourceView(direction(POLAR_DEG, 0.3), 12.0, 1.2e10, nuclide=name) for name in ("Ba-133", "Cs-137")]

    def sums_kev(*views: SourceView) -> NDArray[np.float64]:
        camera = Camera(ALONE, ("Ba-133", "Cs-137"), np.random.default_rng(12), 0)
        events = regroup(expose(camera, 15.0, *views))
        return np.add.reduceat(energies_kev(events.pixels), events.first[:-1])

    both, first, second = sums_kev(*seen), sums_kev(seen[0]), sums_kev(seen[1])
    # Three sigmas of at least the 1,200 events of Cs-137 alone; above 450 keV there are some 300.
    assert len(both) == pytest.approx(len(first) + len(second), rel=0.06)
    assert np.count_nonzero(first > 450.0) == 0
    assert np.count_nonzero(both > 450.0) == pytest.approx(np.count_nonzero(second > 450.0), rel=0.25)
