"""Campaigns: every case with every seed, resumable; the result does not depend on which executor flies them.

A campaign's folder: ``campaign.json`` (its definition), ``runs.jsonl`` (one object per run: the fields of ``RunResult`` and
the parameters of the sweep), ``failures.jsonl`` (errors of failed flights, if there are any).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from radron.agent.errors import ConfigError
from radron.sim.campaign.workers import Executor, Fly, Job, Outcome, fly_job
from radron.sim.result import RunResult
from radron.sim.runfile import RunFile, json_line, make_folder, write_text
from radron.sim.sweep import Case, Value

_Key = tuple[tuple[str, tuple[Value, ...]], int]  # a case's key, a seed
Watch = Callable[[int, int, Outcome[Any, Any] | None], None]  # runs done, runs in all, the newest


@dataclass(frozen=True, slots=True)
class Campaign:
    """A series of simulated flights: ``runs`` flights of each case, with the seeds ``seed_base``, ``seed_base + 1`` and so on.

    A case is a scenario at one combination of varied parameters. All cases have equal seeds and parameters. ``estimator`` and
    ``law``: None for the scenario's own. ``listen``: scores an estimator that reads the log without influence on the flight;
    None: the estimator that determined where to fly.
    """

    cases: tuple[Case, ...]
    runs: int
    estimator: str | None = None
    law: str | None = None
    seed_base: int = 0
    listen: str | None = None

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ConfigError(f"--runs {self.runs}: give 1 or more")
        if self.seed_base < 0:
            raise ConfigError(f"--seed-base {self.seed_base}: give 0 or more")
        if not self.cases:
            raise ConfigError("no scenario to fly; name at least one")

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the varied parameters."""
        return tuple(name for name, _ in self.cases[0].point)

    def in_order(self) -> list[Case]:
        """Return the cases by name, and the cases of one scenario in the order of their varied parameters."""
        return sorted(self.cases, key=lambda case: case.name)

    def jobs(self) -> list[Job]:
        """Return all flights, seed by seed, so that the remaining time can be predicted."""
        seeds = range(self.seed_base, self.seed_base + self.runs)
        return [Job(case, seed, self.estimator, self.law, self.listen) for seed in seeds for case in self.in_order()]

    def manifest(self) -> dict[str, Any]:
        """Return the campaign's definition, which must be unchanged when the campaign is resumed in its folder."""
        content = hashlib.blake2b(digest_size=8)
        for case in self.in_order():
            content.update(msgspec.json.encode(case.scenario, order="sorted"))
        return {
            "radron": version("radron"),
            "cases": [case.label for case in self.in_order()],
            "content": content.hexdigest(),
            "estimator": self.estimator,
            "law": self.law,
            "listen": self.listen,
            "runs": self.runs,
            "seed_base": self.seed_base,
        }


@dataclass(frozen=True, slots=True)
class Flown:
    """The results of a campaign in order (by scenario, parameters, seed), and the flights that failed, in equal order."""

    campaign: Campaign
    lines: tuple[Mapping[str, Any], ...]
    failures: tuple[Outcome[Job, RunResult], ...]

    def of(self, case: Case) -> list[RunResult]:
        """Return the results of one case, by seed."""
        return [result_of(line) for line in self.lines if _case_key(line, self.campaign.parameters) == case.key]


