"""Differences of one camera: each is drawn once, has the given size, and leaves the camera's other random numbers unchanged."""

import math

import msgspec
import numpy as np
import pytest

from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import Readout
from radron.sim.radiation import emission
from radron.sim.radiation.calibration import NOMINAL_A, PixelCalibration
from radron.sim.radiation.camera import Camera, CameraTruth, SourceView
from radron.sim.radiation.individual import Individual
from support.sensors.partial_bank import ALONE, POLAR_DEG, direction, partial_bank

SECOND = 1_000_000_000
BEHIND = (0.0, 0.0, -1.0)


@pytest.fixture(autouse=True)
def _small_bank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name))


def many(count: int = 1500, **truth: float) -> list[Individual]:
    return [Individual(CameraTruth(**truth), np.random.default_rng(seed)) for seed in range(count)]


def exposed(
    seconds: int = 100, seed: int = 5, towards: tuple[float, float, float] = direction(POLAR_DEG, 0.3), **values: float
) -> list[Readout]:
    """Direct photons alone, of a source that stands still."""
    camera = Camera(msgspec.structs.replace(ALONE, **values), "Cs-137", np.random.default_rng(seed), 0)
    view = SourceView(towards, 12.0, 3e9)
    return [camera.expose(k * SECOND, (k + 1) * SECOND, [view]) for k in range(seconds)]


def hits(readouts: list[Readout]) -> int:
    return sum(len(readout.hits) for readout in readouts)


def test_all_off_is_exactly_as_assumed() -> None:
    for own in many(20):
        assert (own.sensitivity, own.clock_offset_ns, own.background(10.0), own.transmission(BEHIND)) == (1.0, 0, 1.0, 1.0)
    assert (PixelCalibration.draw(CameraTruth(), np.random.default_rng(1)).true_a == NOMINAL_A).all()


def test_sensitivities_spread_as_given() -> None:
    assert np.std([own.sensitivity for own in many(sensitivity_spread=0.05)]) == pytest.approx(0.05, rel=0.08)


def test_a_camera_counts_more_by_its_sensitivity() -> None:
    seed = max(range(50), key=lambda k: Individual(CameraTruth(sensitivity_spread=0.3), np.random.default_rng(k)).sensitivity)
    factor = Individual(CameraTruth(sensitivity_spread=0.3), np.random.default_rng(seed)).sensitivity
    assert factor > 1.5
    counted = hits(exposed(seed=seed, sensitivity_spread=0.3)) / hits(exposed(seed=seed))
    assert counted == pytest.approx(factor, rel=0.1)  # 2000 events, of some eight pixels each


def test_energy_gains_spread_as_given_and_shift_the_true_slope_alone() -> None:
    gains = []
    for seed in range(100):
        drawn = PixelCalibration.draw(CameraTruth(energy_gain_spread=0.02), np.random.default_rng(seed))
        assert (drawn.a == NOMINAL_A).all()
        assert np.ptp(drawn.true_a) == 0.0
        gains.append(drawn.true_a[0] / NOMINAL_A)
    assert np.std(gains) == pytest.approx(0.02, rel=0.2)


def test_the_gain_changes_energies_not_events() -> None:
    def energy_kev(readouts: list[Readout]) -> float:
        nominal = Calibration.nominal()
        return sum(float(nominal.energy_kev(readout.hits.index, readout.hits.tot).sum()) for readout in readouts)

    plain, shifted = exposed(20), exposed(20, energy_gain_spread=0.1)
    for one, other in zip(plain, shifted, strict=True):
        assert sorted(one.hits.tick) == sorted(other.hits.tick)
    drawn = PixelCalibration.draw(CameraTruth(energy_gain_spread=0.1), _after_the_cameras_own(5))
    gain = drawn.true_a[0] / NOMINAL_A
    assert abs(gain - 1.0) > 0.005
    assert energy_kev(shifted) / energy_kev(plain) == pytest.approx(gain, rel=0.003)


def _after_the_cameras_own(seed: int) -> np.random.Generator:
    """The stream as the electronics get it: the camera has split one off for what sets it apart."""
    rng = np.random.default_rng(seed)
    rng.spawn(1)
    return rng


