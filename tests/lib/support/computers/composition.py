"""The composition of docker-compose.yml, started under a name, addresses, images and a folder of its own."""

import ipaddress
import json
import os
import random
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

ROOT = Path(__file__).resolve().parents[4]
ONLOOKER = ROOT / "tests/docker/onlooker.py"
T = TypeVar("T")


class Composition:
    """A run of the composition as ``project``; ``folder``: where its results go."""

    def __init__(self, project: str, folder: Path) -> None:
        self.project = project
        self.folder = folder
        owner = {"RADRON_UID": str(os.getuid()), "RADRON_GID": str(os.getgid())} if os.getuid() else {}
        self._environment = {**os.environ, **owner, "TAG": self.project, "RESULTS": str(folder), "NET": _free_prefix()}

    def compose(self, *words: str, within_s: float) -> str:
        """Run a command of compose; its output. Raises AssertionError with the command's output if the command fails."""
        return _run("docker", "compose", "-p", self.project, *words, within_s=within_s, environment=self._environment)

    def image_mb(self, name: str) -> float:
        """Size of an image of this run, 1e6 bytes."""
        size = _run("docker", "image", "inspect", "--format", "{{.Size}}", f"{name}:{self.project}", within_s=10.0)
        return int(size) / 1e6

    def container(self, service: str) -> dict[str, Any]:
        """The engine's record of a service's container."""
        name = self.compose("ps", "--all", "--quiet", service, within_s=20.0).strip()
        (known,) = json.loads(_run("docker", "inspect", name, within_s=10.0))
        return dict(known)

    def state(self, service: str) -> dict[str, Any]:
        """State of a service's container: Status, ExitCode, Health, ..."""
        return dict(self.container(service)["State"])

    def save_logs(self) -> None:
        """Keep what all containers said beside the results."""
        (self.folder / "containers.log").write_text(self.compose("logs", "--no-color", "--timestamps", within_s=30.0))

    def remove(self) -> None:
        """Take everything down: containers, networks, volumes, images."""
        self.compose("down", "--volumes", "--rmi", "all", "--timeout", "2", "--remove-orphans", within_s=60.0)

    def left_over(self) -> str:
        """Leftovers of the run; empty when nothing is left."""
        label = f"label=com.docker.compose.project={self.project}"
        found = [_run("docker", kind, "ls", "-q", "--filter", label, within_s=10.0) for kind in ("network", "volume")]
        return "".join([_run("docker", "ps", "-aq", "--filter", label, within_s=10.0), *found])


class Onlooker:
    """The swarm as the operator sees it, through an agent's container. ``sight``: newest state by drone, {} at first."""

    def __init__(self, composition: Composition, service: str) -> None:
        self.sight: dict[str, dict[str, Any]] = {}
        name = composition.container(service)["Id"]
        self._process = subprocess.Popen(
            ["docker", "exec", "-i", name, "python", "-P", "-c", ONLOOKER.read_text()],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def tracking(self) -> list[str]:
        """The drones that track and have a hypothesis, sorted."""
        return sorted(d for d, seen in self.sight.items() if seen["stage"] == "track" and seen["angle_deg"] is not None)

    def smallest_gap_deg(self) -> float | None:
        """Between two neighbouring drones that track, around their hypothesis; None for fewer than two."""
        angles = sorted(self.sight[drone]["angle_deg"] % 360.0 for drone in self.tracking())
        if len(angles) < 2:
            return None
        return min((after - before) % 360.0 for before, after in zip(angles, [*angles[1:], angles[0]], strict=True))

    def close(self) -> None:
        """Stop looking."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10.0)
        self._reader.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.sight = json.loads(line)


def until(condition: Callable[[], T], within_s: float, what: str) -> T:
    """Wait for a value that is true, and return it. Raises AssertionError where it does not come about in time."""
    deadline_s = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, f"not within {within_s:g} s: {what}"
        time.sleep(0.25)
    return found


def _run(*command: str, within_s: float, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=within_s, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: code {done.returncode}\n{done.stderr[-4000:]}"
    return done.stdout


def _free_prefix() -> str:
    """Two bytes of addresses: a /16 that no network of the engine overlaps."""
    networks = _run("docker", "network", "ls", "-q", within_s=10.0).split()
    form = "{{range .IPAM.Config}}{{.Subnet}} {{end}}"
    used = _run("docker", "network", "inspect", "--format", form, *networks, within_s=10.0).split()
    taken = [ipaddress.ip_network(subnet) for subnet in used if ":" not in subnet]
    prefixes = [f"10.{number}" for number in random.sample(range(64, 250), 186)]
    return next(p for p in prefixes if not any(ipaddress.ip_network(f"{p}.0.0/16").overlaps(net) for net in taken))
