"""The inequalities of docs/design/separation.md, by random draws within its assumptions, and the numbers of that page."""

import re
from math import cos, hypot, pi, sin, sqrt

import numpy as np
import pytest
import shapely
from msgspec.structs import replace

from radron.agent.config.drone import ResponseConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, EncirclementConfig, LimitsConfig, MissionConfig, SafetyConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.frames.transform import Transform
from radron.agent.motion import climbing, orbit, separation, steering
from radron.agent.motion.braking import comes_to_rest
from radron.agent.motion.fence import Fence
from radron.agent.motion.orbit import Orbit, highest_circle_m, ring_lift_m, ring_radius_m
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import half_planes, keep_away
from radron.agent.motion.tracker import Tracker
from radron.agent.navigation import moment, navigator
from radron.agent.navigation.peers import newest
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard import agentless, contact, crossing, lines, relayed, silent, viewer
from radron.agent.navigation.unheard.agentless import Agentless
from radron.agent.navigation.unheard.contact import SILENT_NS, link_state, wall_between
from radron.agent.navigation.unheard.crossing import climb_s, crossing_height_m, is_over_m
from radron.agent.navigation.unheard.silent import Silent
from radron.agent.navigation.unheard.viewer import Viewer
from radron.protocol.messages import Stage
from support import docs_pages
from support.flights.drone_messages import at
from support.flights.encounter import least_m

PAGE = (docs_pages.DOCS / "design" / "separation.md").read_text(encoding="utf-8")
LIMITS = LimitsConfig()
# Constants of the page, by name, in its units.
VALUES = {
    "separation_m": LIMITS.separation_m,
    "limits.speed_mps": LIMITS.speed_mps,
    "acceleration_mps2": LIMITS.acceleration_mps2,
    "jerk_mps3": LIMITS.jerk_mps3,
    "climb_mps": LIMITS.climb_mps,
    "_ACCELERATION_SHARE": climbing._ACCELERATION_SHARE,
    "search_speed_mps": SurveyConfig().search_speed_mps,
    "encirclement.speed_mps": EncirclementConfig().speed_mps,
    "tracking_error_m": ResponseConfig().tracking_error_m,
    "REPLAN_NS": navigator.REPLAN_NS * 1e-9,
    "STEP_S": moment.STEP_S,
    "HORIZON": moment.HORIZON,
    "LEAST_MARGIN_M": separation.LEAST_MARGIN_M,
    "_RIGHT_OF_WAY": separation._RIGHT_OF_WAY,
    "DOUBT_SIGMAS": separation.DOUBT_SIGMAS,
    "_ROWS": steering._ROWS,
    "SILENT_NS": contact.SILENT_NS * 1e-9,
    "QUIET_NS": contact.QUIET_NS * 1e-9,
    "OLDEST_NS": newest.OLDEST_NS * 1e-9,
    "LEAVING_NS": relayed.LEAVING_NS * 1e-9,
    "_BEHIND_M": viewer._BEHIND_M,
    "APART_NS": lines.APART_NS * 1e-9,
    "_RADIUS_MPS": orbit._RADIUS_MPS,
    "_HEIGHT_MPS": orbit._HEIGHT_MPS,
    "_NEAREST_S": agentless._NEAREST_S,
    "_FARTHEST_S": agentless._FARTHEST_S,
    "_HOLD_S": agentless._HOLD_S,
    "LEFT_S": silent.LEFT_S,
    "_NEAR_M": crossing._NEAR_M,
}
MESSAGE_S, DEVIATION_M, CLOCK_S = 0.06, 1.13, 0.05  # delay of a message; 2 sigma of both deviations; error of the clocks
REPLAN_S, POSE_S, SECOND = 0.2, 0.1, 1_000_000_000
NOW_NS = 1_000 * SECOND
NAMES = ("d1", "d2", "d3", "d4", "d5", "d6")
AREA = AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)))


def mission(count=3, **changes):
    return MissionConfig(name="test", area=AREA, drones=tuple(DroneInMission(id=f"d{k + 1}") for k in range(count)), **changes)


