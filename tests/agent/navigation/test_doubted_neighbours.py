"""Drones with two position hypotheses after an unannounced jump of their localisation: as seen by peers, and by themselves."""

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import PATIENT_S, Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.entries import Sighting
from radron.protocol.messages import Alternative, Stage
from support.flights.two_drones import MISSION, SECOND, plan, pose, status

NOW_NS = SECOND // 10
LAUNCH = Alternative((10.0, 0.0, 0.0), np.pi / 2)  # the frame of b by the mission


@pytest.mark.parametrize(("sigma_m", "places"), [(0.1, 1), (16.0, 2)])
def test_a_drone_in_doubt_after_a_jump_is_given_way_in_both_places(sigma_m, places):
    """Its pose jumps by 20 m along its x axis, which is the mission's y axis."""
    peers, around = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    peers.receive(pose(), 0)
    around.around(peers, Self(0, 0, 0.0, Transform()))
    now_ns = SECOND // 10
    doubt = {"alternative": LAUNCH} if places == 2 else {}
    peers.receive(replace(pose(now_ns, sigma_m, epoch=1), position_m=(21.0, 0.0, 3.0), **doubt), now_ns)
    found = around.around(peers, Self(now_ns, 0, 0.0, Transform()))
    assert len(found) == places
    assert found[0].plan.state(now_ns).position == pytest.approx((10.0, 1.2, 3.0))
    if places == 2:
        assert found[1].plan.state(now_ns).position == pytest.approx((10.0, 21.0, 3.0))
        assert found[1].plan.blind
        assert not found[1].takes_part


def jumped_m(along_m: float, told: bool) -> tuple[Neighbourhood, Peers]:
    """Peer b, at (10, 1) m and flying on at 2 m/s along the mission's y axis; its localisation jumps by that much along that
    axis.

    ``told``: b has published both places, and with its frame that they are equally likely.
    """
    frames, peers = FrameGraph.from_launch_layout(MISSION), Peers(["b"])
    around = Neighbourhood(MISSION, frames, "a")
    peers.receive(pose(), 0)
    around.around(peers, Self(0, 0, 0.0, Transform()))
    if told:
        launch, axis_m2 = frames.mission_from_local("b", 0), 0.25 * along_m**2
        assert launch is not None
        back = Transform(translation=(-along_m, 0.0, 0.0), covariance=np.diag([axis_m2, axis_m2, 0.0, 0.0]))
        frames.place("b", 1, launch @ back)
    sigma_m = abs(along_m) / 2**0.5 if told else 0.3
    now = replace(pose(NOW_NS, sigma_m, epoch=1), position_m=(1.2 + along_m, 0.0, 3.0), alternative=LAUNCH if told else UNSET)
    assert peers.receive(now, NOW_NS) is None
    return around, peers


def places(found) -> list[tuple[float, float]]:
    return [one.plan.state(NOW_NS).position[:2] for one in found]


@pytest.mark.parametrize("along_m", [3.0, 8.0, 30.0])
def test_one_that_tells_of_its_doubt_is_in_either_of_two_places_and_not_around_them(along_m):
    around, peers = jumped_m(along_m, told=True)
    found = around.around(peers, Self(NOW_NS, 0, 0.3, Transform()))
    assert places(found) == [pytest.approx((10.0, 1.2)), pytest.approx((10.0, 1.2 + along_m))]
    assert [one.plan.sigma_m for one in found] == pytest.approx([0.3, 0.0], abs=0.01)


def test_an_uncertainty_that_two_places_do_not_explain_stays_around_each():
    """The two places are 8 m apart, which explains 5.7 m of the published 7 m."""
    around, peers = jumped_m(8.0, told=True)
    now = replace(peers["b"].pose, stamp_ns=2 * NOW_NS, position_sigma_m=7.0)
    assert peers.receive(now, now.stamp_ns) is None
    found = around.around(peers, Self(2 * NOW_NS, 0, 0.3, Transform()))
    assert found[0].plan.sigma_m == pytest.approx((7.0**2 - 0.5 * 8.0**2 + 0.3**2) ** 0.5)


def test_the_word_of_a_drone_narrows_no_uncertainty_that_follows_from_the_log():
    """The frame of b is estimated: by the measurements of all drones, not by its own statement."""
    a, b = MISSION.drones
    mission = replace(MISSION, drones=(a, replace(b, localization="rtk")))
    frames, peers = FrameGraph.from_launch_layout(mission), Peers(["b"])
    around, sigmas_m = Neighbourhood(mission, frames, "a"), []
    for alternative in (UNSET, LAUNCH):
        frames.place("b", 1, Transform(np.pi / 2, (10.0, -8.0, 0.0), np.diag([8.0, 8.0, 0.0, 0.0])))
        stamp_ns = NOW_NS * (1 + len(sigmas_m))
        now = replace(pose(stamp_ns, 0.3, epoch=1), position_m=(9.2, 0.0, 3.0), alternative=alternative)
        assert peers.receive(now, stamp_ns) is None
        sigmas_m.append([one.plan.sigma_m for one in around.around(peers, Self(stamp_ns, 0, 0.3, Transform()))])
    assert sigmas_m[0] == sigmas_m[1]
    assert sigmas_m[0][0] > 3.0


