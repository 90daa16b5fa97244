"""Entries and missions for the tests of the fusion, with independent geometry: made without the code under test."""

from __future__ import annotations

import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from radron.agent.config.estimators import FusionConfig, GivenHypothesisConfig, PaperEstimatorConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.protocol.codec import encode
from radron.protocol.entries import Cone, ConeOrder, Counts, Entry, Exposure, PoseSample
from support.flights.fusions import fusion_of

T0_NS = 1_700_000_000_000_000_000
BOOT = "00000000000000b1"
END_NS = 40_000_000_000  # after ``T0_NS``: all ``entries`` are older


def mission_of(drones=("a", "b", "c"), estimator="paper", schedule=None, grid_s=0.5, **paper):
    return MissionConfig(
        name="test",
        drones=tuple(drone if isinstance(drone, DroneInMission) else DroneInMission(id=drone) for drone in drones),
        area=AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
        fusion=FusionConfig(
            estimator=estimator,
            grid_s=grid_s,
            paper=PaperEstimatorConfig(**paper),
            given=None if schedule is None else GivenHypothesisConfig(schedule=schedule),
        ),
    )


def cone_entry(mission, time_s, apex, axis, theta, *, drone="a", sequence=0, epoch=0, probability=0.8, boot=BOOT):
    """A cone whose first order is the right one; the second looks the other way."""
    axis = tuple(float(value) for value in np.asarray(axis, dtype=float))
    orders = (
        ConeOrder(axis, float(theta), 0.1, probability),
        ConeOrder(tuple(-value for value in axis), float(theta), 0.1, 1.0 - probability),
    )
    return Cone(
        mission=mission.mission_id,
        stamp_ns=T0_NS + round(time_s * 1e9),
        drone=drone,
        boot=boot,
        sequence=sequence,
        epoch=epoch,
        apex_m=tuple(float(value) for value in apex),
        apex_sigma_m=0.1,
        yaw_sigma_rad=0.01,
        orders=orders,
        energies_kev=(200.0, 460.0),
        energy_sigmas_kev=(5.0, 9.0),
        separation_mm=1.5,
    )


def exposure_entry(mission, time_s, position, *, drone="a", sequence=0, duration_s=0.25):
    """Poses at 10 Hz, as published."""
    start_ns = T0_NS + round(time_s * 1e9)
    samples = int(duration_s * 10) + 1
    pose = tuple(float(value) for value in position)
    return Exposure(
        mission=mission.mission_id,
        stamp_ns=start_ns,
        drone=drone,
        boot=BOOT,
        sequence=sequence,
        epoch=0,
        end_ns=start_ns + round(duration_s * 1e9),
        live_time_s=duration_s,
        counts=Counts(5, 0, 1),
        poses=tuple(PoseSample(round(i * 1e8), pose, (1.0, 0.0, 0.0, 0.0)) for i in range(samples)),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )


def cone_towards(rng, apex, target, arm_rad):
    """axis and theta of a cone from apex whose surface misses the target by an angle of N(0, arm_rad)."""
    line = np.asarray(target, dtype=float) - apex
    line /= np.linalg.norm(line)
    theta = rng.uniform(0.4, 1.6)
    helper = rng.normal(size=3)
    side = np.cross(line, helper)
    side /= np.linalg.norm(side)
    axis = math.cos(theta) * line + math.sin(theta) * side
    return axis, float(np.clip(theta + rng.normal(0.0, arm_rad), 0.01, 3.1))


def flight(mission, rng, seconds, source_at, *, rate_hz=2.0, arm_rad=0.08, radius=12.0):
    """Cones of drones that circle the source at 3 m height and 3 m/s, Poisson in time."""
    entries: list[Entry] = []
    drones = [drone.id for drone in mission.drones]
    sequence = dict.fromkeys(drones, 0)
    time_s = 0.0
    while (time_s := time_s + rng.exponential(1.0 / rate_hz)) < seconds:
        index = int(rng.integers(len(drones)))
        x, y = source_at(time_s)
        phase = time_s * 3.0 / radius + 2.0 * math.pi * index / len(drones)
        apex = np.array([x + radius * math.cos(phase), y + radius * math.sin(phase), 3.0])
        axis, theta = cone_towards(rng, apex, (x, y, 0.0), arm_rad)
        name = drones[index]
        entries.append(cone_entry(mission, time_s, apex, axis, theta, drone=name, sequence=sequence[name]))
        sequence[name] += 1
    return entries


def same_bits(left, right):
    """Whether two hypotheses are equal to the last bit."""
    if left is None or right is None:
        return left is right
    return _bits(left) == _bits(right)


def _bits(hypothesis):
    arrays = (hypothesis.position, hypothesis.covariance, hypothesis.velocity)
    return (*(array.tobytes() for array in arrays), hypothesis.stamp_ns, hypothesis.cones, hypothesis.x0_stamp_ns)


def agrees(fusion, other):
    """Whether two fusions have the same log and the same hypothesis."""
    return fusion.digest == other.digest and same_bits(fusion.hypothesis, other.hypothesis)


def settle(fusion, now_ns, budget=400):
    """Advance until nothing is left to replay."""
    fusion.advance(now_ns, budget)
    while fusion.pending:
        fusion.advance(now_ns, budget)
    return fusion.hypothesis


def since_s(entry):
    """Seconds from the beginning to its stamp."""
    return 1e-9 * (entry.stamp_ns - T0_NS)


def feed(fusion, entries):
    return [fusion.receive(entry, encode(entry)) for entry in entries]


@pytest.fixture(scope="session")
def kit():
    """The helpers of this file (test files are imported without packages, so they come as a fixture)."""
    names = (mission_of, cone_entry, exposure_entry, cone_towards, flight, same_bits, agrees, settle, feed, since_s)
    return SimpleNamespace(T0_NS=T0_NS, BOOT=BOOT, END_NS=END_NS, **{function.__name__: function for function in names})


@pytest.fixture(scope="session")
def mission():
    """A mission in which x0 takes six cones."""
    return mission_of(initial_cones=6)


@pytest.fixture(scope="session")
def entries(mission):
    """Cones and exposures of 30 s, some cones at the very same time."""
    cones = flight(mission, np.random.default_rng(11), 30.0, lambda time_s: (40.0 + time_s, 60.0))
    twins = [msgspec.structs.replace(cone, boot="00000000000000b2", separation_mm=2.0) for cone in cones[5:8]]
    exposures = [exposure_entry(mission, i / 2, (1.0, 2.0, 3.0), sequence=1000 + i) for i in range(20)]
    return sorted([*cones, *twins, *exposures], key=lambda entry: entry.entry_id)


@pytest.fixture(scope="session")
def in_order(mission, entries):
    """The reference: every entry in its order, folded in one go."""
    fusion = fusion_of(mission)
    assert all(feed(fusion, entries))
    settle(fusion, T0_NS + END_NS)
    assert fusion.hypothesis.cones > 40
    return fusion
