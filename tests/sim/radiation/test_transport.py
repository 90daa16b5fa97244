import numpy as np
import pytest
import xraylib

from radron.sim.radiation.materials import ELECTRON_MASS_KEV, cdte
from radron.sim.radiation.transport import (
    HALF_SIZE_MM,
    MAX_SITES,
    SITE_COLUMNS,
    attenuation_per_mm,
    enter,
    photoelectron_cosine,
    projected_area_mm2,
    scatter_compton,
    scatter_rayleigh,
    transport,
    way_out,
)

LINE = 661.657


def shoot(energy_kev: float, count: int, seed: int) -> list[np.ndarray]:
    """Sites of photons that come straight from the front and interact 0.1 mm deep, in the middle."""
    rng = np.random.default_rng(seed)
    sites, stack = np.zeros((MAX_SITES, SITE_COLUMNS)), np.zeros((MAX_SITES + 1, 7))
    events = []
    for _ in range(count):
        position, direction = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
        n = transport(energy_kev, 0.1, position, direction, HALF_SIZE_MM, cdte(), rng, sites, stack)
        events.append(sites[:n].copy())
    return events


def test_compton_angles_follow_klein_nishina() -> None:
    rng = np.random.default_rng(1)
    cosines = np.array([scatter_compton(LINE, 1, cdte(), rng)[1] for _ in range(40_000)])
    edges = np.linspace(-1.0, 1.0, 21)
    fine = np.linspace(-1.0, 1.0, 20_001)
    ratio = 1.0 / (1.0 + LINE / ELECTRON_MASS_KEV * (1.0 - fine))
    transfer = LINE / 12.39842 * np.sqrt((1.0 - fine) / 2.0)
    density = ratio**2 * (ratio + 1.0 / ratio - 1.0 + fine**2) * np.interp(transfer, cdte().transfer, cdte().incoherent[1])
    cumulative = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
    expected = np.diff(np.interp(edges, fine, cumulative / cumulative[-1])) * len(cosines)
    chi2 = ((np.histogram(cosines, edges)[0] - expected) ** 2 / expected).sum()
    assert chi2 < 43.8  # 19 degrees of freedom, p = 0.001


def test_doppler_broadening_is_centred_and_of_the_known_width() -> None:
    rng = np.random.default_rng(2)
    drawn = np.array([scatter_compton(LINE, 1, cdte(), rng) for _ in range(40_000)])
    sharp = LINE / (1.0 + LINE / ELECTRON_MASS_KEV * (1.0 - drawn[:, 1]))
    right_angle = np.abs(drawn[:, 1]) < 0.1
    shift = (drawn[:, 0] - sharp)[right_angle]
    assert abs(np.median(shift)) < 0.3
    # One atomic unit of momentum shifts E' by E' |k - k'| / (E mc) m c^2 / 137 = 2.8 keV; tellurium's profile is 1-2 units wide.
    half_width = np.diff(np.quantile(shift, [0.25, 0.75]))[0] / 2.0
    assert 2.0 < half_width < 6.0
    assert (drawn[:, 0] < LINE).all()


@pytest.mark.parametrize("energy", [30.0, 122.0, LINE])
def test_rayleigh_angles_follow_thomson_times_the_form_factor(energy: float) -> None:
    rng = np.random.default_rng(3)
    cosines = np.array([scatter_rayleigh(energy, 0, cdte(), rng) for _ in range(10_000)])
    fine = 1.0 - np.geomspace(1e-8, 2.0, 5000)[::-1]
    transfer = energy / 12.39842 * np.sqrt((1.0 - fine) / 2.0)
    factor = np.array([xraylib.FF_Rayl(48, float(x)) for x in transfer])
    density = factor**2 * (1.0 + fine**2)
    mean = np.trapezoid(density * (1.0 - fine), fine) / np.trapezoid(density, fine)
    error = cosines.std() / 100.0
    assert 1.0 - cosines.mean() == pytest.approx(mean, abs=4.0 * error + 0.01 * mean)