OWN = Transform(translation=(10.0, 0.0, 0.0))  # the own frame by continuity; by its localisation, that of the mission


def test_one_in_doubt_itself_keeps_clear_of_others_as_seen_from_both_of_its_places():
    """The drone's alternative position lies 10 m further along x than its localisation says: so b may be 10 m further along x."""
    around, peers = jumped_m(0.0, told=False)
    peers.receive(status(Stage.TRACK), NOW_NS)
    me = Self(NOW_NS, 1, 10.0 / 2**0.5, OWN.inverse(), otherwise=Transform(), doubt_m=10.0)
    found = around.around(peers, me)
    assert places(found) == [pytest.approx((0.0, 1.2)), pytest.approx((10.0, 1.2))]
    assert [one.plan.sigma_m for one in found] == pytest.approx([0.4, 0.4], abs=0.05)
    assert [one.takes_part for one in found] == [True, False]
    assert not found[1].plan.blind  # clear of both places, too


@pytest.mark.parametrize("is_elsewhere", [False, True])
def test_one_in_doubt_itself_has_another_that_it_sees_in_one_place_only(is_elsewhere):
    """The peer is where it is sighted, wherever this drone is; twice in one place it would displace others from the plans."""
    peers, around = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    own_from_mission = Transform() if is_elsewhere else OWN.inverse()
    for tick in range(11):  # b flies along the mission's y axis at 2 m/s
        stamp_ns, place = tick * NOW_NS, own_from_mission.apply_point((10.0, 1.0 + 0.2 * tick, 3.0))
        peers.receive(replace(pose(stamp_ns), position_m=(1.0 + 0.2 * tick, 0.0, 3.0)), stamp_ns)
        range_m = float(np.linalg.norm(place))
        x, y, z = (np.array(place) / range_m).tolist()
        peers.see(
            Sighting(
                stamp_ns=stamp_ns, drone="a", mission="0" * 16, boot="1" * 16, sequence=tick, epoch=1, target="b",
                position_m=(0.0, 0.0, 0.0), direction=(x, y, z), direction_sigma_rad=0.03, range_m=range_m, range_sigma_m=0.3,
            )
        )  # fmt: skip
    doubt = Transform(translation=OWN.translation, covariance=np.diag([25.0, 25.0, 0.0, 0.0]))
    me = Self(stamp_ns, 1, 10.0 / 2**0.5, doubt.inverse(), otherwise=Transform(), doubt_m=10.0)
    (other,) = around.around(peers, me)
    assert other.plan.state(stamp_ns).position[:2] == pytest.approx((10.0 if is_elsewhere else 0.0, 3.0), abs=0.1)


def test_two_in_doubt_reckon_with_all_four_ways_in_which_they_may_lie():
    around, peers = jumped_m(8.0, told=True)
    me = Self(NOW_NS, 1, 10.0 / 2**0.5, OWN.inverse(), otherwise=Transform(), doubt_m=10.0)
    expected = {(0.0, 1.2), (0.0, 9.2), (10.0, 1.2), (10.0, 9.2)}
    assert {(round(x, 3), round(y, 3)) for x, y in places(around.around(peers, me))} == expected


@pytest.mark.parametrize(("returning_s", "revoked", "both"), [(5.0, True, True), (PATIENT_S, True, False), (90.0, False, True)])
def test_one_that_is_not_heard_keeps_clear_of_silent_ones_from_its_other_place_for_a_while_only(returning_s, revoked, both):
    """Peers without a link to it expect it to land."""
    now_ns = 2 * SECOND
    peers, around = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for message in (pose(), plan(), status(Stage.TRACK)):
        peers.receive(message, 0)
    around.around(peers, Self(0, 0, 0.0, Transform()))
    doubt = {"otherwise": Transform(), "doubt_m": 10.0, "returning_s": returning_s, "revoked": revoked}
    found = around.around(peers, Self(now_ns, 1, 10.0 / 2**0.5, OWN.inverse(), **doubt))
    without = around.around(peers, Self(now_ns, 1, 0.0, OWN.inverse(), returning_s=returning_s, revoked=revoked))
    assert len(found) == (2 if both else 1) * len(without)
    assert max(one.plan.sigma_m for one in found) < 1.0


