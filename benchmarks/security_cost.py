"""What encryption and signatures cost: CPU of a drone's links, and the delay of a cone from its publication to every peer's log.

Swarms of processes on this machine with the traffic of agents, without vehicles and cameras, alternately with TLS and signatures
and without both. CPU: of a process, user and system, so that other load matters little. Delay: from before a cone is signed until
each peer has verified it. Medians over the runs, and their ranges. Whole agents: benchmarks/live_cost.py --compare.

The goals hold for a swarm of ten.

Run: python benchmarks/security_cost.py [--drones 10] [--seconds 10] [--runs 6] [--json OUT]; about 3 minutes
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import resource
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from mesh import MOST_DRONES, free_ports, start, stop, until

from common.goals import Goal, show
from radron.agent.fusion.proofs import Proofs
from radron.protocol.codec import decode_from, encode, written
from radron.protocol.entries import Cone, ConeOrder, Entry
from radron.protocol.identity import Role, load_identity
from radron.protocol.issuing import throwaway
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Plan, Pose, Stage, Status
from radron.protocol.signing import Verifier
from radron.protocol.trust import trust_of

MISSION, SWARM = "0" * 16, "benchmark"
TICK_S = 0.1  # a pose and a plan; a batch of entries every second one, a status every tenth
BATCH = 3  # cones and exposures of one readout
PLANNED = 20  # positions
ENTRIES_LATE = 0.55  # ticks after pose and plan: readouts come at any time
SETTLED_S = 1.0  # from the complete mesh to the first message: handshakes are over
MOST_POINTS, MOST_RATIO = 3.0, 1.5  # goals: CPU in percent of a core, and the cones' delay, against plain links


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--drones", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run")
    parser.add_argument("--runs", type=int, default=6, help="of each kind")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found: dict[str, list[tuple[float, float]]] = {"secured": [], "plain": []}
    with tempfile.TemporaryDirectory() as folder:
        throwaway({Path(folder, f"d{i}"): (f"d{i}", Role.DRONE) for i in range(MOST_DRONES)}, time.time_ns())
        for number in range(2 * options.runs):
            kind = ("secured", "plain")[number % 2]
            found[kind].append(fly(options.drones, options.seconds, folder if kind == "secured" else ""))
            print(f"{kind:8} CPU {found[kind][-1][0]:5.2f} % of a core, cone to a peer's log p50 {found[kind][-1][1]:5.2f} ms")
    cpu, delay = ({kind: [run[place] for run in runs] for kind, runs in found.items()} for place in (0, 1))
    load = os.getloadavg()[0]
    title = f"{options.drones} drones, {options.runs} runs of {options.seconds:g} s each; load of this machine {load:.1f}"
    against = [f"{told(one['secured'])} against {told(one['plain'])}" for one in (cpu, delay)]
    goals = [
        Goal(
            "CPU of a drone's links, more than without TLS and signatures", apart(cpu), MOST_POINTS, "points", f"{against[0]} %"
        ),
        Goal("cone to every peer's log, p50, against without", ratio(delay), MOST_RATIO, "times", f"{against[1]} ms"),
    ]
    show(title, goals)
    if options.json is not None:
        figures = {"cpu_percent": cpu, "cone_to_log_p50_ms": delay, "load": load}
        options.json.write_text(json.dumps({"security_cost": figures}, indent=1) + "\n")


def told(values: list[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f}-{max(values):.2f})"


def apart(values: dict[str, list[float]]) -> float:
    return statistics.median(values["secured"]) - statistics.median(values["plain"])


def ratio(values: dict[str, list[float]]) -> float:
    """Median of the ratios of two runs, one after the other: the load of the machine changes over minutes."""
    return statistics.median(secured / plain for secured, plain in zip(values["secured"], values["plain"], strict=True))


def fly(number: int, seconds: float, folder: str) -> tuple[float, float]:
    """CPU in percent of a core, and the cones' median delay in ms: medians over the drones. ``folder`` "": plain links."""
    ends = [f"{'tls' if folder else 'tcp'}/127.0.0.1:{port}" for port in free_ports(number)]
    peers = [start(drone, folder, i, ends, seconds) for i in range(number)]
    for _, pipe in peers:
        pipe.recv()  # ready: the drone hears all others
    begin_s = time.monotonic() + SETTLED_S
    for _, pipe in peers:
        pipe.send(begin_s)
    told = [pipe.recv() for _, pipe in peers]
    stop(peers)
    return statistics.median(cpu for cpu, _ in told), statistics.median(delay for _, delay in told)


