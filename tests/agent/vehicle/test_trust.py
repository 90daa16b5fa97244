"""The error bound of a position without satellites, and its end."""

import pytest

from radron.agent.vehicle.trust import CONFIRM_S, PositionTrust, drift_m


@pytest.fixture
def lost():
    """Of an autopilot that flies by satellites alone, and has been without them for 5 s, from 1 s on."""
    trust = PositionTrust(by_satellites=True)
    trust.take_fix(True, 0.0)
    trust.take_fix(False, 1.0)
    return trust


def test_the_bound_of_the_drift_grows_without_satellites_and_lasts_until_the_position_is_confirmed(lost):
    assert lost.drift_m(6.0) == pytest.approx(drift_m(5.0))
    lost.take_fix(True, 6.0)
    lost.take_fix(True, 7.5)
    assert not lost.at(6.0 + CONFIRM_S - 0.1)
    assert lost.drift_m(6.0 + CONFIRM_S - 0.1) == pytest.approx(drift_m(5.0))
    assert lost.drift_m(6.0 + CONFIRM_S) == 0.0


def test_a_jump_with_which_satellites_are_found_ends_the_drift_but_not_the_doubt(lost):
    lost.take_fix(True, 6.0)
    lost.jumped(6.3, moved=False)  # the heading, or a height
    assert lost.drift_m(6.3) == pytest.approx(drift_m(5.3))
    lost.jumped(6.5, moved=True)
    lost.take_fix(True, 8.0)
    assert lost.drift_m(6.5) == 0.0
    assert not lost.at(6.5 + CONFIRM_S - 0.1)


def test_a_jump_without_satellites_ends_nothing(lost):
    lost.jumped(6.0, moved=True)
    assert lost.drift_m(6.0) == pytest.approx(drift_m(5.0))
    assert not lost.hears_satellites(6.0)


def test_with_another_position_source_satellites_do_not_matter():
    trust = PositionTrust(by_satellites=False)
    trust.take_fix(False, 1.0)
    trust.jumped(2.0, moved=True)
    assert trust.at(2.0)
    assert trust.hears_satellites(2.0)
