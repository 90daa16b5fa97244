"""Differences of the drones' clocks."""

import math

import pytest
from msgspec.structs import replace

from radron.agent.localization.clocks import HEARD_NS, WINDOW_NS, Clocks
from radron.agent.vehicle.interface import GnssFix
from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Fix, Retraction
from radron.protocol.keys import key_of
from radron.protocol.messages import Pose, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, messages, pilot, state, tracking

FIX = GnssFix(
    stamp_ns=START_NS, latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0, horizontal_sigma_m=1.2, vertical_sigma_m=2.0
)
STATUS = Status(stamp_ns=0, drone="a", mission="0" * 16, boot="1" * 16, stage=Stage.TRACK)
MS = 1_000_000


def exchange_statuses(clocks, true_ns, own_ms, names, way_ns=lambda _: 2 * MS):
    """Each of these drones sends a status to all others. ``own_ms``: lead of each drone's own time; ``way_ns``: for how long a
    status is on its way to a receiver.
    """
    for sender in names:
        sent_ns = true_ns + own_ms[sender] * MS
        stamp_ns = clocks[sender].utc.of(sent_ns)
        status = replace(STATUS, drone=sender, stamp_ns=stamp_ns, delays_ns=clocks[sender].delays_ns(sent_ns))
        for receiver in names:
            if receiver != sender:
                clocks[receiver].hear(status, true_ns + way_ns(receiver) + own_ms[receiver] * MS)


def exchanged(ahead_ms, seconds=5, ways_ms=(2, 2), names=("a", "b", "c")):
    """Clocks of drones that hear each other once a second; ``ways_ms``: how long a message takes to a, and to others."""
    clocks = {name: Clocks(name, [other for other in names if other != name]) for name in names}
    for second in range(seconds):
        true_ns = START_NS + second * SECOND
        queued_ns = (second % 3) * 30 * MS  # some are queued for long
        exchange_statuses(clocks, true_ns, ahead_ms, names, lambda to, more=queued_ns: ways_ms[to != "a"] * MS + more)
    return clocks, lambda name: true_ns + ahead_ms[name] * MS + SECOND // 2


def test_the_one_clock_that_is_wrong_is_told_by_its_owner_alone():
    clocks, now_ns = exchanged({"a": 0, "b": 120, "c": 1})
    assert clocks["b"].offset_s == pytest.approx(0.119, abs=0.002)
    assert clocks["b"].problem(now_ns("b")) == "its clock is 0.12 s ahead of a, c: check chrony"
    assert clocks["a"].problem(now_ns("a")) is None
    assert clocks["c"].problem(now_ns("c")) is None


def test_of_two_clocks_that_differ_both_are_doubted():
    """By all of the difference: it is beyond the limit, half of it would not be."""
    clocks, now_ns = exchanged({"a": 0, "b": 80}, names=("a", "b"))
    assert clocks["a"].problem(now_ns("a")) == "its clock is 0.08 s behind b: check chrony"
    assert clocks["b"].problem(now_ns("b")) == "its clock is 0.08 s ahead of a: check chrony"


def test_a_clock_behind_and_seconds_off():
    clocks, now_ns = exchanged({"a": -3_700_000, "b": 0, "c": 0})
    assert clocks["a"].problem(now_ns("a")) == "its clock is 3700.00 s behind b, c: check chrony"
    assert clocks["b"].offset_s == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("jump_ms", [300, -300, 900, -900, 20_000, -20_000])
