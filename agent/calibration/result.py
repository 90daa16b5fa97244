"""The calibration of a camera from the collected measurements: values with uncertainties, goals, and a verdict."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radron.agent.calibration.collection import BLOCKS, Collection, block_of_pixels
from radron.agent.calibration.depth import Drift, fit_drift
from radron.agent.calibration.facing import Facing
from radron.agent.calibration.gain import Gain, fit_blocks, fit_gain
from radron.agent.calibration.orientation import Orientation, fit_orientation
from radron.agent.calibration.plan import HITS_PER_PIXEL, Source
from radron.agent.detector.files.calibration import MAX_BAD_SHARE, PIXELS
from radron.agent.detector.inspection import NOISY_RATIO
from radron.agent.detector.spectroscopy.shapes import strongest_line_kev
from radron.agent.geometry import Vector3

GAIN_GOAL, BLOCK_GOAL, DRIFT_GOAL, ORIENTATION_GOAL_DEG, BACKGROUND_GOAL = 0.01, 0.03, 0.05, 1.0, 0.10
MAX_GAIN_OFF = 0.4  # relative; a camera further off is defect, or its calibration belongs to another
MAX_TURNED_DEG = 20.0  # against the drone file: twice the prior
MAX_WALK_NS = 20.0


class Background(Struct, frozen=True):
    """Rate of events per second without the source, with its uncertainty, and the live time measured."""

    per_s: float
    sigma_per_s: float
    live_s: float


class Goal(Struct, frozen=True):
    """One requirement of a calibration, with the value reached as text, and whether that is enough."""

    name: str
    reached: bool
    text: str


class Result(Struct, frozen=True, kw_only=True):
    """The result of a calibration of one camera, with the numbers from which it was found.

    None: too few events. noisy_pixels, dead_pixels: matrix indices; None: too few hits.
    walk_ns: mean delay of weak pixels beside strong ones, and its standard deviation. blocks: gain of 16 parts of the sensor, row
    by row from the lower left.
    """

    stamp: str
    nuclide: str
    activity_bq: float
    distance_m: float
    facings: tuple[Facing, ...]
    live_s: float
    events: int
    gain: Gain | None
    blocks: tuple[Gain | None, ...]
    drift: Drift | None
    walk_ns: tuple[float, float] | None
    orientation: Orientation | None
    noisy_pixels: tuple[int, ...]
    dead_pixels: tuple[int, ...] | None
    background: Background | None

    @property
    def bad_pixels(self) -> list[int]:
        """Matrix indices of noisy pixels, and of dead pixels as far as they are known."""
        return [*self.noisy_pixels, *(self.dead_pixels or ())]

    @property
    def background_per_s(self) -> float | None:
        """Rate of events per second without the source that a sensor without bad pixels would count; None: not measured."""
        return None if self.background is None else self.background.per_s * PIXELS / (PIXELS - len(set(self.bad_pixels)))


def evaluate(
    collection: Collection,
    source: Source,
    facings: list[Facing],
    camera_rpy_deg: Vector3,
    background: Background | None,
    stamp: str,
) -> Result:
    """Compute the calibration from all measurements of a source.

    camera_rpy_deg: orientation of the camera by the drone file. stamp: time of the calibration, as its name.
    """
    energies = collection.energies_kev
    coarse = collection.coarse_gain or 1.0
    found = fit_gain(energies, source.nuclide)
    blocks = fit_blocks(energies, collection.blocks, source.nuclide, *found) if found else [None] * BLOCKS**2
    orientation = fit_orientation(collection.cones, facings, camera_rpy_deg)
    rpy_deg = orientation.camera_rpy_deg if orientation else camera_rpy_deg
    camera_from_body = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix().T
    directions = [camera_from_body @ np.array(facing.direction) for facing in facings]
    walk = collection.walk_ns
    noisy, dead = judge_pixels(collection.pixels)
    return Result(
        stamp=stamp,
        nuclide=source.nuclide,
        activity_bq=source.activity_bq,
        distance_m=source.distance_m,
        facings=tuple(facings),
        live_s=collection.live_s,
        events=collection.events,
        gain=found[0].times(coarse) if found else None,
        blocks=tuple(None if block is None else block.times(coarse) for block in blocks),
        drift=fit_drift(collection.apart_ns, strongest_line_kev(source.nuclide), directions),
        walk_ns=(float(walk.mean()), float(walk.std() / np.sqrt(len(walk)))) if len(walk) > 1 else None,
        orientation=orientation,
        noisy_pixels=noisy,
        dead_pixels=dead,
        background=background,
    )


def judge_pixels(pixels: NDArray[np.int64]) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
    """Return the matrix indices of noisy pixels, and of dead pixels, from the hits of each pixel (65536,).

    Dead pixels are None with too few hits.
    """
    typical = float(np.mean(np.sort(pixels)[: PIXELS - PIXELS // 100]))
    noisy = np.flatnonzero(pixels > NOISY_RATIO * max(1.0, typical))
    dead = np.flatnonzero(pixels == 0) if np.median(pixels) >= HITS_PER_PIXEL - 1.0 else None
    return tuple(noisy.tolist()), None if dead is None else tuple(dead.tolist())


def goals(result: Result) -> tuple[Goal, ...]:
    """Return the requirements of a calibration, each with whether it is reached."""
    return tuple(judge(result) for judge in (_gain, _blocks, _drift, _walk, _orientation, _pixels, _background))


def _gain(result: Result) -> Goal:
    gain = result.gain
    if gain is None:
        line = strongest_line_kev(result.nuclide)
        return Goal("gain", False, f"no peak near the line of {line:g} keV; is the source {result.nuclide}, and in place?")
    text = f"{gain.value:.4f} +- {gain.sigma:.4f}"
    if abs(gain.value - 1.0) > MAX_GAIN_OFF:
        return Goal("gain", False, f"{text}: too far from 1; is it this camera's calibration, and its bias right?")
    return Goal("gain", gain.sigma <= GAIN_GOAL * gain.value, f"{text} (goal +- {GAIN_GOAL:.0%})")


def _blocks(result: Result) -> Goal:
    live = _live_blocks(result)
    known = [block for block in live if block is not None]
    goal = f"goal +- {BLOCK_GOAL:.0%} in each"
    if not known or len(known) < len(live):
        return Goal("gain by block", False, f"{len(live) - len(known)} of {len(live)} with too few events ({goal})")
    values = [block.value for block in known]
    worst = max(block.sigma / block.value for block in known)
    return Goal("gain by block", worst <= BLOCK_GOAL, f"{min(values):.3f} to {max(values):.3f}, worst +- {worst:.1%} ({goal})")


def _live_blocks(result: Result) -> list[Gain | None]:
    """The gains of blocks with at least one good pixel: a dead block has no peak, however long the source is measured."""
    good = np.ones(PIXELS, bool)
    good[result.bad_pixels] = False
    return [result.blocks[block] for block in np.unique(block_of_pixels()[good])]


def _drift(result: Result) -> Goal:
    drift = result.drift
    if drift is None:
        return Goal("drift time", False, "too few coincidences")
    reached = drift.sigma_ns <= DRIFT_GOAL * drift.drift_ns
    text = f"{drift.drift_ns:.1f} +- {drift.sigma_ns:.1f} ns across the sensor (goal +- {DRIFT_GOAL:.0%})"
    return Goal("drift time", reached, text)


def _walk(result: Result) -> Goal:
    if result.walk_ns is None:
        return Goal("time walk", False, "no cluster with weak and strong pixels")
    mean, sigma = result.walk_ns
    text = f"weak pixels {mean:.1f} +- {sigma:.1f} ns after strong ones (goal: at most {MAX_WALK_NS:g} ns)"
    return Goal("time walk", abs(mean) <= MAX_WALK_NS, text)


def _orientation(result: Result) -> Goal:
    found = result.orientation
    goal = f"goal +- {ORIENTATION_GOAL_DEG:g} deg"
    if found is None:
        return Goal("orientation", False, f"too few cones at a facing ({goal})")
    turned, sigma = float(np.linalg.norm(found.turned_deg)), max(found.sigma_deg)
    rpy = ", ".join(f"{angle:.1f}" for angle in found.camera_rpy_deg)
    text = f"camera_rpy_deg = [{rpy}], {turned:.1f} deg from the drone file's, +- {sigma:.1f} deg ({goal})"
    if turned > MAX_TURNED_DEG:
        return Goal("orientation", False, f"{text}: too far; are the facings right, and camera_rpy_deg in the drone file?")
    return Goal("orientation", sigma <= ORIENTATION_GOAL_DEG, text)


def _pixels(result: Result) -> Goal:
    if result.dead_pixels is None:
        return Goal("pixels", False, f"{len(result.noisy_pixels)} noisy; too few hits to tell the dead ones")
    text = f"{len(result.dead_pixels):,} dead, {len(result.noisy_pixels):,} noisy, masked (at most {MAX_BAD_SHARE:.0%} may be)"
    return Goal("pixels", len(result.bad_pixels) <= MAX_BAD_SHARE * PIXELS, text)


def _background(result: Result) -> Goal:
    found = result.background
    if found is None:
        return Goal("background", False, "not measured: give --background")
    text = f"{found.per_s:.2f} +- {found.sigma_per_s:.2f} events a second (goal +- {BACKGROUND_GOAL:.0%})"
    return Goal("background", found.sigma_per_s <= BACKGROUND_GOAL * found.per_s, text)
