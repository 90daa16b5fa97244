import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.fusion.estimator import Hypothesis
from radron.protocol.entries import Counts
from radron.protocol.keys import key_of
from radron.protocol.messages import Plan, Stage, Status
from radron.protocol.spectrum import SpectrumBin
from radron.station.picture.picture import Picture
from support.page import shown_drone
from support.page.shown_drone import D1, NOW_NS, PLACE_M, POSE, SPEED_MPS, exposure

MISSION = MissionConfig(
    name="m",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0))),
    drones=(D1, DroneInMission(id="d2")),
    datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0),
)
STATUS = Status(stamp_ns=NOW_NS, drone="d1", mission=MISSION.mission_id, boot="0" * 16, stage=Stage.SURVEY, problems=("cold",))


@pytest.fixture
def picture():
    return Picture(MISSION, None)


def give(picture, *messages):
    shown_drone.give(picture, MISSION, *messages)


def drone(picture, now_ns=NOW_NS, alive=("d1", "d2")):
    picture.appear(alive)
    return picture.frame(now_ns).drones[0]


def test_a_pose_and_its_plan_are_shown_in_the_mission_frame(picture):
    plan = Plan(stamp_ns=NOW_NS, drone="d1", epoch=0, step_ns=10**8, positions_m=((3.0, 0.0, 2.0), (4.0, 0.0, 2.0)))
    give(picture, POSE, plan, STATUS)
    shown = drone(picture)
    assert shown.place == pytest.approx(PLACE_M)
    assert shown.yaw == pytest.approx(1.571)
    assert shown.speed_mps == SPEED_MPS
    assert shown.plan[-1] == pytest.approx((10.0, 24.0))
    assert (shown.stage, shown.problems, shown.stale) == ("survey", ("cold",), False)


def test_a_long_plan_is_thinned_and_follows_its_frame(picture):
    places = tuple((float(step), 0.0, 2.0) for step in range(40))
    give(picture, POSE, Plan(stamp_ns=NOW_NS, drone="d1", epoch=0, step_ns=10**8, positions_m=places))
    shown = drone(picture).plan
    assert len(shown) == 12
    assert (shown[0], shown[-1]) == (pytest.approx((10.0, 20.0)), pytest.approx((10.0, 59.0)))
    give(picture, replace(POSE, stamp_ns=NOW_NS + 1, epoch=1))
    assert drone(picture).plan == ()  # the plan is of an earlier frame


def test_an_older_pose_does_not_replace_a_newer_one(picture):
    give(picture, POSE, replace(POSE, stamp_ns=NOW_NS - 1, position_m=(9.0, 9.0, 9.0)))
    assert drone(picture).place == pytest.approx(PLACE_M)


def test_a_drone_that_is_not_heard_or_whose_process_has_ended_is_stale(picture):
    assert drone(picture).age_s is None
    give(picture, POSE)
    assert not drone(picture, NOW_NS + 1_400_000_000).stale
    assert drone(picture, NOW_NS + 1_600_000_000).stale
    assert drone(picture, NOW_NS, alive=("d2",)).stale


def test_what_is_no_message_or_of_no_drone_of_the_mission_is_counted_and_dropped(picture):
    picture.receive(key_of(MISSION.swarm, POSE), b"\xc1", NOW_NS)
    picture.receive("nonsense", b"", NOW_NS)
    give(picture, replace(POSE, drone="d9"))
    assert picture.counters == {"rejected_malformed": 2, "unknown_drone": 1}
    assert drone(picture).place is None


def test_the_count_rates_are_those_of_the_last_seconds(picture):
    give(picture, *(exposure(MISSION, number, 0.5, Counts(500 if number < 4 else 20, 2, 1)) for number in range(12)))
    assert drone(picture, NOW_NS + 6 * 10**9).rates_ps == (40.0, 4.0, 2.0)
    assert drone(picture, NOW_NS + 60 * 10**9).rates_ps is None  # a camera that is silent shows no rates
    assert len(picture.log.fusion.log) == 12


def test_the_mission_is_told_with_its_fence_around_the_area(picture):
    about = picture.about(replay=False)
    assert about.datum_deg == (50.0, 14.0)
    assert min(x for x, _ in about.fence) == pytest.approx(-30.0, abs=0.1)
    assert about.area[0] == (0.0, 0.0)
    assert not about.encrypted


def test_the_spectrum_is_that_of_the_last_half_minute(picture):
    def told(number, *bins):
        spectrum = tuple(SpectrumBin(*each) for each in bins)
        return exposure(MISSION, number, 1.0, Counts(10, 2, 1), live_time_s=0.9, spectrum=spectrum)

    assert picture.spectra(NOW_NS).drones == ()
    give(picture, told(0, (3, 100, 0)), told(40, (3, 5, 1), (20, 7, 0)), told(41, (3, 2, 0)))
    (shown,) = picture.spectra(NOW_NS + 42 * 10**9).drones
    assert (shown.id, shown.live_s) == ("d1", 1.8)
    assert {place: count for place, count in enumerate(shown.singles) if count} == {3: 7, 20: 7}
    assert {place: count for place, count in enumerate(shown.coincidences) if count} == {3: 1}
    assert picture.spectra(NOW_NS + 90 * 10**9).drones == ()  # a camera that is silent shows none
    assert len(picture.about(replay=False).energies_kev) == len(shown.singles) + 1


def test_all_sources_of_the_hypothesis_are_shown_each_with_its_own_nuclide(picture):
    def hypothesis(x, nuclide, others=()):
        return Hypothesis(NOW_NS, np.array([x, 0.0, 0.0]), np.diag([0.04, 0.01, 0.0]), np.zeros(3), 9, NOW_NS,
                          activity_bq=1e9, nuclide=nuclide, others=others)  # fmt: skip

    told = hypothesis(1.0, None, (hypothesis(20.0, "Co-60"), hypothesis(40.0, "Ir-192")))
    picture.log.fusion.hypothesis = told
    frame = picture.frame(NOW_NS)
    assert (frame.source.place, frame.source.nuclide) == ((1.0, 0.0, 0.0), picture.mission.nuclide)
    assert [(other.place[0], other.nuclide) for other in frame.others] == [(20.0, "Co-60"), (40.0, "Ir-192")]
    assert frame.others[0].dose_usvph > 3.0 * frame.source.dose_usvph  # 0.35 against 0.09 uSv/h at 1 m from 1 MBq
    assert [one.number for one in (frame.source, *frame.others)] == [1, 2, 3]
    picture.log.fusion.hypothesis = replace(told, activity_bq=None, lines_kev=(136, 265))
    shown = picture.frame(NOW_NS).source
    assert (shown.nuclide, shown.dose_usvph) == ("unknown, lines at 136, 265 keV", None)
    picture.log.fusion.hypothesis = hypothesis(20.0, "Co-60", (hypothesis(1.0, None),))
    frame = picture.frame(NOW_NS + 10**9)
    assert [one.number for one in (frame.source, *frame.others)] == [2, 1]
