"""Own time of the autopilot's stamps: within the link's least delay, whatever the delays, pauses and restarts."""

import random

import pytest

from radron.agent.vehicle.clock import WINDOW_NS, BootClock

MS = 1_000_000
BOOTED_NS = 1_700_000_000_000_000_000


def test_late_messages_get_the_time_at_which_they_were_made() -> None:
    rng, clock = random.Random(1), BootClock()
    for boot_ms in range(1000, 6000, 33):
        delay_ns = int(rng.expovariate(1 / 4.0) * MS)
        stamp_ns = clock.observe(boot_ms, BOOTED_NS + boot_ms * MS + delay_ns)
        if boot_ms > 2000:  # of 30 messages one was less than 1 ms late, but for a chance of 1 in 1000
            assert 0 <= stamp_ns - (BOOTED_NS + boot_ms * MS) < 2 * MS


def test_a_stamp_is_never_after_the_arrival() -> None:
    rng, clock = random.Random(2), BootClock()
    for boot_ms in range(0, 5000, 33):
        arrival_ns = BOOTED_NS + boot_ms * MS + rng.randrange(-20, 20) * MS
        assert clock.observe(boot_ms, arrival_ns) <= arrival_ns


def test_a_restarted_autopilot_is_believed_at_once() -> None:
    clock = BootClock()
    clock.observe(3_600_000, BOOTED_NS)
    assert clock.observe(5_000, BOOTED_NS + 100 * MS) == BOOTED_NS + 100 * MS


@pytest.mark.parametrize(("boots_ms", "rebooted"), [((5_000, 3_500, 5_033), False), ((500_000, *range(5_000, 5_400, 33)), True)])
def test_an_autopilot_that_was_booted_again_is_noticed_and_a_late_packet_is_none(boots_ms, rebooted) -> None:
    clock = BootClock()
    for number, boot_ms in enumerate((*boots_ms, *range(boots_ms[-1] + 33, boots_ms[-1] + 400, 33))):
        clock.observe(boot_ms, BOOTED_NS + (600_000 + 33 * number) * MS)
    assert clock.has_rebooted is rebooted


def test_a_reordered_message_does_not_count_as_a_restart() -> None:
    clock = BootClock()
    clock.observe(10_000, BOOTED_NS)
    assert clock.observe(9_970, BOOTED_NS + 1 * MS) == BOOTED_NS - 30 * MS


def test_a_paused_simulation_is_right_again_after_the_window() -> None:
    clock = BootClock()
    clock.observe(1_000, BOOTED_NS)
    resumed_ns = BOOTED_NS + WINDOW_NS + MS
    assert clock.observe(1_033, resumed_ns) == resumed_ns


def test_a_simulation_at_half_the_speed_lags_by_less_than_the_window() -> None:
    clock = BootClock()
    for step in range(300):
        arrival_ns = BOOTED_NS + step * 66 * MS
        assert 0 <= arrival_ns - clock.observe(step * 33, arrival_ns) <= WINDOW_NS // 2 + 33 * MS
