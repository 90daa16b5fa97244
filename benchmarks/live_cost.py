"""Cost of the live swarm: CPU and memory of each agent, of the world and of the launcher, and regularity of the setpoints.

Flies ``radron-sim live`` and watches its processes. Agent: the node and its watchdog together, over the last 30 s of tracking.
Setpoints: newly computed ones, at their arrival at the vehicle, over the whole flight.

Run: python benchmarks/live_cost.py [--drones 3 10] [--seconds 45] [--busy 2] [--compare] [--runs 3] [--json OUT]
With ten drones and ``--compare``: about 4 minutes for each run.
``--busy``: number of endless loops that run during the flight, at normal priority. ``--compare``: each flight also without
encryption and signatures, alternately; of several runs the medians are shown, and all are in the JSON.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from statistics import mean, median

import msgspec
from rich.console import Console
from rich.table import Table

from common.goals import Goal, show
from common.live_flight import Seen, all_tracking, cone_delays_ms, flight_folder, flights, fly, messages
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.vehicle.interface import Request, VehicleCommand

WINDOW_S = 30.0
MOST_POINTS, MOST_RATIO = 3.0, 1.5  # goals, of a swarm of ten


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--scenario", default="paper-demo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drones", type=int, nargs="+", default=[3, 10])
    parser.add_argument("--seconds", type=float, default=45.0, help="of tracking")
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--compare", action="store_true", help="also without encryption and signatures")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    links = (True, False) if options.compare else (True,)
    for drones, _, secured in product(options.drones, range(options.runs), links):
        with flight_folder() as folder, _busy(options.busy):
            arguments = [options.scenario, "--seed", str(options.seed), "--drones", str(drones)]
            arguments += [] if secured else ["--insecure"]
            seen = fly(folder, [*arguments, "--set", f"mission.track.duration_s={options.seconds:g}"])
            rows.append({"drones": drones, "secured": secured, **_cost(folder, seen)})
    medians = [
        _median([row for row in rows if (row["drones"], row["secured"]) == kind]) for kind in product(options.drones, links)
    ]
    _print(medians)
    if options.compare:
        show("Encryption and signatures, against without", list(_goals(medians)))
    if options.json is not None:
        options.json.write_text(json.dumps({"live_cost": rows}, indent=1) + "\n")


def _median(rows: list[dict[str, float]]) -> dict[str, float]:
    """Of several flights with the same swarm and links."""
    return {key: median(row[key] for row in rows) for key in rows[0]}


def _goals(rows: list[dict[str, float]]) -> Iterator[Goal]:
    for secured, plain in zip(rows[::2], rows[1::2], strict=True):
        swarm, keys = f"{secured['drones']:g} drones", ("agent_cpu_percent", "cone_p50_ms")
        (cpu, cpu_plain), (delay, delay_plain) = ((secured[key], plain[key]) for key in keys)
        yield Goal(
            f"{swarm}: CPU of an agent, more", cpu - cpu_plain, MOST_POINTS, "points", f"{cpu:.1f} against {cpu_plain:.1f} %"
        )
        told = f"{delay:.2f} against {delay_plain:.2f} ms"
        yield Goal(f"{swarm}: a cone to another agent, p50", delay / delay_plain, MOST_RATIO, "times", told)


@contextmanager
def _busy(number: int) -> Iterator[None]:
    """Endless loops during the flight."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def _cost(folder: Path, seen: dict[int, Seen]) -> dict[str, float]:
    """CPU in percent of a core over the end of tracking, peak memory in MB."""
    found = flights(folder)
    stretches = all_tracking(folder, found)
    end_s = min(end for _, end in stretches)
    start_s = max(end_s - WINDOW_S, *(start for start, _ in stretches))
    agents = {pid: one for pid, one in seen.items() if one.kind == "agent"}
    cpu = [100.0 * (one.share(start_s, end_s) + seen[one.parent].share(start_s, end_s)) for one in agents.values()]
    parts = {kind: [one for one in seen.values() if one.kind == kind] for kind in ("world", "launcher")}
    return {
        "agents": len(agents),
        "window_s": end_s - start_s,
        "agent_cpu_percent": mean(cpu),
        "agent_cpu_percent_most": max(cpu),
        "agent_uss_mb": max(one.uss_mb + seen[one.parent].uss_mb for one in agents.values()),
        "agent_rss_mb": max(one.rss_mb + seen[one.parent].rss_mb for one in agents.values()),
        **{f"{kind}_cpu_percent": 100.0 * sum(one.share(start_s, end_s) for one in ones) for kind, ones in parts.items()},
        "mesh_s": _mesh_s(found, min(seen[one.parent].began_s for one in agents.values())),
        "cone_p50_ms": median(cone_delays_ms(found)),
        **_setpoints(folder, found),
    }


def _setpoints(folder: Path, found: dict[str, RecordedFlight]) -> dict[str, float]:
    """Newly computed setpoints as received by the vehicles: the lowest rate and the longest gap."""
    agents = json.loads((folder / "agents.json").read_text())["agents"]
    rates = [agent["computed_setpoints"] / _offboard_s(found[agent["drone"]]) for agent in agents]
    return {"setpoint_hz": min(rates), "setpoint_gap_ms": 1e3 * max(agent["largest_gap_s"] for agent in agents)}


def _offboard_s(flight: RecordedFlight) -> float:
    """How long this agent sent setpoints, seconds."""
    given = [
        record.publish_ns
        for record in flight.records()
        if record.topic == topics.COMMAND and msgspec.json.decode(record.data, type=VehicleCommand).request is Request.OFFBOARD
    ]
    return (given[-1] - given[0]) * 1e-9


def _mesh_s(found: dict[str, RecordedFlight], began_s: float) -> float:
    """Until every agent has heard every other one, from the start of the first agent's process."""
    last_s = began_s
    for drone, flight in found.items():
        missing = set(found) - {drone}
        for record, sender, _, _ in messages(flight, topics.MESSAGE):
            missing.discard(sender)
            if not missing:
                last_s = max(last_s, record.publish_ns * 1e-9)
                break
        else:
            sys.exit(f"{drone} never heard {', '.join(sorted(missing))}")
    return last_s - began_s


def _print(rows: list[dict[str, float]]) -> None:
    table = Table(title="Cost, live")
    table.add_column("")
    heads = {
        "agent_cpu_percent": "an agent, % of a core",
        "agent_cpu_percent_most": "the dearest agent, %",
        "agent_uss_mb": "its own memory, MB",
        "agent_rss_mb": "resident memory, MB",
        "world_cpu_percent": "world, %",
        "launcher_cpu_percent": "launcher, %",
        "mesh_s": "start to full mesh, s",
        "cone_p50_ms": "a cone to another agent, p50, ms",
        "setpoint_hz": "new setpoints, lowest rate, Hz",
        "setpoint_gap_ms": "largest gap between two, ms",
    }
    for row in rows:
        table.add_column(f"{row['drones']:g} drones{'' if row['secured'] else ', insecure'}", justify="right")
    for key, head in heads.items():
        table.add_row(head, *(f"{row[key]:.1f}" for row in rows))
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
