"""Messages of one drone from two sources: reported, and both places kept clear; honest messages and jumps are not reported."""

import itertools

import pytest
from msgspec.structs import replace

from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.peers.sources import MAX_STORIES, RIVAL_NS, SHOWN_NS, contradict
from radron.agent.pilot import Step
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Pose, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, messages, partner, pilot, state

MS = 1_000_000
PERIOD_NS = 100 * MS
TWO = "d2: two sources send under its id (a copied key, or an agent started twice); both are kept clear of"


def pose(stamp_ns, x_m=30.0, epoch=0):
    return replace(next(partner(stamp_ns)), position_m=(x_m, 20.0, 3.0), velocity_mps=(0.0, 0.0, 0.0), epoch=epoch)


def status(stamp_ns, boot="2", stage=Stage.TRACK):
    return Status(stamp_ns=stamp_ns, drone="d2", mission=MISSION.mission_id, boot=boot * 16, stage=stage)


def heard(*news):
    """The others of d1 after these messages, each received at its stamp or later."""
    peers, now_ns = Peers(["d2"]), 0
    for message in news:
        now_ns = max(now_ns, message.stamp_ns)
        peers.receive(message, now_ns)
    return peers, now_ns


def neighbourhood():
    return Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "d1")


def places(peers, now_ns, hood=None):
    """The positions of d2 of which d1 keeps clear."""
    hood = hood or neighbourhood()
    return sorted(one.plan.positions[0][0] for one in hood.around(peers, Self(now_ns, 0, 0.0, Transform())))


def stamps(count, after_ns=0):
    return [START_NS + after_ns + number * PERIOD_NS for number in range(count)]


def alternating(count=8, apart_m=15.0, ahead_ns=10 * MS, **second):
    """Poses of d2, and of an impostor with its key, which come ahead of them."""
    pairs = ((pose(at_ns), pose(at_ns + ahead_ns, 30.0 + apart_m, **second)) for at_ns in stamps(count))
    return list(itertools.chain.from_iterable(pairs))


def test_two_places_are_told_and_both_are_kept_clear_of():
    peers, now_ns = heard(*alternating())
    assert peers.problems(now_ns) == (TWO,)
    assert places(peers, now_ns) == pytest.approx([30.0, 45.0])


def test_one_source_is_one_place_however_fast_it_flies():
    fast = (
        replace(pose(at_ns, 30.0 + 15.0 * (at_ns - START_NS) / SECOND), velocity_mps=(15.0, 0.0, 0.0)) for at_ns in stamps(30)
    )
    peers, now_ns = heard(*fast)
    assert peers.problems(now_ns) == ()
    assert len(places(peers, now_ns)) == 1


def test_who_comes_first_keeps_its_place_however_far_ahead_the_other_ones_stamps_are():
    peers, now_ns = heard(*alternating(ahead_ns=95 * MS))
    assert peers["d2"].pose.position_m[0] == 30.0
    assert peers["d2"].pose.stamp_ns == stamps(8)[-1]
    assert places(peers, now_ns) == pytest.approx([30.0, 45.0])


def test_who_drags_a_drone_away_little_by_little_is_noticed():
    """Each forged pose is near the last one, and ahead of the true ones, which would be older than known."""
    news = [
        message
        for number, at_ns in enumerate(stamps(40))
        for message in (pose(at_ns), pose(at_ns + 90 * MS, 30.0 + 0.5 * number))
    ]
    peers, now_ns = heard(*news)
    assert peers.problems(now_ns) == (TWO,)
    first, second = places(peers, now_ns)
    assert first == pytest.approx(30.0)
    assert second == pytest.approx(49.5)


