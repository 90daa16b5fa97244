import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from shapely import LineString, Polygon

from radron.agent.config.mission import AreaConfig, DroneInMission, EncirclementConfig, MissionConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.fusion.estimator import Exclusion, Outlook
from radron.agent.motion.survey import survey_path
from radron.agent.navigation import covered as covered_module
from radron.agent.navigation.covered import MOST_ENTRIES, MOST_WINDOWS
from radron.agent.navigation.surveying import _PORTION, COVERAGE_S, CoverageLog, InformedSearch, Prospect, Search, conclusion
from radron.protocol.entries import Coverage

SQUARE = ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=SQUARE),
    survey=SurveyConfig(lane_spacing_m=10.0, speed_mps=4.0),
    drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=(40.0, 0.0, 0.0), yaw_deg=90.0)),
)
STEP_S = 0.2


def coverage(drone, path, stamp_ns=0, epoch=0):
    return Coverage(
        stamp_ns=stamp_ns,
        drone=drone,
        mission=MISSION.mission_id,
        boot="0" * 16,
        sequence=stamp_ns,
        epoch=epoch,
        path_m=tuple((float(x), float(y)) for x, y in path),
        swath_m=10.0,
    )


@pytest.fixture
def search():
    return Search(MISSION, "a", FrameGraph.from_launch_layout(MISSION))


def take(search, drone, path):
    """As many entries as the drone would have published."""
    line = LineString(path)
    points = [line.interpolate(at_m).coords[0] for at_m in np.arange(0.0, line.length + 1.0, 1.001)]
    for number, first in enumerate(range(0, len(points) - 1, 30)):
        search.take(coverage(drone, points[first : first + 31], number * 5 * 10**9))


def first_lane():
    """Begin and end of the lane that a drone alone flies first."""
    path = survey_path(Polygon(SQUARE), Polygon(SQUARE), "a", ["a"], MISSION.survey.lane_spacing_m, {"a": (0.0, 0.0)})
    return path[0], path[1]


def fly(search, active, start, seconds):
    """The path of a drone that follows exactly."""
    track = [start]
    for _ in range(round(seconds / STEP_S)):
        positions, _ = search.reference(active, track[-1], 5, STEP_S)
        track.append((float(positions[1, 0]), float(positions[1, 1])))
    return np.array(track)


def unseen_m2(*tracks):
    rest = Polygon(SQUARE)
    for track in tracks:
        rest = rest.difference(LineString(track).buffer(5.0))
    return rest.area


def test_alone_it_covers_everything(search):
    assert unseen_m2(fly(search, ["a"], (0.0, 0.0), 60.0)) < 0.02 * 1600


def test_two_share_and_the_survivor_takes_over_what_is_left(search):
    mine = fly(search, ["a", "b"], (0.0, 0.0), 15.0)
    assert mine[:, 0].max() < 21.0
    take(search, "a", mine)
    assert unseen_m2(mine, fly(search, ["a"], tuple(mine[-1]), 60.0)) < 0.02 * 1600


def test_coverage_of_others_is_read_in_their_own_frame(search):
    """b's frame is turned by 90 degrees: its (y, x) lies before a."""
    mine = fly(search, ["a", "b"], (0.0, 0.0), 1.0)
    flown = [(0.0, 35.0), (30.0, 35.0)]  # in b's frame; in the mission frame from (5, 0) to (5, 30)
    take(search, "b", flown)
    after = fly(search, ["a"], tuple(mine[-1]), 8.0)
    assert after[-1, 0] > 10.0  # nothing to do in the strip that b has seen


@pytest.mark.parametrize("left_m", [1.6, 12.0])
def test_a_standstill_does_not_last(search, left_m):
    """Beside a corner the reference turns round soon after it, and a drone may hover there."""
    search.reference(["a"], (0.0, 0.0), 5, STEP_S)
    follower = search._follower
    near_s = follower.length_m - left_m
    while search._progress < near_s:  # flies the path up to there
        search.reference(["a"], tuple(follower.at(np.array([min(search._progress + 0.5, near_s)]))[0]), 5, STEP_S)
    there = tuple(follower.at(np.array([near_s]))[0])
    for _ in range(round(left_m / 0.05)):
        search.reference(["a"], there, 5, STEP_S)
    search.reference(["a"], there, 5, STEP_S)
    assert search._follower is not follower  # the remaining area has been divided again


