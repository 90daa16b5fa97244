"""``radron-station survey``: from the CSV file to its page, its numbers and the estimate of a mission."""

from __future__ import annotations

from math import sqrt
from pathlib import Path

import msgspec
import numpy as np

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.loading import convert, load_mission
from radron.agent.errors import ConfigError
from radron.agent.extras import lacking
from radron.agent.outputs import replacing
from radron.station.survey.check import Statistics, statistics
from radron.station.survey.entries import edges_kev_of, exposures, folded, places_m
from radron.station.survey.page import draw, draw_ground
from radron.station.survey.table import read_survey

SOUND_INDEX = 0.1  # largest deviation of the Poisson index from 1, if it is not chance
CHANCE_SIGMA = 4.0
SOUND_GAIN = 0.02  # largest change


def run_survey(
    file: Path,
    out: Path,
    energy: str,
    resolution: float,
    columns: tuple[str | None, str | None],
    fold: tuple[Path | None, str | None],
) -> None:
    """Check a survey, write its page and numbers into the folder ``out``, and print a summary; fold it where a mission is given.

    columns: names of the columns of time and height. fold: mission file, and id of the drone with the survey's detector.

    Raises RadronError, before anything is written, if an input cannot be used.
    """
    missing = lacking("matplotlib")
    if missing is not None:
        raise ConfigError(missing)
    detector = _detector(energy)
    assert detector.energy_kev is not None
    survey = read_survey(file, *columns)
    edges_kev = edges_kev_of(survey, detector.energy_kev)
    if not np.all(np.diff(edges_kev) > 0.0):
        raise ConfigError(f"--energy {energy}: does not rise over {survey.counts.shape[1]} channels")
    found = statistics(survey, edges_kev, resolution)
    estimate, flown = None, np.zeros((0, 2))
    mission_file, drone = fold
    if mission_file is not None:
        mission = load_mission(mission_file)
        carriers = [one.id for one in mission.drones if one.detector != "minipix"]
        name = drone or (carriers[0] if len(carriers) == 1 else None)
        if name is None:
            raise ConfigError(f"--drone: name the drone with this detector; ordinary ones have {', '.join(carriers) or 'none'}")
        flown = places_m(survey, mission)[:, :2]
        estimate = folded(mission, list(exposures(survey, mission, name, detector)))
    out.mkdir(parents=True, exist_ok=True)
    from matplotlib.figure import Figure  # noqa: PLC0415  takes half a second

    figure = Figure(figsize=(12.0, 9.0), layout="constrained")
    draw(figure, survey, edges_kev, found)
    with replacing(out / "survey.png", (file,)) as part:
        figure.savefig(part, format="png", dpi=110)
    files = ["survey.png", "survey.json"]
    ground = None if estimate is None else estimate.contamination
    if ground is not None:
        figure = Figure(figsize=(8.0, 7.0), layout="constrained")
        draw_ground(figure, ground, flown)
        files.append("ground.png")
        with replacing(out / "ground.png", (file,)) as part:
            figure.savefig(part, format="png", dpi=110)
    told = {"survey": found, "dropped": survey.dropped[:100], "estimate": estimate}
    with replacing(out / "survey.json", (file,)) as part:
        part.write_bytes(msgspec.json.format(msgspec.json.encode(told), indent=1))
    print("\n".join(summary(found, survey.dropped)))
    if estimate is not None:
        print(f"estimate: {estimate.text}")
    print(f"written to {out}: {', '.join(files)}")


def _detector(energy: str) -> DetectorConfig:
    try:
        coefficients = [float(word) for word in energy.split(",")]
    except ValueError:
        raise ConfigError(f"--energy {energy}: give numbers, such as -17.4,3.1025,2.74e-5") from None
    return convert({"kind": "spectrum", "energy_kev": coefficients}, DetectorConfig, "--energy")


def summary(found: Statistics, dropped: tuple[str, ...]) -> list[str]:
    """Return the summary of a survey for people, with what is wrong with it."""
    lines = [f"{found.records} records in {found.duration_s:.0f} s, {found.rate_ps:.1f} counts/s"]
    lines.append(f"slow changes of the rate {found.slow_change:.0%} rms; Poisson index {found.poisson_index:.2f}")
    lines += [f"line at {line.energy_kev:.0f} keV ({line.sigma:.0f} sigma) {line.nuclide}".rstrip() for line in found.lines]
    if dropped:
        lines.append(f"{len(dropped)} rows dropped, the first: {dropped[0]}")
    if found.empty:
        first, last = found.empty[0], found.empty[-1]
        lines.append(f"{len(found.empty)} empty records, of {first + 1} to {last + 1}: the detector was dead")
    if found.gaps:
        lines.append(f"{found.gaps} gaps between records")
    if abs(found.poisson_index - 1.0) > max(SOUND_INDEX, CHANCE_SIGMA * sqrt(2.0 / found.records)):
        lines.append(f"Poisson index {found.poisson_index:.2f}: the counts are not single photons, or were smoothed")
    if found.gain and max(found.gain) - min(found.gain) > SOUND_GAIN:
        lines.append(f"gain drifts by {max(found.gain) - min(found.gain):.1%} (line at {found.gain_line_kev:.0f} keV)")
    return lines
