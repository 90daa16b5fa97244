"""The regular messages of a drone."""

import pytest

from agent.mission.reporter import Condition, Reporter
from protocol.messages import Stage, Status

SECOND = 1_000_000_000
NOW_NS = 1_767_225_600 * SECOND


@pytest.mark.parametrize("back_s", [3, 600])
def test_a_clock_that_is_set_back_does_not_silence_the_drone(back_s: int) -> None:
    reporter = Reporter("d1", "m" * 16, "0" * 16, "paper")
    condition = Condition(Stage.TRACK, {}, (), "", None, {}, None)

    def statuses(since_ns: int) -> int:
        times = range(since_ns, since_ns + 5 * SECOND, SECOND // 20)
        return sum(
            isinstance(one, Status) for now_ns in times for one in reporter.due(now_ns, None, None, None, lambda: condition)
        )

    usual = statuses(NOW_NS)
    assert usual >= 4
    assert statuses(NOW_NS + (5 - back_s) * SECOND) >= usual - 1