@pytest.mark.parametrize("along", [0.25, 0.5, 0.75])
def test_the_way_to_the_first_lane_does_not_lead_back_over_it(search, along):
    """A drone of a map of a hectare was launched on its first lane, and stood for the whole flight before the lane's begin."""
    begin, end = (np.array(point) for point in first_lane())
    positions, _ = search.reference(["a"], tuple(begin + along * (end - begin)), 200, 0.2)
    legs = np.diff(positions, axis=0)
    legs = legs[np.hypot(*legs.T) > 1e-6]
    turns = np.einsum("ij,ij->i", legs[1:], legs[:-1]) / (np.hypot(*legs[1:].T) * np.hypot(*legs[:-1].T))
    assert turns.min() > -0.9


def test_all_that_is_covered_is_known_to_be_so_before_the_own_path_ends(search):
    """All drones end the search by the same log, wherever on their paths they are."""
    fly(search, ["a", "b"], (0.0, 0.0), 4.0)
    assert not search.is_complete
    take(search, "b", [(x, y) for k, x in enumerate(range(0, 41, 5)) for y in ((0, 40) if k % 2 == 0 else (40, 0))])
    fly(search, ["a", "b"], (0.0, 16.0), 4.0)
    assert search.is_complete


def test_coverage_in_an_unknown_frame_waits(search):
    search.take(coverage("b", [(0.0, 0.0), (100.0, 100.0)], epoch=7))
    assert unseen_m2(fly(search, ["a"], (0.0, 0.0), 60.0)) < 0.02 * 1600


def test_at_the_end_of_its_path_it_flies_what_nobody_has_covered(search):
    """A hole between two drones that had divided by different logs does not stay."""
    mine = fly(search, ["a", "b"], (0.0, 0.0), 30.0)
    take(search, "a", mine)
    take(search, "b", [(0.0, 15.0), (20.0, 15.0)])  # b saw x = 20..30 up to y = 20 and then no more
    later = fly(search, ["a", "b"], tuple(mine[-1]), 60.0)
    seen_by_b = np.array([(25.0, 0.0), (25.0, 20.0)])
    before, after = unseen_m2(mine, seen_by_b), unseen_m2(mine, seen_by_b, later)
    assert before > 400.0
    assert after < 0.6 * before  # its fair half of the rest


def shape_work(monkeypatch):
    """Counts the shapes that are made, and the points of the largest."""
    made = []
    real = covered_module.covered

    def counted(coverage):
        made.append(sum(len(path) for path, _ in coverage))
        return real(coverage)

    monkeypatch.setattr(covered_module, "covered", counted)
    return made


def test_what_is_published_costs_a_bounded_part_of_each_step(search, monkeypatch):
    """However much comes: the area is divided by the coverage counted so far, and again when all is counted."""
    made = shape_work(monkeypatch)
    rng = np.random.default_rng(1)
    for number in range(3000):  # five an hour
        x, y = 35.0 * rng.random(2)
        search.take(coverage("b", [(y, 40.0 - x - metre) for metre in range(6)], number * 10**9))
    search.reference(["a"], (0.0, 0.0), 5, STEP_S)
    assert len(made) <= _PORTION
    fly(search, ["a"], (0.0, 0.0), 200.0)
    assert len(made) == 3000 / 20
    assert max(made) <= MOST_ENTRIES * 6


