"""News with a wrong stamp: dropped, so that no later and true one is older than known."""

import pytest
from msgspec.structs import replace

from radron.agent.localization.clocks import MOST_SIGMA_M, Clocks
from radron.agent.navigation.peers.newest import FUTURE_NS, Peers
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from support.flights.one_pilot import MISSION, START_NS, partner, pilot

MS = 1_000_000


def pose(stamp_ns):
    return next(partner(stamp_ns))


@pytest.mark.parametrize(("ahead_ns", "taken"), [(FUTURE_NS, True), (FUTURE_NS + MS, False), (950 * MS, False)])
def test_news_of_the_future_is_dropped(ahead_ns, taken):
    peers = Peers(["d2"])
    assert peers.receive(pose(START_NS + ahead_ns), START_NS) == (None if taken else "from_the_future")
    assert peers.receive(pose(START_NS + MS), START_NS + MS) == ("older_than_known" if taken else None)


@pytest.mark.parametrize("ahead_ns", [300 * MS, 1410 * MS, -1410 * MS, 3600_000 * MS])
def test_news_of_a_drone_whose_clock_is_known_to_differ_is_taken_at_its_time_by_the_own_clock(ahead_ns):
    """By two delays of 20 ms, published by both drones; as long as only one delay is known, the message is dropped."""
    one, taken = pilot(), []
    now_ns = START_NS + 20 * MS
    for delays_ns, after_ms in (({}, (0,)), ({"d1": 20 * MS + ahead_ns}, (1, 201))):  # 201: of the future
        status = replace(heard(START_NS + ahead_ns, 0), mission=MISSION.mission_id, delays_ns=delays_ns)
        one.receive(key_of("radron", status), encode(status), now_ns)
        for news in (pose(START_NS + ahead_ns + after * MS) for after in after_ms):
            one.receive(key_of("radron", news), encode(news), now_ns)
        known = one._peers["d2"].pose
        taken.append(None if known is None else known.stamp_ns)
    assert taken[1] == START_NS + MS
    assert one.counters["dropped_from_the_future"] >= 1


@pytest.mark.parametrize("step_ms", [-3600_000, -5_000, -300, 300, 1_500, 5_000])
def test_news_stays_as_old_as_it_is_when_the_own_clock_is_set(step_ms):
    """A step forward by 0.1 to 2 s was taken for a pause of the agent, and made all peers that much older."""
    one = pilot()

    def hear(message, now_ns):
        one.receive(key_of("radron", message), encode(message), now_ns)

    for delays_ns in ({}, {"d1": 20 * MS}):
        hear(replace(heard(START_NS, 0), mission=MISSION.mission_id, delays_ns=delays_ns), START_NS + 20 * MS)
    for tenth in range(20):
        sent_ns = START_NS + 100 * MS * tenth
        one.observe_clock(step_ms * MS if tenth >= 10 else 0, sent_ns)
        hear(pose(sent_ns), sent_ns + 20 * MS)
        assert one._peers["d2"].pose.stamp_ns == pytest.approx(sent_ns, abs=MS)
        assert len(one._peers["d2"].poses) == tenth + 1
    assert one._peers["d2"].sources.second_places(sent_ns) == []


def heard(stamp_ns, delay_ns):
    return Status(stamp_ns=stamp_ns, drone="d2", mission="0" * 16, boot="2" * 16, stage=Stage.TRACK, delays_ns={"d1": delay_ns})


@pytest.mark.parametrize("forged_ns", [2**61, -(2**61), 10_000 * MS, -10_000 * MS])
def test_forged_delays_neither_move_the_clock_nor_hide_where_the_drone_is(forged_ns):
    clocks = Clocks("d1", ["d2"])
    clocks.hear(heard(START_NS, forged_ns), START_NS + 20 * MS)
    assert clocks.offset_s == clocks.sigma_m(20.0) == 0.0
    assert clocks.own_stamp_ns("d2", START_NS) == START_NS


def test_true_delays_tell_how_far_the_own_clock_is_behind():
    clocks = Clocks("d1", ["d2"])
    clocks.hear(heard(START_NS, 320 * MS), START_NS - 280 * MS)
    assert clocks.own_stamp_ns("d2", START_NS) == pytest.approx(START_NS - 300 * MS, abs=1000)
    assert clocks.offset_s == pytest.approx(-0.3)


