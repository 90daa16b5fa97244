"""The emulated vehicle's record of how regularly setpoints arrive."""

from itertools import count

import pytest

from radron.sim.vehicle.px4.mavlink.setpoint import SetpointLog

_contents = count()


def payload(content: int | None = None, sent_ms: int = 0) -> bytes:
    """A payload: the sender's time, then its content; a new one unless given."""
    return sent_ms.to_bytes(4, "little") + (next(_contents) if content is None else content).to_bytes(8, "little")


def arrive(log: SetpointLog, *at_s: float, offboard: bool = True) -> None:
    for time_s in at_s:
        log.add(payload(), round(time_s * 1e9), offboard)


def test_the_largest_gap_is_between_targets_in_offboard() -> None:
    log = SetpointLog()
    arrive(log, 0.0, 0.05, 0.35, 0.4)
    assert list(log.gaps_s) == pytest.approx([0.05, 0.3, 0.05])
    assert log.largest_gap_s == pytest.approx(0.3)


def test_a_repeated_target_closes_no_gap() -> None:
    log = SetpointLog()
    log.add(payload(7), 0, True)
    log.add(payload(7, sent_ms=50), 50_000_000, True)
    log.add(payload(8), 200_000_000, True)
    assert (log.received, log.computed) == (3, 2)
    assert log.largest_gap_s == pytest.approx(0.2)


def test_time_out_of_offboard_is_no_gap() -> None:
    log = SetpointLog()
    arrive(log, 0.0, 0.05)
    log.leave_offboard()
    arrive(log, 9.0, 9.1)
    arrive(log, 20.0, offboard=False)
    arrive(log, 30.0, 30.05)
    assert log.largest_gap_s == pytest.approx(0.1)
