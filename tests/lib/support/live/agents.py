"""Real agents and emulated vehicles as processes, for tests: started, watched, and always ended."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import psutil

from radron.protocol.identity import Role
from radron.protocol.issuing import throwaway

SUPPORT = Path(__file__).parents[1]
T = TypeVar("T")


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> list[int]:
    """Ports of 127.0.0.1 that are free."""
    sockets = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()


def until(condition: Callable[[], T], within_s: float, what: str = "") -> T:
    """Wait until a condition holds, and return its value."""
    deadline_s = time.monotonic() + within_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, f"not within {within_s} s: {what or condition}"
        time.sleep(0.02)
    return value


class Vehicles:
    """Emulated vehicles. ``reports``: (time, reports of all vehicles), newest last. ``unhealthy``: why not, by index;
    ``parameters``: deviations from the values that the preflight check asks for.
    """

    def __init__(
        self, ports: list[int], unhealthy: dict[int, str] | None = None, parameters: dict[str, float] | None = None
    ) -> None:
        order = {
            "ports": ports,
            "places": [(5.0 + 6.0 * index, 5.0) for index in range(len(ports))],
            "unhealthy": unhealthy or {},
            "parameters": parameters or {},
        }
        self._process = subprocess.Popen(
            [sys.executable, str(SUPPORT / "px4/vehicles.py"), json.dumps(order)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.reports: list[tuple[float, list[dict[str, Any]]]] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        try:
            until(lambda: self.reports, 60.0, "emulated vehicles")
        except BaseException:
            self.close()
            raise

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.reports.append((time.monotonic(), json.loads(line)))

    def now(self, vehicle: int) -> dict[str, Any]:
        """The newest report of a vehicle; an empty one before there is any."""
        return self.reports[-1][1][vehicle] if self.reports else {}

    def first(self, vehicle: int, condition: Callable[[dict[str, Any]], bool], since_s: float) -> float | None:
        """When a vehicle first met a condition after a time."""
        return next((at_s for at_s, each in list(self.reports) if at_s >= since_s and condition(each[vehicle])), None)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join()


class Agent:
    """A ``radron-agent run``; with ``hanging`` its camera driver can be made to hang."""

    def __init__(self, folder: Path, name: str, hanging: bool = False, **environment: str) -> None:
        config = str(folder / f"{name}.toml")
        self._log = (folder / f"{name}.log").open("ab")
        self._log_path = folder / f"{name}.log"
        self._log_from = self._log.tell()
        child = [sys.executable, str(SUPPORT / "live/hanging_agent.py"), config]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "radron.agent.shell.supervisor", *child]
            if hanging
            else [str(Path(sys.executable).parent / "radron-agent"), "run", "--config", config],
            stderr=self._log, env={**os.environ, **environment}, start_new_session=True,
        )  # fmt: skip

    @property
    def child(self) -> int:
        """Process id of the agent itself."""
        return until(lambda: psutil.Process(self.process.pid).children(), 10.0, "a child")[0].pid

    @property
    def log(self) -> str:
        """The agent's output so far."""
        return self._log_path.read_bytes()[self._log_from :].decode()

    def events(self) -> list[dict[str, Any]]:
        """The lines of its log that are JSON."""
        return [json.loads(line) for line in self.log.splitlines() if line.startswith("{")]

    def ended(self, within_s: float) -> int:
        """Wait for its end; the exit code."""
        return self.process.wait(timeout=within_s)

    def close(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._log.close()


def write_configs(folder: Path, count: int, **vehicle: object) -> list[int]:
    """Mission and drone files d1.toml, d2.toml ... in a folder; the UDP ports at which the agents wait for their vehicles."""
    names = [f"d{number + 1}" for number in range(count)]
    ports = free_ports(count, socket.SOCK_DGRAM)
    mesh = ", ".join(f'{name} = "tls/127.0.0.1:{port}"' for name, port in zip(names, free_ports(count), strict=True))
    drones = ", ".join(f'{{ id = "{name}", origin_m = [{5 + 6 * index}, 5, 0] }}' for index, name in enumerate(names))
    (folder / "mission.toml").write_text(
        f'name = "test"\ndrones = [{drones}]\narea = {{ polygon_m = [[0, 0], [60, 0], [60, 60], [0, 60]] }}\n'
    )
    members = {folder / "identity" / name: (name, Role.DRONE) for name in names}
    throwaway({**members, operator_folder(folder): ("operator", Role.OPERATOR)}, time.time_ns())
    settings = "".join(f"{key} = {json.dumps(value)}\n" for key, value in vehicle.items())
    for name, port in zip(names, ports, strict=True):
        (folder / f"{name}.toml").write_text(
            f'id = "{name}"\nmission = "mission.toml"\nstate = "state"\n'
            f'mesh = {{ identity = "identity/{name}", endpoints = {{ {mesh} }} }}\n'
            f'recorder = {{ folder = "records" }}\n'
            f'[vehicle]\naddress = "udpin://127.0.0.1:{port}"\n{settings}'
        )
    return ports


def operator_folder(folder: Path) -> Path:
    """The operator's certificate and key."""
    return folder / "identity" / "operator"


def station_endpoint(folder: Path, name: str = "d1") -> str:
    """Endpoint at which an operator reaches an agent."""
    text = (folder / f"{name}.toml").read_text()
    return text.split(f'{name} = "', 1)[1].split('"', 1)[0]


def command(folder: Path, action: str, *options: str) -> subprocess.CompletedProcess[str]:
    """``radron-agent command`` to the swarm of these files."""
    tool = str(Path(sys.executable).parent / "radron-agent")
    links = ("--connect", station_endpoint(folder), "--identity", str(operator_folder(folder)))
    return subprocess.run(
        [tool, "command", action, "--swarm", "radron", *links, *options],
        capture_output=True, text=True, timeout=40.0, check=False,
    )  # fmt: skip


@contextmanager
def closing(*things: Any) -> Iterator[None]:
    """Close everything at the end, in reverse order."""
    try:
        yield
    finally:
        for thing in reversed(things):
            thing.close()
