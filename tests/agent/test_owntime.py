"""Own time, which is monotonic, and UTC by a clock that is set."""

import pytest

from radron.agent.ownclock import STEP_NS, OwnClock
from radron.agent.owntime import Utc
from support.flights.one_pilot import START_NS, partner

MS = 1_000_000


class Computer:
    """Both clocks of a computer. ``late_ns``: by which a reading of UTC is late, one of them after the other."""

    def __init__(self):
        self.utc_ns, self.steady_ns, self.late_ns = START_NS, 5_000 * MS, []

    def utc(self):
        late_ns = self.late_ns.pop(0) if self.late_ns else 0
        self.steady_ns += late_ns
        self.utc_ns += late_ns
        return self.utc_ns

    def steady(self):
        return self.steady_ns


@pytest.mark.parametrize("step_ms", [-5_000, -2, 2, 500, 5_000])
def test_own_time_runs_on_over_a_step_of_utc(step_ms):
    computer = Computer()
    clock = OwnClock(computer.utc, computer.steady)
    assert (clock.now_ns(), clock.look()) == (START_NS, 0)
    computer.steady_ns += 100 * MS
    computer.utc_ns += (100 + step_ms) * MS
    assert (clock.now_ns(), clock.look()) == (START_NS + 100 * MS, step_ms * MS)
    assert clock.of(clock.now_ns()) == computer.utc_ns
    assert clock.own_ns(computer.utc_ns) == clock.now_ns()


def test_the_time_between_two_readings_is_no_step():
    computer = Computer()
    clock = OwnClock(computer.utc, computer.steady)
    computer.late_ns = [30 * MS, 20 * MS]  # the process was interrupted twice
    assert clock.look() == 0
    computer.utc_ns += STEP_NS
    assert clock.look() == 0


def test_a_message_goes_out_in_utc():
    pose, utc = next(partner(START_NS)), Utc()
    assert utc.stamped(pose) is pose
    utc.ahead_ns = -5_000 * MS
    assert utc.stamped(pose).stamp_ns == START_NS - 5_000 * MS
    utc.ahead_ns = -2 * START_NS
    assert utc.stamped(pose).stamp_ns == 0  # no message can carry less
