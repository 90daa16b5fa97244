"""The figures of docs/estimator.md: ``python docs/figures/estimator.py [NAME ...] --out docs``; without names all of them.

Cones and counts come from simulated cameras (radron.sim.radiation) through the agents' detector chain; only the vehicles' paths
are prescribed here instead of flown. Poses are exact, their stated 1-sigma errors are 0.14 m and 1 deg. Each figure has its own
seed, which is printed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import AreaConfig, DetectionConfig, DroneInMission, MissionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.cones import Orders, cone_likelihood
from radron.agent.fusion.bayes.estimator import BayesEstimator
from radron.agent.fusion.bayes.response import REFERENCE_BQ, response_of
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.estimator import GridStep, Outlook
from radron.agent.fusion.observation import ConeObservation, Observation, observe
from radron.agent.localization.history import PoseHistory
from radron.agent.owntime import Utc
from radron.agent.sensing.observer import Observer
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.sim.figures.style import CONE, DRONES, ESTIMATE, TRUTH, dress, new_figure, plain_log, save
from radron.sim.radiation.bank import DIRECTION_BINS, bin_centres
from radron.sim.radiation.camera import Camera, CameraTruth, SourceView
from radron.sim.radiation.events import COMPLETE
from radron.sim.radiation.store import load_bank
from radron.sim.world.frame import CameraMount

Array = NDArray[np.float64]
Place = tuple[float, float]
NUCLIDE = "Cs-137"
SIDE_M, HEIGHT_M = 100.0, 3.0
START_NS = 1_767_225_600_000_000_000
SLICE_S = 0.1
SEARCH_MPS = 5.0
SEEDS = {"cone": 1, "counts": 0, "search": 3, "modes": 1}


class Rig:
    """Three cameras carried along prescribed paths past one source, and what the agents make of their hits."""

    def __init__(self, seed: int, activity_bq: float) -> None:
        names = ("d1", "d2", "d3")
        corners = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
        self.mission = MissionConfig(
            name="figure", drones=tuple(DroneInMission(id=name) for name in names), area=AreaConfig(polygon_m=corners)
        )
        self.estimator = BayesEstimator(self.mission, Polygon(corners))
        self._activity_bq = activity_bq
        drones = [DroneConfig(id=name) for name in names]
        self._mounts = [CameraMount(drone.camera_rpy_deg) for drone in drones]
        rngs = np.random.default_rng(seed).spawn(len(names))
        self._cameras = [Camera(CameraTruth(), NUCLIDE, rng, START_NS) for rng in rngs]
        self._chains = [DetectorChain(DetectionConfig(), NUCLIDE, Calibration.nominal()) for _ in names]
        self._histories = [PoseHistory() for _ in drones]
        self._observers = [
            Observer(drone, self.mission, "0" * 16, history, count(1), lambda epoch: None, Utc())
            for drone, history in zip(drones, self._histories, strict=True)
        ]

    def expose(self, time_s: float, poses: Sequence[tuple[float, float, float]], source: Place | None) -> list[Observation]:
        """The observations that a slice of 0.1 s yields; poses: x, y (m) and yaw (rad) of each vehicle."""
        start_ns = START_NS + round(time_s * 1e9)
        end_ns = start_ns + round(SLICE_S * 1e9)
        found: list[Observation] = []
        for number, (x, y, yaw) in enumerate(poses):
            attitude = (math.cos(yaw / 2.0), 0.0, 0.0, math.sin(yaw / 2.0))
            for stamp_ns in (start_ns, end_ns):
                self._histories[number].add(_state(stamp_ns, (x, y, HEIGHT_M), attitude))
            views: tuple[SourceView, ...] = ()
            if source is not None:
                place = np.array((x, y, HEIGHT_M))
                views = (self._mounts[number].view(place, attitude, (*source, 0.0), self._activity_bq),)
            readout = self._cameras[number].expose(start_ns, end_ns, views)
            for entry in self._observers[number].observe(self._chains[number].process(readout)):
                observation = observe(entry, Transform())
                if observation is not None:
                    found.append(observation)
        return found

    def step(self, state: BayesState, number: int, observations: Sequence[Observation]) -> BayesState:
        """The estimator's state after the slice of that number."""
        return self.estimator.step(state, grid_step(number), observations)


