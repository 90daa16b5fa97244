"""Test the estimator ``sources`` among several sources: ``python -m benchmarks.several_sources --flights 20 [--real]``.

Three simulated cameras fly lanes of 11 m over 100 x 100 m for 110 s and then circles of 6 m around each source by turns, 3 m high
at 3 m/s. Number (0 to 6), nuclides (as named), places and activities (0.3 to 6 GBq, log uniform) are drawn from the seed; sources
of one nuclide are at least 5 m apart, or 20 m if one is ten times as strong. ``--real``: positions off by 0.15 m along each axis,
sensitivities by 5 %, energy scales by 0.5 %, background x 1.2, 7 % from direction to direction. ``--alone``: one source of 3 GBq,
beside ``bayes``. ``--higher-m``: extra height of the second half of each circle. ``--walls``: behind the walls of the scenario
``mismatch-walls``, unknown to the estimators; with ``--map`` known to all. ``--unknown Co-60,F-18``: nuclides that are no
candidates, with or without sources. NEES: mean squared error of place over stated covariance, 2 if they match.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from radron.agent.config.buildings import BuildingsConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import AreaConfig, DetectionConfig, DroneInMission, MissionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.detection import Detections
from radron.agent.detector.files.calibration import Calibration
from radron.agent.frames.transform import Transform
from radron.agent.fusion.estimator import Estimator, GridStep, Hypothesis
from radron.agent.fusion.observation import ConeObservation, ConeSurface, CountObservation, Observation
from radron.agent.fusion.registry import estimator_named
from radron.agent.fusion.sources.spectra import KNOWN
from radron.agent.fusion.sources.tracker import Track
from radron.protocol.entries import EntryId
from radron.protocol.spectrum import SpectrumBin
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.truth import CameraTruth
from radron.sim.scenario import load_scenario
from radron.sim.world.walls import Walls

Array = NDArray[np.float64]
SIDE_M, LANE_M, HEIGHT_M, SPEED_MPS, RADIUS_M = 100.0, 11.0, 3.0, 3.0, 6.0
LANES_S, STEP_S, DRONES = 110.0, 0.5, 3
START_NS = 1_800_000_000_000_000_000
NS = 1_000_000_000
ASSUMED = CameraTruth()
IN_90 = 4.605  # of chi squared with two degrees of freedom


@dataclass(frozen=True)
class Placed:
    """A source of the truth."""

    nuclide: str
    place: Array
    activity_bq: float
    height_m: float = 0.0


@dataclass(frozen=True)
class Truth:
    """Differences between the cameras and the assumptions about them."""

    bias_m: float = 0.0
    camera: CameraTruth = ASSUMED
    walls: Walls | None = None

    @classmethod
    def real(cls) -> Truth:
        """With the errors of ``--real``."""
        return cls(
            0.15, CameraTruth(sensitivity_spread=0.05, energy_gain_spread=0.005, background_hits_per_s=1.8, anisotropy=0.07)
        )

    @property
    def quiet(self) -> CameraTruth:
        """Without background, for the other nuclides of the same camera."""
        return CameraTruth(
            background_hits_per_s=0.0,
            sensitivity_spread=self.camera.sensitivity_spread,
            energy_gain_spread=self.camera.energy_gain_spread,
            anisotropy=self.camera.anisotropy,
        )


@dataclass
class Tally:
    """Results over all flights."""

    flights: int = 0
    right: int = 0
    sources: int = 0
    nuclides: int = 0
    false: int = 0
    error_m: list[float] = field(default_factory=list)
    height_m: list[float] = field(default_factory=list)
    activity: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    unknown: int = 0
    handed_over: int = 0
    refining_s: list[float] = field(default_factory=list)
    moving_s: list[float] = field(default_factory=list)


def drawn(rng: np.random.Generator, nuclides: Sequence[str], highest_m: float = 0.0) -> list[Placed]:
    """Sources as in the module's docstring."""
    count, found = int(rng.integers(0, 4 if highest_m > 0.0 else 7)), list[Placed]()
    while len(found) < count:
        activity = 3e8 * 20.0 ** rng.uniform()
        one = Placed(str(rng.choice(list(nuclides))), rng.uniform(5.0, SIDE_M - 5.0, 2), activity)
        if highest_m > 0.0:
            one = replace(one, height_m=float(rng.uniform(0.0, highest_m)))
        if all(may_lie_beside(one, other) for other in found):
            found.append(one)
    return found


