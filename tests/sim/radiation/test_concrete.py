import pytest

from radron.sim.radiation.concrete import concrete_attenuation_per_m


@pytest.mark.parametrize(("energy_kev", "mass_attenuation_cm2pg"), [(400.0, 0.09783), (600.0, 0.08236), (1250.0, 0.05807)])
def test_concrete_as_in_the_tables(energy_kev: float, mass_attenuation_cm2pg: float) -> None:
    """NIST's tables (NISTIR 5632) for ordinary concrete, which has 1.2 % more hydrogen than Portland concrete."""
    assert concrete_attenuation_per_m(energy_kev) == pytest.approx(100.0 * 2.3 * mass_attenuation_cm2pg, rel=0.02)


def test_it_is_smooth_where_xraylibs_tables_end() -> None:
    below, above = concrete_attenuation_per_m(798.0), concrete_attenuation_per_m(801.0)
    assert above / below == pytest.approx((798.0 / 801.0) ** 0.5, abs=1e-3)
