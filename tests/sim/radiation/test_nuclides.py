import pytest

from radron.agent.errors import ConfigError
from radron.sim.radiation.nuclides import NUCLIDES, nuclide
from radron.sim.radiation.surroundings import background_lines, scattered_lines


def test_all_nuclides_of_the_project_are_known() -> None:
    names = "Am-241 Ba-133 Co-57 Co-60 Cs-137 Eu-152 F-18 I-131 Ir-192 K-40 Na-22 Se-75"
    assert set(NUCLIDES) == set(names.split())
    assert nuclide("Cs-137").lines == ((661.657, 0.851),)


@pytest.mark.parametrize("name", NUCLIDES)
def test_lines_are_physical_and_strongest_first(name: str) -> None:
    lines = nuclide(name).lines
    assert all(10.0 < energy < 1600.0 and 0.0 < intensity <= 2.0 for energy, intensity in lines)
    assert [i for _, i in lines] == sorted((i for _, i in lines), reverse=True)


def test_an_unknown_nuclide_names_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'Cs137' is not known; known are Am-241, .*Cs-137"):
        nuclide("Cs137")


def test_scattered_photons_keep_their_number_and_lose_energy() -> None:
    lines = scattered_lines(nuclide("Cs-137"))
    assert sum(i for _, i in lines) == pytest.approx(0.851)
    assert min(e for e, _ in lines) == pytest.approx(184.3, rel=0.05)  # back-scatter
    assert max(e for e, _ in lines) < 661.657


def test_background_is_normalised() -> None:
    assert sum(weight for _, weight in background_lines()) == pytest.approx(1.0)
