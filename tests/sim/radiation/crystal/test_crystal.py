"""Transport in ordinary detectors against arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radron.sim.radiation.crystal.body import beam, bounding_radius, box, crossing, cylinder
from radron.sim.radiation.crystal.detectors import DETECTORS
from radron.sim.radiation.crystal.matter import Matter, at, matter, pair_cm2
from radron.sim.radiation.crystal.photons import areas
from radron.sim.radiation.crystal.table import response_table
from radron.sim.radiation.crystal.tube import range_gcm2

NAI = DETECTORS["nai-2x2"]


@pytest.fixture(scope="module")
def nai() -> Matter:
    return matter(NAI.elements(), NAI.density_gcm3)


def spectrum(energy_kev: float, size_cm: float, nai: Matter) -> tuple[float, np.ndarray]:
    shape = box(size_cm, size_cm, size_cm)
    bins = math.ceil(energy_kev)
    return areas(energy_kev, 0.5, shape, nai, bounding_radius(shape), 60_000, 1.0, bins, np.random.default_rng(1))


def test_chords_of_box_and_cylinder() -> None:
    along = np.array([0.0, 0.0, 1.0])
    enter, leave = crossing(np.array([0.2, 0.1, 0.0]), along, box(1.0, 1.0, 2.0))
    assert (enter, leave) == pytest.approx((-1.0, 1.0))
    enter, leave = crossing(np.array([0.0, 0.3, 0.0]), np.array([1.0, 0.0, 0.0]), cylinder(1.0, 3.0))
    assert leave - enter == pytest.approx(2.0 * math.sqrt(0.25 - 0.09))
    for position in ([0.6, 0.0, 0.0], [0.0, 0.51, 0.0]):
        enter, leave = crossing(np.array(position), along, cylinder(1.0, 3.0))
        assert leave <= enter


@pytest.mark.parametrize(("cosine", "shadow"), [(1.0, math.pi), (0.0, 2.0 * 3.0), (-1.0, math.pi)])
def test_beam_meets_the_shadow_of_a_cylinder(cosine: float, shadow: float) -> None:
    """Radius 1 cm, length 3 cm, upright: a disc from below and above, a rectangle from the side. 40,000 rays: 1 %."""
    shape, rng = cylinder(2.0, 3.0), np.random.default_rng(2)
    radius = bounding_radius(shape)
    position, direction = np.empty(3), np.empty(3)
    hits = 0
    for _ in range(40_000):
        beam(cosine, radius, rng, position, direction)
        assert direction[2] == pytest.approx(cosine)
        assert abs(position @ direction) < 1e-9
        enter, leave = crossing(position, direction, shape)
        hits += leave > enter
    assert hits / 40_000 * math.pi * radius**2 == pytest.approx(shadow, rel=0.03)


@pytest.mark.parametrize("energy_kev", [60.0, 661.657, 2614.5])
def test_thin_crystal_counts_by_volume_and_attenuation(energy_kev: float, nai: Matter) -> None:
    """So thin that no photon is shielded: the area is mu V."""
    size_cm = 0.01 / at(energy_kev, nai.per_cm)
    full, rest = spectrum(energy_kev, size_cm, nai)
    assert full + rest.sum() == pytest.approx(at(energy_kev, nai.per_cm) * size_cm**3, rel=0.03)


def test_compton_edge_and_escape_peaks(nai: Matter) -> None:
    _, rest = spectrum(661.657, 0.05, nai)
    assert rest[478:].sum() < 0.01 * rest.sum()  # one scattering gives at most 477.3 keV
    assert rest[440:478].sum() > 1.5 * rest[300:338].sum()  # Klein-Nishina rises to the edge
    _, rest = spectrum(2614.5, 1.0, nai)
    both, one = rest[1592], rest[2103]  # both annihilation photons escape, or one
    assert both > 5.0 * rest[1570:1590].mean()
    assert one > 3.0 * rest[2080:2100].mean()


def test_pair_production_begins_at_twice_the_electron_mass() -> None:
    assert pair_cm2(53, 1021.0) == 0.0
    assert 0.0 < pair_cm2(53, 1200.0) < pair_cm2(53, 2000.0) < pair_cm2(53, 3000.0)
    assert pair_cm2(82, 2000.0) == pytest.approx((82 / 53) ** 2 * pair_cm2(53, 2000.0))


def test_range_of_electrons() -> None:
    """0.412 g/cm2 at 1 MeV (Katz and Penfold)."""
    assert range_gcm2(1000.0) == pytest.approx(0.412)
    assert range_gcm2(100.0) < 0.1 * range_gcm2(1000.0)


def test_table_is_the_same_for_the_same_seed() -> None:
    one = response_table("csi-1cm3", 1000, 3)
    assert one == response_table("csi-1cm3", 1000, 3)
    assert one != response_table("csi-1cm3", 1000, 4)
