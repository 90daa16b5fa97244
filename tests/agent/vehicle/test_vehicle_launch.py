"""The launch place: averaged on the ground, frozen when armed, remembered over a restart only in the same frame."""

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import LaunchPlace
from radron.agent.vehicle.launch import WINDOW_S, LaunchSurvey
from radron.agent.vehicle.mavlink.messages import GlobalOrigin

ORIGIN = GlobalOrigin(473977420, 85455940, 488123)
ON_GROUND = {"armed": False, "in_air": False}
FLYING = {"armed": True, "in_air": True}
BOOTED_NS = 1_767_225_600_000_000_000
STORED = LaunchPlace(
    north_m=1.0, east_m=2.0, down_m=3.0, origin_latitude_deg=47.397742, origin_longitude_deg=8.545594, origin_altitude_m=488.123
)


def surveyed(seconds: float, stored: LaunchPlace | None = None, origin: GlobalOrigin | None = ORIGIN) -> LaunchSurvey:
    survey = LaunchSurvey(stored)
    if origin is not None:
        survey.take_origin(origin)
    for step in range(round(seconds * 30)):
        survey.observe(step / 30, (10.0 + 0.5 * (-1) ** step, -20.0, 0.3), **ON_GROUND)
    return survey


def test_it_is_the_mean_over_the_last_seconds_on_the_ground() -> None:
    place = surveyed(3.0).place
    assert place is not None
    assert (place.north_m, place.east_m, place.down_m) == pytest.approx((10.0, -20.0, 0.3), abs=0.01)
    assert (place.origin_latitude_deg, place.origin_altitude_m) == pytest.approx((47.397742, 488.123), abs=1e-9)


def test_it_needs_some_time_on_the_ground_and_the_frames_origin() -> None:
    assert surveyed(0.5).place is None
    survey = surveyed(3.0, origin=None)
    assert survey.place is None
    assert "origin" in str(survey.problem)


@pytest.mark.parametrize("origin", [ORIGIN, None])
def test_one_that_flies_from_a_place_that_nobody_knows_has_one_of_its_own_after_a_while(origin) -> None:
    """Its state was torn: the agent reported it on the ground, and refused to land it, while the failsafe flew it home."""
    survey = LaunchSurvey()
    if origin is not None:
        survey.take_origin(origin)
    places = []
    for second in range(9):
        survey.observe(100.0 + second, (50.0, 20.0, -8.0), **FLYING, booted_ns=BOOTED_NS, resets=2)
        places.append(survey.place)
    assert places[4] is None
    assert places[5] == places[-1]
    assert (places[-1].north_m, places[-1].down_m) == (0.0, 0.0)
    assert 1000 <= places[-1].epoch <= 1_000_000
    assert origin is None or "the launch place is not known" in str(survey.problem)
    for second in range(9):  # landed, and disarmed
        survey.observe(200.0 + second, (60.0, 20.0, 0.0), **ON_GROUND, booted_ns=BOOTED_NS, resets=2)
    again = LaunchSurvey(survey.to_keep)
    again.take_origin(ORIGIN)
    for step in range(100):
        again.observe(step / 30, (60.0, 20.0, 0.0), **ON_GROUND, booted_ns=BOOTED_NS, resets=2)
    assert (again.place.north_m, again.place.epoch) == (pytest.approx(60.0), 0)  # measured anew


@pytest.mark.parametrize(("booted_ns", "known"), [(BOOTED_NS, True), (BOOTED_NS + 10**10, False)])
def test_without_satellites_the_stored_place_counts_while_the_autopilot_is_not_booted_again(booted_ns, known) -> None:
    survey = LaunchSurvey(replace(STORED, booted_ns=BOOTED_NS))
    for second in range(40):
        survey.observe(100.0 + second, (50.0, 20.0, -8.0), **FLYING, booted_ns=booted_ns)
        assert (survey.place is None) is (second < (5 if known else 30))  # its origin may yet be reported
    assert (survey.place.north_m == STORED.north_m) is known
    assert (survey.place.epoch == 0) is known


def test_it_is_frozen_when_the_vehicle_is_armed() -> None:
    survey = surveyed(3.0)
    before = survey.place
    for step in range(100):
        survey.observe(3.0 + step / 30, (50.0, 50.0, -30.0), **FLYING)
    assert survey.place == before
    assert survey.problem is None


def test_once_flown_it_stays_after_a_landing_elsewhere() -> None:
    survey = surveyed(3.0)
    before = survey.place
    survey.observe(4.0, (50.0, 50.0, -3.0), **FLYING)
    for step in range(200):
        survey.observe(20.0 + step / 30, (60.0, 70.0, 0.0), **ON_GROUND)
    assert survey.place == before