@pytest.mark.parametrize("names", [("a", "b", "c"), ("a", "b")])
def test_a_clock_that_is_set_in_flight_is_known_within_two_seconds(jump_ms, names):
    """With statuses once a second, and at once where a clock is seen to have been set."""
    clocks = {name: Clocks(name, [other for other in names if other != name]) for name in names}
    hurry, known_s = set(), None
    for tick in range(20 * 20):
        true_ns = START_NS + tick * SECOND // 20
        if tick == 200:
            clocks["b"].set_own(jump_ms * MS, true_ns)
        for number, sender in enumerate(names):
            if tick % 20 != 3 + 6 * number and sender not in hurry:
                continue
            hurry.discard(sender)
            stamp_ns = clocks[sender].utc.of(true_ns)
            status = replace(STATUS, drone=sender, stamp_ns=stamp_ns, delays_ns=clocks[sender].delays_ns(true_ns))
            for receiver in names:
                if receiver != sender and clocks[receiver].hear(status, true_ns + 5 * MS):
                    hurry.add(receiver)
        theirs_ns = clocks["b"].utc.of(true_ns)
        off_ns = [clocks[name].own_stamp_ns("b", theirs_ns) - true_ns for name in names if name != "b"]
        off_ns += [clocks["b"].own_stamp_ns(name, true_ns) - true_ns for name in names if name != "b"]
        if tick >= 200 and all(abs(one_ns) < 20 * MS for one_ns in off_ns):
            known_s = (tick - 200) / 20 if known_s is None else known_s
        else:
            assert known_s is None  # once known, it stays so
    assert known_s is not None
    assert known_s <= 2.0


def exchanged_over(seconds, way_ns, ahead_ns, phases=(3, 13)):
    """Offsets of two clocks, as published by a and b after every twentieth of a second. ``way_ns``: of a message sent then, by
    its sender; ``ahead_ns``: of the clock of b.
    """
    clocks, flying, told = {"a": Clocks("a", ["b"]), "b": Clocks("b", ["a"])}, [], []
    for tick in range(seconds * 20):
        true_ns = START_NS + tick * SECOND // 20
        clocks["b"].set_own(ahead_ns(tick / 20), true_ns)
        for sender, phase in zip("ab", phases, strict=True):
            if tick % 20 == phase:
                delays_ns = clocks[sender].delays_ns(true_ns)
                status = replace(STATUS, drone=sender, stamp_ns=clocks[sender].utc.of(true_ns), delays_ns=delays_ns)
                flying.append((true_ns + way_ns(tick / 20, sender), "ab"[sender == "a"], status))
        for arrival in sorted((one for one in flying if one[0] <= true_ns), key=lambda one: one[0]):
            flying.remove(arrival)
            clocks[arrival[1]].hear(arrival[2], arrival[0])
        told.append((clocks["a"].offsets_s(true_ns).get("b", 0.0), -clocks["b"].offsets_s(true_ns).get("a", 0.0)))
    return told


@pytest.mark.parametrize("phases", [(3, 13), (3, 4), (13, 3)])
@pytest.mark.parametrize("late_ms", [400, 1480])
def test_the_offset_stays_while_the_delays_of_messages_change(phases, late_ms):
    """The offset moved by half of the change while the smallest delays of the two ways were not of one time."""
    told = exchanged_over(60, lambda s, _: (late_ms if 15.0 <= s < 35.0 else 5) * MS, lambda _: 0, phases)
    assert max(abs(one) for both in told for one in both) < 0.03


def test_a_clock_that_is_set_while_messages_take_long_is_known_after_a_while():
    """A step shorter than the delays cannot be told from other delays until the earlier ones are forgotten."""
    told = exchanged_over(60, lambda _, __: 700 * MS, lambda s: 400 * MS if s >= 20.0 else 0)
    assert told[20 * 20 - 1] == pytest.approx((0.0, 0.0), abs=0.03)
    assert all(both == pytest.approx((-0.4, -0.4), abs=0.03) for both in told[40 * 20 :])


def test_a_delay_forged_alone_moves_nothing():
    clocks, now_ns = exchanged({"a": 0, "b": 0, "c": 0})
    for seconds, forged_ns in enumerate((-900 * MS, -20 * SECOND, 30 * SECOND), 1):
        stamp_ns = now_ns("b") + seconds * SECOND
        clocks["a"].hear(replace(STATUS, drone="b", stamp_ns=stamp_ns, delays_ns={"a": forged_ns}), stamp_ns + 2 * MS)
        assert clocks["a"].own_stamp_ns("b", stamp_ns) == stamp_ns
        assert clocks["a"].offset_s == pytest.approx(0.0, abs=0.02)


def test_the_common_time_is_that_of_the_majority():
    clocks, now_ns = exchanged({"a": 0, "b": -1410, "c": 1})
    assert clocks["b"].common_ns(now_ns("b")) == pytest.approx(now_ns("a"), abs=5 * MS)
    assert clocks["a"].common_ns(now_ns("a")) == now_ns("a")
    clocks, now_ns = exchanged({"a": 0, "b": -1410}, names=("a", "b"))  # undecidable which clock is wrong
    assert all(clocks[name].common_ns(now_ns(name)) == now_ns(name) for name in "ab")