def may_lie_beside(one: Placed, other: Placed) -> bool:
    """Whether they are of different nuclides, or far enough apart."""
    ratio = one.activity_bq / other.activity_bq
    least_m = 5.0 if 0.1 < ratio < 10.0 else 20.0
    return one.nuclide != other.nuclide or float(np.hypot(*(one.place - other.place))) > least_m


def path(
    drone: int, sources: Sequence[Placed], circle_s: float, rng: np.random.Generator, higher_m: float = 0.0
) -> tuple[Array, Array]:
    """Positions (S, 3) and headings (S,) every STEP_S: lanes, then circles, on which the camera faces the source."""
    way = np.arange(STEP_S / 2.0, LANES_S, STEP_S) * SPEED_MPS
    lane, along = np.divmod(way, SIDE_M)
    x = SIDE_M / DRONES * drone + LANE_M * (0.5 + lane % 3)
    places = [np.column_stack((x, np.where(lane % 2 == 0, along, SIDE_M - along), np.full(len(way), HEIGHT_M)))]
    headings = [0.5 / SPEED_MPS * way + drone]
    for source in sources:
        turn = np.arange(0.0, circle_s, STEP_S)
        phase = turn * SPEED_MPS / RADIUS_M + 2.0 * np.pi * drone / DRONES
        off = RADIUS_M * np.column_stack((np.cos(phase), np.sin(phase)))
        wobble = np.column_stack((np.sin(0.21 * turn + drone), np.cos(0.17 * turn + drone)))
        at = source.place + off + 0.8 * wobble
        level_m = HEIGHT_M + higher_m * (turn >= circle_s / 2.0)
        places.append(np.column_stack((at, level_m + 0.3 * np.sin(0.13 * turn + drone))))
        headings.append(np.arctan2(*(source.place - at).T[::-1]) + rng.normal(0.0, 0.15, len(turn)))
    return np.concatenate(places), np.concatenate(headings)


def observed(
    seed: int, sources: Sequence[Placed], truth: Truth, circle_s: float, nuclide: str | tuple[str, ...], higher_m: float = 0.0
) -> list[Observation]:
    """The swarm's log; ``nuclide``: the mission's, with its lines for the cones."""
    rng = np.random.default_rng(seed)
    found: list[Observation] = []
    names = sorted({source.nuclide for source in sources}) or ["Cs-137"]
    for drone in range(DRONES):
        bias = np.append(rng.normal(0.0, truth.bias_m, 2), 0.0)
        own = int(rng.integers(1 << 30))
        cameras = [
            Camera(truth.camera if k == 0 else truth.quiet, name, np.random.default_rng(own), START_NS)
            for k, name in enumerate(names)
        ]
        chains = [DetectorChain(DetectionConfig(), nuclide, Calibration.nominal()) for _ in names]
        for step, (place, heading) in enumerate(zip(*path(drone, sources, circle_s, rng, higher_m), strict=True)):
            start_ns = START_NS + round(step * STEP_S * NS)
            axes = _camera_axes(heading, rng)
            parts = []
            for name, camera, chain in zip(names, cameras, chains, strict=True):
                views = [_view(source, place, axes, truth.walls) for source in sources if source.nuclide == name]
                parts.append(chain.process(camera.expose(start_ns, start_ns + round(STEP_S * NS), views)))
            found += _told(parts, place + bias, axes, truth.bias_m, f"d{drone + 1}", start_ns)
    return sorted(found, key=lambda one: (one.stamp_ns, one.identity))


def _camera_axes(heading: float, rng: np.random.Generator) -> Array:
    """Rows: left, up and forward of a camera that tilts a little, world frame."""
    tilt = rng.normal(0.0, 0.08, 2)
    forward = np.array([math.cos(heading), math.sin(heading), tilt[0]])
    forward /= np.linalg.norm(forward)
    left = np.array([-math.sin(heading), math.cos(heading), tilt[1]])
    left -= forward * (left @ forward)
    left /= np.linalg.norm(left)
    return np.array([left, np.cross(forward, left), forward])


