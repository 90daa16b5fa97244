"""Surveys of contaminated ground, with counts of the simulation's photons (``common.lawns``), not by the estimator's kernels."""

from __future__ import annotations

import random
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import Polygon

from common.lawns import background_ps, kernel
from radron.agent.config.estimators import FieldEstimatorConfig, FusionConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.field.estimator import FieldEstimator
from radron.agent.fusion.field.grid import MARGIN_M
from radron.agent.fusion.observation import CountObservation
from radron.protocol.entries import EntryId

SIDE_M = 40.0
DRONES = ("a", "b")
NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
STEP_S = 0.5
POINT_M = 0.5
NOWHERE = Transform(0.0, (0.0, 0.0, 0.0))


def mission_of(**field):
    corners = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
    return MissionConfig(
        name="lawn",
        drones=tuple(DroneInMission(id=name) for name in DRONES),
        area=AreaConfig(polygon_m=corners),
        fusion=FusionConfig(estimator="field", ground="soil", field=FieldEstimatorConfig(**field)),
    )


def estimator_of(**field):
    mission = mission_of(**field)
    return FieldEstimator(mission, Polygon(mission.area.polygon_m))


def lanes(height_m, times=2, spacing_m=4.0, speed_mps=3.0):
    """Places (N, 3) of two drones, one half of the area each, every ``STEP_S``."""
    ways = []
    for drone in range(len(DRONES)):
        x = np.arange(drone * SIDE_M / 2 + spacing_m / 2, (drone + 1) * SIDE_M / 2, spacing_m)
        corners = np.array([(east, north) for i, east in enumerate(x) for north in ((0, SIDE_M) if i % 2 == 0 else (SIDE_M, 0))])
        corners = np.concatenate([corners if k % 2 == 0 else corners[::-1] for k in range(times)]).astype(float)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
        there = np.arange(0.25, along[-1] / speed_mps, STEP_S) * speed_mps
        level = [np.interp(there, along, corners[:, axis]) for axis in range(2)]
        ways.append(np.stack((*level, np.full(len(there), height_m)), axis=1))
    return ways


def observation(drone, number, place, counts, time_s):
    partial, full = (int(count) for count in counts)
    end_ns = START_NS + round(time_s * NS)
    identity = EntryId("0" * 32, end_ns, drone, "00000000000000b1", number)
    three = np.array([partial + full, full, 0], float)
    return CountObservation(end_ns, end_ns - NS // 4, tuple(place), STEP_S, three, 0.2, 0.02, NOWHERE, identity, 0)


def survey(activity, seed=1, height_m=3.0, times=2):
    """Observations over ground of this activity per area (a function of x and y, Bq/m2, also 10 m beyond the area)."""
    rng = np.random.default_rng(seed)
    line = np.arange(POINT_M / 2 - MARGIN_M, SIDE_M + MARGIN_M, POINT_M)
    points = np.stack([part.ravel() for part in np.meshgrid(line, line)], axis=1)
    per_point = activity(points[:, 0], points[:, 1]) * POINT_M**2
    points, per_point = points[per_point > 0.0], per_point[per_point > 0.0]
    found = []
    for drone, way in zip(DRONES, lanes(height_m, times), strict=True):
        for number, place in enumerate(way):
            away = np.hypot(*(points - place[:2]).T)
            rate = background_ps(height_m) + per_point @ kernel("Cs-137", height_m, away)
            found.append(observation(drone, number, place, rng.poisson(rate * STEP_S), (number + 1) * STEP_S))
    return found


def folded(estimator, observations, until_s=None):
    """The state after all observations, in steps of the grid, and a last one when every fit is due."""
    state = estimator.initial(START_NS)
    by_step = {}
    for one in observations:
        by_step.setdefault(one.stamp_ns // (NS // 2), []).append(one)
    for index in sorted(by_step):
        state = estimator.step(state, step_of(index), by_step[index])
    last = (max(by_step) // 20 + 1) * 20 if until_s is None else until_s * 2 + START_NS // (NS // 2)
    return estimator.step(state, step_of(last), [])


def step_of(index):
    return GridStep(index, index * (NS // 2), (index + 1) * (NS // 2))


def shuffled(observations, seed=3):
    result = list(observations)
    random.Random(seed).shuffle(result)
    return result


@pytest.fixture(scope="session")
def lawn():
    return SimpleNamespace(
        survey=survey, folded=folded, estimator_of=estimator_of, mission_of=mission_of, shuffled=shuffled, step_of=step_of,
        side_m=SIDE_M, start_ns=START_NS, lanes=lanes, observation=observation,
    )  # fmt: skip