def plan_change_m(seconds):
    """Lemma 2: greatest distance between two plans so long after they part; both obey the limits of acceleration and jerk."""
    jerk, most = 2.0 * sqrt(2.0) * LIMITS.jerk_mps3, 2.0 * LIMITS.acceleration_mps2
    ramp_s = min(seconds, most / jerk)
    rest_s = seconds - ramp_s
    return jerk * ramp_s**3 / 6.0 + 0.5 * jerk * ramp_s**2 * rest_s + 0.5 * most * rest_s**2


def apart_m(delay_s, lost=0):
    """Theorem 1: distance of plans, without slack, with so many plans lost in a row."""
    carried_m = 0.5 * LIMITS.acceleration_mps2 * (delay_s + POSE_S) ** 2
    return LIMITS.separation_m + 2.0 - 0.07 - plan_change_m(delay_s + (lost + 1) * REPLAN_S) - carried_m


def test_a_half_plane_keeps_its_distance():
    """Lemma 1."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        nominal, other = rng.uniform(-9.0, 9.0, (20, 2)), rng.uniform(-9.0, 9.0, (21, 2))
        normals, offsets = half_planes(nominal, tuple(rng.uniform(-9.0, 9.0, 2)), other, 5.0, bool(rng.integers(2)))
        along = rng.uniform(-30.0, 30.0, (20, 1))
        allowed = offsets[:, None] * normals + along * normals @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        assert np.hypot(*(allowed - other[1:]).T).min() >= 5.0 - 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_two_plans_from_one_state_part_by_no_more_than_the_limits_allow(seed):
    """Lemma 2: the flown plan, replanned for new references, against the plan that the peer knows."""
    rng = np.random.default_rng(seed)
    tracker = Tracker(LIMITS, Fence(shapely.box(-500.0, -500.0, 500.0, 500.0), 1.5, 60.0))
    state, goal = PeerState((0.0, 0.0, 3.0)), rng.uniform(-40.0, 40.0, 2)
    made = known = tracker.plan(0, state, Reference(np.tile((*goal, 3.0), (21, 1)), np.zeros((21, 3)), REPLAN_S))
    for step in range(1, 16):
        now_ns = round(step * REPLAN_S * SECOND)
        if step in (6, 11):
            known, goal = made, -3.0 * goal  # the hardest change: back
        state = tracker.state(now_ns)
        reference = Reference(np.tile((*goal, 3.0), (21, 1)), np.zeros((21, 3)), REPLAN_S)
        made = tracker.plan(now_ns, state, reference)
        for ahead_s in (0.05, 0.1, 0.2) if 6 <= step < 11 else ():
            since_s = (step - 6) * REPLAN_S + ahead_s
            flown = tracker.state(now_ns + round(ahead_s * SECOND)).position
            place = REPLAN_S + since_s  # the known plan was made a replan before
            there = [np.interp(place, REPLAN_S * np.arange(21), known.positions[:, axis]) for axis in (0, 1)]
            assert hypot(flown[0] - there[0], flown[1] - there[1]) <= plan_change_m(since_s) + 0.04  # read between its steps


@pytest.mark.parametrize(("delay_s", "seed"), [(0.06, 100), (0.46, 103)])
@pytest.mark.parametrize("turns", [0.0, 0.05])
def test_two_drones_that_hear_each_other_keep_the_separation_with_late_plans(delay_s, seed, turns):
    """Theorem 1, with the slack of soft constraints (within 1 m by `benchmarks/plan_delay.py`) and without errors."""
    assert least_m(seed, delay_s, turns) >= apart_m(delay_s) - 1.0


def test_beyond_the_longest_delay_they_do_not():
    """The limit of theorem 1 is one of the code, not of its proof."""
    assert least_m(101, 0.86) < LIMITS.separation_m


def random_motion(rng, speed_mps=6.5):
    heading = rng.uniform(0.0, 2.0 * pi)
    return PeerState((*rng.uniform(0.0, 100.0, 2), 3.0), (speed_mps * cos(heading), speed_mps * sin(heading), 0.0))


def after(state, seconds, rng):
    """The motion so much later, with any acceleration within the limit."""
    force, toward = rng.uniform(0.0, LIMITS.acceleration_mps2), rng.uniform(0.0, 2.0 * pi)
    (x, y, z), (u, v, _) = state.position, state.velocity
    ax, ay = force * cos(toward), force * sin(toward)
    moved = x + seconds * (u + 0.5 * seconds * ax), y + seconds * (v + 0.5 * seconds * ay), z
    return PeerState(moved, (u + seconds * ax, v + seconds * ay, 0.0))


def kept_from_line_m(wall, sigma_m):
    """Distance from the line that a plan keeps, by the constraint that the tracker receives."""
    ahead = np.array([[0.0, 0.0, 3.0]])
    me = Viewer(0, 0, REPLAN_S, Transform(), lambda: ahead, lambda _: None, None, 3.0, None)
    beyond = me.beyond("d2", wall, sigma_m)
    (x, y, _), (u, v) = beyond.positions[0], beyond.away[0]
    return (
        x * wall.normal[0]
        + y * wall.normal[1]
        - wall.offset
        + (keep_away("d1", beyond, LIMITS.separation_m)) * (u * wall.normal[0] + v * wall.normal[1])
    )


@pytest.mark.parametrize("sigma_m", [0.0, 0.3])
def test_each_side_stays_three_metres_and_two_sigma_from_the_line(sigma_m):
    rng = np.random.default_rng(2)
    wall = wall_between(random_motion(rng), random_motion(rng))
    assert kept_from_line_m(wall, sigma_m) == pytest.approx(3.0 + 2.0 * sigma_m)


def test_both_sides_derive_one_line_from_one_contact():
    """Lemma 4, without disagreement about the contact."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        mine, theirs = random_motion(rng), random_motion(rng)
        one, other = wall_between(mine, theirs), wall_between(theirs, mine)
        assert one.normal == pytest.approx((-other.normal[0], -other.normal[1]))
        assert one.offset == pytest.approx(-other.offset)