@pytest.mark.parametrize("ahead", [{"a": 0, "b": 7_800, "c": 7_801, "d": 1}, {"a": -470, "b": 0, "c": -471, "d": 0}])
def test_where_the_clocks_split_into_halves_all_take_the_time_of_the_one_that_is_behind(ahead):
    """And not each half that of the other one."""
    clocks, now_ns = exchanged(ahead, names=tuple(ahead))
    behind_ns = min(now_ns(name) for name in ahead)
    assert all(clocks[name].common_ns(now_ns(name)) == pytest.approx(behind_ns, abs=5 * MS) for name in ahead)
    assert all(clocks[name].problem(now_ns(name)) is not None for name in ahead)


def test_where_most_clocks_are_set_back_all_are_wrong_until_the_common_time_has_come_to_where_it_was():
    """All drones have measured at those stamps before, elsewhere, also the drone whose clock is right by the new time."""
    names = ("a", "b", "c", "d")
    clocks, back_ms = {name: Clocks(name, [other for other in names if other != name]) for name in names}, 13_000
    told, followed_s = {name: [] for name in names}, {name: [] for name in names}
    for second in range(40):
        true_ns, own_ms = START_NS + second * SECOND, {"a": -back_ms, "b": 0, "c": 0, "d": 0}
        if second == 10:
            for name in "cd":
                clocks[name].set_own(-back_ms * MS, true_ns)
        exchange_statuses(clocks, true_ns, own_ms, names)
        for name in names:
            told[name].append(clocks[name].sigma_m(1.0))
            followed_s[name].append((clocks[name].followed_ns(true_ns + own_ms[name] * MS) - START_NS) / SECOND)
    for second, expected in ((9, "a"), (13, "abcd"), (20, "abcd"), (26, "b"), (39, "b")):
        assert {name for name in names if told[name][second] > 12.5} == set(expected)
        assert all(told[name][second] == 0.0 for name in set(names) - set(expected))
    for one in followed_s.values():  # the hypothesis waits for it meanwhile
        assert one[9] == pytest.approx(9.0, abs=0.1)
        assert all(one[second] == pytest.approx(9.5, abs=0.6) for second in range(12, 22))
        assert one[30] == pytest.approx(17.0, abs=0.1)


@pytest.mark.parametrize("silent", ["", "d"])
def test_where_most_clocks_were_ahead_for_a_while_all_follow_the_common_time_back(silent):
    """Only drones with wrong clocks have measured at those stamps. With a lost link, too, all follow soon."""
    names, ahead_ms = ("a", "b", "c", "d"), 26_600
    clocks = {name: Clocks(name, [other for other in names if other != name]) for name in names}
    doubted, off_s = {name: [] for name in names}, {name: [] for name in names}
    for second in range(60):
        true_ns = START_NS + second * SECOND
        heard = [name for name in names if second < 24 or name not in silent]
        for name in "bcd" if second in (10, 25) else "":
            clocks[name].set_own(ahead_ms * MS if second == 10 else 0, true_ns)
        exchange_statuses(clocks, true_ns, dict.fromkeys(names, 0), heard)
        for name in names:
            doubted[name].append(clocks[name].is_doubted)
            off_s[name].append((clocks[name].followed_ns(true_ns) - true_ns) / SECOND)
    for name in heard:
        assert off_s[name][20] == pytest.approx(26.6, abs=0.1)
        assert [doubted[one][20] for one in "abcd"] == [True, False, False, False]
        known = 28 if not silent else 54  # d, as far as they know, has measured until then
        assert all(abs(one) < 0.1 for one in off_s[name][known:])
        assert not any(doubted[name][known:])
        assert silent == "" or off_s[name][40] > 9.0


