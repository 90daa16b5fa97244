"""News of one drone from two sources: told, and both places kept clear of; honest news beside it, and jumps, are not told."""

import itertools

import pytest
from msgspec.structs import replace
from one_pilot import MISSION, SECOND, START_NS, messages, partner, pilot, state

from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.navigation.myself import Self
from agent.navigation.neighbours import Neighbourhood
from agent.navigation.peers.newest import Peers
from agent.navigation.peers.sources import RIVAL_NS, SHOWN_NS, contradict
from protocol.codec import encode
from protocol.keys import key_of
from protocol.messages import Stage, Status

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


def places(peers, now_ns):
    """Where d1 keeps clear of d2."""
    hood = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "d1")
    return sorted(one.plan.positions[0][0] for one in hood.around(peers, Self(now_ns, 0, 0.0, Transform())))


def stamps(count, after_ns=0):
    return [START_NS + after_ns + number * PERIOD_NS for number in range(count)]


def alternating(count=8, apart_m=15.0, ahead_ns=10 * MS, **second):
    """Poses of d2, and of somebody with its key, which come ahead of them."""
    pairs = ((pose(at_ns), pose(at_ns + ahead_ns, 30.0 + apart_m, **second)) for at_ns in stamps(count))
    return list(itertools.chain.from_iterable(pairs))


def test_two_places_are_told_and_both_are_kept_clear_of():
    peers, now_ns = heard(*alternating())
    assert peers.problems(now_ns) == (TWO,)
    assert places(peers, now_ns) == pytest.approx([30.0, 45.0])


def test_one_source_is_one_place_however_fast_it_flies():
    peers, now_ns = heard(*(pose(at_ns, 30.0 + 15.0 * (at_ns - START_NS) / SECOND) for at_ns in stamps(30)))
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
    assert places(peers, now_ns) == pytest.approx([30.0])  # where 45 in another frame is, nobody knows
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
    """It was taken for one that had been started anew in flight, and does not know of that yet, though the first one went on."""
    told = [
        status(START_NS + tick * SECOND, "3" if tick % 2 else "2", Stage.PREFLIGHT if tick % 2 else Stage.TRACK)
        for tick in range(6)
    ]
    two, now_ns = heard(*told)
    assert two.problems(now_ns) == (TWO,)


@pytest.mark.parametrize("stage", [Stage.LANDED, Stage.PREFLIGHT])
def test_a_second_agents_status_does_not_take_a_flying_drone_out_of_the_air(stage):
    flying = (pose(START_NS), status(START_NS))
    forged, now_ns = heard(*flying, status(START_NS + 1, "3", stage))
    assert places(forged, now_ns) == pytest.approx([30.0])
    landed, now_ns = heard(*flying, status(START_NS + 1, "2", stage))
    assert places(landed, now_ns) == []


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