def drone(pipe: Connection, folder: str, index: int, ends: list[str], seconds: float) -> None:
    """A drone of the swarm, in its own process."""
    asyncio.run(_drone(pipe, folder, index, ends, seconds))


async def _drone(pipe: Connection, folder: str, index: int, ends: list[str], seconds: float) -> None:
    names = [f"d{i}" for i in range(len(ends))]
    own, boot, delays_ms = names[index], f"{index:016x}", list[float]()
    identity = load_identity(Path(folder, own)) if folder else None
    trust = trust_of(identity)
    verifier = Verifier(trust.authority) if trust is not None else None
    proofs = Proofs(names, (own, MISSION, boot), trust, verifier)

    def take(key: str, payload: bytes) -> None:
        message, now_ns = decode_from(key, payload), time.time_ns()
        if isinstance(message, Status):
            proofs.is_signed(message, now_ns)
        elif isinstance(message, Entry):
            for entry, _ in proofs.proven(message, payload, now_ns):
                if isinstance(entry, Cone):
                    delays_ms.append((time.time_ns() - entry.stamp_ns) * 1e-6)

    links = MeshConfig(listen=ends[index], connect=tuple(ends[:index]), identity=identity, drones=tuple(names))
    mesh = await Mesh.open(links, SWARM, own, receive=take)
    pipe.send("ready")
    await until(lambda: len(mesh.alive) == len(ends) - 1)
    pipe.send("complete")
    # Agents do not publish at the same moment. With TLS a mesh is complete for one of them up to 30 ms later than for another:
    # counted from there, some would publish together, with TLS alone.
    began_s = await asyncio.to_thread(pipe.recv) + TICK_S * index / len(ends)
    await asyncio.sleep(began_s - time.monotonic())
    delays_ms.clear()
    before_s = _cpu_s()
    for tick in range(round(seconds / TICK_S)):
        for late, messages in ((0.0, _news), (ENTRIES_LATE, _entries)):
            await asyncio.sleep(max(0.0, began_s + (tick + late) * TICK_S - time.monotonic()))
            for message in messages(own, boot, tick, proofs):
                mesh.publish(key_of(SWARM, message), encode(message))
    share = 100.0 * (_cpu_s() - before_s) / (time.monotonic() - began_s)
    pipe.send((share, statistics.median(delays_ms)))
    await asyncio.to_thread(pipe.recv)
    await mesh.close()


def _news(own: str, boot: str, tick: int, proofs: Proofs) -> Iterator[Pose | Plan | Status]:
    now_ns, place = time.time_ns(), (1.5, 2.5, 10.5)
    yield Pose(stamp_ns=now_ns, drone=own, epoch=0, position_m=place, velocity_mps=(0.5,) * 3, quaternion=(1.0, 0.0, 0.0, 0.0),
               position_sigma_m=0.1, yaw_sigma_rad=0.01)  # fmt: skip
    yield Plan(stamp_ns=now_ns, drone=own, epoch=0, step_ns=100_000_000, positions_m=(place,) * PLANNED)
    if tick % 10 == 0:
        status = Status(stamp_ns=now_ns, drone=own, mission=MISSION, boot=boot, stage=Stage.TRACK, counters={"received": tick})
        yield proofs.signed_status(written(status)[1])


def _entries(own: str, boot: str, tick: int, proofs: Proofs) -> Sequence[Entry]:
    if tick % 2:
        return ()
    return proofs.signed([_cone(own, boot, BATCH * tick + i + 1) for i in range(BATCH)], time.time_ns())


def _cone(own: str, boot: str, sequence: int) -> Cone:
    order = ConeOrder(axis=(0.0, 0.0, 1.0), theta_rad=0.5, sigma_rad=0.05, probability=0.5)
    now_ns = time.time_ns()
    return Cone(stamp_ns=now_ns, drone=own, mission=MISSION, boot=boot, sequence=sequence, epoch=0, apex_m=(1.5, 2.5, 10.5),
                apex_sigma_m=0.1, yaw_sigma_rad=0.01, orders=(order, order), energies_kev=(200.0, 460.0),
                energy_sigmas_kev=(5.0, 9.0), separation_mm=1.5)  # fmt: skip


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
