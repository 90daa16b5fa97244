"""The returns for want of battery: which drone, and when."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.mission.problems import LOW_BATTERY, Problems
from radron.agent.mission.reserve import Reserve
from radron.protocol.messages import Stage, Status
from support.flights.one_pilot import SECOND, state

LATER_NS = 10 * SECOND


def other(name: str, stage: Stage, battery: float | None = None) -> dict[str, Status]:
    return {name: Status(stamp_ns=0, drone=name, mission="0" * 16, boot="1" * 16, stage=stage, battery=battery)}


def returns(
    level: float | None, others: dict[str, Status] | None = None, for_ns: int = LATER_NS, unheard: tuple[str, ...] = ()
) -> bool:
    reserve, vehicle = Reserve("d2", 0.2), replace(state(0), battery=level)
    return reserve.observed(0, vehicle, others or {}, unheard).observed(for_ns, vehicle, others or {}, unheard).returns


@pytest.mark.parametrize(("level", "goes"), [(None, False), (0.3, False), (0.2, False), (0.19, True)])
def test_below_the_reserve_it_returns(level: float | None, goes: bool) -> None:
    assert returns(level) is goes


def test_a_level_that_is_low_for_a_moment_is_not_believed() -> None:
    assert not returns(0.1, for_ns=SECOND)


@pytest.mark.parametrize(
    ("others", "goes"),
    [
        (other("d3", Stage.RETURN), False),
        (other("d3", Stage.LANDING), False),
        (other("d3", Stage.LANDED, 0.1), True),
        (other("d1", Stage.TRACK, 0.15), False),
        (other("d1", Stage.TRACK, 0.5), True),
        (other("d3", Stage.TRACK, 0.15), True),
    ],
)
def test_one_after_the_other(others: dict[str, Status], goes: bool) -> None:
    assert returns(0.15, others) is goes


def test_a_vehicle_that_may_come_home_without_its_agent_goes_first() -> None:
    assert not returns(0.15, unheard=("d3",))


@pytest.mark.parametrize(("way_home_s", "goes"), [(0.0, False), (15.0, False), (25.0, True)])
def test_who_would_land_with_too_little_waits_for_nobody(way_home_s, goes) -> None:
    """After 10 s 16 % are left, and at least 0.2 % go each second: 10 % after another 30 s, of which the landing takes 10."""
    reserve = Reserve("d2", 0.2)
    for second in range(11):
        vehicle = replace(state(0), battery=0.19 - 0.003 * second)
        reserve = reserve.observed(second * SECOND, vehicle, other("d1", Stage.RETURN), way_home_s=way_home_s)
    assert reserve.returns is goes


@pytest.mark.parametrize(("way_home_s", "spent_at_s"), [(0.0, 9), (12.0, 5), (20.0, 5)])
def test_whose_battery_does_not_last_for_the_way_home_knows_it(way_home_s, spent_at_s) -> None:
    """From 10 % the battery drains by 0.4 % each second; 1 % may be a step of the autopilot's reading."""
    reserve, since_s = Reserve("d2", 0.2), None
    for second in range(12):
        reserve = reserve.observed(second * SECOND, replace(state(0), battery=0.1 - 0.004 * second), {}, way_home_s=way_home_s)
        since_s = second if reserve.is_spent and since_s is None else since_s
    assert since_s == spent_at_s


def test_a_level_that_is_noisy_or_sags_ends_no_flight() -> None:
    """0.1 % each second are really drained, from 20 % on, and home is 15 s away."""
    rng = np.random.default_rng(1)
    for trial in range(20):
        reserve = Reserve("d2", 0.2)
        for second in range(80):
            level = 0.199 - 0.001 * second + 0.003 * rng.standard_normal() - (0.03 if second > 2 and trial % 2 else 0.0)
            reserve = reserve.observed(second * SECOND, replace(state(0), battery=level), {}, way_home_s=15.0)
            assert not reserve.is_spent


def test_one_that_can_wait_no_longer_does_not() -> None:
    assert returns(0.09, other("d1", Stage.RETURN))
    assert returns(0.09, unheard=("d3",))


@pytest.mark.parametrize(
    ("level", "in_air", "problems"),
    [(None, False, ()), (0.2, False, ()), (0.19, False, (LOW_BATTERY,)), (0.19, True, ())],
)
def test_it_does_not_take_off_only_to_return(level: float | None, in_air: bool, problems: tuple[str, ...]) -> None:
    """Started at 18 % three drones rose one after the other, and landed 5 s later."""
    vehicle = replace(state(0), battery=level, in_air=in_air)
    assert Problems("d2", "0" * 16, 0.2).against_start(0, vehicle, {}) == problems
