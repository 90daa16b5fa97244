"""Log entries of a member that are old, or far more than cameras measure: what they cost the others.

Flies ``radron-sim live`` while a process with the key of d2 publishes such entries for 20 s. Measured at the other drones: newly
computed setpoints a second, before and meanwhile; processor time and memory of the agents; their reports of d2. Also reported:
whether all logs are equal at the end.

Run: python -m benchmarks.crowding [old exposure cone coverage none] [--seconds 20] [--at 40] [--json OUT]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from statistics import mean

import msgspec
from rich.console import Console
from rich.table import Table

from common.goals import Goal, show
from common.live_flight import Seen, flight_folder, flights, fly, messages
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.vehicle.interface import Request, VehicleCommand
from radron.protocol.codec import decode_from
from radron.protocol.keys import drone_key
from radron.protocol.messages import Status

MIN_SETPOINT_HZ = 18.0  # goal
CASES = {
    "none": "",
    "old": '[[fault]]\nkind = "old-entries"\ntarget = "d2"\nper_s = {old:g}\nago_s = 60.0\n',
    "exposure": '[[fault]]\nkind = "dense-entries"\ntarget = "d2"\nwhat = "exposure"\nper_s = 900.0\n',
    "cone": '[[fault]]\nkind = "dense-entries"\ntarget = "d2"\nwhat = "cone"\nper_s = 1000.0\n',
    "coverage": '[[fault]]\nkind = "dense-entries"\ntarget = "d2"\nwhat = "coverage"\nper_s = 1000.0\n',
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}; all if none is given")
    parser.add_argument("--scenario", default="paper-demo")
    parser.add_argument("--at", type=float, default=40.0, help="s after the start, when it begins")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long it lasts")
    parser.add_argument("--old", type=float, default=3.0, help="old entries a second")
    parser.add_argument("--track", type=float, default=60.0, help="s of tracking")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = [_flown(case, options) for case in options.cases or CASES]
    table = Table(title=f"Entries of d2 for {options.seconds:g} s")
    for column in rows[0]:
        table.add_column(column.replace("_", " "))
    for row in rows:
        table.add_row(*(f"{value:.1f}" if isinstance(value, float) else str(value) for value in row.values()))
    Console(width=160).print(table)
    show(
        "Under these entries",
        [
            Goal(f"{row['case']}: mean time between setpoints", 1e3 / float(row["hz"]), 1e3 / MIN_SETPOINT_HZ, "ms")
            for row in rows
        ],
    )
    if options.json is not None:
        options.json.write_text(json.dumps({"crowding": rows}, indent=1) + "\n")


def _flown(case: str, options: argparse.Namespace) -> dict[str, str | float]:
    with flight_folder() as folder:
        folder.joinpath("case.toml").write_text(_scenario(case, options))
        seen = fly(folder, [str(folder / "case.toml"), "--set", f"mission.track.duration_s={options.track:g}"])
        return {"case": case, **_figures(folder, seen, options)}


def _scenario(case: str, options: argparse.Namespace) -> str:
    fault = CASES[case].format(old=options.old)
    times = f"at_s = {options.at:g}\nfor_s = {options.seconds:g}\n" if fault else ""
    return f'base = "{options.scenario}"\nname = "crowding"\n\n{fault}{times}'


def _figures(folder: Path, seen: dict[int, Seen], options: argparse.Namespace) -> dict[str, str | float]:
    found = flights(folder)
    report = json.loads((folder / "agents.json").read_text())
    others = [name for name in found if name != "d2"]
    start_s = _started_s(found[others[0]])
    begin_s, end_s = start_s + options.at, start_s + options.at + options.seconds
    agents = [one for one in seen.values() if one.kind == "agent"]
    named = {name: _named(found[name], begin_s) for name in others}
    last = [_held(one, end_s) for one in agents]
    first = [_held(one, begin_s) for one in agents]
    return {
        "hz": min(_rate(found[name], begin_s, end_s) for name in others),
        "hz_before": min(_rate(found[name], begin_s - 10.0, begin_s) for name in others),
        "cpu_%": mean(100.0 * one.share(begin_s, end_s) for one in agents),
        "cpu_before_%": mean(100.0 * one.share(begin_s - 10.0, begin_s) for one in agents),
        "more_MB": max(after - before for after, before in zip(last, first, strict=True)),
        "peak_MB": max(one.rss_mb for one in agents),
        "alive": sum(agent["alive"] for agent in report["agents"]),
        "starts": len(agents),
        "agreed": report["agreed"],
        "named": ", ".join(f"{name}: {after_s}" for name, after_s in named.items()),
        "failsafes": sum(agent["failsafes"] for agent in report["agents"]),
    }


def _held(one: Seen, at_s: float) -> float:
    return max((held.rss_mb for time_s, held in one.held if time_s <= at_s), default=0.0)


def _started_s(flight: RecordedFlight) -> float:
    """When the mission began, by an agent's statuses."""
    for _, _, kind, payload in messages(flight, topics.PUBLICATION):
        if kind == "status":
            status = decode_from(drone_key(flight.header.mission.swarm, flight.header.drone.id, kind), payload)
            if isinstance(status, Status) and status.started_ns is not None:
                return status.started_ns * 1e-9
    sys.exit("the mission did not begin")


def _named(flight: RecordedFlight, begin_s: float) -> str:
    """An agent's first report of d2 in the attack, and its delay in seconds."""
    told: set[str] = set()
    for record, _, kind, payload in messages(flight, topics.PUBLICATION):
        if kind == "status":
            status = decode_from(drone_key(flight.header.mission.swarm, flight.header.drone.id, kind), payload)
            assert isinstance(status, Status)
            after_s = record.publish_ns * 1e-9 - begin_s
            new = [str(one) for one in status.texts.problems if one.about == "d2" and one not in told]
            if new and after_s > 0.0:
                return f"{after_s:.1f} s ({new[0]})"
            told.update(new)
    return "never"


def _rate(flight: RecordedFlight, begin_s: float, end_s: float) -> float:
    """Newly computed setpoints a second, of one agent; commands are sent by the step that has computed them."""
    commands = [
        record.data
        for record in flight.records()
        if record.topic == topics.COMMAND and begin_s <= record.publish_ns * 1e-9 < end_s
    ]
    flown = [data for data in commands if msgspec.json.decode(data, type=VehicleCommand).request is Request.OFFBOARD]
    return len(dict.fromkeys(flown)) / (end_s - begin_s)


if __name__ == "__main__":
    main()
