"""Expected counts of ordinary detectors over soil, against published rates and the simulation's own transport."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.responses import read_table, shipped_content
from radron.agent.errors import ConfigError
from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import CountObservation, observe
from radron.agent.fusion.ordinary import FULL, REST, OrdinaryCounts
from radron.protocol.entries import Counts, Exposure, PoseSample
from radron.sim.radiation.camera import SourceView
from radron.sim.radiation.crystal.emulated import DEVICE_STEP_KEV, Ordinary, OrdinaryTruth
from radron.sim.radiation.truth import GroundTruth

HEX = "0123456789abcdef"


def expected(name: str, nuclide: str = "Cs-137") -> OrdinaryCounts:
    return OrdinaryCounts(read_table(shipped_content(name), name), nuclide)


def rates(detector: OrdinaryCounts, height_m: float, horizontal_m: np.ndarray) -> np.ndarray:
    zero = np.zeros_like(horizontal_m)
    direct, scattered = detector.per_bq(horizontal_m, zero, np.full_like(horizontal_m, height_m), (zero, zero))
    return direct + scattered


# Counts per second over an infinite plane of 1 MBq/m2, all and of full energy (contamination study, its own Monte Carlo);
# the photons of a plane come from up to hundreds of metres, so that both codes' far fluxes enter: 12 %.
@pytest.mark.parametrize(("height_m", "anything", "full"), [(2.0, 6606, 1141), (5.0, 5972, 845), (10.0, 5487, 630)])
def test_plane_of_caesium_below_sodium_iodide(height_m: float, anything: float, full: float) -> None:
    horizontal = np.geomspace(0.05, 1500.0, 3000)
    weights = 2.0 * math.pi * np.gradient(horizontal) * horizontal
    found = 1e6 * (rates(expected("nai-2x2"), height_m, horizontal) * weights[:, None]).sum(axis=0)
    assert found.sum() == pytest.approx(anything, rel=0.12)
    assert found[FULL] == pytest.approx(full, rel=0.06)


@pytest.mark.parametrize(("height_m", "horizontal_m"), [(3.0, 0.5), (3.0, 6.0), (5.0, 12.0), (2.0, 30.0)])
@pytest.mark.parametrize("name", ["nai-2x2", "csi-1cm3"])
def test_point_source_as_in_the_simulation(name: str, height_m: float, horizontal_m: float) -> None:
    """Different codes of transport over soils of different composition: 12 %."""
    distance = math.hypot(height_m, horizontal_m)
    truth = Ordinary(OrdinaryTruth(detector=name), ["Cs-137"], np.random.default_rng(1), 0, GroundTruth(natural=0.0))
    view = SourceView((0.0, 0.0, 1.0), distance, 1e9, camera_m=height_m)
    counts = truth.expose(0, 10**12, [view], height_m).counts / 1000.0
    counts = counts[round(36.0 / DEVICE_STEP_KEV) :]  # the table begins at 30 keV
    assert 1e9 * rates(expected(name), height_m, np.array([horizontal_m])).sum() == pytest.approx(counts.sum(), rel=0.12)


def test_background_as_in_the_simulation() -> None:
    for name in ("nai-2x2", "csi-1cm3", "gm-sbm20"):
        truth = Ordinary(OrdinaryTruth(detector=name), ["Cs-137"], np.random.default_rng(1), 0, GroundTruth())
        counted = truth.expose(0, 10**13, [], 3.0).counts.sum() / 1e4
        assert expected(name).background_ps.sum() == pytest.approx(counted, rel=0.1)


def observation(bins: tuple[int, ...]) -> CountObservation:
    exposure = Exposure(
        stamp_ns=0, drone="d1", mission=HEX, boot=HEX, sequence=1, epoch=0, end_ns=10**9, live_time_s=0.9,
        counts=Counts(sum(bins), 0, 0), poses=(PoseSample(0, (0.0, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0)),), position_sigma_m=0.1,
        yaw_sigma_rad=0.1, bins=bins,
    )  # fmt: skip
    found = observe(exposure, Transform())
    assert isinstance(found, CountObservation)
    return found


def test_counts_of_full_energy_are_those_about_the_line() -> None:
    detector = expected("nai-2x2")
    edges = np.array(read_table(shipped_content("nai-2x2"), "nai").edges_kev)
    bins = np.ones(64, int)
    at_line = int(np.searchsorted(edges, 661.7)) - 1
    bins[at_line] = 100
    found = detector.counted(observation(tuple(bins.tolist())))
    assert sum(found) == bins.sum()
    assert 100 <= found[FULL] <= 105
    assert expected("gm-sbm20").counted(observation((7,))) == (7, 0)


def test_exposures_with_other_channels_do_not_fit() -> None:
    detector = expected("nai-2x2")
    assert detector.fits(observation((1,) * 64))
    assert not detector.fits(observation((1,) * 63))
    assert not detector.fits(replace(observation((1,)), bins=()))


def test_nuclide_without_a_table_is_refused() -> None:
    with pytest.raises(ConfigError, match="no table of scattered photons; known: Cs-137"):
        expected("nai-2x2", "Se-75")


def test_sodium_iodide_is_a_hundred_times_the_tube() -> None:
    near = np.array([1.0])
    assert rates(expected("nai-2x2"), 3.0, near)[0, REST] > 100.0 * rates(expected("gm-sbm20"), 3.0, near)[0, REST]