def test_photoelectrons_go_forward_at_high_energy_and_sideways_at_low() -> None:
    rng = np.random.default_rng(4)
    low, high = (np.array([photoelectron_cosine(kinetic, rng) for _ in range(4000)]) for kinetic in (5.0, 600.0))
    assert abs(low.mean()) < 0.2
    assert high.mean() > 0.5
    assert low.var() == pytest.approx(0.2, abs=0.05)  # sin^2: the variance of the cosine is 1/5


def test_energy_is_conserved_and_escapes_only_as_photons() -> None:
    events = shoot(LINE, 5000, 5)
    totals = np.array([event[:, 3].sum() for event in events])
    assert totals.max() <= LINE + 1e-9
    assert np.mean(totals > LINE - 1e-6) == pytest.approx(0.2, abs=0.08)
    assert all((event[:, 3:5] > 0.0).all() for event in events)
    assert all((np.abs(event[:, :3]) <= HALF_SIZE_MM + 1e-9).all() for event in events)


def test_first_compton_deposit_and_recoil_direction_obey_the_kinematics() -> None:
    checked = 0
    for event in filter(len, shoot(LINE, 5000, 6)):
        electron = event[0, 3]
        if 50.0 < electron < 450.0:
            cosine = event[0, 5:8] @ [0.0, 0.0, -1.0]
            k = LINE / ELECTRON_MASS_KEV
            expected = (1.0 + 1.0 / k) * np.sqrt(electron / (electron + 2.0 * ELECTRON_MASS_KEV))
            assert cosine == pytest.approx(min(1.0, expected), abs=0.35)  # Doppler broadened
            checked += 1
    assert checked > 2000


def test_k_fluorescence_has_the_right_lines_and_yield() -> None:
    """59.5 keV: nearly all is photoelectric; where a K line escapes from the site, it deposits the rest."""
    events = [event for event in shoot(59.541, 6000, 7) if len(event)]
    first = np.array([event[0, 3] for event in events])
    emitted = first < 59.0
    compton = first < 20.0
    assert np.mean(emitted & ~compton) == pytest.approx(0.95 * 0.838 * 0.86, abs=0.04)
    lines = 59.541 - first[emitted & ~compton]
    for low, high in ((22.9, 23.3), (26.0, 26.8), (27.1, 27.6), (30.9, 31.8)):  # Cd Ka, Cd Kb, Te Ka, Te Kb
        assert ((lines > low) & (lines < high)).mean() > 0.02
    assert ((lines > 22.9) & (lines < 31.8)).mean() > 0.99


def test_the_beam_meets_faces_in_proportion_to_their_shadow() -> None:
    rng = np.random.default_rng(8)
    polar, azimuth = 1.2, 0.4
    source = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    position = np.zeros(3)
    faces = np.zeros(3)
    for _ in range(20_000):
        enter(source, HALF_SIZE_MM, rng, position)
        faces += position == HALF_SIZE_MM
    hx, hy, hz = HALF_SIZE_MM
    shadow = 4.0 * np.array([hy * hz * source[0], hx * hz * source[1], hx * hy * source[2]])
    assert faces / 20_000 == pytest.approx(shadow / shadow.sum(), abs=0.015)
    assert projected_area_mm2(tuple(source)) == pytest.approx(shadow.sum())


def test_way_out_of_the_box() -> None:
    assert way_out(np.zeros(3), np.array([0.0, 0.0, -1.0]), HALF_SIZE_MM) == pytest.approx(1.0)
    slanted = np.array([0.6, 0.0, 0.8])
    assert way_out(np.array([7.0, 0.0, 0.0]), slanted, HALF_SIZE_MM) == pytest.approx(0.04 / 0.6)


def test_attenuation_falls_with_energy() -> None:
    energies = [40.0, 60.0, 122.0, 356.0, LINE, 1173.0, 1460.0]
    values = [attenuation_per_mm(energy, cdte()) for energy in energies]
    assert values == sorted(values, reverse=True)