def test_a_clock_that_is_years_off_still_leaves_a_sigma_that_can_be_sent():
    clocks, years_ns = Clocks("d1", ["d2"]), 10**18
    clocks.hear(heard(START_NS, years_ns + 20 * MS), START_NS + 20 * MS - years_ns)
    assert clocks.offset_s == pytest.approx(-1e9)
    assert clocks.sigma_m(20.0) == MOST_SIGMA_M


def test_poses_by_two_estimates_of_a_drones_clock_are_no_jump():
    """The delays of its messages grow in one direction by 0.7 s: its earlier messages move along."""
    peers, begun, moved_m = Peers(["d2"]), pose(START_NS), 2.1
    x_m, y_m, z_m = begun.position_m
    later = replace(begun, stamp_ns=START_NS + MS, position_m=(x_m + moved_m, y_m, z_m))  # sent 0.7 s later
    assert peers.receive(begun, START_NS, ahead_ns=0) is None
    assert peers.receive(later, START_NS + 701 * MS, ahead_ns=700 * MS) is None
    known = peers["d2"]
    assert known.pose == later
    assert [one.stamp_ns for one in known.poses] == [START_NS - 700 * MS, START_NS + MS]
    assert known.sources.second_places(START_NS + 701 * MS) == []


@pytest.mark.parametrize("set_ms", [-6440, -1500, -700, 700, 6440])
def test_what_a_drone_told_before_its_clock_was_set_stays_where_it_is(set_ms):
    """Moved along, it would be news of the future: the next poses older than known, then a jump. Until the set clock is known,
    news is read by the former one.
    """
    peers = Peers(["d2"])
    for k in range(6):  # each pose is 20 ms on its way; the clock is set before the third one, and known from the fifth on
        sent_ns, ahead_ns = START_NS + 100 * MS * k, set_ms * MS if k >= 4 else 0
        raw_ns = sent_ns + (set_ms * MS if k >= 2 else 0)
        reason = peers.receive(pose(raw_ns - ahead_ns), sent_ns + 20 * MS, ahead_ns=ahead_ns)
        assert (reason is None) is (k not in (2, 3))
    known = peers["d2"]
    assert [one.stamp_ns for one in known.poses] == [START_NS + 100 * MS * k for k in (0, 1, 4, 5)]
    assert known.sources.second_places(START_NS + 600 * MS) == []


@pytest.mark.parametrize("jump_s", [-13.8, 11.0, -1.0])
def test_news_from_before_a_drones_clock_was_set_keep_their_time(jump_s):
    """Old messages got stamps in the future, and all later ones counted as older than known, until that time had come."""
    peers, ahead_ns, known_ns = Peers(["d2"]), round(jump_s * 1000) * MS, START_NS + 700 * MS
    assert peers.receive(pose(START_NS), START_NS, ahead_ns=0) is None
    assert peers.receive(pose(known_ns), known_ns, ahead_ns=ahead_ns) is None
    assert [one.stamp_ns for one in peers["d2"].poses] == [START_NS, known_ns]
    assert peers["d2"].ahead_ns == ahead_ns


def test_a_late_status_of_a_moment_in_which_a_clock_was_wrong_hides_nobody():
    """Believed after the clock was right again, all it told was stale; then what had been heard moved 30 s into the future, and
    all was older than known until that time had come.
    """
    one, jump_ns, taken = pilot(), 30_000 * MS, []
    begun_ns = START_NS + 1000 * MS

    def hear(message, now_ns):
        one.receive(key_of("radron", message), encode(message), now_ns)

    def told(sent_ns, ahead_ns=0):
        return replace(heard(sent_ns + ahead_ns, ahead_ns + 20 * MS), mission=MISSION.mission_id)

    one.step(START_NS)
    for delays_ns in ({}, {"d1": 20 * MS}):
        hear(replace(told(begun_ns), delays_ns=delays_ns), begun_ns + 20 * MS)
    late = told(begun_ns + 300 * MS, jump_ns)  # the clock is set ahead by 30 s from 200 to 400 ms, and this comes at 700 ms
    for tenth in range(1, 40):
        sent_ns = begun_ns + 100 * MS * tenth
        ahead_ns = jump_ns if 2 <= tenth < 4 else 0
        hear(pose(sent_ns + ahead_ns), sent_ns + 20 * MS)
        if tenth == 7:
            hear(late, sent_ns + 21 * MS)
        if tenth == 15:
            hear(told(sent_ns), sent_ns + 21 * MS)
        known = one._peers["d2"].pose
        taken.append(sent_ns - known.stamp_ns)
    assert max(taken) <= 200 * MS  # the two of the wrong clock apart
    assert min(taken) >= 0
