"""Position estimates of drones and peers: each invariant is shown violations, and beside them cases that it must accept."""

from math import inf

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.mission.memory import Memory
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.invariants.place import Calibrated, KnowsHome, KnowsItsPlace, OwnPlace
from radron.sim.scoring.invariants.reckoning import Confined, FreshTelemetry, Reckoned
from support.flights import moments

JUMP = {"kind": "position-jump", "at_s": 5.0, "for_s": 2.0, "target": "d2", "turn_deg": 45.0}


def estimated(*faults):
    """A setting in which frames are estimated."""
    found = moments.setting(*faults)
    found.mission = moments.with_estimated_frames(found.mission)
    return found


def with_localization(scenario, localization):
    """The scenario with another localisation of d2."""
    one, other, *rest = scenario.mission.drones
    drones = one, replace(other, localization=localization), *rest
    return replace(scenario, mission=replace(scenario.mission, drones=drones))


def seen(invariant, one, *, seconds=7.0, **changes):
    """Drones in violation while ``one`` is the first drone's pilot; in flight and at the end."""
    pilots = moments.changed(0, one, moments.pilot)
    times_s = np.arange(10.0, 10.0 + seconds, 0.05)
    found = [one for time_s in times_s for one in invariant.look(moments.moment(float(time_s), pilots=pilots, **changes))]
    found += invariant.finish(moments.moment(float(times_s[-1]), pilots=pilots, **changes))
    return [violation.drones for violation in found]


def placed(**at):
    return moments.pilot(placed=moments.whereabouts(**at))


def test_a_drone_that_takes_itself_to_be_elsewhere() -> None:
    assert seen(OwnPlace(moments.setting()), placed(x=11.5)) == [("d1",)]
    assert seen(OwnPlace(moments.setting()), placed(x=11.5, sigma_m=0.3)) == []
    assert seen(OwnPlace(moments.setting()), placed(x=10.9)) == []
    assert seen(OwnPlace(moments.setting()), placed(x=11.5), seconds=4.9) == []
    assert seen(OwnPlace(moments.setting(JUMP | {"target": "d1", "for_s": 9.0})), placed(x=11.5)) == []
    assert seen(OwnPlace(moments.setting()), placed(x=11.5), told_s=[9.0, 10.0, 10.0]) == []  # vehicle not heard


def test_a_drone_that_takes_itself_to_point_elsewhere() -> None:
    assert seen(OwnPlace(moments.setting()), placed(yaw_rad=0.2)) == [("d1",)]
    assert seen(OwnPlace(moments.setting()), placed(yaw_rad=0.2 - 2.0 * np.pi)) == [("d1",)]
    assert seen(OwnPlace(moments.setting()), placed(yaw_rad=0.2, yaw_sigma_rad=0.05)) == []
    assert seen(OwnPlace(moments.setting()), placed(yaw_rad=2.0 * np.pi + 0.1)) == []


def test_a_jump_that_is_announced_exempts_nobody_else_and_its_drone_for_a_while() -> None:
    wrong, announced = placed(x=11.5), JUMP | {"announced": True}
    assert seen(OwnPlace(estimated(JUMP)), wrong) == []
    assert seen(OwnPlace(estimated(announced)), wrong) == [("d1",)]
    assert seen(OwnPlace(estimated(announced | {"target": "d1"})), wrong) == []
    assert seen(OwnPlace(estimated(announced | {"target": "d1"})), wrong, seconds=20.0) == [("d1",)]
    assert seen(OwnPlace(estimated(announced | {"target": "d1", "for_s": 40.0})), wrong, seconds=20.0) == [("d1",)]


def test_a_drone_that_is_too_sure_of_where_it_is_over_a_flight() -> None:
    assert seen(Calibrated(estimated()), placed(x=10.8), seconds=30.0) == [("d1",)]
    assert seen(Calibrated(estimated()), placed(x=10.8, sigma_m=0.2), seconds=30.0) == []
    assert seen(Calibrated(estimated()), placed(x=10.8), seconds=15.0) == []
    assert seen(Calibrated(moments.setting()), placed(x=10.8), seconds=30.0) == []


def test_a_drone_is_not_judged_by_where_it_has_flown_since_its_newest_telemetry() -> None:
    pilots = moments.changed(0, placed(x=10.8), moments.pilot)
    for late_s, expected in ((0.0, [("d1",)]), (0.3, [])):
        invariant = Calibrated(estimated())
        for time_s in np.arange(10.0, 40.0, 0.05).tolist():
            at = moments.moment(time_s, pilots=pilots, told_s=[time_s - late_s, time_s, time_s])
            assert list(invariant.look(at)) == []
        assert [one.drones for one in invariant.finish(at)] == expected


