"""Soak test: what is left over after long and many flights: threads, open files, tasks, objects, and memory by log entry.

Lockstep: a long mission with growing logs, and many short missions in the same process, after which nothing may remain.
Live: a long flight, with samples of its processes. Exit code 1 if threads, files, tasks or objects grow, or memory by more than 2
kB for each entry of each agent's log, or if a long flight ended early. In lockstep the memory includes the flight's trace, kept
by the simulation: a tenth of it.

Run: python benchmarks/soak.py [--lockstep 120] [--missions 3] [--live 60] [--drones 3] [--seed 1] [--out results/soak]
Seconds of simulated flight, number of short missions, seconds of live tracking; 0 leaves a part out. ``make soak``: an hour,
twenty missions, ten minutes.
"""

from __future__ import annotations

import argparse
import gc
import json
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from common.live_flight import Seen, all_tracking, flights, fly, messages
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.protocol.entries import Entry
from radron.protocol.messages import DRONE_KINDS
from radron.sim.figures.style import DRONES, dress, new_figure, save
from radron.sim.scoring.moment import Moment

MOST_BYTES = 2000.0  # allowed growth of a process for each entry of each log in it
FEWEST_ENTRIES = 3000  # growth of a log that is needed for a verdict
WARM_SHARE = 0.3  # of a part's samples, not judged: caches fill
WHOLE_SHARE = 0.8  # of the requested time, required of a long flight: live drones begin to track one after another
SAMPLE_S = 10.0  # of simulated time
COUNTED = ("threads", "files", "tasks", "objects")
SHORT_S = 15.0  # tracking of a short mission
NEVER_HOME = {"mission.safety.battery_reserve": 0.0}  # else all return after 17 minutes; lockstep's vehicles fly on
_ENTRY_KINDS = {name for name, kind in DRONE_KINDS.items() if issubclass(kind, Entry)}


