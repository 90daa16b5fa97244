"""Observation of a live flight for benchmarks: its processes while they run, and its agents' records afterwards."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import psutil

from radron.agent.flight import topics
from radron.agent.flight.reader import FlightRecord, RecordedFlight
from radron.protocol.codec import decode_from
from radron.protocol.keys import parse_key
from radron.protocol.messages import Stage, Status

SAMPLE_S = 1.0
_FULL_SAMPLES = 10  # samples between two counts of a process's own memory, which are expensive
LIMIT_S = 900.0  # of a flight beyond its requested duration


class Held(NamedTuple):
    """Resources of a process at a moment."""

    rss_mb: float
    threads: int
    files: int  # open ones, sockets included


@dataclass
class Seen:
    """A process: samples of (wall time s, CPU s so far), of its resources, and its largest memory."""

    kind: str  # agent, watchdog, world, launcher
    pid: int
    parent: int
    began_s: float
    cpu: list[tuple[float, float]] = field(default_factory=list)
    held: list[tuple[float, Held]] = field(default_factory=list)
    rss_mb: float = 0.0
    uss_mb: float = 0.0

    @property
    def name(self) -> str:
        """Kind and id, for tables."""
        return f"{self.kind} {self.pid}"

    def share(self, start_s: float, end_s: float) -> float:
        """Part of a core that it took between two times, as far as it was there."""
        inside = [sample for sample in self.cpu if start_s <= sample[0] <= end_s]
        if len(inside) < 2:
            return 0.0
        return (inside[-1][1] - inside[0][1]) / (inside[-1][0] - inside[0][0])


@contextmanager
def flight_folder() -> Iterator[Path]:
    """A folder for a flight, which stays where the flight failed: what went wrong is in it."""
    folder = Path(tempfile.mkdtemp(prefix="radron-flight-"))
    yield folder
    shutil.rmtree(folder)


def fly(folder: Path, arguments: list[str], limit_s: float = LIMIT_S) -> dict[int, Seen]:
    """Run ``radron-sim live`` with its results in ``folder``; returns its processes by their ids.

    Raises:
        SystemExit: it fails or does not end; its output is in ``folder``/live.log.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = [str(Path(sys.executable).with_name("radron-sim")), "live", *arguments, "--out", str(folder)]
    with (folder / "live.log").open("w") as log:
        launcher = psutil.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        seen: dict[int, Seen] = {}
        end_s = time.monotonic() + limit_s
        try:
            while launcher.poll() is None and time.monotonic() < end_s:
                _sample(launcher, seen)
                time.sleep(SAMPLE_S)
        finally:
            if launcher.poll() is None:
                launcher.terminate()
                launcher.wait(10.0)
    if launcher.returncode != 0:
        text = (folder / "live.log").read_text().strip().splitlines()
        sys.exit(f"{' '.join(command)}: ended with {launcher.returncode}: {text[-1] if text else 'no output'}")
    return seen


def _sample(launcher: psutil.Process, seen: dict[int, Seen]) -> None:
    for process in [launcher, *launcher.children(recursive=True)]:
        try:
            with process.oneshot():
                kind = "launcher" if process.pid == launcher.pid else _kind(process.cmdline())
                one = seen.setdefault(process.pid, Seen(kind, process.pid, process.ppid(), process.create_time()))
                one.kind = kind  # a process may replace itself by another program
                times = process.cpu_times()
                one.cpu.append((time.time(), times.user + times.system))
                one.held.append((time.time(), Held(process.memory_info().rss / 1e6, process.num_threads(), process.num_fds())))
                one.rss_mb = max(one.rss_mb, one.held[-1][1].rss_mb)
                if len(one.cpu) % _FULL_SAMPLES == 0:
                    one.uss_mb = max(one.uss_mb, process.memory_full_info().uss / 1e6)
        except psutil.Error:  # the process has just ended
            continue


def _kind(command: list[str]) -> str:
    modules = {"radron.agent.shell.supervisor": "watchdog", "radron.agent": "agent", "radron.sim.live.world": "world"}
    return next((modules[word] for word in command if word in modules), "other")


def flights(folder: Path) -> dict[str, RecordedFlight]:
    """The agents' flights below ``folder``, by drone; one of each drone."""
    found: dict[str, RecordedFlight] = {}
    for file in sorted(folder.rglob("*-0000.mcap")):
        flight = RecordedFlight(file)
        found[flight.header.drone.id] = flight
    if not found:
        sys.exit(f"{folder}: no flight records")
    return found


def messages(flight: RecordedFlight, topic: str) -> Iterator[tuple[FlightRecord, str, str, bytes]]:
    """(record, sender, kind, payload) of the messages that an agent heard (``topics.MESSAGE``) or published."""
    for record in flight.records():
        if record.topic == topic:
            key, payload = topics.decode_message(record.data)
            address = parse_key(key)
            yield record, address.sender, address.kind, payload


def cone_delays_ms(found: dict[str, RecordedFlight]) -> list[float]:
    """Of each cone, from its publication to the pilot of each other agent: wall times of the records."""
    sent_ns = {
        payload: record.publish_ns
        for flight in found.values()
        for record, _, kind, payload in messages(flight, topics.PUBLICATION)
        if kind == "cone"
    }
    delays: list[float] = []
    for flight in found.values():
        first = dict[bytes, int]()
        for record, _, kind, payload in messages(flight, topics.MESSAGE):
            if kind == "cone" and payload in sent_ns:
                first.setdefault(payload, record.publish_ns)
        delays += [(at_ns - sent_ns[payload]) * 1e-6 for payload, at_ns in first.items()]
    return delays


def tracking(flight: RecordedFlight) -> tuple[float, float] | None:
    """Wall times, s, between which this agent said that it was tracking."""
    times = [at_s for at_s, status in _statuses(flight) if status.stage is Stage.TRACK]
    return (times[0], times[-1]) if times else None


def all_tracking(folder: Path, found: dict[str, RecordedFlight]) -> list[tuple[float, float]]:
    """``tracking`` of all agents of a flight.

    Raises:
        SystemExit: not all tracked; with the last report of each remaining agent.
    """
    stretches = {drone: tracking(flight) for drone, flight in found.items()}
    missing = [f"{drone}: {_course(found[drone])}" for drone, stretch in stretches.items() if stretch is None]
    if missing:
        tracked = len(found) - len(missing)
        sys.exit("\n".join([f"only {tracked} of {len(found)} agents tracked; see {folder}/live.log", *missing]))
    return [stretch for stretch in stretches.values() if stretch is not None]


def _statuses(flight: RecordedFlight) -> Iterator[tuple[float, Status]]:
    """The statuses that this agent published, with their wall times, s."""
    for record, sender, kind, payload in messages(flight, topics.PUBLICATION):
        if kind == "status":
            status = decode_from(f"radron/2/{flight.header.mission.swarm}/{sender}/{kind}", payload)
            if isinstance(status, Status):
                yield record.publish_ns * 1e-9, status


def _course(flight: RecordedFlight) -> str:
    """The stages that an agent went through, with its first status's problems in each."""
    told: list[str] = []
    stage = None
    for at_s, status in _statuses(flight):
        if status.stage is not stage:
            stage = status.stage
            told.append(f"{at_s:.1f} {stage.value}" + (f" ({'; '.join(status.problems)})" if status.problems else ""))
    return ", ".join(told) or "no status"