def test_one_that_was_armed_but_not_flown_may_be_carried_elsewhere() -> None:
    survey = surveyed(3.0)
    survey.observe(4.0, (10.0, -20.0, 0.3), armed=True, in_air=False)
    for step in range(200):
        survey.observe(20.0 + step / 30, (60.0, 70.0, 0.0), **ON_GROUND)
    assert survey.place is not None
    assert survey.place.north_m == pytest.approx(60.0)


def test_a_flying_vehicle_without_launch_place_gets_one_when_it_has_landed() -> None:
    survey = LaunchSurvey()
    survey.take_origin(ORIGIN)
    survey.observe(0.0, (5.0, 5.0, -5.0), **FLYING)
    for step in range(60):
        survey.observe(20.0 + step / 30, (60.0, 70.0, 0.0), **ON_GROUND)
    assert survey.place is not None
    assert survey.problem is None


def test_it_follows_a_drift_on_the_ground() -> None:
    survey = surveyed(1.0)
    for step in range(round(2 * WINDOW_S * 30)):
        survey.observe(1.0 + step / 30, (12.0, -20.0, 0.3), **ON_GROUND)
    assert survey.place is not None
    assert survey.place.north_m == pytest.approx(12.0)


def test_an_agent_restarted_in_flight_goes_by_what_was_stored() -> None:
    survey = LaunchSurvey(STORED)
    assert survey.to_keep == STORED  # before it is confirmed it must not get lost
    assert survey.place is None
    survey.take_origin(ORIGIN)
    survey.observe(0.0, (5.0, 5.0, -5.0), **FLYING)
    assert survey.place == STORED
    assert survey.problem is None


def test_what_was_stored_for_another_origin_is_not_used() -> None:
    survey = LaunchSurvey(replace(STORED, origin_longitude_deg=8.5456))
    survey.take_origin(ORIGIN)
    survey.observe(0.0, (5.0, 5.0, -5.0), **FLYING)
    assert survey.place is None
    assert "origin" in str(survey.problem)


def test_without_anything_stored_an_armed_vehicle_has_no_launch_place() -> None:
    survey = LaunchSurvey()
    survey.take_origin(ORIGIN)
    survey.observe(0.0, (5.0, 5.0, -5.0), **FLYING)
    assert survey.place is None
    assert "land" in str(survey.problem)


def test_an_agent_restarted_after_a_landing_elsewhere_keeps_the_frame_of_the_launch() -> None:
    place = surveyed(3.0, stored=replace(STORED, flown=True)).place
    assert place == replace(STORED, flown=True)
    booted_since = surveyed(3.0, stored=replace(STORED, flown=True, origin_longitude_deg=8.5456)).place
    assert booted_since is not None
    assert booted_since.north_m == pytest.approx(10.0, abs=0.01)


def test_without_satellites_too_if_the_autopilot_has_not_been_booted_since() -> None:
    for booted_ns, kept in ((BOOTED_NS, True), (BOOTED_NS + 60_000_000_000, False)):
        stored = replace(STORED, origin_latitude_deg=None, booted_ns=booted_ns, resets=4, flown=True)
        survey = without_satellites(stored)
        stand(survey, 0.0, 3.0)
        assert (survey.place == stored) is kept


def test_after_a_jump_it_is_measured_again_on_the_ground() -> None:
    """The position of that frame is known by the motion in flight only, and the flight is over."""
    for jumped in (True, False):
        survey = LaunchSurvey(replace(STORED, flown=True, epoch=int(not jumped)))
        if jumped:
            survey.jumped()  # while no agent ran
        survey.take_origin(ORIGIN)
        for step in range(60):
            survey.observe(step / 30, (10.0, -20.0, 0.3), **ON_GROUND)
        assert survey.place is not None
        assert (survey.place.north_m, survey.place.epoch) == (pytest.approx(10.0), 0)


def test_what_is_kept_tells_whether_it_was_flown_from() -> None:
    survey = surveyed(3.0)
    assert survey.to_keep is None  # may still change
    survey.observe(3.0, (10.0, -20.0, 0.3), armed=True, in_air=False)
    assert survey.to_keep == survey.place
    survey.observe(4.0, (10.0, -20.0, -3.0), **FLYING)
    survey.observe(60.0, (60.0, 70.0, 0.3), **ON_GROUND)
    assert survey.place is not None
    assert survey.to_keep == replace(survey.place, flown=True)


def test_on_the_ground_what_was_stored_before_it_flew_is_void() -> None:
    place = surveyed(3.0, stored=STORED).place
    assert place is not None
    assert place.north_m == pytest.approx(10.0, abs=0.01)