def _state(stamp_ns: int, position: tuple[float, float, float], quaternion: tuple[float, float, float, float]) -> VehicleState:
    return VehicleState(
        stamp_ns=stamp_ns, epoch=0, position_m=position, velocity_mps=(0.0, 0.0, 0.0), quaternion=quaternion,
        height_m=position[2], position_sigma_m=0.14, yaw_sigma_rad=math.radians(1.0), mode=FlightMode.OFFBOARD, armed=True,
        in_air=True, healthy=True,
    )  # fmt: skip


def grid_step(number: int) -> GridStep:
    """Step of that number since the start; a step is a slice."""
    width_ns = round(SLICE_S * 1e9)
    start_ns = START_NS + number * width_ns
    return GridStep(start_ns // width_ns, start_ns, start_ns + width_ns)


def facing(x: float, y: float, target: Place) -> float:
    """Yaw (rad) from a place towards a target."""
    return math.atan2(target[1] - y, target[0] - x)


def circling(time_s: float, centre: Place, radius_m: float, speed_mps: float = 3.0) -> list[tuple[float, float, float]]:
    """Three vehicles evenly on a circle, facing its centre."""
    poses = []
    for number in range(3):
        phase = speed_mps * time_s / radius_m + 2.0 * math.pi * number / 3.0
        x, y = centre[0] + radius_m * math.cos(phase), centre[1] + radius_m * math.sin(phase)
        poses.append((x, y, facing(x, y, centre)))
    return poses


def cone(seed: int) -> Figure:
    """The likelihood on the ground of one cone, and of twelve cones from three places."""
    source, activity_bq = (55.0, 52.0), 3e9
    rig = Rig(seed, activity_bq)
    places = ((45.0, 45.0), (60.0, 42.0), (50.0, 64.0))
    poses = [(x, y, facing(x, y, source)) for x, y in places]
    cones: list[ConeObservation] = []
    number = 0
    while len(cones) < 12:
        cones += [found for found in rig.expose(number * SLICE_S, poses, source) if isinstance(found, ConeObservation)]
        number += 1
    axis = np.linspace(30.0, 80.0, 251)
    x, y = np.meshgrid(axis, axis)
    figure = new_figure(9.0, 5.4)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = ("One cone: two readings, a ring each", f"{len(cones)} cones of three cameras")
    for panel, chosen, title in zip(panels, (cones[:1], cones), titles, strict=True):
        log_likelihood = sum(np.log(on_ground(found, x, y, activity_bq)) for found in chosen)
        mesh = panel.contourf(x, y, log_likelihood / math.log(10.0), levels=24, cmap="cividis")
        for apex in {found.apex for found in chosen}:
            panel.plot(apex[0], apex[1], marker="^", color="white", markeredgecolor="black", markersize=8, linestyle="none")
        panel.plot(*source, marker="*", color=ESTIMATE, markeredgecolor="white", markersize=13, linestyle="none")
        dress(panel, title, "east (m)", "north (m)" if panel is panels[0] else "")
        panel.set_aspect("equal")
        figure.colorbar(mesh, ax=panel, location="bottom", ticks=MaxNLocator(6), label="log10 likelihood, relative to no source")
    figure.suptitle("Triangles: cameras, 3 m above the ground. Star: the source", x=0.01, ha="left", fontsize=10)
    return figure


def on_ground(found: ConeObservation, x: Array, y: Array, activity_bq: float) -> Array:
    """The likelihood of a cone for a source of that activity at places x, y on the ground."""
    response, orders = response_of(NUCLIDE), Orders.of(found)
    way = np.stack((x - found.apex[0], y - found.apex[1], np.full(x.shape, -found.apex[2])), axis=-1)
    distance = np.linalg.norm(way, axis=-1)
    delta = np.arccos(np.clip(way @ orders.axis.T / distance[..., None], -1.0, 1.0)) - orders.theta_rad
    directed = orders.density(delta, np.zeros(delta.shape))[0].sum(axis=(-2, -1))
    rate = response.cone_area_mm2 * response.flux(distance) * activity_bq / REFERENCE_BQ
    return cone_likelihood(rate, directed, response.cone_background_ps)


def counts(seed: int) -> Figure:
    """Expected counts by distance, and the effective area by bearing. Draws no random numbers."""
    figure = new_figure(9.0, 4.2)
    by_distance, by_bearing = figure.subplots(1, 2)
    response, distance = response_of(NUCLIDE), np.geomspace(2.0, 100.0, 200)
    activities = ((1e8, ":"), (1e9, "--"), (1e10, "-"))
    for activity_bq, dashes in activities:
        signal = response.signal(response.flux(distance) * activity_bq / REFERENCE_BQ, distance)
        for channel, colour in ((0, DRONES[0]), (1, DRONES[1])):
            by_distance.loglog(distance, signal[:, channel], color=colour, linestyle=dashes, linewidth=1.5)
    for channel, colour, name in ((0, DRONES[0], "partial energy"), (1, DRONES[1], "full energy")):
        by_distance.plot([], [], color=colour, label=name)
        by_distance.axhline(response.background_ps[channel], color=colour, linewidth=4.0, alpha=0.25)
    for activity_bq, dashes in activities:
        by_distance.plot([], [], color=CONE, linestyle=dashes, label=f"{activity_bq / 1e9:g} GBq")
    by_distance.legend(fontsize=8, frameon=False, loc="upper right")
    by_distance.set_ylim(1e-2, 1e4)
    plain_log(by_distance.xaxis, 2.0, 100.0)
    dress(by_distance, "Expected counts; wide lines: background", "distance (m)", "counts per second")
    area = load_bank(NUCLIDE, CameraTruth()).area_mm2[:DIRECTION_BINS]
    polar = np.degrees(np.arccos(np.clip(bin_centres()[:, 2], -1.0, 1.0))).round(3)
    rows, row = np.unique(polar, return_inverse=True)
    expected = sum(response.parts(np.array(1.0), np.array(0.0), np.abs(np.cos(np.radians(rows))))[0].T)
    for mean, colour, dashes, name in (
        (np.bincount(row, area.sum(axis=1)) / np.bincount(row), DRONES[0], "-", "all events"),
        (expected, CONE, "--", "all events, by the estimator"),
        (np.bincount(row, area[:, COMPLETE]) / np.bincount(row), DRONES[2], "-", "complete two-cluster events"),
    ):
        overall = float((mean * np.sin(np.radians(rows))).sum() / np.sin(np.radians(rows)).sum())
        by_bearing.plot(rows, mean / overall, color=colour, linestyle=dashes, linewidth=1.6, label=name)
    by_bearing.set_ylim(0.0, 1.4)
    by_bearing.set_xticks((0, 45, 90, 135, 180))
    by_bearing.legend(fontsize=8, frameon=False, loc="lower center")
    dress(by_bearing, "Effective area by bearing (simulated)", "angle from the sensor's normal (deg)", "relative to its mean")
    return figure


def search(seed: int) -> Figure:
    """The posterior on the grid at three instants of a search along lanes, to and fro, each 8 m east of the one before."""
    source = (66.0, 71.0)
    rig = Rig(seed, 1e9)
    state = rig.estimator.initial(None)
    history: list[tuple[float, Outlook, list[list[Place]]]] = []
    paths: list[list[Place]] = [[], [], []]
    number = 0
    while state.track is None and number < 1200:
        time_s = number * SLICE_S
        passes, along = divmod(SEARCH_MPS * time_s, SIDE_M - 10.0)
        north = 5.0 + along if passes % 2 == 0 else SIDE_M - 5.0 - along
        poses = [(lane + 8.0 * passes, north, 0.5 * time_s) for lane in (9.0, 42.0, 75.0)]
        for path, (x, y, _) in zip(paths, poses, strict=True):
            path.append((x, y))
        state = rig.step(state, number, rig.expose(time_s, poses, source))
        outlook = rig.estimator.outlook(state, grid_step(number))
        if outlook is not None:
            history.append((time_s + SLICE_S, outlook, [path.copy() for path in paths]))
        number += 1
    declared_s = number * SLICE_S
    figure = new_figure(10.0, 4.1)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    last = len(history) - 1
    for panel, chosen in zip(panels, (round(0.35 * last), round(0.7 * last), last), strict=True):
        _posterior(figure, panel, *history[chosen], source)
    panels[0].set_ylabel("north (m)")
    title = f"Lines: paths of the drones. Star: the source, 1 GBq. Initial estimate declared at {declared_s:.1f} s"
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    return figure


def _posterior(figure: Figure, panel: Axes, time_s: float, outlook: Outlook, paths: list[list[Place]], source: Place) -> None:
    area = outlook.cell_m == outlook.cell_m.min()
    columns = len(np.unique(outlook.places[area, 0]))
    x, y, weight = (part[area].reshape(-1, columns) for part in (*outlook.places.T, outlook.weight))
    cell_m2 = float((x[0, 1] - x[0, 0]) ** 2)
    density = np.log10(np.maximum(weight / cell_m2, 1e-8))
    mesh = panel.pcolormesh(x, y, density, cmap="cividis", vmin=-7.0, vmax=-1.0, shading="nearest", rasterized=True)
    for number, path in enumerate(paths):
        panel.plot(*np.array(path).T, color="white", linewidth=1.2)
        panel.plot(*path[-1], marker="^", color=DRONES[number], markeredgecolor="white", markersize=8)
    panel.plot(*source, marker="*", color=ESTIMATE, markeredgecolor="white", markersize=13)
    dress(panel, f"{time_s:.1f} s: P(no source) = {outlook.none:.2g}", "east (m)")
    panel.set_aspect("equal")
    figure.colorbar(mesh, ax=panel, location="bottom", label="log10 density (per m2)", shrink=0.9)


def modes(seed: int) -> Figure:
    """The modes' probabilities and the error while a source rests, walks, rests, and runs."""
    legs = ((40.0, 0.0), (60.0, 1.0), (60.0, 0.0), (20.0, -3.0), (30.0, 0.0))  # seconds, m/s eastwards
    names = ("at rest", "1 m/s", "at rest", "3 m/s", "at rest")
    rig = Rig(seed, 3e9)
    state = rig.estimator.initial(None)
    rows: list[tuple[float, ...]] = []
    x, number = 20.0, 0
    for duration_s, speed_mps in legs:
        for _ in range(round(duration_s / SLICE_S)):
            time_s = number * SLICE_S
            x += speed_mps * SLICE_S
            source = (x, 50.0)
            state = rig.step(state, number, rig.expose(time_s, circling(time_s, source, 12.0), source))
            hypothesis = rig.estimator.hypothesis(state, grid_step(number))
            if hypothesis is not None and state.track is not None:
                error_m = math.dist(hypothesis.position[:2], source)
                rows.append((time_s, *state.track.weight.sum(axis=0).tolist(), error_m, hypothesis.rms_m))
            number += 1
    time, rest, slow, fast, error, rms = np.array(rows).T
    figure = new_figure(9.0, 5.2)
    above, below = figure.subplots(2, 1, sharex=True)
    for values, colour, dashes, name in (
        (rest, DRONES[0], "-", "at rest"),
        (slow, DRONES[1], "--", "moving"),
        (fast, DRONES[3], "-.", "moving fast"),
    ):
        above.plot(time, values, color=colour, linestyle=dashes, linewidth=1.6, label=name)
    above.set_ylim(-0.02, 1.25)
    above.set_yticks((0.0, 0.25, 0.5, 0.75, 1.0))
    above.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    dress(above, "Probabilities of the motion modes; above: what the source does", "", "probability")
    below.plot(time, error, color=ESTIMATE, linewidth=1.2, label="error")
    below.plot(time, rms, color=DRONES[0], linestyle="--", linewidth=1.4, label="1 sigma, stated")
    below.set_ylim(bottom=0.0)
    below.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    dress(below, "", "time (s)", "horizontal distance (m)")
    begin_s = 0.0
    for (duration_s, _), name in zip(legs, names, strict=True):
        above.text(begin_s + duration_s / 2.0, 1.12, name, ha="center", va="center", fontsize=9)
        begin_s += duration_s
        for panel in (above, below):
            panel.axvline(begin_s, color=TRUTH, linewidth=0.8, linestyle=":")
    above.set_xlim(0.0, begin_s)
    return figure


FIGURES: dict[str, Callable[[int], Figure]] = {"cone": cone, "counts": counts, "search": search, "modes": modes}


def main(
    names: Annotated[list[str] | None, typer.Argument(help=f"of {', '.join(FIGURES)}")] = None,
    out: Annotated[Path, typer.Option(help="folder of the pictures")] = Path("docs"),
) -> None:
    """Draw figures of docs/estimator.md."""
    for name in names or FIGURES:
        if name not in FIGURES:
            raise typer.BadParameter(f"{name!r} is no figure; use one of {', '.join(FIGURES)}")
    for name in names or FIGURES:
        path = out / f"estimator-{name}.png"
        save(FIGURES[name](SEEDS[name]), path)
        print(f"{path}: seed {SEEDS[name]}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    typer.run(main)
