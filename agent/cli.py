"""The ``radron-agent`` command."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from radron.agent import version
from radron.agent.commands import ConfigOption, command, doctor, preflight, revoke, run, status, upload, watch
from radron.agent.terminal import run_command

_HELP = "One drone of the swarm, on board."
app = typer.Typer(no_args_is_help=True, add_completion=False)


app.callback(help=_HELP)(version.options)
app.command()(run)
app.command()(preflight)
app.command()(doctor)
app.command()(command)
app.command()(revoke)
app.command()(upload)
app.command()(status)
app.command()(watch)


Recording = Annotated[Path, typer.Argument(metavar="FILE.t3pa", help="A Timepix3 measurement, as Advacam's software exports it.")]
CameraConstants = Annotated[
    Path | None,
    typer.Option(metavar="PATH", help="Folder of a.txt, b.txt, c.txt, t.txt, or Pixet's XML; else typical constants."),
]
ToaBits = Annotated[
    int | None, typer.Option(min=8, max=56, help="Bits of the file's ToA, if it wraps unnoticed.", show_default="recognised")
]
Measurement = Annotated[
    int | None, typer.Option(min=1, help="Which of several appended measurements.", show_default="all, one after the other")
]
Chip = Annotated[int | None, typer.Option(min=0, max=15, help="Which chip of a detector that has several.")]


@app.command()
def cones(
    file: Recording,
    csv: Annotated[Path, typer.Option(metavar="OUT", help="Where to write the cones, one per line.")],
    nuclide: Annotated[str, typer.Option(help="Whose lines to look for; auto: those that the spectrum shows.")] = "Cs-137",
    calibration: CameraConstants = None,
    toa_bits: ToaBits = None,
    measurement: Measurement = None,
    chip: Chip = None,
) -> None:
    """Turn the pixel hits of a file into Compton cones, and summarise the file.

    The CSV has one line per cone: stamp_ns since the detector's clock was reset (of the first measurement, where a file holds
    several); axis_x, axis_y, axis_z in the camera's frame (x
    along the pixel rows, y up, z out of the sensor), from the absorbed photon to the electron if cluster 1 was the electron
    (reading 1) and opposite to it in reading 2; opening angle, 1 sigma and probability of both readings; the clusters' energies,
    fitted to the line; their distance.
    """
    from radron.agent.detector.command import run_cones  # noqa: PLC0415  scipy's import time belongs to this command alone
    from radron.agent.detector.files.t3pa import T3paReader  # noqa: PLC0415

    run_cones(partial(T3paReader, file, toa_bits, measurement=measurement, chip=chip), csv, nuclide, calibration)


@app.command()
def inspect(
    file: Recording,
    calibration: CameraConstants = None,
    toa_bits: ToaBits = None,
    measurement: Measurement = None,
    chip: Chip = None,
    png: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the page into this file (needs matplotlib).")] = None,
    json: Annotated[Path | None, typer.Option(metavar="JSON", help="Write all numbers into this file.")] = None,
) -> None:
    """Tell what a file of the camera holds: format, times, rates, pixels, clusters, spectrum, lost data.

    Reads .t3pa and .t3p, and a frame of time over threshold (..._ToT.txt with its .dsc).
    """
    from radron.agent.detector.files.t3pa import T3paReader  # noqa: PLC0415  scipy's import time belongs to this command alone
    from radron.agent.detector.inspection_page import run_inspect  # noqa: PLC0415

    run_inspect(T3paReader(file, toa_bits, measurement=measurement, chip=chip), calibration, png, json)


@app.command()
def calibrate(
    facing: Annotated[
        list[str],
        typer.Option(
            metavar="BEARING[,ELEVATION][=FILE]",
            help="Direction of the source, degrees clockwise from the nose and above the vehicle's horizon, at least three; "
            "with a file for each, or measured with the camera.",
        ),
    ],
    activity: Annotated[float, typer.Option(metavar="BQ", help="The source's activity.")],
    distance: Annotated[float, typer.Option(metavar="M", help="From the source to the camera.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="The camera's folder of calibrations, with their history.")],
    config: ConfigOption,
    nuclide: Annotated[str, typer.Option(help="The source's nuclide.")] = "Cs-137",
    background: Annotated[
        Path | None, typer.Option(metavar="FILE.t3pa", help="A recording without the source.", show_default="measured first")
    ] = None,
) -> None:
    """Calibrate this drone's camera with a known source: gain, drift time, pixels, orientation on the vehicle, background.

    Exit code 0: usable; 1: not usable, and why; 2: it could not be measured.
    """
    import os  # noqa: PLC0415
    from datetime import UTC, datetime  # noqa: PLC0415

    from radron.agent.calibration.command import Order, parse_facings, run_calibrate  # noqa: PLC0415
    from radron.agent.calibration.plan import Source  # noqa: PLC0415
    from radron.agent.shell.overrides import load_drone_file  # noqa: PLC0415

    drone = load_drone_file(config, os.environ)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    order = Order(drone, Source(nuclide, activity, distance), parse_facings(facing), background, out, stamp)
    usable = run_calibrate(order, lambda text: typer.prompt(f"{text} Then press Enter", default="", show_default=False))
    if not usable:
        raise typer.Exit(1)


@app.command()
def replay(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT.mcap", help="Any file of a recorded flight, or a folder with one flight.")
    ],
) -> None:
    """Replay a recorded flight, and verify that every hypothesis, setpoint and message is identical, bit for bit.

    Exit code 0: identical; 1: different; 2: the flight cannot be replayed (to its end).
    """
    from radron.agent.flight.command import run_replay  # noqa: PLC0415  belongs to this command alone

    raise typer.Exit(run_replay(flight))


@app.command()
def audit(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT.mcap", help="Any file of a recorded flight, or a folder with one flight.")
    ],
) -> None:
    """Print the commands that reached a drone in a recorded flight, and what became of each.

    A line each: when it arrived (UTC, the drone's clock), the station's name, certificate with serial and end, action, addressed
    drones, and whether this drone obeyed or why it refused. Copies with the same outcome are one line. Exit code 2: not (all of)
    the flight can be read.
    """
    from radron.agent.flight.audit_command import run_audit  # noqa: PLC0415  belongs to this command alone

    run_audit(flight)


@app.command()
def identify(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT.mcap", help="Any file of a recorded flight, or a folder with one flight.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw setpoint against position into this file (needs matplotlib).")
    ] = None,
) -> None:
    """Identify the vehicle's response to setpoints from a recorded flight, and print it as [vehicle.response] for the drone file.

    An agent identifies drag and lag in its first seconds of flight: the section gives the values that it starts from.
    """
    from radron.agent.flight.identify_command import run_identify  # noqa: PLC0415  belongs to this command alone

    run_identify(flight, out)


def main() -> None:
    """Run the command; errors that the user can fix end in one line and exit code 2."""
    run_command("radron-agent", app)
