"""Each invariant is shown violations, and beside them cases that it must accept."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codes import Code
from radron.protocol.messages import Stage
from radron.protocol.texts import CodedText
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.invariants.beliefs import Refused, SameLogSameHypothesis, SourceCalibrated, Summarised, TruthPossible
from radron.sim.scoring.invariants.care import Accused, Impersonated, Memory, Named, Reserve, Told
from radron.sim.scoring.invariants.commands import Finite, FreshSetpoint, Queues
from radron.sim.scoring.invariants.judge import ANY, Judge
from radron.sim.scoring.invariants.liveness import Landed
from radron.sim.scoring.invariants.space import Collision, Fence, Heights, Separation
from support.flights import moments

GUST = {"kind": "gust", "at_s": 20.0, "for_s": 5.0, "target": "d2"}


def places(drone, *place):
    return [place if k == drone else other for k, other in enumerate(moments.PLACES)]


def told(invariant, *seen):
    """The drones of the violations by these moments."""
    return [violation.drones for moment in seen for violation in invariant.look(moment)]


def test_two_drones_are_too_near_to_each_other() -> None:
    near = places(1, 12.9, 10.0, 3.0)
    assert told(Separation(moments.setting()), moments.moment(10.0, near)) == [("d1", "d2")]
    assert told(Separation(moments.setting()), moments.moment(10.0, places(1, 13.1, 10.0, 3.0))) == []


def test_under_faults_they_may_be_nearer_but_not_much() -> None:
    set_ = moments.setting(GUST | {"target": "d3"})
    invariant = Separation(set_)
    assert told(invariant, moments.moment(21.0, places(1, 12.9, 10.0, 3.0))) == []
    assert told(invariant, moments.moment(21.05, places(1, 12.4, 10.0, 3.0))) == [("d1", "d2")]
    assert invariant.least_m == pytest.approx(2.4)


def test_layers_above_each_other_and_drones_on_the_ground_are_apart() -> None:
    invariant = Separation(moments.setting())
    assert (
        told(invariant, moments.moment(10.0, places(1, 10.0, 10.0, 6.5)), moments.moment(11.0, places(1, 10.0, 12.0, 0.1))) == []
    )


def test_a_drone_whose_own_thrust_is_faulted_is_exempt_until_it_has_recovered() -> None:
    invariant, near = Separation(moments.setting(GUST)), places(1, 12.0, 10.0, 3.0)
    assert told(invariant, *(moments.moment(time_s, near) for time_s in (20.05, 24.0, 39.0))) == []
    assert told(invariant, moments.moment(41.0, near)) == [("d1", "d2")]


def test_a_clock_that_is_wrong_exempts_nobody() -> None:
    invariant = Separation(moments.setting({"kind": "clock", "at_s": 1.0, "target": "d2", "jump_s": 1.0}))
    assert told(invariant, moments.moment(10.0, places(1, 12.0, 10.0, 3.0))) == [("d1", "d2")]


def test_a_violation_is_told_once_while_it_lasts_and_again_when_it_comes_back() -> None:
    near, far = places(1, 12.0, 10.0, 3.0), moments.PLACES
    seen = [moments.moment(10.0 + 0.05 * k, place) for k, place in enumerate((near, near, far, near))]
    assert told(Separation(moments.setting()), *seen) == [("d1", "d2")] * 2


def test_a_collision_is_nearer_than_a_breach_of_separation() -> None:
    invariant = Collision(moments.setting())
    assert told(invariant, moments.moment(10.0, places(1, 12.1, 10.0, 3.0))) == []
    assert told(invariant, moments.moment(10.0, places(1, 11.9, 10.0, 3.0))) == [("d1", "d2")]


@pytest.mark.parametrize(("x", "z", "told_of"), [(11.3, 0.6, [("d1", "d2")]), (11.6, 0.6, []), (10.0, 1.6, []), (10.0, 0.0, [])])
def test_none_comes_down_on_another_one(x, z, told_of) -> None:
    ((_, y, _), *others) = places(1, x, 10.0, z)
    assert told(Collision(moments.setting()), moments.moment(10.0, [(10.0, y, 0.0), *others])) == told_of


def test_a_drone_outside_the_fence() -> None:
    outside, inside = places(2, -20.5, 10.0, 3.0), places(2, -19.5, 10.0, 3.0)
    invariant = Fence(moments.setting(GUST))
    assert told(invariant, moments.moment(21.0, inside), moments.moment(21.0, outside)) == [("d3",)]
    assert told(invariant, moments.moment(21.0, places(1, -25.0, 10.0, 3.0))) == []  # in the gust
    assert told(invariant, moments.moment(45.0, places(1, -25.0, 10.0, 3.0))) == [("d2",)]


def test_a_drone_above_the_ceiling_or_below_the_floor() -> None:
    invariant = Heights(moments.setting())
    assert told(invariant, moments.moment(10.0, places(0, 10.0, 10.0, 60.5))) == [("d1",)]
    assert told(invariant, moments.moment(10.0, places(1, 10.0, 10.0, 1.4))) == [("d2",)]
    landing = moments.changed(1, moments.pilot(Stage.LANDING), moments.pilot)
    assert told(invariant, moments.moment(11.0, places(1, 10.0, 10.0, 1.4), pilots=landing)) == []


def test_a_setpoint_that_nobody_renews() -> None:
    old = moments.changed(0, moments.autopilot(setpoint_age_s=1.35), moments.autopilot)
    assert told(FreshSetpoint(moments.setting()), moments.moment(10.0, autopilots=old)) == [("d1",)]
    held = moments.changed(0, moments.autopilot(FlightMode.HOLD, setpoint_age_s=None), moments.autopilot)
    assert told(FreshSetpoint(moments.setting()), moments.moment(10.0, autopilots=held)) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_number_that_is_not_finite(bad: float) -> None:
    believed = moments.hypothesis(x=bad)
    velocity = np.zeros((3, 3))
    velocity[2, 0] = bad
    for drone, changes in (
        (1, {"commands": moments.changed(1, moments.command(bad), moments.command)}),
        (0, {"pilots": moments.changed(0, moments.pilot(believed=believed), moments.pilot)}),
        (1, {"pilots": moments.changed(1, moments.pilot(counters=("unsendable_plan",)), moments.pilot)}),
        (2, {"velocity_mps": velocity}),
    ):
        assert told(Finite(moments.setting()), moments.moment(10.0), moments.moment(10.05, **changes)) == [(f"d{drone + 1}",)]


def test_a_queue_that_grows() -> None:
    assert told(Queues(moments.setting()), moments.moment(10.0, sent=[1, 201, 1])) == [("d2",)]
    assert told(Queues(moments.setting()), moments.moment(10.0, inboxes=[1, 1, 20_001])) == [("d3",)]


def excluding(*faults, seconds=6.0):
    """Violations of a drone that believes for ``seconds`` in a source position 6.4 sigma from the true one."""
    pilots = moments.changed(1, moments.pilot(believed=moments.hypothesis(x=33.2)), moments.pilot)
    times = np.arange(10.0, 10.0 + seconds, 0.05)
    return told(TruthPossible(moments.setting(*faults)), *(moments.moment(float(time_s), pilots=pilots) for time_s in times))


def test_a_hypothesis_that_excludes_the_truth() -> None:
    assert excluding() == [("d2",)]
    assert excluding(seconds=4.9) == []
    assert excluding({"kind": "camera-gain", "at_s": 5.0, "target": "d3"}) == []
    assert excluding({"kind": "camera-gain", "at_s": 30.0, "target": "d3"}) == [("d2",)]
    assert excluding({"kind": "loss", "at_s": 5.0, "probability": 0.5}) == [("d2",)]
    assert excluding({"kind": "revoked", "at_s": 5.0, "target": "d2"}) == []  # its estimate reaches no drone
    assert excluding({"kind": "revoked", "at_s": 5.0, "target": "d3"}) == [("d2",)]


@pytest.mark.parametrize(("east_m2", "expected"), [(0.25, [("d2",)]), (0.0, [])])  # zero variance: given by the mission
def test_a_hypothesis_without_a_covariance_in_one_direction_excludes_the_truth(east_m2, expected) -> None:
    believed = moments.hypothesis(x=30.1)
    believed.covariance = np.diag([east_m2, 0.0, 0.0])
    pilots = moments.changed(1, moments.pilot(believed=believed), moments.pilot)
    times = np.arange(10.0, 16.0, 0.05)
    seen = [moments.moment(float(time_s), pilots=pilots) for time_s in times]
    assert told(TruthPossible(moments.setting()), *seen) == expected


def test_equal_logs_with_different_hypotheses() -> None:
    here, there = moments.hypothesis(), moments.hypothesis(x=30.0 + 1e-12)
    pilots = [moments.pilot(believed=here, digest="7"), moments.pilot(believed=there, digest="7"), moments.pilot()]
    assert told(SameLogSameHypothesis(moments.setting()), moments.moment(10.0, pilots=pilots)) == [("d1", "d2")]
    for other in (
        moments.pilot(believed=there, digest="8"),
        moments.pilot(believed=there, digest="7", pending=True),
        moments.pilot(believed=moments.hypothesis(x=31.0, stamp_ns=1), digest="7"),
        moments.pilot(believed=moments.hypothesis(), digest="7"),
    ):
        assert told(SameLogSameHypothesis(moments.setting()), moments.moment(10.0, pilots=[pilots[0], other, None])) == []


def test_a_forged_entry_that_was_taken() -> None:
    forged = {"kind": "forged", "at_s": 5.0, "target": "d1", "what": "other-mission"}
    for number, taken in ((2**30 + 7, [("d2",)]), (7, [])):
        pilots = moments.changed(1, moments.pilot(entries=(number,)), moments.pilot)
        ended = Refused(moments.setting(forged)).finish(moments.moment(90.0, pilots=pilots))
        assert [violation.drones for violation in ended] == taken


def test_a_battery_that_is_nearly_empty_in_the_air() -> None:
    empty = moments.moment(10.0, batteries=[0.8, 0.02, 0.8])
    assert told(Reserve(moments.setting()), empty) == [("d2",)]
    lies = {"kind": "battery", "at_s": 1.0, "target": "d2", "lies": True}
    assert told(Reserve(moments.setting(lies)), empty) == []
    assert told(Reserve(moments.setting()), moments.moment(10.0, places(1, 20.0, 10.0, 0.0), batteries=[0.8, 0.02, 0.8])) == []


@pytest.mark.parametrize(
    ("kind", "agent_lost", "lives", "mode", "expected"),
    [
        ("takeover", "return", True, FlightMode.MANUAL, []),
        ("takeover", "return", True, FlightMode.HOLD, []),  # given back, it waits for the operator
        ("takeover", "return", True, FlightMode.OFFBOARD, [("d2",)]),
        ("refusal", "return", True, FlightMode.HOLD, [("d2",)]),
        ("kill", "hold", False, FlightMode.HOLD, []),
        ("kill", "hold", False, FlightMode.RETURN, [("d2",)]),
        ("kill", "hold", False, FlightMode.LAND, [("d2",)]),
        ("kill", "hold", True, FlightMode.HOLD, [("d2",)]),
        ("kill", "return", False, FlightMode.HOLD, [("d2",)]),
    ],
)
def test_whose_battery_may_be_nearly_empty_in_the_air(kind, agent_lost, lives, mode, expected) -> None:
    setting = moments.setting({"kind": kind, "at_s": 1.0, "for_s": 5.0, "target": "d2"})
    setting.mission = replace(setting.mission, safety=replace(setting.mission.safety, agent_lost=agent_lost))
    autopilots = moments.changed(1, moments.autopilot(mode, setpoint_age_s=None), moments.autopilot)
    pilots = moments.changed(1, moments.pilot() if lives else None, moments.pilot)
    empty = moments.moment(10.0, batteries=[0.8, 0.02, 0.8], autopilots=autopilots, pilots=pilots)
    assert told(Reserve(setting), empty) == expected
    before = moments.moment(0.5, batteries=[0.8, 0.02, 0.8], autopilots=autopilots)
    assert told(Reserve(setting), before) == [("d2",)]


def unsuspected(*faults, suspects=(), unknown=(), by="d1", sightings=True, seconds=12.0, gone="", **changes):
    """Violations in the ``seconds`` after an unannounced jump of 20 m; ``faults``: others before it; ``suspects``,
    ``unknown``: the drones that ``by`` suspects, and the drones with frames unknown to it.
    """
    jump = {"kind": "position-jump", "at_s": 10.0, "target": "d2", "jump_m": 20.0, "announced": False} | changes
    one = moments.pilot(suspects=suspects, unknown=unknown)
    pilots = moments.changed(("d1", "d2", "d3").index(by), one, moments.pilot)
    pilots = [None if name == gone else one for name, one in zip(("d1", "d2", "d3"), pilots, strict=True)]
    times = np.arange(10.0, 10.0 + seconds, 0.05)
    invariant = Named(moments.setting(jump, *faults, sightings=sightings))
    return told(invariant, *(moments.moment(float(time_s), pilots=pilots) for time_s in times))


def test_a_drone_that_is_not_where_it_says_and_nobody_suspects_it() -> None:
    assert unsuspected() == [("d2",)]
    assert unsuspected(suspects=("d3",)) == [("d2",)]
    assert unsuspected(suspects=("d2",)) == []
    assert unsuspected(unknown=("d2",)) == [("d2",)]  # as to every agent that has just been started
    assert unsuspected(suspects=("d2",), by="d2") == [("d2",)]
    assert unsuspected(sightings=False) == unsuspected(announced=True) == unsuspected(jump_m=3.0) == []
    assert unsuspected(target=["d1", "d2", "d3"]) == unsuspected(target=["d2", "d3"]) == []  # no two are left that are right
    motor, spoofed = ({"kind": kind, "at_s": 5.0, "target": "d3"} for kind in ("motor", "spoofed"))
    assert unsuspected(motor) == [("d2",)]  # its neighbour still knows where it is
    assert unsuspected(spoofed) == []


@pytest.mark.parametrize(
    ("lie", "expected"),
    [
        ({"kind": "lie", "what": "pose"}, []),
        ({"kind": "lie", "what": "sighting"}, []),
        ({"kind": "lie", "what": "plan"}, [("d2",)]),
        ({"kind": "lie", "what": "cone"}, [("d2",)]),
        ({"kind": "equivocating"}, []),
        ({"kind": "copied-key"}, [("d2",)]),
    ],
)
def test_who_has_lied_about_places_tells_nothing_of_the_place_of_another(lie, expected) -> None:
    assert unsuspected({"at_s": 5.0, "for_s": 2.0, "target": "d3"} | lie) == expected


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ({"kind": "cut", "at_s": 11.0, "target": "d2"}, []),
        ({"kind": "cut", "at_s": 11.0, "for_s": 1.0, "target": "d2"}, [("d2",)]),
        ({"kind": "loss", "at_s": 11.0, "target": "d2", "probability": 0.9}, [("d2",)]),
        ({"kind": "partition", "at_s": 11.0, "groups": [["d1", "d3"], ["d2"]]}, []),
        ({"kind": "partition", "at_s": 11.0, "groups": [["d1", "d2", "d3"]]}, [("d2",)]),
        ({"kind": "range", "at_s": 11.0, "range_m": 9.0}, []),
        ({"kind": "range", "at_s": 11.0, "range_m": 40.0}, [("d2",)]),
        ({"kind": "revoked", "at_s": 11.0, "target": "d2"}, []),
        ({"kind": "revoked", "at_s": 11.0, "target": "d3"}, []),  # d1 is left and hears it
        ({"kind": "clock", "at_s": 11.0, "target": "d2", "jump_s": 4.0}, []),
    ],
)
def test_who_hears_nothing_of_a_drone_can_suspect_nothing(fault, expected) -> None:
    assert unsuspected(fault, for_s=20.0, seconds=13.5) == expected


@pytest.mark.parametrize(("restarts", "expected"), [(0, [("d2",)]), (1, [])])
def test_a_new_agent_is_to_be_suspected_anew(restarts, expected) -> None:
    """8 s of each of two agents, or 16 s of one."""
    jump = {"kind": "position-jump", "at_s": 10.0, "target": "d2", "jump_m": 20.0, "announced": False}
    invariant, others = Named(moments.setting(jump, sightings=True)), moments.pilot()
    first, second = moments.pilot(), moments.pilot()
    found = []
    for time_s in np.arange(10.0, 26.0, 0.05):
        one = second if restarts and time_s >= 18.0 else first
        found += told(invariant, moments.moment(float(time_s), pilots=[others, one, others]))
    assert found == expected


@pytest.mark.parametrize(("revoked_s", "expected"), [(5.0, [("d2",)]), (60.0, [])])
def test_who_is_revoked_tells_nobody_whom_it_suspects(revoked_s, expected) -> None:
    """The third of four drones alone suspects the second one."""
    jump = {"kind": "position-jump", "at_s": 10.0, "target": "d2", "jump_m": 20.0, "announced": False}
    three = moments.setting(jump, {"kind": "revoked", "at_s": revoked_s, "target": "d3"}, sightings=True)
    mission = three.mission
    fourth = replace(mission.drones[2], id="d4", origin_m=(26.0, 2.0, 0.0))
    scenario = replace(three.scenario, mission=replace(mission, drones=(*mission.drones, fourth)))
    invariant = Named(Setting(scenario, moments.HEAL_S, moments.END_S))
    places = (*moments.PLACES, (20.0, 20.0, 3.0))
    pilots = [moments.pilot(), moments.pilot(), moments.pilot(suspects=("d2",)), moments.pilot()]
    times = np.arange(10.0, 22.0, 0.05)
    assert told(invariant, *(moments.moment(float(time_s), places, pilots=pilots) for time_s in times)) == expected


def test_nobody_suspects_one_whose_agent_is_gone() -> None:
    assert unsuspected(gone="d2") == []


def test_sightings_that_keep_the_frame_of_a_drone_right_whose_slam_drifts_leave_nobody_to_be_named() -> None:
    def unnamed(localization, x) -> bool:
        jump = {"kind": "spoofed", "at_s": 1.0, "target": "d2", "speed_mps": 1.0, "most_m": 12.0}
        setting = moments.setting(jump, sightings=True)
        drones = [replace(drone, localization=localization) for drone in setting.mission.drones]
        setting.mission = replace(setting.mission, drones=drones)
        pilots = moments.changed(1, moments.pilot(placed=moments.whereabouts(x=x)), moments.pilot)
        return told(Named(setting), *(moments.moment(float(t), pilots=pilots) for t in np.arange(5.0, 30.0, 0.05))) == [("d2",)]

    assert not unnamed("slam", x=20.5)  # true position: 20.0
    assert unnamed("slam", x=23.0)
    assert unnamed("gnss", x=20.5)  # its fixes contradict the others' sightings


def test_a_drone_that_is_one_is_not_said_to_be_two() -> None:
    said = CodedText(Code.TWO_SOURCES, "any words", "d2")
    pilots = moments.changed(0, moments.pilot(problems=(said,)), moments.pilot)
    for kind, when_s, accused in (("loss", 20.0, True), ("copied-key", 20.0, False), ("copied-key", 60.0, True)):
        fault = {"kind": kind, "at_s": 10.0, "for_s": 20.0, "target": "d2"} | ({"probability": 0.1} if kind == "loss" else {})
        seen = told(Accused(moments.setting(fault)), moments.moment(when_s, pilots=pilots))
        assert seen == ([("d1", "d2")] if accused else [])
    corrupt = {"kind": "corrupt", "at_s": 10.0, "probability": 0.1, "target": "d3"}
    assert told(Accused(moments.setting(corrupt)), moments.moment(20.0, pilots=pilots)) == []


def unnamed(named_s, *, seconds=5.0, gone=""):
    """Drones that do not name d2, its key copied at 10 s; d1 and d3 name it from ``named_s`` on. ``gone``: has no agent."""
    invariant = Impersonated(moments.setting({"kind": "copied-key", "at_s": 10.0, "for_s": 20.0, "target": "d2"}))
    said, found = CodedText(Code.TWO_SOURCES, "any words", "d2"), []
    for time_s in np.arange(9.0, 10.0 + seconds, 0.05):
        named = (said,) if time_s >= named_s else ()
        pilots = [None if name == gone else moments.pilot(problems=named) for name in ("d1", "d2", "d3")]
        found += told(invariant, moments.moment(float(time_s), pilots=pilots))
    return found


def test_whose_key_is_copied_is_named_by_all_others_within_two_seconds() -> None:
    assert unnamed(11.9) == []
    assert unnamed(12.2) == unnamed(99.0) == [("d1", "d2"), ("d3", "d2")]
    assert unnamed(99.0, gone="d1") == [("d3", "d2")]
    assert unnamed(99.0, gone="d2") == []


def test_a_copied_key_is_no_excuse_for_coming_nearer() -> None:
    for kind, is_told in (("copied-key", True), ("loss", False)):
        fault = {"kind": kind, "at_s": 5.0, "target": "d2"} | ({"probability": 0.1} if kind == "loss" else {})
        seen = moments.moment(20.0, places(1, 12.7, 10.0, 3.0))
        assert bool(told(Separation(moments.setting(fault)), seen)) is is_told


def too_sure(*faults, off_m=2.5, seconds=30.0, within_s=((0.0, 1e9),), else_m=0.7, motion="static"):
    """Violations of a drone with a hypothesis of 0.5 m on each axis, wrong by ``off_m`` within these times, and by ``else_m``
    else; ``motion``: of the source.
    """
    setting = moments.setting(*faults)
    setting.scenario = replace(setting.scenario, source=replace(setting.scenario.source, motion=motion))

    def seen_at(time_s):
        wrong_m = off_m if any(begin_s <= time_s - 10.0 < end_s for begin_s, end_s in within_s) else else_m
        believed = moments.hypothesis(x=30.0 + wrong_m)
        return moments.moment(time_s, pilots=moments.changed(1, moments.pilot(believed=believed), moments.pilot))

    invariant = SourceCalibrated(setting)
    seen = [seen_at(float(time_s)) for time_s in np.arange(10.0, 10.0 + seconds, 0.05)]
    assert told(invariant, *seen) == []
    return [violation.drones for violation in invariant.finish(seen[-1])]


def test_a_hypothesis_that_is_too_sure_of_itself_over_a_flight() -> None:
    assert too_sure() == [("d2",)]
    assert too_sure(off_m=2.0) == []
    assert too_sure(off_m=2.0, motion="wander") == [("d2",)]  # 16, exceeded too often by a single draw
    assert too_sure(off_m=1.7, motion="wander") == []
    assert too_sure(seconds=9.0) == []
    assert too_sure({"kind": "camera-gain", "at_s": 12.0, "target": "d3"}) == []


def test_a_moment_in_which_a_hypothesis_excludes_the_truth_as_long_as_that_is_allowed() -> None:
    """4 s at 13 sigma: by chance, if nothing else was wrong; not so if it is the rule, or comes again and again."""
    moment = ((12.0, 16.0),)
    assert too_sure(off_m=6.5, within_s=moment) == []
    assert too_sure(off_m=6.5, within_s=moment, else_m=2.5) == [("d2",)]
    assert too_sure(off_m=6.5, within_s=((2.0, 6.0), (12.0, 16.0), (22.0, 26.0))) == [("d2",)]
    assert too_sure(off_m=3.6, within_s=((0.0, 15.0),)) == [("d2",)]


def test_a_log_that_tells_others_that_it_holds_what_it_lacks() -> None:
    def seen(*ranges):
        pilots = moments.changed(2, moments.pilot(entries=(1, 2, 4), told=ranges), moments.pilot)
        return told(Summarised(moments.setting()), *(moments.moment(10.0 + 0.05 * k, pilots=pilots) for k in range(101)))

    assert seen((1, 4)) == [("d3",)]
    assert seen((1, 2)) == [("d3",)]
    assert seen((1, 2), (4, 4)) == []


@pytest.mark.parametrize(
    "kind",
    [{"kind": "camera-dead"}, {"kind": "camera-dead", "blind": True}, {"kind": "camera-stuck"}],
    ids=["dead", "blind", "stuck"],
)
def test_a_camera_that_sees_nothing_new_of_which_nobody_is_told(kind) -> None:
    blind = {"at_s": 5.0, "target": "d2", **kind}
    noisy = CodedText(Code.CAMERA_NOISY, "any words"), CodedText(Code.NUCLIDE_OTHER, "any words")
    useless = CodedText(Code.CAMERA_BLIND, "any words")
    for problems, expected in (((), [("d2",)]), (noisy, [("d2",)]), ((*noisy, useless), [])):
        pilots = moments.changed(1, moments.pilot(problems=problems), moments.pilot)
        seen = [moments.moment(time_s, pilots=pilots) for time_s in (4.0, 20.0, 29.0, 31.0)]
        assert told(Told(moments.setting(blind)), *seen) == expected
    restarted = [moments.moment(4.0), moments.moment(31.0, pilots=moments.changed(1, moments.pilot(), moments.pilot))]
    assert told(Told(moments.setting(blind)), *restarted) == []


def test_an_agent_that_holds_more_than_its_log() -> None:
    grown = moments.pilot()
    grown.leak = bytes(9_000_000)
    small = moments.moment(100.0)
    assert Memory(moments.setting()).finish(small) == []
    (violation,) = Memory(moments.setting()).finish(moments.moment(100.0, pilots=[None, grown, moments.pilot()]))
    assert violation.drones == ("d2",)


def ending(*faults, **changes):
    """Drones still in the air that have not ended as required."""
    invariant = Landed(moments.setting(*faults))
    invariant.look(moments.moment(moments.HEAL_S))
    return [violation.drones[0] for violation in invariant.finish(moments.moment(moments.END_S, **changes))]


def test_a_drone_that_does_not_come_home() -> None:
    assert ending() == ["d1", "d2", "d3"]
    returning = [moments.autopilot(FlightMode.RETURN) for _ in range(3)]
    assert ending(autopilots=returning) == ["d1", "d2", "d3"]  # able: they must have landed
    dead = {"kind": "kill", "at_s": 10.0, "target": "d1"}
    assert ending(dead, autopilots=returning) == ["d2", "d3"]
    assert ending(dead) == ["d1", "d2", "d3"]
    assert ending({"kind": "takeover", "at_s": 10.0, "target": "d3"}) == ["d1", "d2"]
    ground = [(x, y, 0.0) for x, y, _ in moments.PLACES]
    stopped = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]
    assert ending(places=ground, autopilots=stopped) == []
    (x, y, _), *others = ground
    elsewhere = [(x + 9.9, y + 2.0, 0.0), *others]
    assert ending(places=elsewhere, autopilots=stopped) == ["d1"]
    assert ending(dead, places=elsewhere, autopilots=stopped) == []
    assert ending({"kind": "gust", "at_s": 10.0, "for_s": 5.0, "target": "d1"}, places=elsewhere, autopilots=stopped) == []


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        ({"level": 0.17}, []),  # below 10 %, half of the reserve, after 90 s in flight
        ({"level": 0.25}, ["d1"]),
        ({"level": 0.25, "drain_ps": 0.02}, []),
        ({"level": 0.25, "drain_ps": 0.02, "target": "d2"}, ["d1"]),
        ({"level": 0.11, "lies": True}, []),
        ({"level": 0.17, "lies": True}, ["d1"]),  # its battery is well again
    ],
)
def test_who_has_landed_elsewhere_for_want_of_battery_must_have_had_little_left(battery, expected) -> None:
    (x, y, _), *others = [(x, y, 0.0) for x, y, _ in moments.PLACES]
    stopped = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]
    fault = {"kind": "battery", "at_s": 10.0, "for_s": 8.0, "target": "d1"} | battery
    assert ending(fault, places=[(x + 9.9, y + 2.0, 0.0), *others], autopilots=stopped) == expected


@pytest.mark.parametrize(("reserve", "acts", "expected"), [(0.2, False, []), (0.1, False, ["d1"]), (0.1, True, [])])
def test_whose_autopilot_acts_may_land_although_the_reserve_is_small(reserve, acts, expected) -> None:
    (x, y, _), *others = [(x, y, 0.0) for x, y, _ in moments.PLACES]
    stopped = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]
    setting = moments.setting({"kind": "battery", "at_s": 10.0, "for_s": 5.0, "target": "d1", "level": 0.14, "acts": acts})
    setting.mission = replace(setting.mission, safety=replace(setting.mission.safety, battery_reserve=reserve))
    invariant = Landed(setting)
    invariant.look(moments.moment(moments.HEAL_S))
    end = moments.moment(moments.END_S, [(x + 9.9, y + 2.0, 0.0), *others], autopilots=stopped)
    assert [violation.drones[0] for violation in invariant.finish(end)] == expected


def out_without(agent_lost, *faults, pilots=None, mode=FlightMode.HOLD):
    """Drones that have not ended by ``agent_lost``, the autopilots' action without agents; all are in the air, in this mode."""
    setting = moments.setting(*faults)
    setting.mission = replace(setting.mission, safety=replace(setting.mission.safety, agent_lost=agent_lost))
    invariant = Landed(setting)
    invariant.look(moments.moment(moments.HEAL_S))
    changes = {"pilots": pilots} if pilots is not None else {}
    end = moments.moment(moments.END_S, autopilots=[moments.autopilot(mode, setpoint_age_s=None) for _ in range(3)], **changes)
    return [violation.drones[0] for violation in invariant.finish(end)]


