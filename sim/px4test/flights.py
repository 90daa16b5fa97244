"""The flights of a flight test and their criteria, all by the vehicles' true states."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from math import dist
from pathlib import Path

from radron.protocol.messages import Action, Stage
from radron.protocol.stages import STEERED
from radron.sim.campaign.report import write_flight
from radron.sim.live.course import SETTLE_S, Course
from radron.sim.live.operator import Operator
from radron.sim.live.swarm import Swarm
from radron.sim.live.worldlink import Order
from radron.sim.live.worldprocess import LiveError
from radron.sim.px4test.rows import Checks, Row
from radron.sim.px4test.witness import Moment, Witness, least_distance_m, speed_mps
from radron.sim.result import Flight
from radron.sim.scoring.moment import OFF_GROUND_M

SEPARATION_M = 3.0  # required by the missions
COLLISION_M = 1.0  # between the centres of two vehicles
HOME_M = 3.0  # from the launch place: position errors at both ends of the flight
ERROR_M = 2.0  # of the source estimate: well inside a circle of 10 m
FAILSAFE_S, SETPOINTS_S = (
    1.2,
    0.1,
)  # PX4's after the last setpoint; by which the mode is known later, and the last one sent earlier
HEARTBEAT_S = 1.1  # a real vehicle's mode comes with its heartbeat; the earlier text does not contain it
RETURN_S = 2.0
HOLD_S, STOPPING_S = 9.0, 4.0
STILL_MPS, STILL_M = 1.0, 2.0  # the true vehicle wanders by 0.2 to 0.6 m (1 sigma) with the noise of its estimate
OBEY_S = 5.0
BLIND_S = 20.0  # without satellites: the filter gives up after about 5 s
KNOWN_M, KNOWN_S = 3.0, 2.0  # position error up to which a vehicle may be flown; settling time after satellites are back
AGAIN_S = 40.0  # time until all can be started again; a landing may be noticed late


async def missions(swarm: Swarm, seed: int, patience_s: float, folder: Path) -> list[Row]:
    """Fly the mission, and a second one without a restart, in which the operator commands hold and resume; return the results."""
    operator = swarm.operator
    await operator.get_ready(patience_s)
    witness, first = Witness(operator), Checks("the mission")
    operator.view.say("the mission")
    await _judge(first, swarm, witness.moments, await Course(swarm.scenario, seed, operator).mission_flown(), folder / "mission")
    second, hold = Checks("a second mission, nothing restarted"), Checks("an operator's hold and resume")
    try:
        await operator.get_ready(AGAIN_S)
    except LiveError as error:
        second.ask(False, str(error))
        hold.ask(False, "not flown")
        return [first.row(), second.row(), hold.row()]
    operator.view.say("a second mission on the same vehicles, by the same agents")
    witness = Witness(operator)
    holding = asyncio.create_task(_hold(operator, witness, hold))
    try:
        flight = await Course(swarm.scenario, seed, operator).mission_flown()
    finally:
        holding.cancel()
    hold.ask(holding.done() and not holding.cancelled(), "the drones were down before it was over")
    await _judge(second, swarm, witness.moments, flight, folder / "second")
    operator.world.order(Order.CAMERAS_OFF)
    second.ask(await operator.until(operator.observer.agreed, SETTLE_S), "the agents' logs differ in the end")
    return [first.row(), second.row(), hold.row()]


async def killed(swarm: Swarm, seed: int, patience_s: float, folder: Path) -> list[Row]:
    """Fly a mission in which one agent and its watchdog are killed in flight; return the results."""
    operator, checks, victim = swarm.operator, Checks("an agent killed in flight (kill -9)"), 1
    async with _circling(swarm, seed, patience_s) as (witness, flying):
        operator.view.say(f"kill -9 of the agent of {operator.observer.agents[victim].drone}")
        struck_s = witness.now.time_s
        swarm.agents.signal(operator.observer.agents[victim].drone, signal.SIGKILL)
        flight = await flying
    late_s = SETPOINTS_S if operator.world.truth.vehicles[victim].truth == "world" else HEARTBEAT_S
    checks.at_most("failsafe after s", witness.first_s(struck_s, lambda now: now.failsafe[victim]), FAILSAFE_S + SETPOINTS_S)
    checks.at_most("return after s", witness.first_s(struck_s, lambda now: now.modes[victim] == "return"), RETURN_S + late_s)
    await _judge(checks, swarm, witness.moments, flight, folder, failsafe=victim)
    return [checks.row()]


async def gnss_lost(swarm: Swarm, seed: int, patience_s: float, folder: Path) -> list[Row]:
    """Fly a mission in which one vehicle loses its satellites until its filter gives up; return the results.

    All drones circle meanwhile; then the satellites return.
    """
    operator, checks, victim = swarm.operator, Checks("GNSS lost for 20 s"), 2
    async with _circling(swarm, seed, patience_s) as (witness, flying):
        operator.view.say(f"{operator.observer.agents[victim].drone} gets no satellites for {BLIND_S:g} s")
        lost_s = witness.now.time_s
        operator.world.order(Order.SATELLITES_OFF, victim)
        await operator.until(lambda: witness.now.time_s > lost_s + BLIND_S, None)
        operator.world.order(Order.SATELLITES_ON, victim)
        back_s = witness.now.time_s
        operator.view.say("the satellites are back")
        flight = await flying
    blind = witness.since(lost_s)
    checks.figures["own position off by up to m"] = round(max(now.own_error_m[victim] for now in blind), 2)
    down_s = witness.first_s(lost_s, lambda now: not now.flies(victim))
    if down_s is not None:
        checks.figures["down after s"] = round(down_s, 1)
        risen = [now for now in witness.since(lost_s + down_s) if now.position[victim, 2] > 2.0 * OFF_GROUND_M]
        checks.ask(not risen, "it took off again from where it had come down")
    steered = [now for now in witness.since(back_s + KNOWN_S) if now.flies(victim) and now.modes[victim] == "offboard"]
    wrong_m = max((now.own_error_m[victim] for now in steered), default=0.0)
    checks.ask(wrong_m <= KNOWN_M, f"it was steered while {wrong_m:.1f} m from its own estimate")
    await _judge(checks, swarm, witness.moments, flight, folder, failsafe=victim, strays=victim)
    return [checks.row()]


@asynccontextmanager
async def _circling(swarm: Swarm, seed: int, patience_s: float) -> AsyncIterator[tuple[Witness, asyncio.Task[Flight]]]:
    """Fly a mission until all drones have circled for 3 s; yield its witness, and its flight, which ends with the context.

    Raises:
        LiveError: the swarm does not get ready, or the mission is over before.
    """
    operator = swarm.operator
    await operator.get_ready(patience_s)
    witness = Witness(operator)
    flying = asyncio.create_task(Course(swarm.scenario, seed, operator).mission_flown())
    try:
        await _tracking(operator, witness, 3.0, flying)
        yield witness, flying
    finally:
        flying.cancel()


async def _judge(
    checks: Checks,
    swarm: Swarm,
    moments: Sequence[Moment],
    flight: Flight,
    folder: Path,
    failsafe: int | None = None,
    strays: int | None = None,
) -> None:
    """Check the criteria of every flight. ``failsafe``: drone with a permitted failsafe; ``strays``: drone that may land
    elsewhere.
    """
    await swarm.operator.until(lambda: not any(moments[-1].armed), HEARTBEAT_S + SETPOINTS_S)  # disarming shows in a heartbeat
    result, end = flight.result, moments[-1]
    folder.mkdir(parents=True, exist_ok=True)
    await asyncio.to_thread(write_flight, folder, flight)  # drawing takes seconds, during which agents must be heard
    checks.at_most("source found after s", result.time_to_x0_s, 60.0)
    checks.at_most("median error of the source m", result.error_median_m, ERROR_M)
    checks.ask(not result.lost, "the source was lost")
    flat_m, space_m = least_distance_m(moments)
    if failsafe is None:
        checks.at_least("least distance m", flat_m, SEPARATION_M)
        checks.at_most("breaches of the fence", result.fence_breaches, 0)
    else:
        checks.at_least("least distance in space m", space_m, COLLISION_M)
    for drone, member in enumerate(swarm.scenario.mission.drones):
        x, y, z = end.position[drone].tolist()
        checks.ask(
            z < OFF_GROUND_M and not end.armed[drone], f"{member.id} is not down: {z:.1f} m high, armed: {end.armed[drone]}"
        )
        away_m = dist((x, y), member.origin_m[:2])
        if drone != strays:
            checks.ask(away_m <= HOME_M, f"{member.id} landed {away_m:.1f} m from its launch place")
        if drone != failsafe:
            taken = any(now.failsafe[drone] for now in moments)
            checks.ask(not taken, f"the failsafe of {member.id} took over")


async def _tracking(operator: Operator, witness: Witness, for_s: float, flying: asyncio.Task[Flight]) -> None:
    """Wait until all have circled for this time.

    Raises:
        LiveError: the mission ends earlier.
    """
    since_s: float | None = None

    def circles() -> bool:
        nonlocal since_s
        if not witness.moments or any(stage is not Stage.TRACK for stage in witness.now.stages):
            since_s = None
        elif since_s is None:
            since_s = witness.now.time_s
        return flying.done() or (since_s is not None and witness.now.time_s - since_s > for_s)

    await operator.until(circles, None)
    if flying.done():
        flying.result()
        raise LiveError("the mission was over before all had circled")


async def _hold(operator: Operator, witness: Witness, checks: Checks) -> None:
    """Command hold while all circle, check that they stand still, and resume."""
    agents = operator.observer.agents
    await operator.until(lambda: all(agent.stage is Stage.TRACK for agent in agents), None)
    asked_s = witness.now.time_s
    await operator.until(lambda: witness.now.time_s > asked_s + 5.0, None)
    operator.view.say("the operator's hold")
    asked_s = witness.now.time_s
    obeyed = await operator.command(Action.HOLD, lambda: all(agent.stage is Stage.HOLD for agent in agents), OBEY_S)
    checks.ask(obeyed, f"hold was not obeyed by all within {OBEY_S:g} s")
    await operator.until(lambda: witness.now.time_s > asked_s + HOLD_S, None)
    still = witness.since(asked_s + STOPPING_S)
    count = range(len(agents))
    moved = max(dist(now.position[drone], still[0].position[drone]) for now in still for drone in count)
    checks.at_most("speed in hold m/s", max(speed_mps(now, drone) for now in still for drone in count), STILL_MPS)
    checks.at_most("moved in hold m", moved, STILL_M)
    operator.view.say("the operator's resume")
    asked_s = witness.now.time_s
    await operator.command(Action.RESUME, lambda: all(agent.stage in STEERED for agent in agents), OBEY_S)
    steered = ["offboard"] * len(agents)
    await operator.until(lambda: list(witness.now.modes) == steered, OBEY_S)
    checks.at_most("steered again after s", witness.first_s(asked_s, lambda now: list(now.modes) == steered), OBEY_S)
