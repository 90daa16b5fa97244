"""What the fusion costs one agent of a swarm of three: per simulated second, per cone, per idle call, and for x0.

Run: python benchmarks/fusion.py
"""

from __future__ import annotations

import json
import math
import time

import numpy as np
from shapely import Polygon

from agent.config import AreaConfig, DroneInMission, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.fusion.engine import Fusion
from agent.fusion.initial import InitialSearch
from agent.fusion.observation import observe
from protocol.codec import encode
from protocol.messages import Cone, ConeOrder, Counts, Entry, Exposure, PoseSample

SECONDS = 120
STEP_NS = 50_000_000  # the pilot calls at 20 Hz
CONES_PER_S, EXPOSURES_PER_S = 6, 12
DELAY_NS = 60_000_000  # of the radio
BOOT = "0" * 16


def main() -> None:
    mission = MissionConfig(
        name="benchmark",
        drones=tuple(DroneInMission(id=name) for name in "abc"),
        area=AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
    )
    arrivals = sorted(((entry.stamp_ns + DELAY_NS, entry, encode(entry)) for entry in _entries(mission)), key=lambda a: a[0])
    parts = (_flight, _replay, _reaction, _initial)
    print(json.dumps({"fusion": {name: value for part in parts for name, value in part(mission, arrivals).items()}}, indent=1))


def _entries(mission: MissionConfig) -> list[Entry]:
    rng = np.random.default_rng(1)
    entries: list[Entry] = []
    for sequence, time_s in enumerate(np.sort(rng.uniform(0.0, SECONDS, SECONDS * CONES_PER_S))):
        index = int(rng.integers(3))
        phase = 0.25 * time_s + index * math.tau / 3
        apex = np.array([50.0 + 12.0 * math.cos(phase), 50.0 + 12.0 * math.sin(phase), 3.0])
        line = np.array([50.0, 50.0, 0.0]) - apex
        axis = line / np.linalg.norm(line) + 0.7 * rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        theta = math.acos(float(axis @ line / np.linalg.norm(line)))
        order = ConeOrder(tuple(axis.tolist()), theta, 0.1, 0.5)
        entries.append(
            Cone(
                mission=mission.mission_id,
                stamp_ns=round(time_s * 1e9),
                drone="abc"[index],
                boot=BOOT,
                sequence=sequence,
                epoch=0,
                apex_m=tuple(apex.tolist()),
                apex_sigma_m=0.1,
                yaw_sigma_rad=0.01,
                orders=(order, order),
                energies_kev=(200.0, 460.0),
                energy_sigmas_kev=(5.0, 9.0),
                separation_mm=1.0,
            )
        )
    length_ns = round(3e9 / EXPOSURES_PER_S)
    poses = tuple(PoseSample(round(i * 1e8), (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0)) for i in range(3))
    for index in range(SECONDS * EXPOSURES_PER_S):
        entries.append(
            Exposure(
                mission=mission.mission_id,
                stamp_ns=(index // 3) * length_ns,
                drone="abc"[index % 3],
                boot=BOOT,
                sequence=100_000 + index // 3,
                epoch=0,
                end_ns=(index // 3 + 1) * length_ns,
                live_time_s=length_ns / 1e9,
                counts=Counts(5, 0, 1),
                poses=poses,
                position_sigma_m=0.1,
                yaw_sigma_rad=0.01,
            )
        )
    return entries


def _flight(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    fusion = Fusion(mission, FrameGraph.from_launch_layout(mission))
    fusion.start(0)
    calls = iter(arrivals)
    waiting = next(calls, None)
    begin = time.perf_counter()
    for now_ns in range(0, SECONDS * 1_000_000_000, STEP_NS):
        while waiting is not None and waiting[0] <= now_ns:
            fusion.receive(waiting[1], waiting[2])
            waiting = next(calls, None)
        fusion.advance(now_ns)
    flown_s = time.perf_counter() - begin
    assert fusion.hypothesis is not None
    now_ns = SECONDS * 1_000_000_000 - STEP_NS
    begin = time.perf_counter()
    for _ in range(10_000):
        fusion.advance(now_ns)
    idle_s = (time.perf_counter() - begin) / 10_000
    return {
        "per_simulated_second_ms": round(flown_s / SECONDS * 1e3, 3),
        "idle_advance_us": round(idle_s * 1e6, 3),
        "cones": fusion.hypothesis.cones,
        "error_m": round(float(np.hypot(*(fusion.hypothesis.position[:2] - 50.0))), 3),
    }


def _replay(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    """Everything is there at once: one long replay, in slices."""
    fusion = Fusion(mission, FrameGraph.from_launch_layout(mission))
    for _, entry, payload in arrivals:
        fusion.receive(entry, payload)
    slices = []
    while not slices or fusion.pending:
        begin = time.perf_counter()
        fusion.advance(SECONDS * 1_000_000_000)
        slices.append(time.perf_counter() - begin)
    return {"replay_ms": round(sum(slices) * 1e3, 2), "longest_slice_ms": round(max(slices) * 1e3, 2)}


def _reaction(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    """From a cone's arrival to the hypothesis that has it in, x0 excluded."""
    fusion = Fusion(mission, FrameGraph.from_launch_layout(mission))
    taken = []
    for now_ns, entry, payload in arrivals:
        begin = time.perf_counter()
        fusion.receive(entry, payload)
        fusion.advance(now_ns)
        if isinstance(entry, Cone):
            taken.append(time.perf_counter() - begin)
    return {"cone_to_hypothesis_us": round(float(np.median(taken)) * 1e6, 1)}


def _initial(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    search = InitialSearch(Polygon(mission.area.polygon_m))
    cones = [seen.forward for _, entry, _ in arrivals if (seen := observe(entry, Transform())) is not None]
    taken = []
    for first in range(0, 200, 10):
        begin = time.perf_counter()
        search.solve(cones[first : first + 10])
        taken.append(time.perf_counter() - begin)
    return {"x0_median_ms": round(float(np.median(taken)) * 1e3, 2), "x0_max_ms": round(max(taken) * 1e3, 2)}


if __name__ == "__main__":
    main()