@pytest.mark.parametrize("names", [("a", "b", "c"), ("a", "b")])
@pytest.mark.parametrize("wrong_ms", [-20_000, -3_000])
def test_the_common_time_goes_on_where_the_own_clock_is_set_back_while_nobody_is_heard(names, wrong_ms):
    clocks, now_ns = exchanged({"a": 0, "b": 0, "c": 0}, names=names)
    b, before_ns = clocks["b"], now_ns("b")
    b.set_own(wrong_ms * MS, before_ns)
    for later_s in (0, 15, 60):
        true_ns = before_ns + later_s * SECOND
        assert b.common_ns(true_ns) == pytest.approx(true_ns, abs=10 * MS)
        assert b.own_stamp_ns("a", true_ns) == pytest.approx(true_ns, abs=10 * MS)
    b.set_own(0, true_ns)  # right again
    assert b.common_ns(true_ns) == true_ns
    assert b.problem(true_ns) is None


@pytest.mark.parametrize("names", [("a", "b", "c"), ("a", "b")])
@pytest.mark.parametrize("wrong_ms", [-20_000, -3_000, -300])
def test_the_common_time_goes_on_where_others_are_heard_that_have_not_heard_of_the_set_clock_yet(names, wrong_ms):
    """The common time was lost at their next status, which reports a delay by the former clock, for up to a second."""
    clocks, _ = exchanged({"a": 0, "b": 0, "c": 0}, names=names)
    b = clocks["b"]
    for tick in range(5 * 20, 40 * 20):
        true_ns = START_NS + tick * SECOND // 20
        if tick in (10 * 20, 20 * 20, 30 * 20):
            b.set_own(wrong_ms * MS if tick != 20 * 20 else 0, true_ns)
        for number, sender in enumerate(names):
            if tick % 20 != 3 + 6 * ((number + 1) % len(names)):
                continue
            stamp_ns = clocks[sender].utc.of(true_ns)
            status = replace(STATUS, drone=sender, stamp_ns=stamp_ns, delays_ns=clocks[sender].delays_ns(true_ns))
            for receiver in names:
                if receiver != sender:
                    clocks[receiver].hear(status, true_ns + 5 * MS)
        assert b.common_ns(true_ns) == pytest.approx(true_ns, abs=20 * MS)
        assert all(b.own_stamp_ns(name, true_ns) == pytest.approx(true_ns, abs=20 * MS) for name in names if name != "b")


def test_one_other_clock_is_not_believed_for_a_small_step_of_the_own_one():
    clocks, now_ns = exchanged({"a": 0, "b": 300}, names=("a", "b"))
    now_a_ns = now_ns("a")
    clocks["a"].set_own(-1 * MS, now_a_ns)
    assert clocks["a"].common_ns(now_a_ns) == now_a_ns - 1 * MS


def test_a_clock_that_is_set_right_tells_the_common_time_at_once():
    clocks, now_ns = exchanged({"a": 0, "b": 20_000, "c": 0})
    assert clocks["b"].problem(now_ns("b")) is not None
    clocks["b"].set_own(-20 * SECOND, now_ns("b"))
    assert clocks["b"].common_ns(now_ns("b")) == now_ns("a")
    assert clocks["b"].problem(now_ns("b")) is None