KILL = {"kind": "kill", "at_s": 20.0, "for_s": 5.0, "target": "d1"}
FREEZE = {"kind": "freeze", "at_s": 20.0, "for_s": 5.0, "target": "d1"}
SLOW = {"kind": "slow-cpu", "at_s": 20.0, "for_s": 5.0, "target": "d1", "late_s": 1.2}
TORN = {"kind": "disk", "at_s": 24.0, "for_s": 3.0, "target": "d1", "how": "state-torn"}
FULL = {"kind": "disk", "at_s": 5.0, "for_s": 16.0, "target": "d1", "how": "full"}


@pytest.mark.parametrize(
    ("agent_lost", "faults", "expected"),
    [
        ("hold", (KILL, TORN), ["d2", "d3"]),
        ("hold", (KILL, FULL), ["d2", "d3"]),
        ("hold", (KILL, TORN | {"how": "state-flipped"}), ["d2", "d3"]),
        ("hold", (FREEZE, FULL), ["d2", "d3"]),
        ("hold", (SLOW, FULL), ["d2", "d3"]),
        ("return", (KILL, TORN), ["d1", "d2", "d3"]),
        ("hold", (KILL,), ["d1", "d2", "d3"]),
        ("hold", (TORN,), ["d1", "d2", "d3"]),
        ("hold", (KILL, TORN | {"target": "d2"}), ["d1", "d2", "d3"]),
        ("hold", (KILL, TORN | {"how": "slow"}), ["d1", "d2", "d3"]),
        ("hold", (KILL, TORN | {"at_s": 25.5}), ["d1", "d2", "d3"]),  # its agent has been back
        ("hold", (KILL, FULL | {"for_s": 10.0}), ["d1", "d2", "d3"]),
        ("hold", (FREEZE | {"for_s": 0.9}, FULL), ["d1", "d2", "d3"]),
        ("hold", (SLOW | {"late_s": 0.8}, FULL), ["d1", "d2", "d3"]),
        ("hold", ({"kind": "camera-dead", "at_s": 5.0, "target": "d1"},), ["d1", "d2", "d3"]),  # not able either
    ],
)
def test_an_agent_that_has_lost_its_state_leaves_its_vehicle_where_it_holds_without_it(agent_lost, faults, expected) -> None:
    assert out_without(agent_lost, *faults) == expected
    assert out_without(agent_lost, *faults, mode=FlightMode.OFFBOARD) == ["d1", "d2", "d3"]


