"""``radron-sim hits``: a recording of a source by a camera at a fixed place, in the real camera's file format."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.agent.errors import ConfigError
from radron.agent.outputs import check_output, replacing
from radron.sim.radiation.nuclides import nuclide as nuclide_of

if TYPE_CHECKING:
    from radron.sim.radiation.beam import BeamCamera

_SLICE_NS = 200_000_000
MAX_PHOTONS = 1_000_000  # that interact in a recording: about a minute's computing
MAX_SLICE_PHOTONS = 20_000  # that interact in a slice, on average: bounds the memory, 20 MB
_SPREAD = 0.05  # between the pixels of a camera with calibration files


def hits(
    out: Annotated[Path, typer.Argument(metavar="OUT.t3pa", help="File to write.")],
    nuclide: Annotated[str, typer.Option(help="The source's nuclide.")] = "Cs-137",
    activity: Annotated[float, typer.Option(help="Activity in Bq.")] = 3e9,
    distance: Annotated[float, typer.Option(help="Distance to the source in m.")] = 12.0,
    angle: Annotated[float, typer.Option(help="Angle from the sensor's outward normal to the source, degrees.")] = 0.0,
    azimuth: Annotated[float, typer.Option(help="Direction of that angle, from the columns' (x) axis, degrees.")] = 0.0,
    seconds: Annotated[float, typer.Option(help="Duration in s.")] = 60.0,
    seed: Annotated[int, typer.Option(help="Random seed; the same seed gives the same file.")] = 1,
    dead_block: Annotated[float, typer.Option(help="Share of the pixels that are dead, a square in a corner.")] = 0.0,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write a.txt, b.txt, c.txt and t.txt there; the camera's pixels then differ. Without it all are nominal.",
        ),
    ] = None,
) -> None:
    """Simulate a camera's pixel hits (full photon transport) and write them as Advacam's .t3pa."""
    nuclide_of(nuclide)
    _check("--activity", activity, "Bq", 0.0, 1e15)
    _check("--distance", distance, "m", 0.1, 10_000.0)
    _check("--seconds", seconds, "s", 1e-3, 1e6)
    _check("--angle", angle, "degrees", -360.0, 360.0)
    _check("--azimuth", azimuth, "degrees", -360.0, 360.0)
    _check("--seed", seed, "", 0, 2**63)
    _check("--dead-block", dead_block, "", 0.0, 0.9)
    check_output(out)

    import numpy as np  # noqa: PLC0415  (heavy imports wait until they are needed)
    from rich.console import Console  # noqa: PLC0415

    from radron.sim.radiation.beam import BeamCamera  # noqa: PLC0415
    from radron.sim.radiation.camera import SourceView  # noqa: PLC0415
    from radron.sim.radiation.truth import CameraTruth  # noqa: PLC0415

    polar, turn = math.radians(angle), math.radians(azimuth)
    direction = (math.sin(polar) * math.cos(turn), math.sin(polar) * math.sin(turn), math.cos(polar))
    truth = CameraTruth(calibration_spread=0.0 if calibration is None else _SPREAD, dead_block=dead_block)
    view = SourceView(direction, distance, activity)
    camera = BeamCamera(truth, nuclide, view, np.random.default_rng(seed), clock_ns=0)
    photons = camera.photons_per_s * seconds
    if photons > MAX_PHOTONS:
        raise ConfigError(
            f"--activity {activity:g} Bq at --distance {distance:g} m for --seconds {seconds:g}: {photons:.1e} photons would "
            f"interact in the sensor; at most {MAX_PHOTONS:.0e} are simulated: record for less time, or from farther away"
        )
    if calibration is not None:
        try:
            camera.calibration.write(calibration)
        except OSError as error:
            raise ConfigError(f"--calibration {calibration}: cannot be written: {error.strerror}") from None
    rows = _record(camera, round(seconds * 1e9), out)
    Console().print(
        f"{out}: {rows} rows of {seconds:g} s; {nuclide}, {activity:g} Bq at {distance:g} m: "
        f"{camera.direct_per_s:.3g} direct and {camera.scattered_per_s:.3g} scattered photons/s interact",
        highlight=False,
        soft_wrap=True,
    )


def _check(name: str, value: float, unit: str, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ConfigError(f"{name} = {value:g} {unit}".rstrip() + f" is out of range; allowed is {low:g} to {high:g}")


def _record(camera: BeamCamera, span_ns: int, out: Path) -> int:
    """Record and write the hits; returns the number of rows."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from radron.sim.radiation.t3pa import T3paWriter  # noqa: PLC0415

    terminal = Console(stderr=True)
    with (
        replacing(out) as temporary,
        temporary.open("w") as file,
        Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as bar,
    ):
        writer = T3paWriter(file)
        task = bar.add_task("Simulating", total=span_ns)
        slice_ns = min(_SLICE_NS, max(1, int(1e9 * MAX_SLICE_PHOTONS / camera.photons_per_s)))
        for start in range(0, span_ns, slice_ns):
            end = min(span_ns, start + slice_ns)
            writer.write(camera.expose(start, end))
            bar.update(task, completed=end)
    return writer.rows
