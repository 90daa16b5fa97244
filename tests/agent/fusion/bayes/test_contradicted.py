"""Measurements of a vehicle with a wrong own position estimate, beside vehicles with right ones."""

import math

import numpy as np
import pytest

from radron.agent.fusion.bayes import contradicted
from radron.agent.fusion.bayes.contradicted import MAX_REJECTIONS, is_contradicted, rejected
from support.flights.bayes import SOURCE, entries_of, errors_of, flown, fusion_of, hypotheses

S = 1_000_000_000
OFF_M = (11.0, -7.0)


@pytest.fixture
def off(kit):
    """A flight in which c is 13 m off from 30 to 70 s, as by spoofed satellites, and does not know."""
    mission = kit.mission_of()
    return mission, flown(
        kit, mission, of="c", since_s=30.0, until_s=70.0, sigma_m=0.3, off_m=OFF_M, seconds=110.0, activity_bq=9e9
    )


def errors_after(kit, mission, entries, since_s, until_s):
    found = [(time_s, each) for time_s, each in hypotheses(kit, mission, entries, until_s) if time_s > since_s]
    return np.linalg.norm(errors_of(found, lambda _: SOURCE), axis=-1)


def test_who_is_contradicted_does_not_take_the_track_along(kit, off, monkeypatch):
    mission, entries = off
    least = errors_after(kit, mission, entries, 40.0, 70.0).max()
    monkeypatch.setattr(contradicted, "MAX_REJECTIONS", math.inf)
    believed = errors_after(kit, mission, entries, 40.0, 70.0).max()
    assert least < 0.5
    assert believed > 3.0 * least


def test_who_is_right_again_counts_again(kit, off):
    mission, entries = off

    def left_out(until_s):
        """Drones whose measurements do not count at that time, as published."""
        fusion, now_ns = fusion_of(mission), kit.T0_NS + until_s * S
        kit.feed(fusion, [entry for entry in entries if entry.stamp_ns < now_ns - S])
        return kit.settle(fusion, now_ns).contradicted

    assert left_out(60) == ("c",)
    assert left_out(108) == ()


@pytest.mark.parametrize(("drones", "left_out"), [(("a", "b", "c"), {("c",), ()}), (("a", "c"), {()})])
def test_of_three_one_with_a_thousand_cones_that_point_nowhere_is_left_out(kit, drones, left_out):
    """As sent by an impostor with c's key: the swarm lost its source within 2 s, and went home."""
    mission = kit.mission_of(drones)
    entries = list(entries_of(kit, mission, np.random.default_rng(5), 50.0, lambda _: SOURCE, 3e9))
    up, many = (0.0, 0.0, 1.0), np.linspace(40.0, 44.0, 1_000)
    place = (*(SOURCE + 6.0), 3.0)
    entries += [
        kit.cone_entry(mission, time_s, place, up, 0.3, drone="c", sequence=number, boot="b" * 16)
        for number, time_s in enumerate(many)
    ]
    found = hypotheses(kit, mission, sorted(entries, key=kit.since_s), 50.0)
    assert {told.contradicted for time_s, told in found if time_s > 40.0} == left_out
    if len(drones) > 2:
        times = [time_s for time_s, _ in found if time_s > 40.0]
        assert np.diff(times).max() < 0.6  # the track goes on
        assert np.linalg.norm(errors_of([one for one in found if one[0] > 41.0], lambda _: SOURCE), axis=-1).max() < 1.0


def left_out_of(kit, far_m):
    """A source leaps by so much, at 6 m/s from 40 s on, while three cameras circle where it was: time, drones left out, error."""
    mission = kit.mission_of()

    def at(time_s):
        return SOURCE + np.array([min(6.0 * max(0.0, time_s - 40.0), far_m), 0.0])

    entries = entries_of(kit, mission, np.random.default_rng(5), 75.0, at, 3e9, around=SOURCE)
    found = hypotheses(kit, mission, entries, 75.0)
    errors_m = np.linalg.norm(errors_of(found, at), axis=-1)
    return [(time_s, told.contradicted, error_m) for (time_s, told), error_m in zip(found, errors_m, strict=True)]


def test_a_source_that_moves_off_has_nobody_contradicted(kit):
    """The camera that it passes is rejected twice."""
    flight = left_out_of(kit, 6.0)
    assert {drones for _, drones, _ in flight} == {()}
    assert flight[-1][2] < 1.0


def test_a_source_that_leaps_past_a_camera_is_found_again_without_it(kit):
    flight = left_out_of(kit, 12.0)
    assert {drones for _, drones, _ in flight} == {(), ("b",)}
    assert max(time_s for time_s, drones, _ in flight if drones) < 60.0
    assert max(error_m for time_s, _, error_m in flight if time_s > 56.0) < 2.0


def struck(times, vehicle=0, begun=None):
    rejections = begun or {}
    for time_s in times:
        rejections = rejected(rejections, vehicle, int(time_s * S))
    return rejections


@pytest.mark.parametrize(
    ("times", "heard_s", "expected"),
    [
        ((1, 2, 3, 4), (4, 4), True),
        ((1, 2, 3), (4, 4), False),  # the first has faded a little
        ((1, 2, 3, 4), (4,), False),  # between two drones it cannot be decided which is right
        ((1, 2, 3, 4), (4, -2), False),  # the other drone's link is lost
        ((1, 31, 61, 91), (91, 91), False),  # each fades before the next one comes
    ],
)
def test_it_takes_several_rejections_and_two_others(times, heard_s, expected):
    sure = {vehicle: int(time_s * S) for vehicle, time_s in enumerate(heard_s, start=1)}
    assert is_contradicted(struck(times), sure, 0, int(times[-1] * S)) is expected


def test_others_that_are_rejected_too_do_not_contradict_anybody():
    rejections = struck((1.0, 2.0), vehicle=1, begun=struck((1, 2, 3, 4)))
    assert not is_contradicted(rejections, {1: 4 * S, 2: 4 * S}, 0, 4 * S)
    assert is_contradicted(rejections, {1: 4 * S, 2: 4 * S, 3: 4 * S}, 0, 4 * S)


def test_it_ends_once_nothing_has_been_rejected_for_a_while():
    sure = {1: 60 * S, 2: 60 * S}
    rejections = struck((1, 1, 1, 1, 1))
    ends = [second for second in range(1, 60) if not is_contradicted(rejections, sure, 0, second * S)]
    assert ends
    assert ends[0] == pytest.approx(1 + 30 * math.log(5 / MAX_REJECTIONS), abs=1.0)
