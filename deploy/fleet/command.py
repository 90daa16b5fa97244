"""``radron-deploy fleet``: check of a fleet file, and preview of a drone's files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, help="The fleet file (docs/nuc.md).")
FleetArgument = Annotated[Path, typer.Argument(metavar="FLEET.toml", help="The fleet file.")]


@app.command()
def check(fleet: FleetArgument) -> None:
    """Check a fleet file, its mission and its cameras' calibrations, and list the drones."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    from radron.deploy.fleet.files import files_of  # noqa: PLC0415
    from radron.deploy.fleet.loading import load_fleet  # noqa: PLC0415

    loaded = load_fleet(fleet)
    table = Table("drone", "address", "autopilot", "camera", "calibration", title=f"{fleet}: mission {loaded.mission.mission_id}")
    for drone in loaded.config.drones:
        files_of(loaded, drone)  # raises if a file for the drone's disk is missing
        table.add_row(drone.id, drone.address, drone.vehicle.address, drone.detector.driver, drone.calibration or "none")
    Console().print(table)


@app.command()
def files(
    fleet: FleetArgument,
    drone: Annotated[str, typer.Option(metavar="ID", help="Which drone's.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="A new folder for them.")],
) -> None:
    """Write the files of a drone's config partition into a folder, without certificates: to read, or to compare."""
    from radron.deploy.fleet.files import files_of, write_files  # noqa: PLC0415
    from radron.deploy.fleet.loading import load_fleet  # noqa: PLC0415

    loaded = load_fleet(fleet)
    made = files_of(loaded, loaded.drone(drone))
    out.mkdir(parents=True)
    write_files(out, made)
    print(f"{out}: {len(made)} files of {drone}")