def test_a_drone_among_others_that_does_not_get_to_know_where_it_is() -> None:
    assert seen(KnowsItsPlace(estimated()), moments.pilot(), seconds=41.0)[0] == ("d1",)
    others = moments.pilot(placed=moments.whereabouts())
    pilots = [moments.pilot(), others, others]
    alone = [(200.0, 10.0, 3.0), *moments.PLACES[1:]]
    own, of_another = ({"kind": "revoked", "at_s": 0.5, "target": name} for name in ("d1", "d2"))  # neither hears the rest
    cases = (
        (moments.PLACES, (), [("d1",)]),
        (alone, (), []),
        (moments.PLACES, (own,), []),
        (moments.PLACES, (of_another,), []),
    )
    for where, faults, expected in cases:
        invariant = KnowsItsPlace(estimated(*faults))
        times_s = np.arange(0.0, 41.0, 0.05)
        assert [
            one.drones for time_s in times_s for one in invariant.look(moments.moment(float(time_s), where, pilots=pilots))
        ] == expected


def test_a_drone_that_is_too_sure_of_its_heading() -> None:
    assert seen(Calibrated(estimated()), placed(yaw_rad=0.13), seconds=30.0) == [("d1",)]
    assert seen(Calibrated(estimated()), placed(yaw_rad=0.13, yaw_sigma_rad=0.05), seconds=30.0) == []


@pytest.mark.parametrize(
    ("home_m", "faults", "expected"),
    [
        (None, (), [("d1",)]),
        ((25.0, 10.0, 0.0), (), [("d1",)]),
        ((15.0, 10.0, 0.0), (), []),
        ((25.0, 10.0, 0.0), (JUMP | {"target": "d1"},), []),
        (None, (JUMP | {"target": "d1"},), [("d1",)]),
        ((25.0, 10.0, 0.0), ({"kind": "battery", "at_s": 5.0, "target": "d1", "level": 0.05},), [("d1",)]),
    ],
)
def test_a_drone_in_flight_knows_where_it_took_off(home_m, faults, expected) -> None:
    stored = Memory(
        mission="m", stamp_ns=0, started_ns=0, stage=Stage.TRACK, resume=Stage.TRACK, home_m=home_m
    )  # the first moment has the launch places
    told = moments.pilot(placed=moments.SOMEWHERE, memory=stored)
    assert seen(KnowsHome(moments.setting(*faults)), told) == expected
    assert seen(KnowsHome(moments.setting(*faults)), told, seconds=4.0) == []
    unplaced = moments.pilot(memory=stored)
    assert seen(KnowsHome(moments.setting()), unplaced) == []


def reckons(placed=moments.SOMEWHERE, **of):
    return moments.pilot(reckons=moments.reckoning(**of), placed=placed)


def test_another_drone_that_is_nearer_than_believed() -> None:
    """The other drone is 10 m away, d3 too; a drone that accounts for no peer is reported once for each."""

    def told(one, *faults, **changes):
        return [drones for drones in seen(Reckoned(moments.setting(*faults)), one, **changes) if drones[1] == "d2"]

    assert told(reckons(other=(25.0, 10.0, 3.0))) == [("d1", "d2")]
    assert told(reckons(name="d3")) == [("d1", "d2")]
    assert told(reckons(other=(22.5, 10.0, 3.0))) == []
    assert told(reckons(other=(25.0, 10.0, 3.0), sigma_m=0.7)) == []
    assert told(reckons(other=(13.0, 10.0, 3.0))) == []
    assert told(reckons(other=(25.0, 10.0, 3.0)), seconds=1.4) == []
    assert told(moments.pilot(placed=moments.SOMEWHERE)) == []  # flown by a pilot
    assert told(reckons(name="d3", placed=None)) == []
    assert told(reckons(name="d3"), JUMP) == []
    assert told(reckons(name="d3"), {"kind": "late", "at_s": 5.0, "target": "d1"}) == []
    held = moments.changed(0, moments.autopilot(FlightMode.HOLD, setpoint_age_s=None), moments.autopilot)
    assert told(reckons(name="d3"), autopilots=held) == []
    above = [moments.PLACES[0], (20.0, 10.0, 6.0), moments.PLACES[2]]
    assert told(reckons(name="d3"), places=above) == []


def test_a_line_that_another_one_is_beyond_is_reckoned_with() -> None:
    """Also one beyond a line that is kept from for the sake of a third, or on it: two that are not heard flew on one circle."""

    def told(x, name="d2"):
        behind = reckons(other=(x, 10.0, 3.0), away=np.array([[-1.0, 0.0]]), name=name)
        return [drones for drones in seen(Reckoned(moments.setting()), behind) if drones[1] == "d2"]

    assert told(15.0) == told(15.0, "d3") == told(20.1, "d3") == told(23.9, "d3") == []
    assert told(25.0) == told(25.0, "d3") == [("d1", "d2")]


