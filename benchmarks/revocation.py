"""Gaps in the mesh while all drones open their sessions anew without a revoked one, each in its turn.

A process for each drone, as in flight; each publishes a pose every 50 ms. Gap of a pair: between arrivals of a drone's poses at
its peer.

Run: python benchmarks/revocation.py [--drones 10] [--revoked d3] [--runs 3] [--json OUT]; about a minute
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import tempfile
import time
from collections import defaultdict
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import NamedTuple

from mesh import free_ports, start, stop, until

from common.goals import Goal, show
from radron.agent.shell.revoked import turn_s
from radron.protocol.identity import Role, load_identity
from radron.protocol.issuing import throwaway
from radron.protocol.keys import drone_key, parse_key
from radron.protocol.mesh.session import Mesh, MeshConfig

SWARM, POSE_S = "benchmark", 0.05
SETTLED_S, OPENED_S = 2.0, 10.0  # before; until all have opened their sessions anew
MOST_GAP_S, MOST_EFFECT_S = 1.0, 10.0  # goals


class Told(NamedTuple):
    """A drone's report; times by the monotonic clock, which all processes of a machine share."""

    reopened_s: float
    heard: dict[str, list[float]]  # times of the poses by sender


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--drones", type=int, default=10)
    parser.add_argument("--revoked", default="d3")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    names = [f"d{number + 1}" for number in range(options.drones)]
    gaps, last, took = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        throwaway({Path(folder, name): (name, Role.DRONE) for name in names}, time.time_ns())
        for _ in range(options.runs):
            of_pairs, last_s, took_s = measure(folder, names, options.revoked)
            gaps.append(max(of_pairs))
            last.append(last_s)
            took.append(took_s)
            told = f"median {median(of_pairs):.2f} s, most {max(of_pairs):.2f} s"
            print(f"largest gap of each pair: {told}; all sessions opened after {took_s:.1f} s")
    load = os.getloadavg()[0]
    show(
        f"{options.drones} drones, {options.revoked} revoked, {options.runs} runs; load of this machine {load:.1f}",
        [
            Goal("largest gap between two of the others, median of the runs", median(gaps), MOST_GAP_S, "s", _range(gaps)),
            Goal("last pose of the revoked one, after the revocation", max(last), MOST_EFFECT_S, "s", _range(last)),
            Goal("all sessions opened anew", max(took), MOST_EFFECT_S, "s", _range(took)),
        ],
    )
    if options.json is not None:
        figures = {"gap_s": gaps, "last_heard_s": last, "opened_s": took, "load": load}
        options.json.write_text(json.dumps({"revocation": figures}, indent=1) + "\n")


def _range(values: list[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f} s"


def measure(folder: str, names: list[str], revoked: str) -> tuple[list[float], float, float]:
    """Largest gap of each pair of the others; when the revoked one was heard last, and the last session was open; seconds."""
    ends = [f"tls/127.0.0.1:{port}" for port in free_ports(len(names))]
    peers = [start(drone, folder, names, index, ends, revoked) for index in range(len(names))]
    for _, pipe in peers:  # once all are complete
        pipe.send("go")
    for _, pipe in peers:
        pipe.recv()
    began_s = time.monotonic()
    for _, pipe in peers:
        pipe.send(began_s)
    told: dict[str, Told] = {name: pipe.recv() for name, (_, pipe) in zip(names, peers, strict=True)}
    stop(peers)
    left = [name for name in names if name != revoked]
    gaps = [_gap(told[other].heard[one], began_s) for one in left for other in left if one != other]
    last_s = max((told[name].heard[revoked][-1] for name in left if told[name].heard.get(revoked)), default=began_s)
    return gaps, last_s - began_s, max(told[name].reopened_s for name in left) - began_s


def _gap(times: list[float], began_s: float) -> float:
    """The largest gap, up to the end, so that a drone that never returns shows too."""
    return max(after - before for before, after in pairwise((*times, began_s + OPENED_S)) if after > began_s)


def drone(pipe: Connection, folder: str, names: list[str], index: int, ends: list[str], revoked: str) -> None:
    """A drone, in its own process."""
    asyncio.run(_drone(pipe, folder, names, index, ends, revoked))


async def _drone(pipe: Connection, folder: str, names: list[str], index: int, ends: list[str], revoked: str) -> None:
    own, heard = names[index], defaultdict[str, list[float]](list)
    identity = load_identity(Path(folder, own))

    def config(without: frozenset[str]) -> MeshConfig:
        dialled = tuple(end for name, end in zip(names[:index], ends[:index], strict=True) if name not in without)
        return MeshConfig(listen=ends[index], connect=dialled, identity=identity, drones=tuple(names), revoked=without)

    def receive(key: str, payload: bytes) -> None:
        heard[parse_key(key).sender].append(time.monotonic())

    async def publish() -> None:
        while True:
            mesh.publish(drone_key(SWARM, own, "pose"), bytes(100))
            await asyncio.sleep(POSE_S)

    mesh = await Mesh.open(config(frozenset()), SWARM, own, receive=receive, answer=lambda _: [])
    pipe.send("ready")
    await asyncio.to_thread(pipe.recv)
    await until(lambda: len(mesh.alive) == len(names) - 1)
    publishing = asyncio.create_task(publish())
    await asyncio.sleep(SETTLED_S)
    pipe.send("settled")
    began_s = await asyncio.to_thread(pipe.recv)
    if own != revoked:
        await asyncio.sleep(turn_s(index, len(names)))
        await mesh.reopen(config(frozenset({revoked})))
    reopened_s = time.monotonic()
    await asyncio.sleep(began_s + OPENED_S - time.monotonic())
    publishing.cancel()
    pipe.send(Told(reopened_s, dict(heard)))
    await asyncio.to_thread(pipe.recv)
    await mesh.close()


if __name__ == "__main__":
    main()