@pytest.mark.parametrize(("agent_lost", "expected"), [("hold", ["d2", "d3"]), ("return", ["d1", "d2", "d3"])])
def test_a_vehicle_without_an_agent_may_hold_where_the_mission_says_so(agent_lost, expected) -> None:
    gone, dead = moments.changed(0, None, moments.pilot), {"kind": "kill", "at_s": 10.0, "target": "d1"}
    assert out_without(agent_lost, dead, pilots=gone) == expected
    assert out_without(agent_lost, dead, pilots=gone, mode=FlightMode.MANUAL) == ["d1", "d2", "d3"]


def test_where_frames_are_estimated_a_faulted_position_that_is_not_announced_may_lead_everybody_elsewhere() -> None:
    (x, y, _), *others = [(x, y, 0.0) for x, y, _ in moments.PLACES]
    stopped = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]

    def ends_elsewhere(fault) -> bool:
        setting = moments.setting(fault)
        setting.mission = moments.with_estimated_frames(setting.mission)
        invariant = Landed(setting)
        invariant.look(moments.moment(0.0))
        invariant.look(moments.moment(60.0))
        end = moments.moment(100.0, [(x + 9.9, y + 2.0, 0.0), *others], autopilots=stopped)
        return [violation.drones for violation in invariant.finish(end)] == [("d1",)]

    jump, clock = ({"kind": kind, "at_s": 5.0, "for_s": 2.0, "target": "d2"} for kind in ("position-jump", "clock"))
    assert not ends_elsewhere(jump)
    assert ends_elsewhere(jump | {"announced": True})
    assert not ends_elsewhere(jump | {"announced": True, "target": "d1"})
    assert ends_elsewhere(clock | {"jump_s": 5.0})
    assert not ends_elsewhere(clock | {"jump_s": 5.0, "target": "d1"})
    assert not ends_elsewhere({"kind": "lie", "at_s": 5.0, "for_s": 2.0, "target": "d2", "what": "pose"})