def test_two_drones_on_their_sides_are_as_far_apart_as_the_disagreement_about_the_contact_leaves():
    """Theorem 2: 3 + 3 cos phi - (v + a) dt - L sin phi."""
    rng = np.random.default_rng(4)
    least, cases = np.inf, 0
    for _ in range(1_000):
        mine, theirs = random_motion(rng), random_motion(rng)
        lag_s = rng.uniform(0.0, 0.5)
        mine_later, theirs_later = after(mine, lag_s, rng), after(theirs, lag_s, rng)
        if hypot(mine.position[0] - theirs.position[0], mine.position[1] - theirs.position[1]) < 10.0:
            continue
        first, second = wall_between(mine_later, theirs_later), wall_between(theirs, mine)
        turned = first.normal[1] * second.normal[0] - first.normal[0] * second.normal[1]  # sine, of opposite normals
        middle = 0.5 * (np.array(mine.position[:2]) + theirs.position[:2] + np.array(mine.velocity[:2]) + theirs.velocity[:2])
        normals, along = np.array((first.normal, second.normal)), rng.uniform(-40.0, 40.0)
        there = middle + 3.0 * normals[1] + along * np.array((-second.normal[1], second.normal[0]))
        here = there + (first.offset + 3.0 - normals[0] @ there) * normals[0]  # nearest allowed place of the other side
        apart_m = float(normals[0] @ (here - there))
        fastest_mps = max(hypot(*one.velocity[:2]) for one in (mine, theirs, mine_later, theirs_later))
        shift_m = (fastest_mps + LIMITS.acceleration_mps2 * SILENT_NS / SECOND) * lag_s
        bound_m = 3.0 + 3.0 * sqrt(1.0 - turned**2) - shift_m - abs(along * turned)
        assert apart_m >= bound_m - 1e-6
        least, cases = min(least, apart_m - bound_m), cases + 1
    assert cases > 700
    assert least < 0.5  # the bound is tight


