"""The operator's page with a large swarm: how late, how dear, how smooth, in a real browser over a real Zenoh session.

Ten drones live: from the publication of a pose to its picture on the screen, and the station's CPU. Then thirty drones with an
hour of history, from a drone's record (``common/large_flight.py``), and live: time to open, CPU, memory, pictures per second
against an empty map, data for a newly opened page, and the delay of a jump to an earlier time. The fold (log, frames, estimator)
is the same code as on board and is listed separately.

Run: python benchmarks/page_scale.py [--minutes 60] [--drones 30] [--json OUT]. About five minutes; Chromium must be there.
"""

from __future__ import annotations

import argparse
import json
import random
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median, quantiles
from typing import Any

from playwright.sync_api import Page
from rich.console import Console
from rich.table import Table

from common.large_flight import BOOT, LargeFlight, fly
from common.large_page import Child, browsing, child, latencies_ms, renderer_mb, seek_ms, smoothness, snapshot_bytes
from radron.agent.config.drone import DroneConfig
from radron.agent.config.writing import as_toml
from radron.agent.flight import topics
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.segment import Segment, segment_path

FEW = 10
FLOWN = "flown"  # file of the flight that all are made from
WATCH_S = 12.0
SETTLE_S = 3.0
PAN_PX = 4
SMOOTH_S = 6.0
ALL_HEARD = "() => radron.frame?.drones.every((drone) => !drone.stale)"
OPEN_S_PER_MIN = 2.5  # roughly: for so long the record is read, and the swarm goes on
SEEKS = 40
MOST_MS, MOST_CPU, LEAST_FPS = 200.0, 10.0, 30.0  # goals: ms, % of a core, pictures per second
console = Console(width=120, stderr=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--drones", type=int, default=30)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="radron-page-") as folder:
        _say("three drones fly")
        fly(Path(folder) / FLOWN)
        found = {**_live(Path(folder)), **_large(Path(folder), options.drones, 60.0 * options.minutes)}
    _print(found)
    if options.json is not None:
        options.json.write_text(json.dumps({"page_scale": found}, indent=1) + "\n")


def _say(text: str) -> None:
    console.print(f"{time.strftime('%H:%M:%S')} {text}")


def _mission(folder: Path, flight: LargeFlight) -> Path:
    path = folder / f"mission-{len(flight.mission.drones)}.toml"
    path.write_text(as_toml(flight.mission))
    return path


@contextmanager
def _swarm(folder: Path, drones: int, flown_s: float, endpoint: str) -> Iterator[Child]:
    with child("large_swarm", str(folder / FLOWN), str(drones), str(flown_s), endpoint) as swarm:
        swarm.until(0)
        yield swarm


def _live(folder: Path) -> dict[str, Any]:
    """Ten drones, without history."""
    _say(f"{FEW} drones live")
    mission, endpoint = _mission(folder, LargeFlight(FEW, folder / FLOWN)), f"tcp/127.0.0.1:{_free_port()}"
    with _swarm(folder, FEW, 30.0, endpoint) as swarm, child("large_station", str(mission), "--connect", endpoint) as station:
        with browsing(station.until(0)["address"]) as page:
            page.wait_for_function(
                "() => radron.frame?.source && radron.frame.drones.every((drone) => !drone.stale)", timeout=60e3
            )
            page.wait_for_timeout(1000.0 * SETTLE_S)
            page.evaluate("() => { seen.drawn = []; }")
            used = _used(station, WATCH_S)
            drawn = page.evaluate("() => seen.drawn")
        late = latencies_ms(swarm.finish(), drawn)
    if len(late) < 5.0 * WATCH_S:
        sys.exit(f"only {len(late)} places of {len(drawn)} were found again on the page")
    return {
        "latency_median_ms": median(late),
        "latency_p95_ms": quantiles(late, n=20)[-1],
        **{f"few_{key}": value for key, value in used.items()},
    }


def _large(folder: Path, drones: int, seconds: float) -> dict[str, Any]:
    """Many drones with a history, after the same page without anything."""
    flight, endpoint = LargeFlight(drones, folder / FLOWN), f"tcp/127.0.0.1:{_free_port()}"
    mission = _mission(folder, flight)
    with child("large_station", str(mission)) as station, browsing(station.until(0)["address"]) as page:
        _say("an empty map")
        empty = {**_smooth("empty", page, 0), **_smooth("empty_panned", page, PAN_PX)}
        empty["empty_server_mb"] = station.process.memory_info().rss / 1e6
    _say(f"writing a record of {seconds / 60:.0f} min of {drones} drones")
    began_ns = time.time_ns() + round(OPEN_S_PER_MIN * seconds / 60.0 * 1e9) - round(seconds * 1e9)
    record = _record(folder, flight, began_ns, seconds)
    with child("large_station", str(mission), "--record", str(record), "--connect", endpoint) as station:
        address = station.until(0)["address"]
        opened_s, used = _opened(station)
        seeks = seek_ms(address, _times(began_ns, seconds))
        opened = {"record_mb": record.stat().st_size / 1e6, "opened_s": opened_s}
        opened |= {"opening_cpu_s": used["cpu_s"], "opening_fold_s": used["fold_s"]}
        opened |= {"seek_median_ms": median(seeks), "seek_p95_ms": quantiles(seeks, n=20)[-1]}
        _say(f"opened in {opened_s:.0f} s; {drones} drones live")
        flown_s = (time.time_ns() - began_ns) * 1e-9
        with _swarm(folder, drones, max(seconds, flown_s), endpoint), browsing(address) as page:
            page.wait_for_function(ALL_HEARD, timeout=60e3)
            page.wait_for_timeout(1000.0 * SETTLE_S)
            many = {f"many_{key}": value for key, value in _used(station, WATCH_S).items()}
            many |= {**_smooth("many", page, 0), **_smooth("many_panned", page, PAN_PX)}
            many |= {"server_mb": station.process.memory_info().rss / 1e6, "page_mb": renderer_mb()}
            many["page_heap_mb"] = page.evaluate("() => performance.memory.usedJSHeapSize") / 1e6
            many["snapshot_kb"] = snapshot_bytes(address) / 1e3
    return {"drones": drones, "seconds": seconds, **empty, **opened, **many}


def _smooth(name: str, page: Page, pan_px: int) -> dict[str, float]:
    found = smoothness(page, SMOOTH_S, pan_px)
    return {f"{name}_fps": found.pictures_ps, f"{name}_picture_ms": found.cpu_ms}


def _used(station: Child, seconds: float) -> dict[str, float]:
    """CPU of the station in percent of a core, without the fold and in it, and frames per second."""
    before, began_s = station.ask(), time.monotonic()
    time.sleep(seconds)
    after, passed_s = station.ask(), time.monotonic() - began_s
    fold = after["fold_s"] - before["fold_s"]
    return {
        "cpu_percent": 100.0 * (after["cpu_s"] - before["cpu_s"] - fold) / passed_s,
        "fold_percent": 100.0 * fold / passed_s,
        "frames_ps": (after["frames"] - before["frames"]) / passed_s,
    }


def _opened(station: Child) -> tuple[float, dict[str, float]]:
    """Time to read the record, and the resources used."""
    began_s, told_s, place = time.monotonic(), time.monotonic(), 1
    while "opened" not in (said := station.until(place)):
        place += 1
        if time.monotonic() - told_s > 10.0:
            told_s = time.monotonic()
            _say(f"opened {100.0 * said.get('read', 0.0):.0f} % of the record")
    return time.monotonic() - began_s, station.ask()


def _record(folder: Path, flight: LargeFlight, began_ns: int, seconds: float) -> Path:
    """The first drone's record."""
    drone = flight.mission.drones[0].id
    header = FlightHeader.of(flight.mission, DroneConfig(id=drone), BOOT, began_ns, nonce_key=b"")
    path = segment_path(folder, header, 0)
    segment, told_s = Segment(path, header, 0), time.monotonic()
    for number, sent in enumerate(flight.sent(began_ns, 0.0, seconds)):
        topic = topics.PUBLICATION if sent.drone == drone else topics.MESSAGE
        segment.write(topic, topics.encode_message(sent.key, sent.payload), sent.at_ns, sent.at_ns, number)
        if number % 10_000 == 0 and time.monotonic() - told_s > 10.0:
            told_s = time.monotonic()
            _say(f"written {100.0 * (sent.at_ns - began_ns) * 1e-9 / seconds:.0f} % of the record")
    segment.close()
    return path


def _times(began_ns: int, seconds: float) -> list[int]:
    """Times of the flight in a random order, after the first minute at most."""
    begin_ms = began_ns // 1_000_000 + 5000
    return [begin_ms + round(random.Random(1 + number).random() * 1000.0 * (seconds - 10.0)) for number in range(SEEKS)]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _print(found: dict[str, Any]) -> None:
    table = Table(title=f"The page: {FEW} drones, and {found['drones']} drones with {found['seconds'] / 60:.0f} min of history")
    for column in ("", "measured", "asked for", ""):
        table.add_column(column, justify="left" if not column else "right")
    least = min(LEAST_FPS, found["empty_fps"])
    least_panned = min(LEAST_FPS, found["empty_panned_fps"])
    rows = (
        ("publication to screen, median, ms", found["latency_median_ms"], MOST_MS, False),
        ("publication to screen, 95 %, ms", found["latency_p95_ms"], MOST_MS, False),
        (f"station besides the fold, {FEW} drones, % of a core", found["few_cpu_percent"], MOST_CPU, False),
        ("station besides the fold, many drones, %", found["many_cpu_percent"], MOST_CPU, False),
        ("fold, many drones, %", found["many_fold_percent"], None, False),
        ("pictures per second, empty map", found["empty_fps"], None, True),
        ("pictures per second, many drones", found["many_fps"], least, True),
        ("pictures per second, empty map, moved", found["empty_panned_fps"], None, True),
        ("pictures per second, many drones, moved", found["many_panned_fps"], least_panned, True),
        ("browser's CPU for a picture, empty map, moved, ms", found["empty_panned_picture_ms"], None, False),
        ("browser's CPU for a picture, many drones, moved, ms", found["many_panned_picture_ms"], None, False),
        ("opening the record, s", found["opened_s"], None, False),
        ("of it CPU, s", found["opening_cpu_s"], None, False),
        ("of that in the fold, s", found["opening_fold_s"], None, False),
        ("record, MB", found["record_mb"], None, False),
        ("an earlier time, 95 %, ms", found["seek_p95_ms"], None, False),
        ("what a newly opened page gets, kB", found["snapshot_kb"], None, False),
        ("memory of the station, MB", found["server_mb"], None, False),
        ("memory of the page's process, MB", found["page_mb"], None, False),
    )
    for name, value, bound, more in rows:
        good = bound is None or (value >= bound if more else value < bound)
        asked = "" if bound is None else f"{'≥' if more else '<'} {bound:.0f}"
        table.add_row(name, f"{value:.1f}", asked, "" if bound is None else "holds" if good else "FAILS")
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
