"""The swarm in one process, faster than real time, reproducible from a seed.

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
    """Fly one mission.

    Args:
        scenario: the mission and the truth.
        seed: of all random numbers of the run; the same seed gives the same result, bit for bit, except the wall times (of the
            flight itself, without setup).
        estimator: replaces the mission's own.
        listen: estimators that fuse the same log on the first drone without influence on the flight.
        law: flocking law, replaces the mission's own.
        progress: called about every simulated second with the time and the swarm's state.
        watch: sees the world after every tick, and ends the flight by returning True.

    Raises:
        ConfigError: an unknown estimator or law, an estimator where the hypothesis is given, a fault that lockstep cannot play.
    """
    world = World(chosen(scenario, estimator, law), seed, listen, Pilot)
    started = time.perf_counter()
    _run(world, watch, progress)
    wall_s = time.perf_counter() - started
    recorder = world.recorder
    return Flight(recorder.result(seed, wall_s), recorder.trace(), recorder.listened(seed, wall_s))


def watched(scenario: Scenario, seed: int, watch: Observer, make: Callable[..., Pilot] = Pilot) -> None:
    """Fly one mission for an observer alone, without its result; errors as in ``fly``. ``make``: factory of pilots, as
    ``Pilot``.
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
