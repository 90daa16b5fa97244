"""A flight of the demo with its agents on hosts of their own, and packet loss between the hosts."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sysconfig
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from radron.agent.config.drone import DetectorConfig, DroneConfig, PeerMeshConfig, RecorderConfig, VehicleConfig
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.sim.live.relays.linkstate import LinkState
from radron.sim.live.runfolder import as_toml
from support.live.run import LiveRun, live_run
from support.mesh.packet_network import HUB, address, packet_network

AGENT = Path(sysconfig.get_path("scripts")) / "radron-agent"
READY_S, FLIGHT_S = 240.0, 300.0  # a minute of it is flown; the machine is shared
LACKING = "network namespaces and TUN devices need root, /dev/net/tun and iproute2"


@dataclass(frozen=True)
class Flown:
    """Outcome of the flight. ended: exit codes of agents that ended in flight, by drone. error_m: median while tracked, if ever.
    bound_m: posterior Cramer-Rao bound of that error, from the flight's measurements. gap_s: longest time between two setpoints
    of an agent.
    """

    ended: dict[str, int]
    lost: bool
    agreed: bool
    landed: bool
    error_m: float | None
    bound_m: float | None
    gap_s: float


def can_lose_packets() -> bool:
    """Whether this process may make hosts in namespaces."""
    return os.geteuid() == 0 and os.access("/dev/net/tun", os.W_OK) and shutil.which("ip") is not None


def fly_over(folder: Path, drones: int, loss: float, track_s: float, seed: int = 1) -> Flown:
    """Fly it; ``loss``: probability for a packet between two agents to be lost, once all agents are ready."""
    with packet_network(drones, seed) as (hosts, inside, impair), ExitStack() as agents:
        mesh = {f"d{number + 1}": f"tls/{host}:7447" for number, host in enumerate(hosts)}
        links = ("--agent-hosts", ",".join(hosts), "--mesh", ",".join(mesh.values()), "--bind", address(HUB))
        options = ("--drones", str(drones), "--seed", str(seed), "--set", f"mission.track.duration_s={track_s:g}")
        with live_run(folder, "paper-demo", *options, "--json", str(folder / "run.json"), "--external", *links) as run:
            run.until(lambda: "the agents are expected at" in run.said, 120.0)
            children: dict[str, subprocess.Popen[bytes]] = {}
            for number, (drone, host) in enumerate(zip(mesh, hosts, strict=True)):
                config = _drone_file(folder, drone, host, mesh, f"{address(HUB)}:{5600 + number}")
                log = agents.enter_context((folder / f"{drone}.log").open("wb"))
                child = children[drone] = subprocess.Popen([*inside[number], AGENT, "run", "--config", config], stderr=log)
                agents.callback(child.wait)
                agents.callback(child.terminate)
            run.until(lambda: "all agents are ready" in run.said, READY_S)
            impair(LinkState(loss=loss))
            run.process.wait(FLIGHT_S)
            assert run.process.returncode == 0, run.said
            ended = {drone: code for drone, child in children.items() if (code := child.poll()) is not None}
        return _judged(run, ended, [max(_setpoint_gaps_s(folder / drone), default=0.0) for drone in mesh])


def _drone_file(folder: Path, drone: str, host: str, mesh: dict[str, str], camera: str) -> Path:
    config = DroneConfig(
        id=drone,
        mission=str(folder / "agents" / "mission.toml"),
        mesh=PeerMeshConfig(endpoints=mesh, identity=str(folder / "agents" / drone / "identity")),
        vehicle=VehicleConfig(address=f"udpin://{host}:14540"),
        detector=DetectorConfig(driver="feed", address=camera),
        recorder=RecorderConfig(folder=str(folder / drone)),
    )
    path = folder / f"{drone}.toml"
    path.write_text(as_toml(config))
    return path


def _judged(run: LiveRun, ended: dict[str, int], gaps_s: list[float]) -> Flown:
    result = json.loads((run.folder / "run.json").read_text())
    report = json.loads((run.folder / "agents.json").read_text())
    landed = all(agent["stage"] == "landed" for agent in report["agents"])
    errors_m = result["error_median_m"], result["bound_median_m"]
    return Flown(ended, result["lost"], report["agreed"], landed, *errors_m, max(gaps_s))


def _setpoint_gaps_s(folder: Path) -> Iterator[float]:
    """Times between the commands that an agent gave its vehicle."""
    for file in folder.glob("*-0000.mcap"):
        given = [record.publish_ns for record in RecordedFlight(file).records() if record.topic == topics.COMMAND]
        yield from ((after - before) * 1e-9 for before, after in pairwise(given))
