"""The references of both flocking laws."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.config.mission import EncirclementConfig, LimitsConfig
from radron.agent.motion.encirclement import Encirclement, minimum_radius, wrapped
from radron.agent.motion.reference import PeerState

CENTER = (10.0, -5.0, 0.0)
PAPER = Encirclement(EncirclementConfig(law="paper", bias_rad=0.3), LimitsConfig())
SMOOTH = Encirclement(EncirclementConfig(), LimitsConfig())


def at(angle: float, radius: float = 12.0, speed: float = 3.0) -> PeerState:
    """On a circle around CENTER, flying along it counter-clockwise."""
    position = (CENTER[0] + radius * cos(angle), CENTER[1] + radius * sin(angle), 3.0)
    return PeerState(position, (-speed * sin(angle), speed * cos(angle), 0.0))


def angles_of(positions: np.ndarray) -> np.ndarray:
    return np.unwrap(np.arctan2(positions[:, 1] - CENTER[1], positions[:, 0] - CENTER[0]))


def test_the_papers_arc_has_its_radius_its_speed_and_its_steps() -> None:
    reference = PAPER.reference(at(0.7), {}, "a", center=CENTER)
    assert reference.positions.shape == reference.velocities.shape == (31, 3)
    assert np.hypot(*(reference.positions[:, :2] - CENTER[:2]).T) == pytest.approx(np.full(31, 12.0))
    assert angles_of(reference.positions) == pytest.approx(0.7 + np.arange(31) * (3.0 / 12.0) * 0.2)  # alone: no bias
    assert reference.positions[:, 2] == pytest.approx(3.0)
    moved = np.diff(reference.positions, axis=0) / reference.step_s
    assert moved == pytest.approx(0.5 * (reference.velocities[1:] + reference.velocities[:-1]), abs=1e-2)


@pytest.mark.parametrize(("other", "bias"), [(0.5, -0.3), (-0.5, 0.3), (3.0, -0.3), (-3.0, 0.3)])
def test_the_papers_bias_points_away_from_the_neighbour(other: float, bias: float) -> None:
    reference = PAPER.reference(at(0.7), {"b": at(0.7 + other)}, "a", center=CENTER)
    assert angles_of(reference.positions)[0] == pytest.approx(0.7 + bias)


def test_the_papers_neighbour_is_the_nearest_by_angle_not_by_distance() -> None:
    others = {"b": at(0.4, radius=80.0), "c": at(-0.6, radius=12.0)}
    reference = PAPER.reference(at(0.0), others, "a", center=CENTER)
    assert angles_of(reference.positions)[0] == pytest.approx(-0.3)


def test_the_papers_law_does_not_follow_the_centres_movement() -> None:
    still = PAPER.reference(at(0.0), {}, "a", center=CENTER)
    moving = PAPER.reference(at(0.0), {}, "a", center=CENTER, center_velocity=(1.0, 0.0, 0.0))
    assert np.array_equal(still.positions, moving.positions)


def test_at_its_place_a_drone_flies_on_along_the_circle() -> None:
    others = {"b": at(0.7 + 2.0 * pi / 3.0), "c": at(0.7 - 2.0 * pi / 3.0)}
    reference = SMOOTH.reference(at(0.7), others, "a", center=CENTER)
    assert angles_of(reference.positions) == pytest.approx(0.7 + np.arange(31) * 0.05, abs=1e-9)


def test_while_the_circle_stands_a_drone_goes_to_its_place_and_stays_there() -> None:
    """Halfway to where both are opposite each other; the other one does the same."""
    still = PeerState(at(0.7).position)
    reference = SMOOTH.reference(still, {"b": at(0.7 + 2.0, speed=0.0)}, "a", center=CENTER, stands=True)
    assert angles_of(reference.positions)[-1] == pytest.approx(0.7 + 1.0 - 0.5 * pi)
    assert np.hypot(*reference.velocities[-1, :2]) == pytest.approx(0.0, abs=1e-9)


def test_the_smooth_law_moves_with_the_centre() -> None:
    velocity = (1.0, -0.5, 0.0)
    start = at(0.7)
    me = PeerState(start.position, (start.velocity[0] + 1.0, start.velocity[1] - 0.5, 0.0))
    reference = SMOOTH.reference(me, {}, "a", center=CENTER, center_velocity=velocity)
    moved = np.array(CENTER) + np.outer(0.2 * np.arange(31), velocity)
    assert np.hypot(*(reference.positions - moved)[:, :2].T) == pytest.approx(np.full(31, 12.0))
    assert np.hypot(*(reference.velocities[:, :2] - velocity[:2]).T) == pytest.approx(np.full(31, 3.0))


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(-pi, pi), st.floats(1.0, 60.0), st.floats(-3.0, 3.0)),
        min_size=2,
        max_size=7,
        unique_by=lambda place: round(place[0], 2),
    )
)
def test_all_drones_compute_the_same_evenly_spaced_slots(places: list[tuple[float, float, float]]) -> None:
    drones = {f"d{k}": at(angle, radius, speed) for k, (angle, radius, speed) in enumerate(places)}
    ahead, slots = {}, {}
    for name, me in drones.items():
        others = {other: state for other, state in drones.items() if other != name}
        offset = SMOOTH._offset_from_slot(me, others, name, CENTER, (0.0, 0.0, 0.0))
        x, y = (me.position[axis] + 0.5 * me.velocity[axis] - CENTER[axis] for axis in (0, 1))
        ahead[name] = atan2(y, x)
        slots[name] = ahead[name] + offset
    order = sorted(drones, key=ahead.__getitem__)
    for first, second in zip(order, order[1:] + order[:1], strict=True):
        assert wrapped(slots[second] - slots[first] - 2.0 * pi / len(drones)) == pytest.approx(0.0, abs=1e-6)


def test_two_drones_at_the_same_angle_take_different_slots() -> None:
    inner, outer = at(1.0, radius=5.0, speed=0.0), at(1.0, radius=20.0, speed=0.0)
    first = SMOOTH._offset_from_slot(inner, {"b": outer}, "a", CENTER, (0.0, 0.0, 0.0))
    second = SMOOTH._offset_from_slot(outer, {"a": inner}, "b", CENTER, (0.0, 0.0, 0.0))
    assert wrapped(first - second) == pytest.approx(-pi, abs=1e-9)


def test_an_aged_pose_is_carried_on_by_its_velocity() -> None:
    fresh = at(2.0)
    x, y, z = fresh.position
    u, v, w = fresh.velocity
    aged = PeerState((x - 0.2 * u, y - 0.2 * v, z), (u, v, w), age_s=0.2)
    now = SMOOTH.reference(at(0.0), {"b": fresh}, "a", center=CENTER)
    then = SMOOTH.reference(at(0.0), {"b": aged}, "a", center=CENTER)
    assert then.positions == pytest.approx(now.positions)


def test_the_way_to_the_slot_begins_at_the_drone_and_keeps_to_the_speed_limit() -> None:
    me = PeerState((90.0, 40.0, 10.0))
    reference = SMOOTH.reference(me, {"b": at(1.0), "c": at(-2.0)}, "a", center=CENTER)
    assert reference.positions[0] == pytest.approx(me.position)
    speeds = np.hypot(reference.velocities[:, 0], reference.velocities[:, 1])
    assert speeds[0] == pytest.approx(0.85 * 8.0)
    assert np.abs(reference.velocities[:, 2]).max() <= 2.0
    gaps = np.hypot(*(reference.positions[:, :2] - CENTER[:2]).T)
    assert gaps[-1] < gaps[0] - 20.0


def test_the_radius_leaves_room_for_the_separation() -> None:
    drones = {f"d{k}": at(2.0 * pi * k / 8.0) for k in range(8)}
    me = drones.pop("d0")
    reference = SMOOTH.reference(me, drones, "d0", center=CENTER, radius_m=2.0)
    radius = hypot(reference.positions[-1, 0] - CENTER[0], reference.positions[-1, 1] - CENTER[1])
    assert radius >= minimum_radius(8, 3.0) > 3.9
    assert minimum_radius(2, 3.0) == pytest.approx(1.5)
    assert minimum_radius(1, 3.0) == 0.0