def silent_in_doubt(along_m, seconds, **more):
    """b, at (10, 1.2) m, or so far along y from there, is not heard any more."""
    around, peers = jumped_m(along_m, told=True)
    peers.receive(status(Stage.SURVEY), NOW_NS)
    now_ns = NOW_NS + round(seconds * SECOND)
    me = Self(now_ns, 0, 0.1, Transform(), ahead=lambda: np.zeros((21, 3)), height_m=3.0, **more)
    return around, [one.plan for one in around.around(peers, me)], now_ns


@pytest.mark.parametrize("along_m", [8.0, 30.0])
def test_one_in_doubt_that_falls_silent_is_still_in_either_of_two_places(along_m):
    """Its vehicle may stop at each of them; and go home from there, which is beside its home where its localisation is wrong."""
    around, found, now_ns = silent_in_doubt(along_m, 2.5)
    stops = [one.at(now_ns) for one in found]
    for y in (1.2, 1.2 + along_m):
        assert min(np.hypot(10.0 - u, min(abs(y - v), abs(y + 4.0 - v))) for u, v in stops) < 1.1
    assert max(one.sigma_m for one in found) < 1.0
    assert len(around.absence.stops) == 4
    homes = {(round(x, 1), round(y, 1)) for x, y in (home.place for home in around.absence.homes)}
    assert homes == {(10.0, 0.0), (10.0, -along_m)}


def test_one_in_doubt_itself_goes_around_the_homes_of_silent_ones_as_they_lie_from_both_of_its_places():
    """The drone stood before one of the homes until its owner had to be down."""
    around, _, _ = silent_in_doubt(0.0, 10.0, otherwise=Transform(translation=(5.0, 0.0, 0.0)), doubt_m=5.0)
    homes = sorted(round(home.place[0], 1) for home in around.absence.homes)
    assert homes == [5.0, 10.0]


@pytest.mark.parametrize("announced_m", [-35.0, 25.0])
def test_an_announced_jump_moves_neither_of_the_two_places(announced_m):
    """The alternative position counted as the place by the launch frame, and the uncertainty as one about the first place."""
    around, peers = jumped_m(20.0, told=True)
    around.around(peers, Self(NOW_NS, 0, 0.3, Transform()))
    frames, later_ns = around.frames._graph, 2 * NOW_NS
    before = frames.mission_from_local("b", 1)
    frames.place("b", 2, before @ Transform(translation=(-announced_m, 0.0, 0.0)))
    continued = Alternative((10.0, -announced_m, 0.0), np.pi / 2)
    now = replace(pose(later_ns, 20.0 / 2**0.5, epoch=2), position_m=(1.4 + 20.0 + announced_m, 0.0, 3.0), alternative=continued)
    assert peers.receive(now, later_ns) is None
    found = around.around(peers, Self(later_ns, 0, 0.3, Transform()))
    expected = [pytest.approx((10.0, 1.4), abs=0.1), pytest.approx((10.0, 21.4), abs=0.1)]
    assert [one.plan.state(later_ns).position[:2] for one in found] == expected
    assert max(one.plan.sigma_m for one in found) < 1.0


def test_after_a_restart_of_its_observer_one_in_doubt_is_still_in_either_of_two_places():
    """An announced jump by 20 m came before the unannounced one: the launch frame placed the drone nowhere near."""
    former, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    graph = former.frames._graph
    launch = graph.mission_from_local("b", 0)
    doubt = np.diag([50.0, 50.0, 0.0, 0.0])  # of 10 m between the two places
    graph.place("b", 1, launch @ Transform(translation=(-20.0, 0.0, 0.0)))
    graph.place("b", 2, launch @ Transform(0.0, (-10.0, 0.0, 0.0), doubt))
    for epoch, x in enumerate((1.0, 21.2, 11.4)):
        doubt = Alternative((10.0, -20.0, 0.0), np.pi / 2) if epoch == 2 else UNSET
        sigma_m = 0.1 if epoch < 2 else 50.0**0.5
        now = replace(pose((epoch + 1) * NOW_NS, sigma_m, epoch=epoch), position_m=(x, 0.0, 3.0), alternative=doubt)
        assert peers.receive(now, now.stamp_ns) is None
        before = former.around(peers, Self(now.stamp_ns, 0, 0.3, Transform()))
    assert len(before) == 2
    again = Neighbourhood(MISSION, graph, "a")
    again.frames.remember(former.frames.kept)  # the alternative position comes with the next pose
    assert places(again.around(peers, Self(now.stamp_ns, 0, 0.3, Transform()))) == places(before)