FROZEN = {"kind": "freeze", "at_s": 40.0, "for_s": 9.0, "target": "d1"}
UNHEARD = {"kind": "mavlink-loss", "at_s": 40.0, "for_s": 9.0, "target": "d1", "probability": 0.9}
IMPAIRED = {"kind": "mavlink-impaired", "at_s": 40.0, "for_s": 9.0, "target": "d1", "cut": True}
TAKEN = {"kind": "takeover", "at_s": 40.0, "for_s": 9.0, "target": "d1"}
REFUSED = {"kind": "refusal", "at_s": 40.0, "for_s": 9.0, "target": "d1"}


@pytest.mark.parametrize(
    ("agent_lost", "localization", "fault", "expected"),
    [
        ("return", "slam", FROZEN, []),
        ("return", "rtk", FROZEN, ["d1"]),
        ("return", "slam", FROZEN | {"target": "d2"}, ["d1"]),
        ("land", "rtk", FROZEN, []),
        ("land", "rtk", FROZEN | {"target": "d2"}, ["d1"]),
        ("hold", "slam", FROZEN, ["d1"]),  # holds, as any
        ("land", "slam", FROZEN, []),
        ("land", "rtk", UNHEARD, []),
        ("land", "rtk", IMPAIRED, []),
        ("land", "rtk", TAKEN, ["d1"]),
        ("return", "slam", REFUSED, ["d1"]),
    ],
)
def test_who_may_have_been_set_down_elsewhere_for_want_of_setpoints(agent_lost, localization, fault, expected) -> None:
    setting = moments.setting(fault)
    first, *rest = setting.mission.drones
    safety = replace(setting.mission.safety, agent_lost=agent_lost)
    setting.mission = replace(setting.mission, drones=(replace(first, localization=localization), *rest), safety=safety)
    (x, y, _), *others = [(x, y, 0.0) for x, y, _ in moments.PLACES]
    down = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]
    away = moments.moment(60.0, [(x + 9.9, y + 2.0, 0.0), *others], autopilots=down)
    found = Landed(setting)
    found.look(moments.moment(0.0))
    found.able.drones = 0, 1, 2
    assert [violation.drones[0] for violation in found.finish(away)] == expected


