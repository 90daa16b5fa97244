"""The time that a calibration takes."""

import pytest

from radron.agent.calibration.plan import Source, plan
from radron.agent.errors import ConfigError


def test_ten_megabecquerel_at_half_a_metre_take_half_an_hour_at_most() -> None:
    assert 600.0 < plan(Source("Cs-137", 1e7, 0.5)).total_s <= 1800.0


def test_the_time_follows_activity_and_distance() -> None:
    near = plan(Source("Cs-137", 1e7, 0.5)).total_s
    assert plan(Source("Cs-137", 4e7, 1.0)).total_s == pytest.approx(near)
    assert plan(Source("Cs-137", 2e7, 0.5)).total_s == pytest.approx(0.5 * near)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (Source("Cs-137", 1e5, 1.0), "put the source at"),
        (Source("Cs-137", 0.0, 1.0), "allowed are 1e3 to 1e12 Bq"),
        (Source("Cs-137", 1e7, 0.0), "0.1 to 100 m"),
        (Source("Xx-1", 1e7, 1.0), "not known; known: "),
    ],
)
def test_what_cannot_be_measured_is_refused(source: Source, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        plan(source)