def parted(rng, count):
    """Random network components of the first drones: disjoint, and two-way within."""
    owner = rng.integers(0, count, count)
    return [[name for name, one in zip(NAMES, owner, strict=False) if one == part] for part in range(count) if part in owner]


def absence_of(config, me, component):
    """Consequences for one drone, from the poses of its component."""
    names = [member.id for member in config.drones]
    peers, partners = Peers([name for name in names if name != me]), [name for name in component if name != me]
    for name in partners:
        told = replace(at("pose", NOW_NS // SECOND), drone=name, stage=Stage.SURVEY, silences_ns=dict.fromkeys(component, 0))
        assert peers.receive(told, NOW_NS) is None
    missing = [name for name in names if name not in component]
    links = {name: link_state(peers[name], me, NOW_NS, revoked=False) for name in peers.names}
    return Silent(config, me).absence(missing, partners, peers, links, NOW_NS)


def test_components_fly_on_different_circles_and_one_of_them_at_most_stays_low():
    """Lemma 5."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        count = int(rng.integers(2, len(NAMES) + 1))
        config, components = mission(count), parted(rng, count)
        if len(components) < 2:
            continue
        found = [[absence_of(config, me, component) for me in component] for component in components]
        rings = [{one.ring for one in part} for part in found]
        assert all(len(each) == 1 for each in rings)  # all drones of a component derive the same circle
        assert len(set.union(*rings)) == len(components)
        low = [{not one.anywhere for one in part} for part in found]
        assert all(len(each) == 1 for each in low)
        assert sum(each == {True} for each in low) <= 1


@pytest.mark.parametrize("fits", [True, False])
def test_circles_of_components_are_six_metres_apart_and_neighbours_at_different_heights(fits):
    """Theorem 3, in the end."""
    for count in range(2, 7):
        config = mission(count)
        radii_m = [ring_radius_m(config, ring, fits) for ring in range(count)]
        assert np.diff(radii_m) == pytest.approx(6.0)
        assert np.abs(np.diff([ring_lift_m(config, ring) for ring in range(count)])) == pytest.approx(3.0)


def test_drones_that_part_from_a_common_circle_stay_as_far_apart_as_their_angle_allows():
    """Theorem 3, on the way: r0 sin psi, with the rate limits of the code; radii 5.4 m apart 4 s after both notice."""
    rng = np.random.default_rng(6)
    for _ in range(40):
        count = int(rng.integers(2, 9))
        config = mission(count)
        inner_m = ring_radius_m(config, 0, fits_hypothesis=True)
        start_m = rng.uniform(inner_m, max(inner_m, config.encirclement.radius_m))
        psi = 2.0 * pi / count
        bound_m = start_m * (sin(psi) if psi < 0.5 * pi else 1.0)
        first, second = (Orbit(config.encirclement, config.area.floor_m) for _ in range(2))
        first.radius_m = second.radius_m = start_m
        late_s = rng.uniform(0.0, 0.26)  # of the second drone
        for step in range(25):
            first.update(round(step * REPLAN_S * SECOND), 0.2, None, ring_m=inner_m)
            second.update(round((step * REPLAN_S - late_s) * SECOND), 0.2, None, ring_m=inner_m + 6.0)
            one, other = first.radius_m, second.radius_m
            assert sqrt(one**2 + other**2 - 2.0 * one * other * cos(psi)) >= min(bound_m, start_m) - 1e-9
            if step == 20:
                assert other - one >= 5.4 - 2.0 * late_s - 0.05
    assert min(5.5 / (2.0 * sin(pi / n)) * sin(2.0 * pi / n) for n in range(7, 65)) > 4.9  # of the smallest circles


def test_altitude_layers():
    """Theorem 4: 4 m between layers, 4 m above the highest circle, where the ceiling allows; a crossing begins 1 m lower."""
    rng = np.random.default_rng(7)
    for _ in range(200):
        count, ceiling_m = int(rng.integers(2, 13)), rng.uniform(25.0, 120.0)
        lowest_m = rng.uniform(8.0, 15.0)
        area = AreaConfig(polygon_m=AREA.polygon_m, ceiling_m=ceiling_m)
        drones = tuple(DroneInMission(id=f"d{k + 1}") for k in range(count))
        config = MissionConfig(name="test", area=area, drones=drones, safety=SafetyConfig(return_height_m=lowest_m))
        layers_m = np.array([crossing_height_m(config, one.id) for one in drones])
        least_m = max(lowest_m, highest_circle_m(config) + 4.0)
        layer_m = min(4.0, (0.9 * ceiling_m - least_m) / max(count - 1, 1))
        assert np.diff(layers_m).min() >= layer_m - 0.02  # rounded to centimetres
        assert layers_m.min() >= least_m - 0.02
        assert all(is_over_m(config, one.id) == crossing_height_m(config, one.id) - 1.0 for one in drones)


def test_the_constants_of_the_page_are_those_of_the_code():
    section = PAGE.partition("\n| constant |")[2].partition("\n\n")[0]
    found = {}
    for line in section.splitlines()[2:]:
        _, value, names, _ = (cell.strip() for cell in line.strip("|").split("|"))
        numbers = [float(re.match(r"[\d.]+", part)[0]) for part in value.split("; ")]
        found |= dict(zip(re.findall(r"`([\w.]+)`", names), numbers, strict=True))
    assert found == pytest.approx(VALUES)


def row(name):
    """The numbers of a line of the page's blocks."""
    text = next(line for line in PAGE.splitlines() if line.startswith(name)).partition("  ")[2]
    return [float(number) for number in re.findall(r"\d+\.\d+", text)]


def test_the_tables_of_theorem_1():
    """Heard both ways, by the number of plans lost in a row."""
    assert [round(plan_change_m(tau), 2) for tau in row("tau (s)")] == row("delta (m)")
    plans = [apart_m(MESSAGE_S, lost) for lost in range(4)]
    vehicles = [one - DEVIATION_M - CLOCK_S * SurveyConfig().search_speed_mps for one in plans]
    assert row("plans, s_r = 0") == [round(one, 2) for one in plans]
    assert row("vehicles, e = 1.13 m, v = 6.5 m/s") == pytest.approx(vehicles, abs=0.01)
    assert [round(apart_m(delay_s), 2) for delay_s in (0.06, 0.26, 0.46)] == [
        float(number) for number in re.findall(r"\| 0\.\d6 s \| (\d\.\d\d) m", PAGE)
    ]
    assert [apart_m(delay_s) - DEVIATION_M - CLOCK_S * 6.5 for delay_s in (0.15, 0.37)] == pytest.approx([3.0, 2.0], abs=0.05)
    assert 2.0 * sqrt(2.0) * ResponseConfig().tracking_error_m == pytest.approx(DEVIATION_M, abs=0.01)


def test_times_and_ways_to_a_stop():
    """Theorem 2: the way behind the line. Theorem 3: the departure of each drone's vehicle without its agent, from the circle."""
    fast = PeerState((0.0, 0.0, 3.0), (6.5, 0.0, 0.0))
    stop_m = comes_to_rest(fast, LIMITS)[0]
    assert stop_m == pytest.approx(5.9, abs=0.05)
    assert 13.0 + 2.0 * (0.2 * 6.5 + stop_m) + 6.0 == pytest.approx(33.0, abs=0.5)
    three = mission()
    leaves = [Agentless(three).course(name, fast, Stage.SURVEY, (0.0, 0.0, 0.0)).leaves_s for name in ("d1", "d2", "d3")]
    assert leaves == pytest.approx([8.2, 10.8, 13.5], abs=0.05)
    assert three.return_heights_m == (10.0, 14.0, 18.0)
    assert [climb_s(three, one.id) for one in three.drones] == pytest.approx([7.85, 9.85, 9.85])