def test_who_is_able_is_decided_by_the_faults_and_by_who_is_in_the_air_at_the_heal() -> None:
    lie = {"kind": "lie", "at_s": 5.0, "for_s": 5.0, "target": "d1"}
    cases = [
        ([], (0, 1, 2)),
        ([{"kind": "camera-dead", "at_s": 5.0, "target": "d1"}], (1, 2)),
        ([{"kind": "camera-dead", "at_s": 5.0, "for_s": 5.0, "target": "d1"}], (0, 1, 2)),
        ([{"kind": "kill", "at_s": 5.0, "target": "d1"}], (1, 2)),
        ([{"kind": "kill", "at_s": 5.0, "for_s": 5.0, "target": "d1"}], (0, 1, 2)),
        ([{"kind": "clock", "at_s": 5.0, "target": "d1", "jump_s": 1.0}], (0, 1, 2)),
        ([lie | {"what": "cone"}], (1, 2)),  # its log and the others' differ for ever
        ([lie | {"what": "pose"}], (0, 1, 2)),
        ([{"kind": "takeover", "at_s": 5.0, "for_s": 5.0, "target": "d1"}], (1, 2)),  # waits for the operator
        ([{"kind": "mavlink-loss", "at_s": 5.0, "for_s": 5.0, "target": "d1", "probability": 1.0}], (0, 1, 2)),
        ([{"kind": "loss", "at_s": 5.0, "for_s": 45.0, "probability": 0.5}], (0, 1, 2)),
        ([{"kind": "loss", "at_s": 5.0, "probability": 0.5}], ()),
    ]
    for faults, expected in cases:
        able = Landed(moments.setting(*faults)).able
        assert able.see(moments.moment(49.0)) == ()
        assert able.see(moments.moment(50.0)) == expected, faults
    able = Landed(moments.setting()).able
    able.see(moments.moment(50.0, places(0, 10.0, 10.0, 0.0)))
    assert able.see(moments.moment(60.0)) == (1, 2)


