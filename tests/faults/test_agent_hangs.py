"""Agents that hang, stop or die in flight: the vehicle is in its own failsafe within 2 s, nothing stale arrives afterwards, and
an agent that is started anew takes up the flight, with the log that it lost.

Two real agents with their watchdogs fly two emulated vehicles; the first agent is ruined in one way after the other.
"""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Iterator
from math import dist
from pathlib import Path

import pytest

from radron.agent.config.loading import load_mission
from radron.protocol.codec import decode
from radron.protocol.entries import Coverage, EntryId
from radron.protocol.identity import load_identity
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.summary import encode_summary
from support.live.agents import Agent, Vehicles, closing, command, operator_folder, station_endpoint, until, write_configs
from support.live.run import PATIENCE_S, stretched

FAILSAFE_S = 2.0  # the required limit
START_S = 120.0  # boot of the vehicles (5 s), start of the agents, takeoff (10 s), on a busy computer
HUNG = 70
HOME_M = (5.0, 5.0)
AWAY_M = 15.0  # a failsafe that begins so far from home has not come near the ground when the agent is back

Ruin = Callable[[Agent], None]


def stop_child(agent: Agent) -> None:
    os.kill(agent.child, signal.SIGSTOP)


def block_the_loop(agent: Agent) -> None:
    os.kill(agent.child, signal.SIGUSR1)


def keep_the_lock_in_native_code(agent: Agent) -> None:
    os.kill(agent.child, signal.SIGUSR2)


def kill_child(agent: Agent) -> None:
    os.kill(agent.child, signal.SIGKILL)


def kill_parent(agent: Agent) -> None:
    os.kill(agent.process.pid, signal.SIGKILL)


def stop_both(agent: Agent) -> None:
    os.killpg(agent.process.pid, signal.SIGSTOP)


def fail_in_the_step(agent: Agent) -> None:
    os.kill(agent.child, signal.SIGHUP)


RUINS: list[tuple[Ruin, int]] = [  # and the exit code of the watchdog
    (stop_child, HUNG),
    (block_the_loop, HUNG),
    (keep_the_lock_in_native_code, HUNG),
    (kill_child, 128 + 9),
    (kill_parent, -9),
    (stop_both, HUNG),
    (fail_in_the_step, HUNG),
]


class Flight:
    """Two agents in the air; the first can be ruined and started anew."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.vehicles = Vehicles(write_configs(folder, 2))
        self.agents = {"d1": Agent(folder, "d1", hanging=True), "d2": Agent(folder, "d2")}

    def start(self) -> None:
        def started() -> bool:
            # By name, so that the command waits for both; anyway: the agents warn of missing cameras.
            return command(self.folder, "start", "--anyway", "--drones", ",".join(self.agents)).returncode == 0

        until(started, START_S, "a start command that is obeyed")
        for vehicle in range(2):
            until(lambda at=vehicle: self.vehicles.now(at)["mode"] == "offboard", START_S, f"vehicle {vehicle} in offboard")

    def ruin(self, how: Ruin, code: int) -> None:
        """Ruin the first agent, and see the vehicle's failsafe take over and stay in command."""
        agent, vehicles = self.agents["d1"], self.vehicles
        until(lambda: dist(vehicles.now(0)["position_m"][:2], HOME_M) > AWAY_M, 60.0, "the vehicle away from home")
        how(agent)
        ruined_s = time.monotonic()
        until(lambda: vehicles.now(0)["failsafe"], PATIENCE_S, f"failsafe after {how.__name__}")
        taken_s = vehicles.first(0, lambda report: report["failsafe"], ruined_s)
        assert taken_s is not None
        print(f"{how.__name__}: failsafe after {taken_s - ruined_s:.2f} s")
        assert taken_s - ruined_s < stretched(FAILSAFE_S), how.__name__
        until(lambda: vehicles.now(0)["mode"] == "return", PATIENCE_S, f"return after {how.__name__}")
        received = vehicles.now(0)["setpoints"]
        if how is stop_both:
            time.sleep(1.0)  # well in the failsafe
            os.killpg(agent.process.pid, signal.SIGCONT)
        assert agent.ended(PATIENCE_S) == code, how.__name__
        time.sleep(0.5)  # stale setpoints would arrive now
        assert vehicles.now(0)["setpoints"] == received, how.__name__
        assert vehicles.now(1)["mode"] == "offboard", "the other one flies on"

    def restart(self) -> None:
        """Start the first agent anew, and see it take up the flight."""
        self.agents["d1"].close()
        self.agents["d1"] = Agent(self.folder, "d1", hanging=True)
        started_s = time.monotonic()
        until(lambda: self.vehicles.now(0)["mode"] == "offboard", PATIENCE_S, "the restarted agent back in offboard")
        print(f"back in offboard {time.monotonic() - started_s:.1f} s after the start of the agent")
        until(lambda: not self.vehicles.now(0)["failsafe"], PATIENCE_S, "the end of the failsafe")

    def log_of(self, drone: str) -> set[EntryId]:
        """The first drone's coverage in a drone's log, as reported to an operator's station."""
        mission = load_mission(self.folder / "mission.toml")
        entries: set[EntryId] = set()

        def receive(key: str, payload: bytes) -> None:
            message = decode(payload)
            if isinstance(message, Coverage) and message.drone == "d1":
                entries.add(message.entry_id)

        async def ask() -> None:
            endpoints = tuple(station_endpoint(self.folder, name) for name in self.agents)
            links = MeshConfig(connect=endpoints, identity=load_identity(operator_folder(self.folder)))
            mesh = await Mesh.open(links, mission.swarm, None, receive=receive)
            try:
                for _ in range(50):
                    if await mesh.ask(drone, encode_summary(mission.mission_id, {})):
                        break
                    await asyncio.sleep(0.1)
                await asyncio.sleep(0.3)  # the last replies are on their way to us
            finally:
                await mesh.close()

        asyncio.run(ask())
        return entries

    def close(self) -> None:
        for agent in self.agents.values():
            agent.close()
        self.vehicles.close()


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    flight = Flight(tmp_path)
    with closing(flight):
        yield flight


@pytest.mark.slow
def test_the_failsafe_takes_over_within_two_seconds_and_a_restarted_agent_flies_on(flight: Flight) -> None:
    flight.start()
    flown = until(lambda: flight.log_of("d2"), PATIENCE_S, "coverage of the first drone in the log of the other")
    for how, code in RUINS:
        flight.ruin(how, code)
        flight.restart()
    until(lambda: flown <= flight.log_of("d1"), PATIENCE_S, "what it flew before it was ruined, in its log again")
