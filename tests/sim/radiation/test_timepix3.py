import numpy as np
import pytest

from radron.agent.detector.readout import TICK_NS
from radron.sim.radiation.electrons import electrons
from radron.sim.radiation.timepix3 import ENERGY_STEP_KEV, PIXEL, Response, energies_kev, respond, response, scratch
from radron.sim.radiation.transport import HALF_SIZE_MM, SITE_COLUMNS
from radron.sim.radiation.truth import CameraTruth

QUIET = CameraTruth(gain_noise=0.0, pixel_noise_kev=0.0, threshold_kev=0.001, charge_scale=1.0, toa_jitter_ns=0.0)


def deposit(camera: Response, energy_kev: float, z_mm: float, rng: np.random.Generator, x_mm: float = 0.0275) -> np.ndarray:
    """Pixels of one deposit; its electron starts there, in a random direction; without an electron at under 20 keV."""
    sites = np.zeros((1, SITE_COLUMNS))
    direction = rng.normal(size=3)
    sites[0] = [x_mm, 0.0275, z_mm, energy_kev, energy_kev, *(direction / np.linalg.norm(direction))]
    pixels = np.zeros(2000, PIXEL)
    end = respond(sites, 1, HALF_SIZE_MM, camera, electrons(), rng, scratch(), pixels, 0)
    return pixels[:end]


def test_charge_is_conserved() -> None:
    rng = np.random.default_rng(1)
    for energy in (10.0, 100.0, 500.0):
        pixels = deposit(response(QUIET), energy, 0.0, rng)
        rounding = 0.5 * ENERGY_STEP_KEV * len(pixels)
        assert energies_kev(pixels).sum() == pytest.approx(energy, abs=0.005 * energy + rounding)


def test_clusters_of_400_kev_have_many_pixels_and_of_10_kev_few() -> None:
    rng = np.random.default_rng(2)
    camera = response(CameraTruth())
    assert 8 <= np.median([len(deposit(camera, 400.0, 0.0, rng)) for _ in range(200)]) <= 20
    assert np.median([len(deposit(camera, 10.0, 0.0, rng)) for _ in range(200)]) <= 2


def test_charge_from_the_front_spreads_more() -> None:
    rng = np.random.default_rng(3)
    near, far = (np.mean([len(deposit(response(CameraTruth()), 60.0, z, rng)) for _ in range(300)]) for z in (-0.9, 0.9))
    assert far > 1.2 * near


@pytest.mark.parametrize("energy", [150.0, 400.0, 600.0])
def test_cluster_resolution(energy: float) -> None:
    rng = np.random.default_rng(4)
    sums = [energies_kev(deposit(response(CameraTruth()), energy, z, rng)).sum() for z in rng.uniform(-0.7, 0.7, 3000)]
    low, high = np.quantile(sums, [0.16, 0.84])
    assert 0.5 * (high - low) == pytest.approx(np.hypot(2.5, 0.02 * energy), rel=0.15)
    assert np.median(sums) == pytest.approx(energy, rel=0.02)


def test_drift_time_gives_the_depth() -> None:
    rng = np.random.default_rng(5)
    camera = response(CameraTruth())

    def arrival_ns(z_mm: float) -> float:
        return TICK_NS * float(np.mean([deposit(camera, 15.0, z_mm, rng)["tick"].mean() for _ in range(400)]))

    # The pixels are on the rear: what happens near the front arrives later.
    assert arrival_ns(0.9) - arrival_ns(-0.9) == pytest.approx(86.0 * 0.9, abs=1.0)


def test_time_jitter_per_pixel() -> None:
    rng = np.random.default_rng(6)

    def spread_ns(truth: CameraTruth) -> float:
        events = [deposit(response(truth), 19.0, 0.0, rng) for _ in range(2000)]
        return TICK_NS * float(np.std([pixels["tick"][pixels["energy"].argmax()] for pixels in events]))

    quiet = spread_ns(CameraTruth(toa_jitter_ns=0.0))
    assert quiet < 1.0  # the phase of the clock
    assert spread_ns(CameraTruth()) == pytest.approx(np.hypot(2.5, quiet), rel=0.1)


def test_no_pixel_below_the_threshold_and_no_negative_tick() -> None:
    rng = np.random.default_rng(7)
    camera = response(CameraTruth(toa_jitter_ns=20.0))
    events = [deposit(camera, 100.0, -0.99, rng) for _ in range(200)]
    assert all((energies_kev(pixels) >= 4.0).all() and (pixels["tick"] >= 0).all() for pixels in events)