def test_the_judge_ends_a_flight_when_nothing_more_is_to_come() -> None:
    judge = Judge(moments.setting())
    assert not judge(moments.moment(10.0))
    assert not judge(moments.moment(50.0))
    stopped = [moments.autopilot(FlightMode.HOLD, armed=False, setpoint_age_s=None) for _ in range(3)]
    assert judge(moments.moment(80.0, [(x, y, 0.0) for x, y, _ in moments.PLACES], autopilots=stopped))
    assert judge.violations == []
    assert Judge(moments.setting())(moments.moment(moments.END_S))


@pytest.mark.parametrize(("layer_m", "lasts_s"), [(3.0, 50.4), (0.0, 38.5)])  # up to 16 or 10 m, across, down, and disarmed
def test_those_that_are_not_able_are_judged_on_their_way_home_as_long_as_that_takes(layer_m, lasts_s) -> None:
    setting = moments.setting({"kind": "kill", "at_s": 10.0})
    setting.mission = replace(setting.mission, safety=replace(setting.mission.safety, return_layer_m=layer_m))
    invariant = Landed(setting)
    returning = [moments.autopilot(FlightMode.RETURN) for _ in range(3)]
    for later_s, over in ((0.0, False), (lasts_s - 0.1, False), (lasts_s + 0.1, True)):
        assert invariant.is_over(moments.moment(50.0 + later_s, autopilots=returning)) == over


