"""Agents on hosts of their own, the packets between which are lost: TCP repeats them, and the links break and come again."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sysconfig
from contextlib import ExitStack
from pathlib import Path

import pytest
from live_run import live_run
from packet_network import HUB, address, packet_network

from agent.config.drone import DetectorConfig, DroneConfig, PeerMeshConfig, RecorderConfig, VehicleConfig
from sim.live.relays.linkstate import LinkState
from sim.live.runfolder import as_toml

AGENT = Path(sysconfig.get_path("scripts")) / "radron-agent"
READY_S, FLIGHT_S = 240.0, 300.0  # of which 60 s are flown; the machine is shared
LOSS = 0.05

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or not os.access("/dev/net/tun", os.W_OK) or shutil.which("ip") is None,
    reason="network namespaces and TUN devices need root, /dev/net/tun and iproute2",
)


@pytest.mark.long
def test_a_swarm_that_loses_packets_finds_the_source_and_has_one_log(tmp_path: Path) -> None:
    with packet_network(2, seed=1) as (hosts, inside, impair), ExitStack() as agents:
        mesh = {f"d{number + 1}": f"tls/{host}:7447" for number, host in enumerate(hosts)}
        links = ("--agent-hosts", ",".join(hosts), "--mesh", ",".join(mesh.values()), "--bind", address(HUB))
        options = ("--drones", "2", "--seed", "1", "--set", "mission.track.duration_s=20", "--json", str(tmp_path / "run.json"))
        with live_run(tmp_path, "demo", *options, "--external", *links) as run:
            run.until(lambda: "the agents are expected at" in run.said, 120.0)
            children = []
            for number, (drone, host) in enumerate(zip(mesh, hosts, strict=True)):
                config = DroneConfig(
                    id=drone,
                    mission=str(tmp_path / "agents" / "mission.toml"),
                    mesh=PeerMeshConfig(endpoints=mesh, identity=str(tmp_path / "agents" / drone / "identity")),
                    vehicle=VehicleConfig(address=f"udpin://{host}:14540"),
                    detector=DetectorConfig(driver="feed", address=f"{address(HUB)}:{5600 + number}"),
                    recorder=RecorderConfig(folder=str(tmp_path / drone)),
                )
                file = tmp_path / f"{drone}.toml"
                file.write_text(as_toml(config))
                log = agents.enter_context((tmp_path / f"{drone}.log").open("wb"))
                child = subprocess.Popen([*inside[number], AGENT, "run", "--config", file], stderr=log)
                agents.callback(child.wait)
                agents.callback(child.terminate)
                children.append(child)
            run.until(lambda: "all agents are ready" in run.said, READY_S)
            impair(LinkState(loss=LOSS))
            run.process.wait(FLIGHT_S)
            assert run.process.returncode == 0, run.said
            assert [child.poll() for child in children] == [None, None], "a watchdog killed its agent"
    result = json.loads((tmp_path / "run.json").read_text())
    assert not result["lost"]
    assert result["error_median_m"] < 2.0
    report = json.loads((tmp_path / "agents.json").read_text())
    assert report["agreed"], run.said
    assert [agent["stage"] for agent in report["agents"]] == ["landed"] * 2