def test_the_hypothesis_grows_old_where_the_clock_is_set_back_while_nobody_is_heard():
    """The hypothesis was kept as it was, as surely, for as long as the clock had been set back."""
    one = tracking()
    now_ns = START_NS + 5 * SECOND
    for tick in range(1, 101):
        one.step(START_NS + tick * SECOND // 20)
    for delays_ns in ({}, {"d1": 2 * MS}):
        status = replace(STATUS, drone="d2", stamp_ns=now_ns, mission=MISSION.mission_id, delays_ns=delays_ns)
        one.receive(key_of("radron", status), encode(status), now_ns + 2 * MS)
    one.observe_clock(-20 * SECOND, now_ns)
    for tick in range(1, 100):
        later_ns = now_ns + tick * SECOND // 20
        one.observe_vehicle(state(later_ns))
        one.step(later_ns)
    assert one.hypothesis.stamp_ns == pytest.approx(now_ns + 5 * SECOND, abs=SECOND)


def test_what_was_stamped_while_the_clock_was_ahead_is_taken_back_and_the_hypothesis_follows():
    """The clock is ahead at the agent's start. The hypothesis stood still until that time had come again, and went on from
    measurements of 20 s before.
    """
    one, ahead_ns, logged = tracking(), 20 * SECOND, []
    for tick in range(1, 20 * 20):
        own_ns = START_NS + 5 * SECOND + tick * SECOND // 20
        true_ns = own_ns - ahead_ns
        clock_ns = own_ns if tick < 300 else true_ns
        one.observe_clock(clock_ns - own_ns, own_ns)
        one.observe_vehicle(state(own_ns))
        sent = one.observe_fix(replace(FIX, stamp_ns=own_ns)) if tick % 10 == 0 else []
        if tick % 20 == 0:
            delays_ns = {"d1": true_ns - clock_ns + 2 * MS}
            status = replace(STATUS, drone="d2", stamp_ns=true_ns, mission=MISSION.mission_id, delays_ns=delays_ns)
            one.receive(key_of("radron", status), encode(status), own_ns + 2 * MS)
        logged += [decode_from(key, payload) for key, payload in (*sent, *one.step(own_ns).publications)]
        if tick == 299:
            assert one.hypothesis.stamp_ns == pytest.approx(clock_ns, abs=SECOND)
    assert one.hypothesis.stamp_ns == pytest.approx(true_ns, abs=SECOND)
    (back,) = (entry for entry in logged if isinstance(entry, Retraction))
    assert 0 <= back.stamp_ns - START_NS <= 2 * SECOND
    fixes = [entry for entry in logged if isinstance(entry, Fix)]
    wrong = [entry for entry in fixes if back.first <= entry.sequence <= back.last]
    assert [entry for entry in fixes if entry.stamp_ns > START_NS + 5 * SECOND] == wrong != fixes
    assert [entry for entry in fixes if not one.fusion.log.counts(entry.entry_id)] == wrong


def test_half_the_asymmetry_of_the_ways_remains():
    clocks, now_ns = exchanged({"a": 0, "b": 0}, ways_ms=(2, 22), names=("a", "b"))
    assert clocks["a"].offsets_s(now_ns("a"))["b"] == pytest.approx(-0.010, abs=1e-6)


def test_what_was_heard_long_ago_counts_no_more():
    clocks, now_ns = exchanged({"a": 0, "b": 120, "c": 0})
    later_ns = now_ns("b") + 2 * WINDOW_NS
    assert clocks["b"].delays_ns(later_ns) == {}


def test_a_step_of_the_own_clock_changes_the_published_delays_alone():
    clocks, now_ns = exchanged({"a": 0, "b": 0, "c": 0})
    before_ns, own_ns = clocks["a"].delays_ns(now_ns("a")), clocks["a"].own_stamp_ns("b", START_NS)
    assert clocks["a"].set_own(-5 * SECOND, now_ns("a")) == -5 * SECOND
    assert clocks["a"].delays_ns(now_ns("a")) == {name: delay_ns - 5 * SECOND for name, delay_ns in before_ns.items()}
    assert clocks["a"].own_stamp_ns("b", START_NS) == pytest.approx(own_ns, abs=20 * MS)


def test_who_is_silent_for_three_seconds_is_published_as_heard_no_more_but_its_clock_still_counts():
    clocks, now_ns = exchanged({"a": 0, "b": 120, "c": 0})
    later_ns = now_ns("b") + HEARD_NS + SECOND
    assert clocks["b"].delays_ns(later_ns) == {}
    assert clocks["b"].offsets_s(later_ns)["a"] == pytest.approx(0.12, abs=1e-6)


def test_strangers_and_absurd_stamps_are_not_heard():
    clocks = Clocks("a", ["b"])
    clocks.hear(replace(STATUS, drone="x", stamp_ns=START_NS), START_NS)
    clocks.hear(replace(STATUS, drone="b", stamp_ns=2**63 - 1), START_NS)
    clocks.hear(replace(STATUS, drone="b", stamp_ns=START_NS, delays_ns={"a": -(2**62)}), START_NS)
    assert clocks.delays_ns(START_NS) == {"b": 0}
    assert math.isfinite(clocks.offset_s)


def test_a_place_is_doubted_by_how_far_the_drone_flies_in_the_offset():
    clocks, _ = exchanged({"a": 0, "b": 120, "c": 0})
    assert clocks["a"].sigma_m(5.0) == 0.0
    assert clocks["b"].sigma_m(5.0) == pytest.approx(0.6, abs=0.02)


def test_pilots_tell_each_other_and_the_one_that_is_ahead_widens_its_sigma():
    names = ("d1", "d2", "d3")
    mission = replace(MISSION, drones=(*MISSION.drones, replace(MISSION.drones[1], id="d3")))
    pilots = {name: pilot(name, mission) for name in names}
    ahead_ns = {"d1": 0, "d2": 200 * MS, "d3": 0}
    last = {}
    for tick in range(60):
        for name, one in pilots.items():
            now_ns = START_NS + tick * SECOND // 20 + ahead_ns[name]
            one.observe_vehicle(state(now_ns, velocity_mps=(5.0, 0.0, 0.0)))
            step = one.step(now_ns)
            last |= {(name, type(message)): message for message in messages(step, Status) + messages(step, Pose)}
            for other, receiver in pilots.items():
                for message in messages(step, Status) if other != name else ():
                    receiver.receive(key_of("radron", message), encode(message), START_NS + tick * SECOND // 20 + ahead_ns[other])
    assert set(last["d1", Status].delays_ns) == {"d2", "d3"}
    assert any("0.20 s ahead of d1, d3" in problem for problem in last["d2", Status].problems)
    assert not any("clock" in problem for problem in last["d1", Status].problems)
    assert last["d2", Pose].position_sigma_m == pytest.approx(math.hypot(0.1, 1.0), abs=0.02)
    assert last["d2", Pose].clock_sigma_m == pytest.approx(1.0, abs=0.02)
    assert last["d1", Pose].position_sigma_m == 0.1
    assert pilots["d2"].whereabouts.sigma_m == 0.1  # no clock changes its present position


def test_a_pose_is_as_sure_as_the_localisation_for_whom_knows_how_far_the_clocks_differ():
    pose = Pose(
        stamp_ns=START_NS + 2_600 * MS, drone="b", epoch=0, position_m=(0.0, 0.0, 3.0), velocity_mps=(2.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0), position_sigma_m=math.hypot(0.1, 5.2), yaw_sigma_rad=0.01, clock_sigma_m=5.2,
    )  # fmt: skip
    known = exchanged({"a": 0, "b": 2_600}, names=("a", "b"))[0]["a"].in_own_time(pose)
    assert known.stamp_ns == pytest.approx(START_NS, abs=2 * MS)
    assert known.position_sigma_m == pytest.approx(0.1)
    assert Clocks("a", ["b"]).in_own_time(pose).position_sigma_m == pose.position_sigma_m


def test_where_the_difference_is_not_known_the_own_clock_may_be_the_wrong_one():
    """Drone d is heard, and does not hear this drone; this drone's clock is a second ahead of all others'."""
    pose = Pose(
        stamp_ns=START_NS, drone="d", epoch=0, position_m=(0.0, 0.0, 3.0), velocity_mps=(4.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0), position_sigma_m=0.1, yaw_sigma_rad=0.01,
    )  # fmt: skip
    clocks, _ = exchanged({"a": 1_000, "b": 0, "c": 0})
    assert clocks["a"].in_own_time(pose).position_sigma_m == pytest.approx(math.hypot(0.1, 4.0), abs=0.05)
    assert clocks["a"].in_own_time(replace(pose, drone="b")).position_sigma_m == pytest.approx(0.1)
    assert clocks["b"].in_own_time(pose) == pose


def test_who_is_alone_with_its_time_does_not_hold_the_others_back_to_it():
    """Its clock is set 30 s ahead: the hypothesis was 30 s in the future for as long."""
    names = ("b", "c", "a")
    clocks = {name: Clocks(name, [other for other in names if other != name]) for name in names}
    off_s = []
    for tick in range(200):
        true_ns = START_NS + tick * SECOND // 10
        clocks["a"].set_own(30 * SECOND if tick >= 100 else 0, true_ns)
        if tick % 10 == 0:
            exchange_statuses(clocks, true_ns, dict.fromkeys(names, 0), names)
        off_s.append((clocks["a"].followed_ns(true_ns) - true_ns) / SECOND)
    assert off_s[:100] == pytest.approx([0.0] * 100, abs=0.05)
    assert off_s[125:] == pytest.approx([0.0] * 75, abs=0.05)  # once the others are heard again
