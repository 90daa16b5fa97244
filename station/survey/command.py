"""The command ``survey``: check a recorded survey, and fold it by a mission's estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

CsvFile = Annotated[Path, typer.Argument(metavar="FILE.csv", help="The records: see the documentation (Ordinary detectors).")]


def survey(
    file: CsvFile,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write survey.png and survey.json; made if missing.")],
    energy: Annotated[str, typer.Option(metavar="A,B,C", help="keV at the lower edge of channel n: A + B n + C n^2.")],
    resolution: Annotated[float, typer.Option(min=0.001, max=0.5, help="FWHM of a line at 662 keV over its energy.")] = 0.07,
    time: Annotated[str | None, typer.Option(help="Name of the column of the time, s.")] = None,
    height: Annotated[str | None, typer.Option(help="Name of the column of the height above ground, m.")] = None,
    mission: Annotated[Path | None, typer.Option(metavar="MISSION.toml", help="Fold the survey by its estimator.")] = None,
    drone: Annotated[str | None, typer.Option(help="Drone of the mission with the survey's detector.")] = None,
) -> None:
    """Check a recorded survey (CSV): track, count rates, spectrum with lines, time statistics; with --mission an estimate."""
    from radron.station.survey.running import run_survey  # noqa: PLC0415  heavy imports wait

    run_survey(file, out, energy, resolution, (time, height), (mission, drone))