def test_the_judge_waits_for_nobody_who_holds_for_good_without_an_agent() -> None:
    dead = [{"kind": "kill", "at_s": 10.0, "target": name} for name in ("d1", "d2", "d3")]
    (x, y, z), *others = moments.PLACES
    places = [(x, y, z), *((x, y, 0.0) for x, y, _ in others)]
    autopilots = [moments.autopilot(FlightMode.HOLD, armed, setpoint_age_s=None) for armed in (True, False, False)]
    setting = moments.setting(*dead)
    setting.mission = replace(setting.mission, safety=replace(setting.mission.safety, agent_lost="hold"))
    invariant = Landed(setting)
    held = moments.moment(50.0, places, pilots=[None] * 3, autopilots=autopilots)
    invariant.look(held)
    assert invariant.is_over(held)
    returning = [moments.autopilot(FlightMode.RETURN), *autopilots[1:]]
    assert not invariant.is_over(moments.moment(51.0, places, pilots=[None] * 3, autopilots=returning))


def test_the_judge_ends_a_flight_at_the_violation_that_is_looked_for() -> None:
    near = moments.moment(10.0, places(1, 11.0, 10.0, 3.0))
    assert Judge(moments.setting(), until="collision")(near)
    assert not Judge(moments.setting(), until="fence")(near)
    judge = Judge(moments.setting(), until=ANY)
    assert judge(near)
    judge.finish()
    assert {violation.invariant for violation in judge.violations} == {"separation", "collision"}  # and not "landing"
