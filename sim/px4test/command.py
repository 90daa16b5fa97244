"""The command ``px4-test``: live flight tests with missions and failures, on a real PX4 or on the emulated vehicles."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from radron.sim.live.command import run_live
from radron.sim.px4test.px4 import Px4
from radron.sim.runfile import make_folder

if TYPE_CHECKING:
    from radron.sim.px4test.rows import Report

SKIPPED = 77
TESTS = ("missions", "killed", "gnss")


def px4_test(
    *,
    vehicles: Annotated[
        Literal["real", "emulated"],
        typer.Option(
            envvar="PX4_TEST",
            help="real: PX4 itself, by PX4_BIN (a build's bin/px4) or PX4_IMAGE (with docker); skipped with code 77 without.",
        ),
    ] = "real",
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the world.")] = 1,
    only: Annotated[list[str] | None, typer.Option(help=f"Run only some of {', '.join(TESTS)}.")] = None,
    attempts: Annotated[int, typer.Option(min=1, help="Attempts at a session that fails, for machines that stall at times.")] = 1,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the report, plots, and all files of agents and vehicles.")
    ] = Path("results/px4-test"),
) -> None:
    """Test flights of three live agents: two missions, hold and resume, an agent killed, GNSS lost. Code 1: one failed."""
    from radron.sim.commands.console import out as stdout  # noqa: PLC0415  (heavy imports wait until they are needed)
    from radron.sim.commands.console import say  # noqa: PLC0415

    chosen = tuple(only or TESTS)
    if unknown := [name for name in chosen if name not in TESTS]:
        raise typer.BadParameter(f"{unknown[0]}: there are {', '.join(TESTS)}", param_hint="--only")

    px4 = Px4.found(os.environ) if vehicles == "real" else None
    if vehicles == "real" and px4 is None:
        say("SKIPPED: no real PX4 (PX4_BIN=.../build/px4_sitl_default/bin/px4); PX4_TEST=emulated flies the emulated vehicles")
        raise typer.Exit(SKIPPED)

    from radron.sim.px4test.rows import table, write  # noqa: PLC0415
    from radron.sim.px4test.session import fly_all  # noqa: PLC0415

    make_folder(out)
    report: Report = run_live(fly_all(px4, seed, chosen, out, attempts))
    files = write(out, report)
    for line in table(report):
        say(line, stdout)
    say(f"written to {out}: {', '.join(path.name for path in files)}, and a folder for each test")
    raise typer.Exit(0 if report.passed else 1)