@pytest.mark.parametrize(
    ("at", "radius_m", "expected"),
    [
        ((16.7, 22.7), 18.0, []),  # on it, 14.4 m away, 5.3 m before the tangent
        ((15.6, 21.6), 18.0, []),  # two sides' source estimates differ
        ((12.8, 18.8), 18.0, [("d1", "d2")]),
        ((25.0, 17.0), -6.0, []),  # beyond the tangent, and 2.6 m before the circle
        ((17.0, 20.0), -6.0, [("d1", "d2")]),  # 5.2 m before it
    ],
)
def test_a_circle_is_kept_from_all_around_and_not_where_it_is_nearest_alone(at, radius_m, expected) -> None:
    """Its nearest place is 12 m away, in the east, and d1 is inside of it, or outside (``radius_m`` < 0)."""
    kept = reckons(other=(22.0, 10.0, 3.0), away=np.array([[-1.0, 0.0]]), name="d3", radius_m=radius_m)
    places = [moments.PLACES[0], (*at, 3.0), moments.PLACES[2]]
    found = seen(Reckoned(moments.setting()), kept, places=places)
    assert [drones for drones in found if drones == ("d1", "d2")] == expected


def test_a_circle_is_around_the_source_estimate_of_the_one_that_flies_on_it() -> None:
    """d2 is 12 m before the circle that d1 keeps clear for it, and on the circle around its own source estimate."""

    def told(theirs, radius_m=18.0):
        kept = reckons(other=(27.0, 10.0, 3.0), away=np.array([[-1.0, 0.0]]), radius_m=radius_m)
        kept.hypothesis = moments.hypothesis(x=9.0, y=10.0)
        pilots = [kept, moments.pilot(believed=theirs), moments.pilot()]
        times_s = np.arange(10.0, 14.0, 0.05)
        invariant, places = Reckoned(moments.setting()), [(10.0, 10.0, 3.0), (15.0, 10.0, 3.0), (60.0, 10.0, 3.0)]
        found = [one for time_s in times_s for one in invariant.look(moments.moment(float(time_s), places, pilots=pilots))]
        return [violation.drones for violation in found]

    assert told(moments.hypothesis(x=-3.0, y=10.0)) == told(moments.hypothesis(x=0.5, y=10.0)) == []
    assert told(moments.hypothesis(x=1.5, y=10.0)) == [("d1", "d2")]  # 4.5 m before it
    assert told(moments.hypothesis(x=9.0, y=10.0)) == told(None) == [("d1", "d2")]
    assert told(moments.hypothesis(x=-3.0, y=10.0), np.inf) == [("d1", "d2")]  # a line is where it is


def test_an_agent_that_was_started_again_may_not_know_of_others() -> None:
    invariant = Reckoned(moments.setting())
    first, again = reckons(), reckons(name="d3")
    pilots = [moments.changed(0, one, moments.pilot) for one in (first, again)]
    assert invariant.look(moments.moment(10.0, pilots=pilots[0])) == []
    later = [invariant.look(moments.moment(10.0 + 0.5 * k, pilots=pilots[1])) for k in range(1, 12)]
    assert not any("d2" in violation.drones for found in later for violation in found)


BOTH = [("d1", "d2")]


@pytest.mark.parametrize(
    ("faults", "lost_s", "expected"),
    [
        ((), 11.0, BOTH),
        (({"kind": "revoked", "at_s": 8.0, "target": "d1"},), 11.0, []),
        (({"kind": "revoked", "at_s": 8.0, "target": "d2"},), 11.0, []),
        (({"kind": "revoked", "at_s": 8.0, "target": "d3"},), 11.0, BOTH),
        (({"kind": "revoked", "at_s": 10.5, "target": "d1"},), 11.0, BOTH),  # until then it hears of it
        (({"kind": "revoked", "at_s": 8.0, "target": "d1"},), inf, BOTH),
        (({"kind": "revoked", "at_s": 6.0, "target": "d1"}, {"kind": "revoked", "at_s": 8.0, "target": "d2"}), inf, []),
        (({"kind": "revoked", "at_s": 6.0, "target": "d2"}, {"kind": "revoked", "at_s": 8.0, "target": "d1"}), inf, BOTH),
    ],
)
def test_nobody_knows_of_an_agent_that_was_lost_or_revoked_after_a_revocation(faults, lost_s, expected) -> None:
    invariant = Reckoned(moments.setting(*faults))
    first, second = reckons(other=(25.0, 10.0, 3.0)), moments.pilot()
    found = []
    for time_s in np.arange(10.0, 16.0, 0.05):
        pilots = [first, None if time_s >= lost_s else second, moments.pilot()]
        found += invariant.look(moments.moment(float(time_s), pilots=pilots))
    assert [one.drones for one in found if one.drones == ("d1", "d2")] == expected


