"""Simulated flight of a swarm in one process, faster than real time, reproducible from a seed.

Every drone is a full agent: its own pilot, log, fusion and tracker. Messages between agents pass through the codec and the
simulated radio; the world reaches them as telemetry and pixel hits. The agents never see the truth.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence

from radron.agent.pilot import Pilot
from radron.sim.lockstep.world import World
from radron.sim.result import Flight
from radron.sim.scenario import Scenario, chosen
from radron.sim.scoring.moment import Observer

Progress = Callable[[float, str], None]


def fly(
    scenario: Scenario,
    seed: int,
    estimator: str | None = None,
    listen: Sequence[str] = (),
    law: str | None = None,
    progress: Progress | None = None,
    watch: Observer | None = None,
) -> Flight:
    """Simulate one flight of a scenario, and return its scores and time series.

    Args:
        scenario: the mission and the truth.
        seed: seed of all random numbers; equal seeds give equal results, bit for bit, except the wall times (of the flight
            itself, without setup).
        estimator: replaces the mission's own.
        listen: estimators that fuse the log on the first drone without influence on the flight.
        law: flocking law (spacing of the drones on their circle), replaces the mission's own.
        progress: called about every simulated second with the time and the swarm's state.
        watch: sees the world after every tick (time step), and ends the flight by returning True.

    Raises:
        ConfigError: an unknown estimator or law, an estimator where the source's position is given, a fault that lockstep cannot
            play.
    """
    world = World(chosen(scenario, estimator, law), seed, listen, Pilot)
    started = time.perf_counter()
    _run(world, watch, progress)
    wall_s = time.perf_counter() - started
    recorder = world.recorder
    return Flight(recorder.result(seed, wall_s), recorder.trace(), recorder.listened(seed, wall_s))


def watched(scenario: Scenario, seed: int, watch: Observer, make: Callable[..., Pilot] = Pilot) -> None:
    """Simulate one flight for an observer alone, without scores.

    ``make``: function that makes the pilots (decision part of the agents), as ``Pilot``. Raises ConfigError as in :func:`fly`.
    """
    _run(World(scenario, seed, (), make), watch)


def _run(world: World, watch: Observer | None, progress: Progress | None = None) -> None:
    gc.disable()  # a flight makes hardly any reference cycles, and the search for them takes 2 % of its time
    try:
        end = False
        while not end:
            end = world.tick()
            if watch is not None:
                end = watch(world.moment()) or end
            if progress is not None and world.ticks % 20 == 0:
                progress(world.time_s, world.describe())
    finally:
        gc.enable()
        world.close()
