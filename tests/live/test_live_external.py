"""Agents started by another program: the launcher provides the world and the start command."""

from __future__ import annotations

import os
import signal
import subprocess
import sysconfig
from pathlib import Path

import pytest

from radron.agent.config.drone import DetectorConfig, DroneConfig, PeerMeshConfig, VehicleConfig
from radron.sim.live.runfolder import as_toml
from support.live.run import live_run

READY_S, DOWN_S = 180.0, 20.0  # the machine is shared: 10 s and 3 s on an unshared machine
AGENT = Path(sysconfig.get_path("scripts")) / "radron-agent"


@pytest.mark.slow
def test_an_agent_elsewhere_is_waited_for_and_started(tmp_path: Path) -> None:
    pid = os.getpid()
    host = f"127.{1 + pid % 250}.{1 + pid // 250 % 250}.{1 + pid // 62_500 % 250}"  # ports are fixed: so no other test's address
    links = ("--agent-hosts", host, "--mesh", f"tls/{host}:7447", "--bind", host)
    drone = DroneConfig(
        id="d1",
        mission=str(tmp_path / "agents" / "mission.toml"),
        mesh=PeerMeshConfig(endpoints={"d1": f"tls/{host}:7447"}, identity=str(tmp_path / "agents/d1/identity")),
        vehicle=VehicleConfig(address=f"udpin://{host}:14540"),
        detector=DetectorConfig(driver="feed", address=f"{host}:5600"),
    )
    file, log = tmp_path / "elsewhere.toml", tmp_path / "elsewhere.log"
    file.write_text(as_toml(drone))
    with live_run(tmp_path, "paper-demo", "--drones", "1", "--external", *links) as run:
        run.until(lambda: "waiting: d1: not in the mesh yet" in run.said, READY_S)
        assert (tmp_path / "agents" / "mission.toml").exists()
        with log.open("wb") as stderr:
            agent = subprocess.Popen([AGENT, "run", "--config", file], stderr=stderr)
        try:
            run.until(lambda: "all agents are ready" in run.said, READY_S)
            run.until(lambda: '"stage": "takeoff"' in log.read_text(), DOWN_S)
            run.process.send_signal(signal.SIGINT)
            assert run.process.wait(DOWN_S) == 128 + signal.SIGINT
            assert "Traceback" not in run.said
            assert agent.poll() is None  # not ours to end
        finally:
            agent.terminate()
            agent.wait(10.0)