def test_the_background_wanders_as_given_and_slowly() -> None:
    owns = many(background_drift=0.5, background_drift_s=60.0)
    first = np.log([own.background(0.1) for own in owns])
    soon = np.log([own.background(1.0) for own in owns])
    for own in owns:
        own.background(30.0)
    later = np.log([own.background(30.0) for own in owns])
    assert first.std() == pytest.approx(0.5, rel=0.08)
    assert later.std() == pytest.approx(0.5, rel=0.08)
    assert np.std(soon - first) < 0.12
    assert np.corrcoef(soon, later)[0, 1] == pytest.approx(math.exp(-1.0), abs=0.08)


def test_the_drift_moves_the_rate_that_a_camera_counts() -> None:
    truth = CameraTruth(background_hits_per_s=200.0, background_drift=1.0, background_drift_s=5.0)
    camera = Camera(truth, "Cs-137", np.random.default_rng(3), 0)
    counts = [len(camera.expose(k * SECOND, (k + 1) * SECOND, []).hits) for k in range(200)]
    assert np.std(np.log(counts)) == pytest.approx(1.0, abs=0.3)  # of 40 correlation times


def test_the_bodys_shadow_is_deepest_in_its_middle_and_ends_at_its_edge() -> None:
    own = Individual(CameraTruth(shadow=0.3, shadow_half_angle_deg=35.0), np.random.default_rng(1))

    def passes(off_deg: float) -> float:
        off = math.radians(off_deg)
        return own.transmission((math.sin(off), 0.0, -math.cos(off)))

    assert own.transmission(BEHIND) == pytest.approx(0.7)
    assert [passes(angle) for angle in (35.01, 90.0, 180.0)] == [1.0, 1.0, 1.0]
    falling = [passes(angle) for angle in (0.0, 10.0, 20.0, 30.0, 34.9)]
    assert falling == sorted(falling)
    # A ball under 35 degrees, through which a ray at 20 degrees goes 0.803 of its diameter.
    assert passes(20.0) == pytest.approx(0.7 ** math.sqrt(1.0 - (math.sin(math.radians(20)) / math.sin(math.radians(35))) ** 2))


def test_a_shadowed_camera_sees_less_of_what_is_behind_it_and_all_of_what_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = {"shadow": 0.6, "shadow_half_angle_deg": 60.0}
    assert hits(exposed(20, **truth)) == hits(exposed(20))
    monkeypatch.setattr(emission, "load_bank", lambda name, truth: partial_bank(name, 150.0))
    behind = direction(150.0, 0.3)
    share = Individual(CameraTruth(**truth), np.random.default_rng(5)).transmission(behind)
    assert share == pytest.approx(0.4 ** (1.0 - (0.5 / math.sin(math.radians(60.0))) ** 2) ** 0.5)
    assert hits(exposed(200, towards=behind, **truth)) / hits(exposed(200, towards=behind)) == pytest.approx(share, rel=0.1)


def test_the_anisotropy_spreads_over_directions_and_cameras_as_given_and_changes_nothing_else() -> None:
    rng = np.random.default_rng(1)
    directions = rng.standard_normal((50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cameras = many(200, anisotropy=0.07)
    logs = np.log([[own.transmission(tuple(each)) for each in directions.tolist()] for own in cameras])
    assert np.std(logs) == pytest.approx(0.07, rel=0.1)
    # Smooth: a degree further it is hardly different.
    near = directions + 0.017 * np.roll(directions, 1, axis=1)
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    beside = np.log([[own.transmission(tuple(each)) for each in near.tolist()] for own in cameras])
    assert np.std(beside - logs) < 0.1 * 0.07
    drifting = {"sensitivity_spread": 0.05, "background_drift": 0.5}
    plain, own = (many(1, **drifting, **more)[0] for more in ({}, {"anisotropy": 0.07}))
    assert (own.sensitivity, own.background(1.0)) == (plain.sensitivity, plain.background(1.0))


def test_clocks_are_off_by_a_constant_within_the_limit() -> None:
    offsets = np.array([own.clock_offset_ns for own in many(clock_offset_s=0.05)])
    assert np.abs(offsets).max() <= 50_000_000
    assert offsets.std() == pytest.approx(0.1e9 / 12**0.5, rel=0.08)
    plain, shifted = exposed(20, clock_offset_s=0.0), exposed(20, clock_offset_s=0.05)
    moved = {
        time
        for one, other in zip(plain, shifted, strict=True)
        for time in (other.start_ns - one.start_ns, other.end_ns - one.end_ns, other.clock_ns - one.clock_ns)
    }
    assert len(moved) == 1
    assert 0 < abs(moved.pop()) <= 50_000_000
    assert all(np.array_equal(one.hits.tick, other.hits.tick) for one, other in zip(plain, shifted, strict=True))