@dataclass
class Series:
    """Samples of one process: ``time_s`` (or number of flights), ``entries`` of all logs in it together, and its resources.

    ``until_s``: intended end of the sampling.
    """

    name: str
    until_s: float = 0.0
    entries: list[int] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    rss_mb: list[float] = field(default_factory=list)
    counts: dict[str, list[int]] = field(default_factory=dict)

    def add(self, time_s: float, entries: int, rss_mb: float, counts: dict[str, int]) -> None:
        self.time_s.append(time_s)
        self.entries.append(entries)
        self.rss_mb.append(rss_mb)
        for name, count in counts.items():
            self.counts.setdefault(name, []).append(count)

    @property
    def bytes_per_entry(self) -> float | None:
        """Slope of the memory, once warm; None with too few entries."""
        entries, rss_mb = _warm(self.entries), _warm(self.rss_mb)
        if len(entries) < 3 or entries[-1] - entries[0] < FEWEST_ENTRIES:
            return None
        return float(np.polyfit(entries, rss_mb, 1)[0]) * 1e6

    def growth(self, name: str) -> int:
        """Difference between the smallest counts of the last third and of the third before. Leftovers stay, while short-lived
        tasks or sockets do not count.
        """
        counts = _warm(self.counts[name])
        middle = max(1, len(counts) // 2)
        return min(counts[middle:], default=0) - min(counts[:middle], default=0)

    @property
    def flaws(self) -> list[str]:
        """Resources with forbidden growth."""
        found = [
            f"{self.name}: {name} grow by {self.growth(name)}"
            for name in self.counts
            if self.growth(name) > _tolerated(self, name)
        ]
        if self.time_s[-1] < WHOLE_SHARE * self.until_s:
            found.append(f"{self.name}: over after {self.time_s[-1]:.0f} s of {self.until_s:.0f} s")
        slope = self.bytes_per_entry
        if slope is not None and slope > MOST_BYTES:
            found.append(f"{self.name}: {slope:.0f} B for each entry, and {MOST_BYTES:.0f} are allowed")
        return found


def _warm(values: Sequence[Any]) -> Sequence[Any]:
    return values[int(WARM_SHARE * len(values)) :]


def _tolerated(series: Series, name: str) -> float:
    """Threads, files and tasks may not grow at all; objects by rounding, where the logs do not."""
    return 0.002 * series.counts[name][-1] if name == "objects" else 0.0


def long_mission(pipe: Connection, drones: int, seed: int, seconds: float) -> None:
    """A mission in lockstep that tracks for ``seconds``."""
    from radron.sim.lockstep.flight import fly as fly_lockstep  # noqa: PLC0415 - only in its own process

    series, due_s = Series("lockstep, one mission", seconds), 0.0

    def watch(moment: Moment) -> bool:
        nonlocal due_s
        if moment.time_s >= due_s:
            due_s = moment.time_s + SAMPLE_S
            series.add(moment.time_s, sum(len(pilot.fusion.log) for pilot in moment.pilots if pilot is not None), *_held())
            pipe.send(moment.time_s)
        return False

    fly_lockstep(_scenario(drones, seconds), seed, watch=watch)
    pipe.send(series)


def short_missions(pipe: Connection, drones: int, seed: int, number: int) -> None:
    """Missions in lockstep, one after the other in the same process."""
    from radron.sim.lockstep.flight import fly as fly_lockstep  # noqa: PLC0415 - only in its own process

    series = Series("lockstep, missions")
    for place in range(number):
        fly_lockstep(_scenario(drones, SHORT_S), seed + place)
        gc.collect()
        rss_mb, counts = _held()
        series.add(float(place + 1), 0, rss_mb, counts | {"objects": len(gc.get_objects())})
        pipe.send(float(place + 1))
    pipe.send(series)


def _scenario(drones: int, seconds: float) -> Any:
    from radron.sim.scenario import load_scenario, override  # noqa: PLC0415 - only in its own process

    flight = {"mission.track.duration_s": seconds, **NEVER_HOME}
    return override(load_scenario("paper-demo"), {"drones": drones, **flight})


def _held() -> tuple[float, dict[str, int]]:
    """Memory, and threads and open files, of this process."""
    process = psutil.Process()
    return process.memory_info().rss / 1e6, {"threads": process.num_threads(), "files": process.num_fds()}


def in_process(work: Callable[..., None], what: str, until: float, *arguments: float) -> Series:
    """A part in a process of its own, with its progress."""
    context = multiprocessing.get_context("spawn")
    mine, its = context.Pipe()
    process = context.Process(target=work, args=(its, *arguments))
    process.start()
    its.close()
    try:
        with Progress(console=Console(stderr=True)) as progress:
            bar = progress.add_task(what, total=until)
            while True:
                told: float | Series = mine.recv()
                if isinstance(told, Series):
                    return told
                progress.update(bar, completed=told)
    except EOFError:
        sys.exit(f"{what}: the process ended early")
    finally:
        process.kill()
        process.join()


def live(folder: Path, drones: int, seed: int, seconds: float) -> list[Series]:
    """A live flight: its agents, its world and its launcher."""
    arguments = ["paper-demo", "--seed", str(seed), "--drones", str(drones), "--set", f"mission.track.duration_s={seconds:g}"]
    seen = fly(folder, arguments, limit_s=seconds + 900.0)
    left = [one for one in psutil.process_iter() if one.pid in seen and one.create_time() == seen[one.pid].began_s]
    found = flights(folder)
    stretches = all_tracking(folder, found)
    tracked = max(start for start, _ in stretches), min(end for _, end in stretches)
    made_s = np.sort([stamp_s for flight in found.values() for stamp_s in _own_entries(flight)])
    tasks = dict(_tasks(path) for path in sorted(folder.glob("agents/*/agent.log")))
    if left:
        sys.exit(f"processes are left over: {', '.join(str(one.pid) for one in left)}")
    return [_of_process(one, tracked, made_s, tasks, seconds) for one in seen.values() if one.kind != "other"]


def _own_entries(flight: RecordedFlight) -> Iterator[float]:
    """When this agent published its log entries."""
    for record, _, kind, _ in messages(flight, topics.PUBLICATION):
        if kind in _ENTRY_KINDS:
            yield record.publish_ns * 1e-9


def _tasks(log: Path) -> tuple[int, list[tuple[float, int]]]:
    """An agent's process, and its asyncio tasks over time, as it logs them with its counters."""
    process, found = 0, []
    for line in log.read_text().splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if entry.get("event") == "counters":
            process = entry["pid"]
            found.append((datetime.fromisoformat(entry["timestamp"]).timestamp(), entry["tasks"]))
    return process, found


def _of_process(
    one: Seen,
    tracked: tuple[float, float],
    made_s: NDArray[np.float64],
    tasks: dict[int, list[tuple[float, int]]],
    until_s: float,
) -> Series:
    """Samples while the swarm tracked: threads come and go at a process's start and end."""
    series, told = Series(one.name, until_s), tasks.get(one.pid, [])
    for time_s, held in one.held:
        if not tracked[0] <= time_s <= tracked[1]:
            continue
        counts = {"threads": held.threads, "files": held.files}
        newest = next((count for at_s, count in reversed(told) if at_s <= time_s), None)
        if newest is not None:
            counts["tasks"] = newest
        elif told:
            continue  # before its first line
        entries = int(np.searchsorted(made_s, time_s)) if one.kind == "agent" else 0
        series.add(time_s - tracked[0], entries, held.rss_mb, counts)
    return series


def report(all_series: list[Series], folder: Path) -> int:
    """Table, picture and flaws; the exit code."""
    table = Table(title="Soak test")
    table.add_column("process")
    for head in ("samples", "entries", "MB, first to last", "B per entry", "threads", "files", "tasks", "objects"):
        table.add_column(head, justify="right")
    for series in all_series:
        slope = series.bytes_per_entry
        cells = [f"{values[0]} .. {values[-1]}" if (values := series.counts.get(name)) else "" for name in COUNTED]
        memory = f"{series.rss_mb[0]:.0f} .. {series.rss_mb[-1]:.0f}"
        table.add_row(
            series.name, str(len(series.time_s)), str(series.entries[-1]), memory, "" if slope is None else f"{slope:.0f}", *cells
        )
    Console(width=140).print(table)
    _draw(all_series, folder / "soak.png")
    (folder / "soak.json").write_text(json.dumps([vars(series) for series in all_series]) + "\n")
    flaws = [flaw for series in all_series for flaw in series.flaws]
    print("\n".join(flaws) if flaws else f"nothing left over, and memory within {MOST_BYTES:.0f} B for each entry")
    return 1 if flaws else 0


def _draw(all_series: list[Series], path: Path) -> None:
    """Memory, and threads with files, over the share of each part."""
    figure = new_figure(10.0, 4.0)
    memory, counts = figure.subplots(1, 2)
    for place, series in enumerate(all_series):
        along = np.asarray(series.time_s) / max(1e-9, series.time_s[-1])
        colour = DRONES[place % len(DRONES)]
        memory.plot(along, series.rss_mb, color=colour, label=series.name)
        counts.plot(along, series.counts["threads"], color=colour, label=series.name)
        counts.plot(along, series.counts["files"], color=colour, linestyle="--")
    dress(memory, "Memory", "share of the part", "resident, MB")
    dress(counts, "Threads (lines) and open files (dashed)", "share of the part", "number")
    memory.legend(fontsize=7)
    save(figure, path)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--lockstep", type=float, default=120.0)
    parser.add_argument("--missions", type=int, default=3)
    parser.add_argument("--live", type=float, default=60.0)
    parser.add_argument("--drones", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("results/soak"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    who, found = (options.drones, options.seed), []
    if options.lockstep > 0.0:
        found.append(in_process(long_mission, "one long mission", options.lockstep, *who, options.lockstep))
    if options.missions > 0:
        found.append(in_process(short_missions, "one mission after another", options.missions, *who, options.missions))
    if options.live > 0.0:
        found += live(options.out / "live", *who, options.live)
    return report(found, options.out)


if __name__ == "__main__":
    sys.exit(main())
