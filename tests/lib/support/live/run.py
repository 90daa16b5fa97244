"""``radron-sim live`` as a user starts it, for tests: its processes and ports, which are always cleaned up."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import load_toml

PATIENCE_S = 60.0  # for what takes a second or a few on a machine that has nothing else to do
PROGRAM = Path(sysconfig.get_path("scripts")) / "radron-sim"


def stretched(time_s: float) -> float:
    """A time limit on a machine with more work than it has processors."""
    return time_s * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


class LiveRun:
    """A running ``radron-sim live``, with its files in ``folder`` and its output in ``folder/said``."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self._said = folder / "said"
        with self._said.open("wb") as said:
            command = [str(PROGRAM), "live", *arguments, "--out", str(folder)]
            self.process = subprocess.Popen(command, stdout=said, stderr=said, stdin=subprocess.DEVNULL)

    @property
    def said(self) -> str:
        return self._said.read_text(encoding="utf-8")

    def processes(self) -> list[psutil.Process]:
        """World and agents: everything else that has this folder among its arguments."""
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                told = any(str(self.folder) in word for word in process.cmdline())
                if told and process.pid != self.process.pid and process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
        return found

    def drones(self) -> list[DroneConfig]:
        return [load_toml(path, DroneConfig) for path in sorted(self.folder.glob("agents/*/drone.toml"))]

    def busy_ports(self) -> list[int]:
        """Ports of mesh, MAVLink and feeds that cannot be taken."""
        busy = []
        for drone in self.drones():
            vision = drone.vehicle.vision.address if drone.vehicle.vision is not None else None
            feeds = (drone.detector.address, vision, drone.sightings.address)
            tcp = [drone.mesh.endpoints[drone.id], *(feed for feed in feeds if feed is not None)]
            ports = [(socket.SOCK_DGRAM, drone.vehicle.address), *((socket.SOCK_STREAM, address) for address in tcp)]
            for kind, address in ports:
                port = int(re.findall(r"\d+", address)[-1])
                with socket.socket(socket.AF_INET, kind) as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(kind is socket.SOCK_STREAM))  # only TIME_WAIT
                    try:
                        probe.bind(("127.0.0.1", port))
                    except OSError:
                        busy.append(port)
        return busy

    def until(self, condition: Callable[[], object], within_s: float) -> float:
        """Wait for something; the seconds that it took."""
        began_s = time.monotonic()
        while not condition():
            assert time.monotonic() - began_s < within_s, f"not within {within_s:g} s; it said:\n{self.said}"
            time.sleep(0.05)
        return time.monotonic() - began_s

    def agents_up(self) -> bool:
        """Whether every agent has its vehicle."""
        logs = [path.read_text(encoding="utf-8") for path in self.folder.glob("agents/*/agent.log")]
        assert self.process.poll() is None, self.said
        return bool(logs) and all("vehicle is connected" in log for log in logs)


@contextmanager
def live_run(folder: Path, *arguments: str) -> Iterator[LiveRun]:
    """Start it; end it."""
    run = LiveRun(folder, *arguments)
    try:
        yield run
    finally:
        if run.process.poll() is None:
            run.process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                run.process.wait(10.0)
        run.process.kill()
        run.process.wait()
        for process in run.processes():
            with suppress(psutil.Error):
                os.kill(process.pid, signal.SIGKILL)