def _view(source: Placed, place: Array, axes: Array, walls: Walls | None) -> SourceView:
    way = np.append(source.place, source.height_m) - place
    distance = float(np.linalg.norm(way))
    x, y, z = (axes @ way / distance).tolist()
    concrete_m = 0.0 if walls is None else walls.concrete_m(place, place + way)
    return SourceView((x, y, z), distance, source.activity_bq, concrete_m)


def _told(parts: list[Detections], place: Array, axes: Array, sigma_m: float, drone: str, start_ns: int) -> Iterator[Observation]:
    counts, bins, number = np.zeros(3), np.zeros(32, np.int64), 0
    x, y, z = place.tolist()
    errors = math.sqrt(2.0) * sigma_m, 0.0, Transform()
    for part in parts:
        counts += (part.hits, part.photopeak, part.coincidences)
        for one in part.spectrum:
            bins[one.place] += one.singles + one.coincidences
        for cone in part.cones:
            number += 1
            readings = tuple(
                ConeSurface(cone.stamp_ns, (x, y, z), tuple((axis @ axes).tolist()), *map(float, rest))
                for axis, *rest in zip(cone.axis, cone.theta_rad, cone.sigma_rad, cone.probability, strict=True)
            )
            identity = EntryId("m", cone.stamp_ns, drone, "b", number)
            yield ConeObservation(cone.stamp_ns, readings, *errors, identity, 0, sum(cone.energies_kev))
    spectrum = tuple(SpectrumBin(e, count, 0) for e, count in enumerate(bins.tolist()) if count)
    end_ns = start_ns + round(STEP_S * NS)
    identity, twice = EntryId("m", start_ns, drone, "b", 0), 2.0 * math.atan2(axes[2, 1], axes[2, 0])
    facing = math.cos(twice), math.sin(twice)
    yield CountObservation(end_ns, (start_ns + end_ns) // 2, (x, y, z), STEP_S, counts, *errors, identity, 0, spectrum, facing)


def estimate(name: str, mission: MissionConfig, seen: Sequence[Observation], tally: Tally) -> Hypothesis | None:
    """The estimate at the end; the times of all steps into the tally."""
    estimator: Estimator[object] = estimator_named(name, mission)
    grid_ns = round((estimator.grid_s or mission.fusion.grid_s) * NS)
    state, by_step = estimator.initial(None), dict[int, list[Observation]]()
    for one in seen:
        by_step.setdefault(one.stamp_ns // grid_ns, []).append(one)
    period = round(mission.fusion.sources.moved_s * NS)
    each = period // grid_ns
    last = GridStep((max(by_step) // each + 2) * each, 0, 0)
    by_step[last.index] = []  # a last fit with all that was measured
    before, moves = 0, False
    for index in sorted(by_step):
        step = GridStep(index, index * grid_ns, (index + 1) * grid_ns)
        start = time.process_time()
        state = estimator.step(state, step, by_step[index])
        estimator.hypothesis(state, step)  # for which a refinement is computed
        took, now = time.process_time() - start, step.start_ns // period
        (tally.moving_s if now > before else tally.refining_s).append(took)
        before = now
        track = getattr(state, "track", None)
        moves = moves or (isinstance(track, Track) and track.moves)
    tally.handed_over += moves
    return estimator.hypothesis(state, step)


def judge(sources: Sequence[Placed], told: Hypothesis | None, tally: Tally) -> None:
    """Match each source with the nearest estimate of its nuclide, or else of any."""
    left = [] if told is None else [told, *told.others]
    tally.flights += 1
    tally.right += len(left) == len(sources)
    tally.false += max(0, len(left) - len(sources))
    for source in sources:
        tally.sources += 1
        if not left:
            continue
        off = [float(np.hypot(*(one.position[:2] - source.place))) for one in left]
        best = min(range(len(left)), key=lambda k: (left[k].nuclide not in (source.nuclide, None), off[k]))
        found = left.pop(best)
        error = found.position[:2] - source.place
        is_unknown = found.lines_kev is not None
        tally.unknown += is_unknown
        tally.nuclides += found.nuclide in (source.nuclide, None) and not is_unknown
        tally.error_m.append(off[best])
        tally.height_m.append(abs(float(found.position[2]) - source.height_m))
        if found.activity_bq is not None:
            tally.activity.append(abs(found.activity_bq / source.activity_bq - 1.0))
        tally.nees.append(float(error @ np.linalg.solve(found.covariance[:2, :2], error)))


def told(name: str, tally: Tally) -> str:
    """The tally in a line."""
    half, most = np.quantile(tally.error_m or [math.nan], (0.5, 0.9))
    high = np.quantile(tally.height_m or [math.nan], (0.5, 0.9))
    weak, strong = 100.0 * np.quantile(tally.activity or [math.nan], (0.5, 0.9))
    nees, inside = np.mean(tally.nees or [math.nan]), np.mean([one <= IN_90 for one in tally.nees] or [math.nan])
    return (
        f"{name}: number right {tally.right}/{tally.flights}, sources {len(tally.error_m)}/{tally.sources}, nuclides right "
        f"{tally.nuclides}, told as unknown {tally.unknown}, false {tally.false}, handed over as moving {tally.handed_over}; "
        f"error 50/90 % {half:.3f}/{most:.3f} m, activity {weak:.1f}/{strong:.1f} %, "
        f"height {high[0]:.3f}/{high[1]:.3f} m, in 90 % region {inside:.2f}, NEES {nees:.1f}; "
        f"refinement at most {1e3 * max(tally.refining_s):.0f} ms, "
        f"with moves {1e3 * np.median(tally.moving_s):.0f} ms, at most {1e3 * max(tally.moving_s):.0f} ms"
    )


def main(
    flights: Annotated[int, typer.Option(help="Number of flights.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the first one.")] = 1,
    real: Annotated[bool, typer.Option("--real")] = False,
    alone: Annotated[bool, typer.Option("--alone")] = False,
    walls: Annotated[bool, typer.Option("--walls")] = False,
    mapped: Annotated[bool, typer.Option("--map")] = False,
    highest_m: Annotated[float, typer.Option(help="Sources are up to so high, and at most three.")] = 0.0,
    circle_s: Annotated[float, typer.Option(help="Time around each source.")] = 40.0,
    higher_m: Annotated[float, typer.Option(help="Added to the height in the second half of each circle.")] = 0.0,
    nuclides: Annotated[str, typer.Option(help="Of the sources.")] = "Cs-137,Ir-192",
    sought: Annotated[str, typer.Option(help="The mission's nuclide, whose lines make cones.")] = "auto",
    unknown: Annotated[str, typer.Option(help="Nuclides that are no candidates; instead of --sought.")] = "",
) -> None:
    if mapped and not walls:
        raise typer.BadParameter("--map is of the walls of --walls: give both")
    truth = Truth.real() if real else Truth()
    if walls:
        truth = replace(truth, walls=Walls(load_scenario("mismatch-walls").walls))
    square = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
    drones = tuple(DroneInMission(id=f"d{k + 1}") for k in range(DRONES))
    fusion = FusionConfig(estimator="bayes" if alone else "sources")
    nuclide = "Cs-137" if alone else sought if not unknown else tuple(name for name in KNOWN if name not in unknown.split(","))
    mission = MissionConfig(
        name="several",
        drones=drones,
        area=AreaConfig(polygon_m=square),
        nuclide=nuclide,
        source_height_m=(0.0, highest_m),
        fusion=fusion,
        buildings=load_scenario("walls-known").mission.buildings if mapped else BuildingsConfig(),
    )
    tallies = {name: Tally() for name in (("sources", "bayes") if alone else ("sources",))}
    for number in range(seed, seed + flights):
        rng = np.random.default_rng([number, 1])
        alone_at = rng.uniform(10.0, 90.0, 2) if alone else None
        if alone_at is None:
            sources = drawn(rng, nuclides.split(","), highest_m)
        else:
            sources = [Placed(mission.named(), alone_at, 3e9)]
        seen = observed(number, sources, truth, circle_s, mission.nuclide, higher_m)
        for name, tally in tallies.items():
            judge(sources, estimate(name, mission, seen, tally), tally)
            print(f"after {number - seed + 1}: {told(name, tally)}", flush=True)


if __name__ == "__main__":
    typer.run(main)