@pytest.mark.parametrize(
    "path",
    [
        [(float(k * k % 37), float(k * k * k % 39)) for k in range(256)],  # to and fro over the area: ten kilometres
        [(20.0 + k % 2, 20.0) for k in range(256)],
        [(20.0 + 0.01 * k, 20.0) for k in range(256)],
    ],
)
def test_what_no_drone_can_have_flown_does_not_count(search, monkeypatch, path):
    made = shape_work(monkeypatch)
    search.take(coverage("b", path))
    search.take(replace(coverage("b", [(0.0, 0.0), (30.0, 0.0)], stamp_ns=1), swath_m=0.1))
    fly(search, ["a"], (0.0, 0.0), 1.0)
    assert made == []


def test_of_a_path_that_goes_to_and_fro_a_few_points_count(search, monkeypatch):
    made = shape_work(monkeypatch)
    search.take(coverage("b", [(20.0 + k % 2, 20.0 + k // 2 % 2) for k in range(50)]))
    fly(search, ["a"], (0.0, 0.0), 1.0)
    assert made == [12]


def test_the_order_of_arrival_does_not_matter():
    flown = [[(x, y + metre) for metre in range(30)] for x in range(0, 20, 4) for y in (0.0, 8.0)]
    entries = [coverage("a", path, number * 5 * 10**9) for number, path in enumerate(flown)]
    tracks = []
    for order in (entries, entries[::-1]):
        one = Search(MISSION, "a", FrameGraph.from_launch_layout(MISSION))
        for entry in order:
            one.take(entry)
            fly(one, ["a"], (0.0, 0.0), 1.0)
        fly(one, ["a"], (0.0, 0.0), 5.0)
        one.divide_anew()
        tracks.append(fly(one, ["a"], (0.0, 0.0), 20.0))
    assert np.array_equal(*tracks)


def test_stamps_far_away_cost_no_more(search):
    for number in range(2 * MOST_WINDOWS):
        search.take(coverage("b", [(0.0, 0.0), (30.0, 0.0)], stamp_ns=number * 10**15))
    fly(search, ["a"], (0.0, 0.0), 1.0)
    assert sum(len(drone.windows) for drone in search._covered._drones.values()) == MOST_WINDOWS


def test_it_starts_again_when_all_is_covered(search):
    fly(search, ["a"], (0.0, 0.0), 1.0)
    assert not search.is_complete
    search.begin(0)
    take(search, "a", [(x, y) for k, x in enumerate(range(0, 41, 5)) for y in ((0, 40) if k % 2 == 0 else (40, 0))])
    assert unseen_m2(fly(search, ["a"], (0.0, 0.0), 60.0)) < 0.02 * 1600
    assert search.is_complete
    search.begin(100 * 10**9)  # another mission
    assert not search.is_complete


def test_coverage_is_reported_every_few_seconds_without_a_gap():
    log, reports = CoverageLog(10.0), []
    for tick in range(400):
        report = log.add(tick * 50_000_000, 0, (0.15 * tick, 0.0))
        if report is not None:
            reports.append(report)
    assert len(reports) == int(20.0 / COVERAGE_S) - 1
    assert all(before[2][-1] == after[2][0] for before, after in pairwise(reports))


def test_coverage_does_not_lead_from_one_frame_into_another():
    """The localisation jumps by 100 m after 3 s: each part is published in the epoch in which it was flown."""
    log, reports = CoverageLog(10.0), []
    for tick in range(200):
        jumped = tick >= 60
        report = log.add(tick * 50_000_000, int(jumped), (0.15 * tick + 100.0 * jumped, 0.0))
        if report is not None:
            reports.append(report)
    assert [epoch for _, epoch, _ in reports] == [0, 1]
    (before_ns, _, before), (after_ns, _, after) = reports
    assert (before_ns, after_ns) == (0, 3_000_000_000)
    assert max(x for x, _ in before) < 9.0
    assert min(x for x, _ in after) == 109.0


X, Y = np.meshgrid(np.arange(1.0, 40.0, 2.0), np.arange(1.0, 40.0, 2.0))
PLACES = np.column_stack((X.ravel(), Y.ravel()))


def outlook(weight=None, none=0.5, excluded_bq=None, left=None):
    """``left``: where more may hide, of an estimator of several sources."""
    weight = np.ones(len(PLACES)) if weight is None else weight
    exclusion = None if left is None else Exclusion({"Cs-137": excluded_bq}, left, np.zeros(len(PLACES), np.bool_))
    sides_m, inside, activity_bq = np.full(len(PLACES), 2.0), np.ones(len(PLACES), np.bool_), np.full(len(PLACES), 1e9)
    return Outlook(PLACES, sides_m, inside, (1.0 - none) * weight / weight.sum(), activity_bq, none, excluded_bq, exclusion)


def informed(known, mission=MISSION):
    return InformedSearch(mission, Prospect(lambda: known))


def led(search, seconds, position=(20.0, 2.0)):
    """The final position of a drone that follows the reference exactly, and its top speed."""
    velocity, fastest = (0.0, 0.0), 0.0
    for tick in range(round(seconds / STEP_S)):
        found = search.reference(tick * int(STEP_S * 1e9), position, velocity, [], 20, STEP_S)
        positions, velocities = found
        assert positions.shape == velocities.shape == (21, 2)
        assert np.diff(positions, axis=0) == pytest.approx(velocities[:-1] * STEP_S)
        fastest = max(fastest, float(np.hypot(*velocities.T).max()))
        velocity, position = tuple(velocities[0].tolist()), tuple(positions[1].tolist())
    return position, fastest


def test_it_flies_to_what_is_probable_at_the_searchs_speed_and_waits_there():
    near = np.exp(-((PLACES[:, 0] - 30.0) ** 2 + (PLACES[:, 1] - 33.0) ** 2) / 20.0)
    position, fastest = led(informed(outlook(near)), 15.0)
    assert np.hypot(position[0] - 30.0, position[1] - 33.0) < 4.0
    assert fastest == pytest.approx(MISSION.survey.search_speed_mps)


@pytest.mark.parametrize(
    "mission",
    [
        replace(MISSION, survey=SurveyConfig(strategy="lanes")),
        replace(MISSION, encirclement=EncirclementConfig(law="paper")),
        replace(MISSION, area=AreaConfig(polygon_m=((0.0, 0.0), (400.0, 0.0), (400.0, 300.0), (0.0, 300.0)))),
    ],
    ids=["strategy", "law", "area"],
)
def test_lanes_are_flown_where_they_are_asked_for(mission):
    assert informed(outlook(), mission).reference(0, (1.0, 1.0), (0.0, 0.0), [], 20, STEP_S) is None


def test_lanes_are_flown_without_an_outlook():
    assert informed(None).reference(0, (1.0, 1.0), (0.0, 0.0), [], 20, STEP_S) is None


def test_a_search_for_several_sources_flies_lanes_first_and_then_where_more_may_hide():
    left = (PLACES[:, 0] > 28.0) & (PLACES[:, 1] > 28.0)
    search = informed(outlook(left=left))
    assert search.reference(0, (1.0, 1.0), (0.0, 0.0), [], 20, STEP_S) is None
    found = search.reference(0, (1.0, 1.0), (0.0, 0.0), [], 20, STEP_S, covered=True)
    assert found is not None
    velocities = found[1]
    assert min(velocities[1]) > 0.0
    nothing = informed(outlook(left=np.zeros(len(PLACES), np.bool_)))
    assert nothing.reference(0, (1.0, 1.0), (0.0, 0.0), [], 20, STEP_S, covered=True) is None


def test_what_was_measured_of_a_source_that_is_not_told_yet_leads_it_away_from_the_lanes():
    near = np.exp(-((PLACES[:, 0] - 30.0) ** 2 + (PLACES[:, 1] - 33.0) ** 2) / 20.0)
    known = dataclasses.replace(outlook(left=np.ones(len(PLACES), np.bool_)), lead=outlook(near))
    position, _ = led(informed(known), 15.0)
    assert np.hypot(position[0] - 30.0, position[1] - 33.0) < 4.0


def test_its_way_goes_around_the_corner_of_an_area():
    corner = ((0.0, 0.0), (40.0, 0.0), (40.0, 12.0), (12.0, 12.0), (12.0, 40.0), (0.0, 40.0))
    mission = replace(MISSION, area=AreaConfig(polygon_m=corner))
    upper = ((PLACES[:, 0] < 10.0) & (PLACES[:, 1] > 30.0)).astype(float)
    search = informed(outlook(upper), mission)
    position, inside = (38.0, 6.0), Polygon(corner).buffer(0.5)
    for tick in range(60):
        positions, _ = search.reference(tick * int(STEP_S * 1e9), position, (0.0, 0.0), [], 20, STEP_S)
        assert inside.covers(LineString(positions))
        position = tuple(positions[1].tolist())
    assert position[1] > 25.0


def test_the_outlook_is_asked_for_once_a_second():
    asked = []
    prospect = Prospect(lambda: asked.append(1) or outlook())
    for tick in range(100):
        prospect.at(1_000_000_000 * tick // 20)
    assert len(asked) == 5


@pytest.mark.parametrize(
    ("survey", "searched_s", "known", "words"),
    [
        (SurveyConfig(least_activity_bq=1e8), 60.0, outlook(excluded_bq=1.2e8), ""),
        (SurveyConfig(least_activity_bq=1e8), 60.0, outlook(), ""),
        (SurveyConfig(least_activity_bq=1e8), 1e6, None, ""),
        (SurveyConfig(least_activity_bq=1e8), 60.0, outlook(excluded_bq=8e7), "a source of 8e+07 Bq or more is excluded"),
        (SurveyConfig(least_activity_bq=None), 1e6, outlook(excluded_bq=3e7), ""),
        (SurveyConfig(duration_s=300.0), 299.0, outlook(excluded_bq=8e8), ""),
        (SurveyConfig(duration_s=300.0), 300.0, outlook(excluded_bq=8e8), "a source of 8e+08 Bq or more is excluded"),
        (SurveyConfig(), 60.0, outlook(excluded_bq=4e7, left=np.ones(len(PLACES), np.bool_)), ""),
        (SurveyConfig(), 60.0, outlook(excluded_bq=6e7, left=np.zeros(len(PLACES), np.bool_)), "6e+07 Bq or more is excluded"),
        (SurveyConfig(duration_s=300.0), 300.0, None, "nothing found in 300 s; no activity can be excluded"),
    ],
)
def test_the_search_ends_with_what_would_have_been_found(survey, searched_s, known, words):
    found = conclusion(replace(MISSION, survey=survey), searched_s, known)
    assert bool(found) == bool(words)
    assert words in (found or "")


def test_a_search_that_ends_tells_of_a_source_outside_the_fence():
    """The square is 40 m wide, the fence 30 m around it."""
    mission = replace(MISSION, survey=SurveyConfig())
    found = conclusion(mission, 60.0, dataclasses.replace(outlook(excluded_bq=3e7), beyond=(120.0, 20.0)))
    assert found == "nothing found in the area; source outside the fence, towards 090 degrees"
    assert "outside" not in conclusion(mission, 60.0, outlook(excluded_bq=3e7))


def test_the_search_goes_up_to_the_fence_for_a_source_that_is_probably_outside():
    """And stays in the area while there is no sign of one: the drone flies no farther east than the area's edge, at 40 m."""
    for weight, least_m, most_m in ((0.9, 55.0, 66.0), (0.05, 0.0, 40.0)):
        near = outlook(none=0.1)
        places, activity_bq, inside = (
            np.vstack((PLACES, [[95.0, 20.0]])),
            np.append(near.activity_bq, 3e10),
            np.append(near.inside, False),
        )
        shares = np.append((0.9 - weight) * near.weight, weight)
        known = dataclasses.replace(near, places=places, inside=inside, activity_bq=activity_bq, weight=shares)
        points, _ = informed(known).reference(0, (35.0, 20.0), (0.0, 0.0), [], 200, STEP_S)
        assert least_m < points[:, 0].max() <= most_m
