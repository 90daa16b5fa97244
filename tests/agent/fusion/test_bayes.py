"""The Bayesian estimator on made-up flights, whose cones and counts come from a model of their own."""

from __future__ import annotations

import math
import random

import msgspec
import numpy as np
import pytest

from agent.frames.graph import FrameGraph
from agent.fusion.engine import Fusion
from agent.fusion.registry import estimator_named
from protocol.messages import ConeOrder, Counts

BACKGROUND_PS = np.array([1.5, 0.03, 0.01])
AREAS_MM2 = np.array([20.0, 2.9, 2.0])


def fusion_of(mission):
    return Fusion(mission, FrameGraph.from_launch_layout(mission), estimator_named("bayes", mission))


def entries_of(kit, mission, rng, seconds, source_at, activity_bq):
    """Exposures and cones of drones on lanes 15 m apart, then around the source; ``source_at`` None: background only."""
    entries = []
    ids = [drone.id for drone in mission.drones]
    for number in range(int(seconds / 0.5)):
        time_s = number * 0.5
        for index, drone in enumerate(ids):
            phase = time_s * 0.25 + 2.0 * math.pi * index / len(ids)
            middle = (50.0, 50.0) if source_at is None else source_at(time_s)
            radius = max(12.0, 45.0 - time_s)
            place = np.array([middle[0] + radius * math.cos(phase), middle[1] + radius * math.sin(phase), 3.0])
            flux, cones = 0.0, 0
            if source_at is not None:
                distance = float(np.linalg.norm(np.array([*middle, 0.0]) - place))
                flux = activity_bq * 0.851 / (4e6 * math.pi * distance**2) * math.exp(-0.0093 * distance)
                cones = int(rng.poisson(0.55 * flux * 0.5))
            expected = (AREAS_MM2 * flux + BACKGROUND_PS) * 0.5
            counts = Counts(*(int(k) for k in rng.poisson(expected)))
            exposure = kit.exposure_entry(mission, time_s, place, drone=drone, sequence=10 * number, duration_s=0.5)
            entries.append(msgspec.structs.replace(exposure, counts=counts))
            for k in range(cones):
                entries.append(_cone(kit, mission, rng, time_s, place, (*middle, 0.0), drone, 10 * number + 1 + k))
    return entries


def _cone(kit, mission, rng, time_s, place, target, drone, sequence):
    """A cone of which one in eight points anywhere, and whose orders are mixed up in three of ten."""
    if rng.random() < 0.12:
        target = place + rng.normal(size=3)
    axis, theta = kit.cone_towards(rng, place, target, 0.1)
    cone = kit.cone_entry(mission, time_s + 0.2, place, axis, theta, drone=drone, sequence=sequence, probability=0.7)
    if rng.random() < 0.3:
        right, wrong = cone.orders
        cone = msgspec.structs.replace(
            cone, orders=(ConeOrder(wrong.axis, wrong.theta_rad, 0.1, 0.7), ConeOrder(right.axis, right.theta_rad, 0.1, 0.3))
        )
    return cone


def hypotheses(kit, mission, entries, seconds):
    """Times and hypotheses twice a second, entries coming in as they are measured."""
    fusion = fusion_of(mission)
    waiting = sorted(entries, key=lambda entry: entry.entry_id)
    found = []
    for number in range(1, int(seconds * 2)):
        now_ns = kit.T0_NS + number * 500_000_000
        while waiting and waiting[0].stamp_ns < now_ns - 500_000_000:
            kit.feed(fusion, [waiting.pop(0)])
        fusion.advance(now_ns, 10**6)
        if fusion.hypothesis is not None:
            found.append((number * 0.5, fusion.hypothesis))
    return found


def errors_of(found, source_at):
    return np.array([hypothesis.position[:2] - source_at(time_s) for time_s, hypothesis in found])


def test_a_static_source_is_found_with_its_activity(kit):
    """Two minutes of three drones at 12 m: what the counts allow is 0.1-0.2 m (reference: Fisher bound 0.11 m)."""
    mission = kit.mission_of()
    medians, shares = [], []
    for seed in range(3):
        entries = entries_of(kit, mission, np.random.default_rng(seed), 120.0, lambda _: (35.0, 62.0), 2e9)
        found = hypotheses(kit, mission, entries, 120.0)
        medians.append(np.median(np.linalg.norm(errors_of(found[-100:], lambda _: np.array([35.0, 62.0])), axis=1)))
        shares.append(found[-1][1].activity_bq / 2e9)
    assert np.median(medians) < 0.3
    assert np.all(np.abs(np.array(shares) - 1.0) < 0.25)  # the areas that it assumes are not those of these counts


def test_a_moving_source_is_followed_without_lag(kit):
    """1 m/s on the paper's circle. The paper's filter is 4-14 m behind (test_convergence)."""
    mission = kit.mission_of()

    def source_at(time_s):
        return np.array([50.0 + 40.0 * math.cos(time_s / 40.0), 50.0 + 40.0 * math.sin(time_s / 40.0)])

    entries = entries_of(kit, mission, np.random.default_rng(5), 150.0, source_at, 3e9)
    found = hypotheses(kit, mission, entries, 150.0)[-150:]
    errors = errors_of(found, source_at)
    assert np.median(np.linalg.norm(errors, axis=1)) < 1.5
    speeds = [np.linalg.norm(hypothesis.velocity) for _, hypothesis in found]
    assert np.median(speeds) == pytest.approx(1.0, abs=0.3)


def test_background_alone_is_no_source(kit):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(7), 180.0, None, 0.0)
    assert hypotheses(kit, mission, entries, 180.0) == []


def test_the_order_of_arrival_leaves_no_trace(kit):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(9), 40.0, lambda _: (40.0, 60.0), 3e9)
    end_ns = kit.T0_NS + 41_000_000_000
    once = fusion_of(mission)
    kit.feed(once, sorted(entries, key=lambda entry: entry.entry_id))
    assert kit.settle(once, end_ns) is not None
    shuffled = entries + entries[:40]
    random.Random(1).shuffle(shuffled)
    pieces = fusion_of(mission)
    for number, entry in enumerate(shuffled):
        kit.feed(pieces, [entry])
        if number % 50 == 0:
            pieces.advance(kit.T0_NS + number * 100_000_000, 30)
    kit.settle(pieces, end_ns, 70)
    assert once.digest == pieces.digest
    assert kit.same_bits(once.hypothesis, pieces.hypothesis)