def fly_campaign(
    campaign: Campaign, folder: Path, execute: Executor, fly: Fly = fly_job, watch: Watch = lambda done, total, outcome: None
) -> Flown:
    """Fly the flights of a campaign that are missing in its folder, and sort its results.

    Every result is on disk as soon as the flight has ended; after an interruption at any moment, an equal call resumes. Failed
    flights are repeated. In the end ``runs.jsonl`` depends only on the campaign, except for the wall times in it.

    Raises:
        ConfigError: the folder cannot be written, holds another campaign, or its files are damaged.
    """
    make_folder(folder)
    claim(folder / "campaign.json", campaign.manifest())
    runs = RunFile(folder / "runs.jsonl")
    jobs = campaign.jobs()
    flown = _flown(runs, campaign, {(job.case.key, job.seed) for job in jobs})
    waiting = [job for job in jobs if (job.case.key, job.seed) not in flown]
    done = len(jobs) - len(waiting)
    watch(done, len(jobs), None)
    failures: list[Outcome[Job, RunResult]] = []
    outcomes = execute(waiting, fly) if waiting else iter(())
    try:
        for outcome in outcomes:
            if outcome.result is None:
                failures.append(outcome)
                _record(folder / "failures.jsonl", failures)
            else:
                runs.append(_line(outcome.job, outcome.result))
            done += 1
            watch(done, len(jobs), outcome)
    finally:
        if isinstance(outcomes, Generator):
            outcomes.close()  # this stops its workers, also after an exception here
    told = {(outcome.job.case.key, outcome.job.seed) for outcome in failures}
    told |= {(_case_key(line, campaign.parameters), line["seed"]) for line in runs.lines}
    failures += [
        Outcome(job, error="the executor returned no outcome") for job in waiting if (job.case.key, job.seed) not in told
    ]
    place = {case.key: index for index, case in enumerate(campaign.in_order())}
    runs.sort(lambda line: (place[_case_key(line, campaign.parameters)], line["seed"]))
    failures.sort(key=lambda outcome: (place[outcome.job.case.key], outcome.job.seed))
    _record(folder / "failures.jsonl", failures)
    return Flown(campaign, tuple(runs.lines), tuple(failures))


def result_of(line: Mapping[str, Any]) -> RunResult:
    """Return the result of a flight from a line of ``runs.jsonl``; the varied parameters in it are ignored."""
    return msgspec.convert(line, RunResult)


def _flown(runs: RunFile, campaign: Campaign, wanted: set[_Key]) -> set[_Key]:
    """Return the flights already flown. Raises ConfigError for a line that is not a run of this campaign."""
    flown = set()
    for number, line in enumerate(runs.lines, 1):
        try:
            key = _case_key(line, campaign.parameters), result_of(line).seed
        except (KeyError, msgspec.ValidationError) as error:
            reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            raise ConfigError(f"{runs.path}:{number}: not a run: {reason}; remove the line to fly that run again") from None
        if key not in wanted or key in flown:
            raise ConfigError(f"{runs.path}:{number}: not a run of this campaign, or given twice; remove the line")
        flown.add(key)
    return flown


def _line(job: Job, result: RunResult) -> dict[str, Any]:
    return msgspec.structs.asdict(result) | {"scenario": job.case.name, "seed": job.seed} | dict(job.case.point)


def _case_key(line: Mapping[str, Any], parameters: Sequence[str]) -> tuple[str, tuple[Value, ...]]:
    return line["scenario"], tuple(line[name] for name in parameters)


def claim(path: Path, manifest: dict[str, Any], runs: str = "runs.jsonl") -> None:
    """Write the definition of a campaign to a new folder, or check that the folder was made for this campaign.

    ``runs``: the file of completed flights.
    """
    if not path.exists():
        if (path.parent / runs).exists():
            raise ConfigError(f"{path.parent}: has {runs} but no campaign.json that defines them; choose another --out")
        write_text(path, msgspec.json.format(msgspec.json.encode(manifest), indent=2).decode() + "\n")
        return
    try:
        found = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}; choose another --out") from None
    differing = [key for key in manifest if found.get(key) != manifest[key]]
    if differing:
        what = ", ".join(f"{key}: {_short(found.get(key))} there, {_short(manifest[key])} here" for key in differing)
        raise ConfigError(f"{path.parent}: holds another campaign ({what}); choose another --out, or remove that folder")


def _short(value: object) -> str:
    text = msgspec.json.encode(value).decode()
    return text if len(text) <= 60 else f"{text[:57]}..."


def _record(path: Path, failures: Sequence[Outcome[Job, RunResult]]) -> None:
    if not failures:
        if path.is_file():
            path.unlink()
        return
    lines = (
        {"scenario": outcome.job.case.name, "seed": outcome.job.seed}
        | dict(outcome.job.case.point)
        | {"error": outcome.error, "traceback": outcome.trace}
        for outcome in failures
    )
    write_text(path, "".join(map(json_line, lines)))
