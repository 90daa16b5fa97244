"""News with a wrong stamp: dropped, so that no later and true one is older than known."""

import pytest
from one_pilot import START_NS, partner

from agent.localization.clocks import MOST_SIGMA_M, Clocks
from agent.navigation.peers import FUTURE_NS, MOST_AHEAD_NS, Peers
from protocol.messages import Stage, Status

MS = 1_000_000


def pose(stamp_ns):
    return next(partner(stamp_ns))


@pytest.mark.parametrize(
    ("ahead_ns", "behind_ns", "taken"),
    [
        (FUTURE_NS, 0, True),
        (FUTURE_NS + MS, 0, False),
        (950 * MS, 0, False),  # what won over all true ones
        (FUTURE_NS + 300 * MS, 300 * MS, True),  # the own clock is known to be behind
        (FUTURE_NS + 301 * MS, 300 * MS, False),
        (MOST_AHEAD_NS + MS, 3600_000 * MS, False),
    ],
)
def test_news_of_the_future_is_dropped_beyond_what_the_clocks_explain(ahead_ns, behind_ns, taken):
    peers = Peers(["d2"])
    refused = peers.receive(pose(START_NS + ahead_ns), START_NS, behind_ns)
    assert refused == (None if taken else "from_the_future")
    assert peers.receive(pose(START_NS + MS), START_NS + MS) == ("older_than_known" if taken else None)


def heard(stamp_ns, delay_ns):
    return Status(stamp_ns=stamp_ns, drone="d2", mission="0" * 16, boot="2" * 16, stage=Stage.TRACK, delays_ns={"d1": delay_ns})


@pytest.mark.parametrize("forged_ns", [2**61, -(2**61), 10_000 * MS, -10_000 * MS])
def test_forged_delays_neither_move_the_clock_nor_hide_where_the_drone_is(forged_ns):
    clocks = Clocks("d1", ["d2"])
    clocks.hear(heard(START_NS, forged_ns), START_NS + 20 * MS)
    assert clocks.offset_s == clocks.sigma_m(20.0) == clocks.behind_ns("d2") == 0.0


def test_true_delays_tell_how_far_the_own_clock_is_behind():
    clocks = Clocks("d1", ["d2"])
    clocks.hear(heard(START_NS, 320 * MS), START_NS - 280 * MS)
    assert clocks.behind_ns("d2") == pytest.approx(300 * MS, abs=1)
    assert clocks.offset_s == pytest.approx(-0.3)


def test_a_clock_that_is_years_off_still_leaves_a_sigma_that_can_be_sent():
    clocks, years_ns = Clocks("d1", ["d2"]), 10**18
    clocks.hear(heard(START_NS, years_ns + 20 * MS), START_NS + 20 * MS - years_ns)
    assert clocks.offset_s == pytest.approx(-1e9)
    assert clocks.sigma_m(20.0) == MOST_SIGMA_M
