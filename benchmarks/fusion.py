"""Measure the cost of the source estimate for one agent of a swarm of three.

The cost is given per simulated second, per cone, per idle call, and for the first estimate (x0).

Run: python benchmarks/fusion.py
"""

from __future__ import annotations

import json
import math
import time

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.engine import Fusion
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.initial import InitialSearch
from radron.agent.fusion.observation import ConeObservation, observe
from radron.agent.fusion.registry import estimator_named
from radron.protocol.codec import encode
from radron.protocol.entries import Cone, ConeOrder, Counts, Entry, Exposure, PoseSample

SECONDS = 120
STEP_NS = 50_000_000  # the pilot calls at 20 Hz
CONES_PER_S, EXPOSURE_S = 6, 0.5  # of all drones together; of each
SOURCE = np.array([50.0, 50.0, 0.0])
DRONES = "abc"
DELAY_NS = 60_000_000  # of the radio
BOOT = "0" * 16
Vector = NDArray[np.float64]


def main() -> None:
    rows = {}
    for name in ("paper", "bayes"):
        mission = MissionConfig(
            name="benchmark",
            drones=tuple(DroneInMission(id=drone) for drone in DRONES),
            area=AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
            fusion=FusionConfig(estimator=name),
        )
        entries = _entries(mission)
        arrivals = sorted(((_known_ns(entry) + DELAY_NS, entry, encode(entry)) for entry in entries), key=lambda a: a[0])
        parts = (_flight, _replay, _reaction, *((_initial,) if name == "paper" else (_steps,)))
        rows[name] = {key: value for part in parts for key, value in part(mission, arrivals).items()}
    print(json.dumps({"fusion": rows}, indent=1))


def _entries(mission: MissionConfig) -> list[Entry]:
    """Cones and exposures of three drones that circle a source of 3 GBq in the middle; rates as the estimator expects them."""
    rng = np.random.default_rng(1)
    response = response_of(mission.named())
    entries: list[Entry] = []
    for index, drone in enumerate(DRONES):
        own = {"mission": mission.mission_id, "drone": drone, "boot": BOOT, "epoch": 0}
        for number in range(round(SECONDS / EXPOSURE_S)):
            stamp_ns = round(number * EXPOSURE_S * 1e9)
            places = [_place(number * EXPOSURE_S + 0.1 * k, index) for k in range(round(EXPOSURE_S / 0.1) + 1)]
            away = SOURCE - places[len(places) // 2]
            distance = float(np.linalg.norm(away))
            fluence = 3.0 * response.flux(np.array(distance))
            partial, full = rng.poisson(
                (response.signal(fluence, np.array(distance)) + response.background_ps) * EXPOSURE_S
            ).tolist()
            poses = tuple(PoseSample(round(k * 1e8), tuple(p.tolist()), (1.0, 0.0, 0.0, 0.0)) for k, p in enumerate(places))
            entries.append(
                Exposure(
                    **own,
                    stamp_ns=stamp_ns,
                    sequence=100_000 + number,
                    end_ns=stamp_ns + round(EXPOSURE_S * 1e9),
                    live_time_s=EXPOSURE_S,
                    counts=Counts(hits=partial + full, photopeak=full, coincidences=0),
                    poses=poses,
                    position_sigma_m=0.1,
                    yaw_sigma_rad=0.01,
                )
            )
        for sequence, time_s in enumerate(np.sort(rng.uniform(0.0, SECONDS, SECONDS * CONES_PER_S // len(DRONES)))):
            apex = _place(time_s, index)
            line = (SOURCE - apex) / np.linalg.norm(SOURCE - apex)
            axis = line + 0.7 * rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            theta = math.acos(float(axis @ line))
            wrong = rng.normal(size=3)
            orders = (
                ConeOrder(tuple(axis.tolist()), theta, 0.1, 0.7),
                ConeOrder(tuple((wrong / np.linalg.norm(wrong)).tolist()), 1.2, 0.1, 0.3),
            )
            entries.append(
                Cone(
                    **own,
                    stamp_ns=round(time_s * 1e9),
                    sequence=sequence,
                    apex_m=tuple(apex.tolist()),
                    apex_sigma_m=0.1,
                    yaw_sigma_rad=0.01,
                    orders=orders,
                    energies_kev=(200.0, 460.0),
                    energy_sigmas_kev=(5.0, 9.0),
                    separation_mm=1.0,
                )
            )
    return entries


def _place(time_s: float, index: int) -> Vector:
    phase = 0.25 * time_s + index * math.tau / len(DRONES)
    return SOURCE + np.array([12.0 * math.cos(phase), 12.0 * math.sin(phase), 3.0])


def _known_ns(entry: Entry) -> int:
    return entry.end_ns if isinstance(entry, Exposure) else entry.stamp_ns


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
    """All entries at once: one long replay, in slices."""
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
    """Computing time from a cone's arrival to the hypothesis that includes it, without x0 and the estimator's hold time."""
    fusion = Fusion(mission, FrameGraph.from_launch_layout(mission))
    hold_ns = round(fusion.estimator.hold_s * 1e9)
    taken = []
    for now_ns, entry, payload in arrivals:
        begin = time.perf_counter()
        fusion.receive(entry, payload)
        fusion.advance(now_ns + hold_ns)
        if isinstance(entry, Cone):
            taken.append(time.perf_counter() - begin)
    return {"cone_to_hypothesis_us": round(float(np.median(taken)) * 1e6, 1)}


def _steps(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    """Cost of a step with one cone and of one with one exposure while tracking, and of one with an exposure while searching."""
    estimator = estimator_named("bayes", mission)
    seen = sorted((s for _, entry, _ in arrivals if (s := observe(entry, Transform())) is not None), key=lambda s: s.stamp_ns)
    state = estimator.initial(None)
    taken: dict[str, list[float]] = {"search_count_us": [], "track_count_us": [], "track_cone_us": []}
    for one in seen:
        index = one.stamp_ns // 100_000_000
        searching = state.track is None
        begin = time.perf_counter()
        state = estimator.step(state, GridStep(index, index * 100_000_000, (index + 1) * 100_000_000), [one])
        what = "cone" if isinstance(one, ConeObservation) else "count"
        taken.setdefault(f"{'search' if searching else 'track'}_{what}_us", []).append(time.perf_counter() - begin)
    return {name: round(float(np.median(times)) * 1e6, 1) for name, times in taken.items()}


def _initial(mission: MissionConfig, arrivals: list[tuple[int, Entry, bytes]]) -> dict[str, float]:
    search = InitialSearch(Polygon(mission.area.polygon_m))
    seen = (observe(entry, Transform()) for _, entry, _ in arrivals)
    cones = [one.forward for one in seen if isinstance(one, ConeObservation)]
    taken = []
    for first in range(0, 200, 10):
        begin = time.perf_counter()
        search.solve(cones[first : first + 10])
        taken.append(time.perf_counter() - begin)
    return {"x0_median_ms": round(float(np.median(taken)) * 1e3, 2), "x0_max_ms": round(max(taken) * 1e3, 2)}


if __name__ == "__main__":
    main()
