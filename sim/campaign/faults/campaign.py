"""Series of many random missions, resumable: a line for each in ``missions.jsonl``, and ``summary.json``, or nothing on disk."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from radron.agent.errors import ConfigError
from radron.sim.campaign.faults.course import ATTACKED, DEALT, FULL, LIVE, SHORT, Course
from radron.sim.campaign.faults.mission import Mission, Verdict, fly_mission
from radron.sim.campaign.flights import Watch, claim
from radron.sim.campaign.workers import Executor, Outcome
from radron.sim.runfile import RunFile, make_folder
from radron.sim.scoring.invariants.judge import ANY

RUNS = "missions.jsonl"
_COMMANDS = {FULL: "faults", SHORT: "faults --short", DEALT: "faults --dealt", ATTACKED: "faults --attacks", LIVE: "live-faults"}
Fly = Callable[[Mission], Verdict]


@dataclass(frozen=True, slots=True)
class FaultCampaign:
    """A series of random missions with faults: ``runs`` missions with the seeds ``seed``, ``seed + 1`` and so on.

    ``first``: each mission ends at its first violation of a condition.
    """

    runs: int
    seed: int = 0
    course: Course = FULL
    first: bool = False

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ConfigError(f"--runs {self.runs}: give 1 or more")
        if self.seed < 0:
            raise ConfigError(f"--seed {self.seed}: give 0 or more")

    def missions(self) -> list[Mission]:
        """Return all missions, in order."""
        until = ANY if self.first else None
        return [Mission(seed, self.course, until=until) for seed in range(self.seed, self.seed + self.runs)]


@dataclass(frozen=True, slots=True)
class Flown:
    """The verdicts on all missions by seed, and the missions without a verdict because their worker process died."""

    verdicts: tuple[Verdict, ...]
    failures: tuple[Outcome[Mission, Verdict], ...]


def fly_faults(
    campaign: FaultCampaign,
    folder: Path | None,
    execute: Executor,
    fly: Fly = fly_mission,
    watch: Watch = lambda done, total, outcome: None,
) -> Flown:
    """Fly the random missions that are missing in the folder.

    Each verdict is on disk as soon as the mission has ended; an equal call resumes. More missions may be flown into the folder
    later, but no missions of another kind.

    Raises:
        ConfigError: the folder cannot be written, holds another campaign, or its files are damaged.
    """
    missions = campaign.missions()
    runs = _runs(campaign, folder) if folder is not None else None
    found = {verdict.seed: verdict for verdict in _read(runs)} if runs is not None else {}
    waiting = [mission for mission in missions if mission.seed not in found]
    done = len(missions) - len(waiting)
    watch(done, len(missions), None)
    failures = []
    for outcome in _closing(execute(waiting, fly) if waiting else iter(())):
        if outcome.result is None:
            failures.append(outcome)
        else:
            found[outcome.job.seed] = outcome.result
            if runs is not None:
                runs.append(msgspec.to_builtins(outcome.result))
        done += 1
        watch(done, len(missions), outcome)
    if runs is not None:
        runs.sort(lambda line: line["seed"])
    verdicts = [found[mission.seed] for mission in missions if mission.seed in found]
    return Flown(tuple(verdicts), tuple(sorted(failures, key=lambda outcome: outcome.job.seed)))


def replay_line(seed: int, course: Course) -> str:
    """Return the command line that repeats the mission of a seed."""
    return f"radron-sim {_COMMANDS[course]} --seed {seed} --runs 1"


def _closing(outcomes: Iterator[Outcome[Mission, Verdict]]) -> Iterator[Outcome[Mission, Verdict]]:
    """Yield the outcomes; the workers stop when the reader stops."""
    try:
        yield from outcomes
    finally:
        if isinstance(outcomes, Generator):
            outcomes.close()


def _runs(campaign: FaultCampaign, folder: Path) -> RunFile:
    make_folder(folder)
    manifest: dict[str, Any] = {
        "radron": version("radron"),
        "seed": campaign.seed,
        "course": msgspec.json.decode(msgspec.json.encode(campaign.course)),  # in the form in which it is read back
    } | ({"first": True} if campaign.first else {})
    claim(folder / "campaign.json", manifest, RUNS)
    return RunFile(folder / RUNS)


def _read(runs: RunFile) -> Sequence[Verdict]:
    """Read the missions flown already. Raises ConfigError for a line without a mission."""
    verdicts = []
    for number, line in enumerate(runs.lines, 1):
        try:
            verdicts.append(msgspec.convert(line, Verdict))
        except msgspec.ValidationError as error:
            raise ConfigError(f"{runs.path}:{number}: not a mission: {error}; remove the line to fly it again") from None
    return verdicts
