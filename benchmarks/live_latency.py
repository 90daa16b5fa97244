"""Latency from the publication of a cone to the hypothesis that includes it in every other agent, against raw Zenoh.

Flies ``radron-sim live`` (real agents, real Zenoh, real MAVLink) and reads the agents' flight records: the wall times of the
publication, of the reception by a receiver's pilot, and of that pilot's first hypothesis that includes the cone. Meanwhile other
processes exchange payloads of a cone's size over raw Zenoh (put to callback): one sends to one peer, another to as many peers as
an agent (the other agents and the observer).

Run: python benchmarks/live_latency.py [--scenario demo] [--drones 3] [--flight DIR of an earlier flight] [--json OUT]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from common.live_flight import flights, fly, messages
from common.raw_zenoh import RawProbe
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.protocol.keys import parse_key

CONE_BYTES = 406  # as published in the demo
RAW_PERIOD_S = 0.2  # as often as a swarm of three publishes cones
RAW = "raw Zenoh, to one"
RAW_TO_ALL = "raw Zenoh, to as many as an agent"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--scenario", default="paper-demo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drones", type=int)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--flight", type=Path, help="read this flight instead of flying; without raw Zenoh beside it")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    raw: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory(prefix="radron-latency-") as folder:
        if options.flight is None:
            raw = _flown(Path(folder), options)
        delays, (start_s, end_s) = _delays(flights(options.flight or Path(folder)))
    for name, samples in raw.items():  # while cones were on their way, not while agents start or pictures are drawn
        delays[name] = [latency_ms for time_s, latency_ms in samples if start_s <= time_s <= end_s]
    figures = {name: _figures(values) for name, values in delays.items()}
    _print(figures)
    if options.json is not None:
        options.json.write_text(json.dumps({"live_latency": figures}, indent=1) + "\n")


def _flown(folder: Path, options: argparse.Namespace) -> dict[str, list[tuple[float, float]]]:
    """Fly; returns the samples of raw Zenoh taken meanwhile."""
    arguments = [options.scenario, "--seed", str(options.seed)]
    if options.drones is not None:
        arguments += ["--drones", str(options.drones)]
    for setting in options.settings:
        arguments += ["--set", setting]
    with RawProbe(CONE_BYTES, RAW_PERIOD_S) as one, RawProbe(CONE_BYTES, RAW_PERIOD_S, options.drones or 3) as many:
        fly(folder, arguments)
    return {RAW: one.samples, RAW_TO_ALL: many.samples}


def _delays(found: dict[str, RecordedFlight]) -> tuple[dict[str, list[float]], tuple[float, float]]:
    """Delays in ms of every cone at every other agent, once it had a hypothesis; wall times of the first and the last, s."""
    published: dict[bytes, int] = {}
    for flight in found.values():
        for record, _, kind, payload in messages(flight, topics.PUBLICATION):
            if kind == "cone":
                published[payload] = record.publish_ns
    delays: dict[str, list[float]] = {"cone to pilot": [], "pilot to hypothesis": [], "cone to hypothesis": []}
    arrivals = [arrival for flight in found.values() for arrival in _arrivals(flight, published)]
    if not arrivals:
        sys.exit("no cone came from one agent to another while there was a hypothesis; fly longer")
    for sent_ns, given_ns, had_ns in arrivals:
        delays["cone to pilot"].append((given_ns - sent_ns) * 1e-6)
        delays["pilot to hypothesis"].append((had_ns - given_ns) * 1e-6)
        delays["cone to hypothesis"].append((had_ns - sent_ns) * 1e-6)
    had = [had_ns * 1e-9 for _, _, had_ns in arrivals]
    return delays, (min(had), max(had))


def _arrivals(flight: RecordedFlight, published: dict[bytes, int]) -> list[tuple[int, int, int]]:
    """Wall times of a cone's publication, of its arrival at this pilot, and of the first hypothesis after that."""
    arrivals: list[tuple[int, int, int]] = []
    waiting: dict[bytes, int] = {}
    known: set[bytes] = set()
    has_hypothesis = False
    for record in flight.records():
        if record.topic == topics.MESSAGE:
            key, payload = topics.decode_message(record.data)
            if parse_key(key).kind == "cone" and payload in published and payload not in known:
                known.add(payload)
                waiting[payload] = record.publish_ns
        elif record.topic == topics.HYPOTHESIS:
            if has_hypothesis:  # the first one of a flight has to wait for its ten cones
                arrivals += [(published[payload], given_ns, record.publish_ns) for payload, given_ns in waiting.items()]
            waiting.clear()
            has_hypothesis = record.data != b"null"
    return arrivals


def _figures(values: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(values, [50, 99])
    return {"count": len(values), "p50_ms": float(p50), "p99_ms": float(p99), "max_ms": max(values)}


def _print(figures: dict[str, dict[str, float]]) -> None:
    table = Table(title="Latency, live")
    for head in ("", "number", "p50 ms", "p99 ms", "largest ms"):
        table.add_column(head, justify="left" if not head else "right")
    for name, values in figures.items():
        numbers = (f"{values[key]:.2f}" for key in ("p50_ms", "p99_ms", "max_ms"))
        table.add_row(name, str(values["count"]), *numbers)
    console = Console(width=100)
    console.print(table)
    ours = figures["cone to hypothesis"]
    ratios = [f"{ours['p50_ms'] / figures[raw]['p50_ms']:.2f} times that of {raw}" for raw in (RAW, RAW_TO_ALL) if raw in figures]
    console.print("; ".join([*ratios, f"p99: {ours['p99_ms']:.1f} ms"]))


if __name__ == "__main__":
    main()
