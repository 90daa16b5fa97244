import numpy as np
import pytest

from radron.sim.radiation.materials import CDTE_DENSITY_GCM3, air_attenuation_per_m, cdte
from radron.sim.radiation.transport import attenuation_per_mm


def at(energy_kev: float, table: np.ndarray) -> float:
    return float(np.interp(np.log(energy_kev), cdte().log_energy, table))


def test_cs137_line_in_cdte_as_in_the_reference() -> None:
    tables = cdte()
    assert attenuation_per_mm(661.657, tables) * 10.0 / CDTE_DENSITY_GCM3 == pytest.approx(0.0749, rel=0.005)
    assert at(661.657, tables.compton) == pytest.approx(0.85, abs=0.01)


def test_air_as_in_the_reference() -> None:
    assert air_attenuation_per_m(661.657) == pytest.approx(0.00934, rel=0.01)


def test_continuation_above_xraylibs_tables_is_smooth_and_right() -> None:
    below, above = attenuation_per_mm(790.0, cdte()), attenuation_per_mm(810.0, cdte())
    slope = np.log(above / below) / np.log(810.0 / 790.0)
    before = np.log(below / attenuation_per_mm(770.0, cdte())) / np.log(790.0 / 770.0)
    assert slope == pytest.approx(before, abs=0.05)
    # NIST XCOM, air at 1.25 MeV: 0.05687 cm2/g
    assert air_attenuation_per_m(1250.0) == pytest.approx(0.05687 * 1.205e-3 * 100.0, rel=0.01)


def test_k_edges_stand_where_they_should() -> None:
    tables = cdte()
    for element, edge in enumerate((26.711, 31.814)):
        assert tables.k_edge_kev[element] == pytest.approx(edge, abs=0.01)
        assert attenuation_per_mm(edge * 1.02, tables) > 1.2 * attenuation_per_mm(edge * 0.98, tables)


def test_momenta_are_symmetric_and_those_of_inner_shells_wider() -> None:
    tables = cdte()
    k_shell, l_shell = tables.momentum[1, 0], tables.momentum[1, 1]
    assert k_shell == pytest.approx(-k_shell[::-1])
    assert k_shell.std() > 2.0 * l_shell.std() > 0.0
