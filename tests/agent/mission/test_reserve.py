"""Who returns when for want of battery."""

import pytest
from msgspec.structs import replace
from one_pilot import SECOND, state

from agent.mission.problems import LOW_BATTERY, Problems
from agent.mission.reserve import Reserve
from protocol.messages import Stage, Status

LATER_NS = 10 * SECOND


def other(name: str, stage: Stage, battery: float | None = None) -> dict[str, Status]:
    return {name: Status(stamp_ns=0, drone=name, mission="0" * 16, boot="1" * 16, stage=stage, battery=battery)}


def returns(
    level: float | None, others: dict[str, Status] | None = None, for_ns: int = LATER_NS, unheard: tuple[str, ...] = ()
) -> bool:
    reserve, vehicle = Reserve("d2", 0.2), replace(state(0), battery=level)
    reserve.returns(0, vehicle, others or {}, unheard)
    return reserve.returns(for_ns, vehicle, others or {}, unheard)


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


def test_one_that_can_wait_no_longer_does_not() -> None:
    assert returns(0.09, other("d1", Stage.RETURN))
    assert returns(0.09, unheard=("d3",))


@pytest.mark.parametrize(
    ("level", "in_air", "problems"),
    [(None, False, ()), (0.2, False, ()), (0.19, False, (LOW_BATTERY,)), (0.19, True, ())],
)
def test_it_does_not_take_off_only_to_return(level: float | None, in_air: bool, problems: tuple[str, ...]) -> None:
    """Started at 18 % three drones rose one after the other, and came down 5 s later."""
    vehicle = replace(state(0), battery=level, in_air=in_air)
    assert Problems("d2", "0" * 16, 0.2).against_start(0, vehicle, {}) == problems