@pytest.mark.parametrize(
    ("home_m", "revoked_s", "expected"),
    [((12.0, 10.0), 8.0, []), ((12.0, 10.0), 9.5, [("d1", "d2")]), ((14.0, 10.0), 8.0, [("d1", "d2")])],
)
def test_others_keep_clear_of_the_home_of_one_that_is_revoked(home_m, revoked_s, expected) -> None:
    """d1 is 2 or 4 m from its home, revoked or only about to be, and takes d2 to be farther away than it is."""
    setting = moments.setting({"kind": "revoked", "at_s": revoked_s, "target": "d1"})
    first, *others = setting.mission.drones
    setting.mission = replace(setting.mission, drones=(replace(first, origin_m=(*home_m, 0.0)), *others))
    invariant = Reckoned(setting)
    pilots = [reckons(other=(35.0, 10.0, 3.0)), moments.pilot(), moments.pilot()]
    found = [
        one for time_s in np.arange(8.9, 10.45, 0.05) for one in invariant.look(moments.moment(float(time_s), pilots=pilots))
    ]
    assert [one.drones for one in found if one.drones == ("d1", "d2")] == expected


@pytest.mark.parametrize(
    ("revoked_s", "spoofed_s", "told_x", "expected_x", "expected"),
    [
        (8.0, 9.5, 28.0, 28.0, []),
        (8.0, 9.5, 28.0, 33.0, [("d1", "d2")]),  # not at its own position estimate either
        (8.0, 9.5, 12.0, 20.0, []),  # sighted at its true position
        (8.0, 6.0, 28.0, 28.0, []),  # heard each other during the spoofing, and it went on
        (8.0, 4.0, 28.0, 28.0, [("d1", "d2")]),  # published its jump back, and its uncertainty
        (inf, 9.5, 28.0, 28.0, [("d1", "d2")]),
    ],
)
def test_nobody_knows_that_one_was_spoofed_after_a_revocation(revoked_s, spoofed_s, told_x, expected_x, expected) -> None:
    """d2, 10 m away at x = 20, estimates its own position at ``told_x`` after a spoofing of 4 s; d1 has it at ``expected_x``."""
    faults = [{"kind": "spoofed", "at_s": spoofed_s, "for_s": 4.0, "target": "d2"}]
    faults += [{"kind": "revoked", "at_s": revoked_s, "target": "d1"}] if revoked_s < inf else []
    invariant = Reckoned(moments.setting(*faults))
    pilots = [reckons(other=(expected_x, 10.0, 3.0)), placed(x=told_x), moments.pilot()]
    found = []
    for time_s in np.arange(30.0, 36.0, 0.05):  # 15 s after a fault of its own position, that of a drone is not judged
        found += invariant.look(moments.moment(float(time_s), pilots=pilots))
    assert [one.drones for one in found if one.drones == ("d1", "d2")] == expected


@pytest.mark.parametrize(("localization", "expected"), [("gnss", []), ("slam", [("d1", "d2")])])
def test_who_flies_by_slam_loses_nothing_with_its_satellites(localization, expected) -> None:
    """d2, 10 m away, estimates its own position 8 m farther away, and d1 has it there."""
    faults = (
        {"kind": "satellites-lost", "at_s": 9.5, "for_s": 4.0, "target": "d2"},
        {"kind": "revoked", "at_s": 8.0, "target": "d1"},
    )
    setting = moments.setting(*faults)
    setting = Setting(with_localization(setting.scenario, localization), moments.HEAL_S, moments.END_S)
    assert setting.strikes(setting.scenario.fault[0]) == ([] if localization == "slam" else ["d2"])
    pilots = [reckons(other=(28.0, 10.0, 3.0)), placed(x=28.0), moments.pilot()]
    invariant, found = Reckoned(setting), []
    for time_s in np.arange(30.0, 36.0, 0.05):
        found += invariant.look(moments.moment(float(time_s), pilots=pilots))
    assert [one.drones for one in found if one.drones == ("d1", "d2")] == expected


def test_room_beyond_the_fence() -> None:
    assert seen(Confined(moments.setting()), reckons(room=22.0)) == [("d1",)]
    assert seen(Confined(moments.setting()), reckons(room=19.0)) == []
    assert seen(Confined(moments.setting()), reckons(room=22.0), seconds=0.9) == []


def test_a_setpoint_without_news_of_the_vehicle() -> None:
    def told(age_s, **changes):
        found = FreshTelemetry(moments.setting()).look(moments.moment(10.0, told_s=[10.0, 10.0 - age_s, 10.0], **changes))
        return [violation.drones for violation in found]

    assert told(1.6) == [("d2",)]
    assert told(1.4) == []
    assert told(5.0, commands=[moments.command(), None, moments.command()]) == []