def test_a_copy_with_a_later_epoch_is_noticed_and_a_jump_of_the_localisation_is_none():
    peers, now_ns = heard(*alternating(epoch=1))
    assert peers.problems(now_ns) == (TWO,)
    assert places(peers, now_ns) == pytest.approx([30.0, 45.0])  # as if its frame were the same: its frame is unknown
    jumped, now_ns = heard(*map(pose, stamps(5)), *(pose(at_ns, 45.0, epoch=1) for at_ns in stamps(5, SECOND // 2)))
    assert jumped.problems(now_ns) == ()
    assert jumped["d2"].pose.position_m[0] == 45.0


def test_a_single_jump_is_kept_clear_of_for_a_moment_and_not_told():
    before, after = stamps(5), stamps(30, SECOND // 2)
    peers, now_ns = heard(*map(pose, before), *(pose(at_ns, 45.0) for at_ns in after[:3]))
    assert places(peers, now_ns) == pytest.approx([30.0, 45.0])
    peers, now_ns = heard(*map(pose, before), *(pose(at_ns, 45.0) for at_ns in after))
    assert peers.problems(now_ns) == ()
    assert places(peers, now_ns) == pytest.approx([45.0])


def test_delayed_and_repeated_poses_around_a_jump_are_no_second_source():
    before, after = stamps(5), stamps(5, SECOND // 2)
    peers = Peers(["d2"])
    late = pose(before[-1])
    for message in (*map(pose, before[:-1]), pose(after[0], 45.0), late, late, pose(after[1], 45.0), pose(before[2])):
        peers.receive(message, after[1])
    assert peers.problems(after[1]) == ()


def test_once_there_is_one_source_again_all_is_as_before():
    news = alternating()
    peers, now_ns = heard(*news, *map(pose, stamps(30, 8 * PERIOD_NS)))
    assert now_ns > news[-1].stamp_ns + RIVAL_NS
    assert places(peers, now_ns) == pytest.approx([30.0])
    assert peers.problems(now_ns) == (TWO,)
    assert peers.problems(now_ns + SHOWN_NS) == ()


def test_two_boots_at_the_same_time_are_told_and_a_restart_is_not():
    alive, now_ns = heard(status(START_NS), status(START_NS + 1, "3"), status(START_NS + SECOND))
    assert alive.problems(now_ns) == (TWO,)
    restarted, now_ns = heard(status(START_NS), status(START_NS + SECOND, "3"), status(START_NS + 2 * SECOND, "3"))
    assert restarted.problems(now_ns) == ()
    late, now_ns = heard(status(START_NS + SECOND), status(START_NS + 2 * SECOND, "3"), status(START_NS))
    assert late.problems(now_ns) == ()


def test_a_second_agent_that_says_that_it_is_on_the_ground_is_told():
    """The drone counted as started anew in flight, not yet aware of it, though its first agent went on."""
    told = [
        status(START_NS + tick * SECOND, "3" if tick % 2 else "2", Stage.PREFLIGHT if tick % 2 else Stage.TRACK)
        for tick in range(6)
    ]
    two, now_ns = heard(*told)
    assert two.problems(now_ns) == (TWO,)


@pytest.mark.parametrize("stage", [Stage.LANDED, Stage.PREFLIGHT])
@pytest.mark.parametrize("boot", ["2", "3"])
def test_a_status_does_not_take_a_flying_drone_out_of_the_air(stage, boot):
    """Not even a status with its own boot: every holder of its key can write that, too."""
    peers, now_ns = heard(pose(START_NS), status(START_NS), status(START_NS + 1, boot, stage))
    assert places(peers, now_ns) == pytest.approx([30.0])


def landed_for(tenths, *between):
    """A drone that flew, then reported by status and poses for that long that it is on the ground; with others' messages
    between.
    """
    told = [pose(START_NS), status(START_NS)]
    for at_ns in stamps(tenths, PERIOD_NS):
        told += [replace(pose(at_ns), in_air=False), status(at_ns, stage=Stage.LANDED)]
    return heard(*told, *between)


def test_a_drone_that_has_rested_for_seconds_is_on_the_ground():
    assert places(*landed_for(20)) == pytest.approx([30.0])
    assert places(*landed_for(27)) == []
    assert landed_for(27)[0]["d2"].status.stage is Stage.LANDED


@pytest.mark.parametrize("message", [pose(START_NS + 2 * SECOND), status(START_NS + 2 * SECOND)])
def test_an_older_message_that_it_flies_is_evidence(message):
    """The thief's stamps are ahead: the drone's own messages came to be older than known, and were dropped unseen."""
    assert places(*landed_for(27, message)) == pytest.approx([30.0])


def thief(at_ns, ahead_ns=90 * MS, x_m=45.0, epoch=1):
    """An impostor's status with the key of d2: landed, beside the place where d2 flies."""
    at_ns += ahead_ns
    return replace(pose(at_ns, x_m, epoch), in_air=False), status(at_ns, stage=Stage.LANDED)


@pytest.mark.parametrize("variant", [{}, {"epoch": 0}, {"epoch": 0, "x_m": 32.0}, {"ahead_ns": 0}, {"ahead_ns": -500 * MS}])
def test_a_thief_that_says_in_every_way_that_a_hovering_drone_has_landed_hides_it_from_nobody(variant):
    """Twenty times a second, so that each message of the drone itself is older than known; they were 0.45 m apart."""
    peers, hood = Peers(["d2"]), neighbourhood()
    for tick, at_ns in enumerate(range(START_NS, START_NS + 10 * SECOND, 50 * MS)):
        own = [pose(at_ns), *([status(at_ns, stage=Stage.HOLD)] if tick % 20 == 0 else [])] if tick % 2 == 0 else []
        for message in (*(thief(at_ns, **variant) if at_ns > START_NS + SECOND else ()), *own):
            peers.receive(message, at_ns)
        assert 30.0 in [pytest.approx(one) for one in places(peers, at_ns, hood)]
    assert peers["d2"].status.stage is Stage.HOLD


def test_a_thief_that_tells_the_place_but_another_velocity_does_not_have_the_drone_expected_elsewhere():
    """A drone that hovered was expected where 60 m/s would have led: 0.77 m."""
    news = [
        one
        for at_ns in range(START_NS, START_NS + SECOND, 50 * MS)
        for one in (pose(at_ns), replace(pose(at_ns + 90 * MS), velocity_mps=(60.0, 0.0, 0.0)))
    ]
    hovers, flies = pose(START_NS), replace(pose(START_NS), velocity_mps=(60.0, 0.0, 0.0))
    peers, _ = heard(*news)
    told = [one.newest.velocity_mps for one in peers["d2"].sources.stories]
    assert told == [hovers.velocity_mps, flies.velocity_mps]


def test_two_stories_are_told_within_a_second_whatever_the_epochs():
    for epoch in (0, 1):
        news = [one for at_ns in stamps(10) for one in (thief(at_ns, epoch=epoch)[0], pose(at_ns))]
        peers, now_ns = heard(pose(START_NS - SECOND // 10), *news)
        assert peers.problems(now_ns) == (TWO,)


def told_by(one, *news):
    """The status of d1 after it has heard this, each message at the time of the last stamp so far."""
    now_ns = START_NS
    for message in news:
        now_ns = max(now_ns, message.stamp_ns)
        one.receive(key_of(MISSION.swarm, message), encode(message), now_ns)
    return messages(one.step(now_ns), Status)[-1]


def test_the_word_of_a_drone_that_it_has_not_sent_all_that_is_under_its_id_is_believed_and_removes_nothing():
    """Also where it is older than known, and stale by the clock's difference that its thief has forged."""
    one = pilot()
    one.observe_vehicle(state(START_NS))
    for age_ns in (1, 3 * SECOND):
        now_ns = START_NS + 5 * SECOND
        told = told_by(one, pose(now_ns), status(now_ns), replace(status(now_ns - age_ns), disowns=True))
        assert TWO in told.problems
        assert one._peers["d2"].pose == pose(now_ns)
        assert one._peers["d2"].status.stamp_ns == now_ns
        one = pilot()
        one.observe_vehicle(state(START_NS))


def test_the_word_of_a_drone_that_it_has_a_twin_ends_with_its_statuses():
    """The drone itself reports its twin for ten seconds: another ten seconds of its peers would name it long after the thief
    has gone.
    """
    one = pilot()
    one.observe_vehicle(state(START_NS))
    told_by(one, pose(START_NS), replace(status(START_NS), disowns=True))
    for tick in range(80):
        now_ns = START_NS + tick * SECOND // 20
        one.observe_vehicle(state(now_ns))
        one.step(now_ns)
        if tick in (20, 79):
            assert (TWO in one.problems) is (tick == 20)


def test_a_drone_says_when_it_hears_news_of_its_own_boot_that_it_has_not_sent_and_an_echo_is_none():
    one = pilot()
    for tick in range(40):
        now_ns = START_NS + tick * SECOND // 20
        one.observe_vehicle(state(now_ns))
        published = one.step(now_ns).publications
        for key, payload in published:
            one.receive(key, payload, now_ns)
        if tick == 30:
            (own,) = messages(Step(published, None), Pose)
            forged = replace(own, stamp_ns=own.stamp_ns + 1)
            assert not one._problems.has_twin(now_ns)
            one.receive(key_of(MISSION.swarm, forged), encode(forged), now_ns)
        told = messages(Step(published, None), Status)
        assert all((said.disowns is True) is (tick > 30) for said in told)
        assert told or tick != 31  # at once, and not only with the next regular one
    assert "another agent is running as d1" in one.problems


@pytest.mark.parametrize("forged_ms", [-2050, -1000, 1000, 2050])
def test_a_forged_difference_of_the_clocks_hides_nobody(forged_ms):
    """The thief's statuses report the clock of d2 two seconds off: all messages of d2 were stale, or of the future."""
    one, forged_ns, own = pilot(), forged_ms * MS, []
    for tick in range(100):
        now_ns = START_NS + tick * SECOND // 20
        one.observe_vehicle(state(now_ns))
        if tick > 20:
            lie = replace(status(now_ns + forged_ns, stage=Stage.LANDED), delays_ns={"d1": forged_ns + 20 * MS})
            ground = replace(pose(now_ns + forged_ns, 60.0), in_air=False)
            own = [replace(status(now_ns, stage=Stage.HOLD), disowns=True)] if tick % 20 == 0 else []
        else:
            own, lie, ground = [status(now_ns, stage=Stage.HOLD)] if tick % 20 == 0 else [], None, None
        for message in (lie, ground, *own, *([pose(now_ns)] if tick % 2 == 0 else [])):
            if message is not None:
                one.receive(key_of(MISSION.swarm, message), encode(message), now_ns + 20 * MS)
        one.step(now_ns + 20 * MS)
    found = places(one._peers, now_ns + 20 * MS)
    assert pytest.approx(30.0) in found


def test_many_stories_do_not_drive_out_that_of_the_drone_itself():
    """A thief that is somewhere else with each pose."""
    news = [one for k, at_ns in enumerate(stamps(40)) for one in (pose(at_ns), pose(at_ns + 90 * MS, 50.0 + 7.0 * k))]
    peers, now_ns = heard(*news)
    assert pytest.approx(30.0) in places(peers, now_ns)
    assert len(peers["d2"].sources.stories) == MAX_STORIES


def test_a_pilot_tells_its_operator():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    news = alternating()
    for message in news:
        one.receive(key_of(MISSION.swarm, message), encode(message), message.stamp_ns)
    (told,) = messages(one.step(news[-1].stamp_ns), Status)
    assert told.problems.count(TWO) == 1


def test_poses_of_a_clock_that_was_just_set_are_of_one_source():
    """At 5 m/s a clock that is wrong by 0.6 s makes a pose 3 m wrong, until it is known by how much it was set."""
    before, after = pose(START_NS), pose(START_NS + 50 * MS, x_m=35.0)
    assert contradict(before, after)
    assert not contradict(before, replace(after, clock_sigma_m=3.0))