def test_an_origin_that_moves_in_flight_takes_the_place_away_and_keeps_it_for_a_restart() -> None:
    survey = surveyed(3.0)
    before = survey.place
    survey.take_origin(GlobalOrigin(473977520, 85455940, 488123))
    survey.observe(4.0, (50.0, 50.0, 0.0), **FLYING)
    assert "origin" in str(survey.problem)
    assert survey.place is None
    assert before is not None
    assert survey.to_keep == replace(before, flown=True)
    survey.take_origin(ORIGIN)
    survey.observe(5.0, (50.0, 50.0, 0.0), **FLYING)
    assert (survey.place, survey.problem) == (before, None)


def test_an_origin_whose_altitude_is_corrected_in_flight_is_only_told() -> None:
    survey = surveyed(3.0)
    before = survey.place
    survey.take_origin(GlobalOrigin(473977420, 85455940, 488623))
    survey.observe(4.0, (50.0, 50.0, 0.0), **FLYING)
    assert "origin" in str(survey.problem)
    assert survey.place == before


def without_satellites(stored: LaunchPlace | None = None) -> LaunchSurvey:
    return LaunchSurvey(stored, gnss=False)


def stand(survey: LaunchSurvey, from_s: float, seconds: float, north_m: float = 10.0) -> None:
    for step in range(round(seconds * 30)):
        survey.observe(from_s + step / 30, (north_m, -20.0, 0.3), **ON_GROUND, booted_ns=BOOTED_NS, resets=4)


def test_without_satellites_it_needs_no_origin_and_one_that_comes_later_moves_nothing() -> None:
    survey = without_satellites()
    stand(survey, 0.0, 3.0)
    before = survey.place
    assert before is not None
    assert (before.origin_latitude_deg, before.booted_ns, before.resets) == (None, BOOTED_NS, 4)
    survey.observe(4.0, (10.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=4)
    survey.take_origin(ORIGIN)
    survey.observe(5.0, (10.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=4)
    assert (survey.place, survey.problem) == (before, None)


def test_without_satellites_a_restarted_agent_knows_the_frame_by_when_the_autopilot_was_booted() -> None:
    survey = without_satellites()
    stand(survey, 0.0, 3.0)
    survey.observe(3.0, (10.0, -20.0, 0.3), armed=True, in_air=False, booted_ns=BOOTED_NS, resets=4)
    stored = survey.to_keep
    again = without_satellites(stored)
    again.observe(0.0, (5.0, 5.0, -5.0), **FLYING, booted_ns=BOOTED_NS + 5_000_000, resets=4)
    assert again.place == stored
    for booted_ns in (BOOTED_NS + 60_000_000_000, None):
        other = without_satellites(stored)
        other.observe(0.0, (5.0, 5.0, -5.0), **FLYING, booted_ns=booted_ns, resets=4)
        assert other.place is None
        assert "land" in str(other.problem)


def test_a_jump_in_flight_begins_an_epoch_that_a_restarted_agent_goes_on_from() -> None:
    survey = without_satellites()
    stand(survey, 0.0, 3.0)
    survey.observe(4.0, (10.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=4)
    survey.jumped()
    survey.observe(4.1, (30.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=5)
    place = survey.place
    assert place is not None
    assert (place.epoch, place.resets, place.north_m) == (1, 5, pytest.approx(10.0))
    again = without_satellites(survey.to_keep)
    again.observe(0.0, (30.0, 5.0, -5.0), **FLYING, booted_ns=BOOTED_NS, resets=5)
    again.jumped()
    assert again.place == replace(place, epoch=2, flown=True)


def test_a_jump_on_the_ground_begins_the_measurement_anew_and_no_epoch() -> None:
    survey = without_satellites()
    stand(survey, 0.0, 3.0)
    survey.jumped()
    stand(survey, 3.0, 0.5, north_m=25.0)
    assert survey.problem == "measuring the launch place"
    stand(survey, 3.5, 1.0, north_m=25.0)
    assert survey.place is not None
    assert (survey.place.epoch, survey.place.north_m) == (0, pytest.approx(25.0))


def test_a_jump_of_a_frame_that_the_mission_takes_for_exact_begins_an_epoch_and_is_told() -> None:
    survey = LaunchSurvey(gnss=False, exact=True)
    stand(survey, 0.0, 3.0)
    survey.jumped()  # on the ground it is measured anew
    stand(survey, 3.0, 2.0)
    before = survey.place
    survey.observe(6.0, (10.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=4)
    survey.jumped()
    survey.observe(6.1, (10.0, -20.0, -3.0), **FLYING, booted_ns=BOOTED_NS, resets=4)
    assert survey.place is not None
    assert before is not None
    assert survey.place == replace(before, epoch=before.epoch + 1)
    assert "exact" in str(survey.problem)
