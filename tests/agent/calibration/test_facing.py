"""Facings as the operator writes them."""

import numpy as np
import pytest

from radron.agent.calibration.command import parse_facings
from radron.agent.calibration.facing import Facing, parse_facing
from radron.agent.errors import ConfigError


def test_directions_are_clockwise_from_the_nose_and_up() -> None:
    np.testing.assert_allclose(Facing(90.0).direction, (0.0, -1.0, 0.0), atol=1e-12)  # to the right: -y in FLU
    np.testing.assert_allclose(Facing(0.0, 90.0).direction, (0.0, 0.0, 1.0), atol=1e-12)
    assert parse_facing("30,-20") == Facing(30.0, -20.0)
    assert parse_facing("-45") == Facing(-45.0, 0.0)


@pytest.mark.parametrize("text", ["", "left", "30,100", "1,2,3", "nan", "400"])
def test_what_is_no_direction_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="expected BEARING or BEARING,ELEVATION"):
        parse_facing(text)


def test_facings_must_be_three_apart_and_alike() -> None:
    assert len(parse_facings(["0=a.t3pa", "60=b.t3pa", "-60,10=c.t3pa"])) == 3
    with pytest.raises(ConfigError, match="2 facings of the source; at least 3"):
        parse_facings(["0", "60"])
    with pytest.raises(ConfigError, match="two facings are 5 deg apart"):
        parse_facings(["0", "5", "60"])
    with pytest.raises(ConfigError, match="a file with each facing, or with none"):
        parse_facings(["0", "60=b.t3pa", "-60"])
