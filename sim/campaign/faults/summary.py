"""Summary of many random missions with faults: numbers, a table by kind of fault, and a line for each violation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec import Struct

from radron.sim.campaign.faults.campaign import replay_line
from radron.sim.campaign.faults.course import Course
from radron.sim.campaign.faults.mission import EXCEPTION, Verdict
from radron.sim.faults.kinds import KINDS
from radron.sim.figures.faults import kinds_figure
from radron.sim.figures.style import save
from radron.sim.runfile import write_text


class KindRow(Struct, frozen=True, kw_only=True):
    """Results of all random missions that contain one kind of fault.

    missions: their number. violated: missions with a violated condition. able: missions in which one drone or more was able to
    finish. located: missions of these in which the source was located.
    """

    kind: str
    missions: int
    violated: int
    able: int
    located: int


class Summary(Struct, frozen=True, kw_only=True):
    """Results of many random missions, as in ``summary.json``.

    violations: of all conditions; collisions, separation_breaches, fence_breaches, exceptions: of these. violated: missions with
    a violation. able: missions with one drone or more able to finish; able_swarm: two or more. located and located_swarm: the
    able missions that located the source; converged: missions whose able drones agreed. core_s, sim_s, drone_s: sums (see
    ``Verdict``). by_invariant: violations of each condition. kinds: by kind of fault.
    """

    missions: int
    violated: int
    violations: int
    collisions: int
    separation_breaches: int
    fence_breaches: int
    exceptions: int
    able: int
    located: int
    able_swarm: int
    located_swarm: int
    converged: int
    core_s: float
    sim_s: float
    drone_s: float
    by_invariant: dict[str, int]
    kinds: list[KindRow]

    @property
    def core_s_per_drone_s(self) -> float:
        """Processor time for each second of a drone in the air."""
        return self.core_s / max(self.drone_s, 1.0)


def summarise(verdicts: Sequence[Verdict]) -> Summary:
    """Compute the summary of many random missions."""
    count = Counter(violation.invariant for verdict in verdicts for violation in verdict.violations)
    able = [verdict for verdict in verdicts if verdict.able]
    swarm = [verdict for verdict in able if verdict.able > 1]
    return Summary(
        missions=len(verdicts),
        violated=sum(bool(verdict.violations) for verdict in verdicts),
        violations=count.total(),
        collisions=count["collision"],
        separation_breaches=count["separation"],
        fence_breaches=count["fence"],
        exceptions=count[EXCEPTION],
        able=len(able),
        located=sum(verdict.located for verdict in able),
        able_swarm=len(swarm),
        located_swarm=sum(verdict.located for verdict in swarm),
        converged=sum(verdict.converged for verdict in able),
        core_s=round(sum(verdict.core_s for verdict in verdicts), 1),
        sim_s=round(sum(verdict.sim_s for verdict in verdicts), 1),
        drone_s=round(sum(verdict.drone_s for verdict in verdicts), 1),
        by_invariant=dict(sorted(count.items())),
        kinds=[row for kind in KINDS if (row := _row(kind, verdicts)).missions],
    )


def _row(kind: str, verdicts: Sequence[Verdict]) -> KindRow:
    struck = [verdict for verdict in verdicts if any(fault["kind"] == kind for fault in verdict.faults)]
    able = [verdict for verdict in struck if verdict.able]
    return KindRow(
        kind=kind,
        missions=len(struck),
        violated=sum(bool(verdict.violations) for verdict in struck),
        able=len(able),
        located=sum(verdict.located for verdict in able),
    )


def table(summary: Summary) -> str:
    """Return the results by kind of fault as a table in Markdown."""
    head = ("fault", "missions", "violated", "able", "located")
    counts = [(row.kind, row.missions, row.violated, row.able, row.located) for row in summary.kinds]
    counts.append(("all", summary.missions, summary.violated, summary.able, summary.located))
    rows = [tuple(map(str, row)) for row in counts]
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]
    lines = [head, tuple("-" * width for width in widths), *rows]
    return "".join(
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |\n" for line in lines
    )


def sentences(summary: Summary) -> list[str]:
    """Return the summary of many random missions in sentences."""
    return [
        f"{summary.missions} missions, {summary.violated} of them with {summary.violations} violations: "
        + (", ".join(f"{name} {number}" for name, number in summary.by_invariant.items()) or "none"),
        f"two or more drones able in {summary.able_swarm}, source located in {summary.located_swarm} of these; "
        f"one able in {summary.able - summary.able_swarm}, located in {summary.located - summary.located_swarm}; "
        f"logs and hypotheses agreed in {summary.converged} of {summary.able}",
        f"{summary.core_s / max(summary.missions, 1):.1f} core-s a mission, {summary.core_s_per_drone_s:.3f} for each second "
        f"that a drone is in the air; {summary.sim_s / max(summary.missions, 1):.0f} s flown a mission",
    ]


def told(verdict: Verdict, course: Course) -> list[str]:
    """Return a line for each violated condition of a mission, and the command that repeats it; empty without a violation."""
    first = {violation.invariant: violation for violation in reversed(verdict.violations)}
    lines = [
        f"seed {verdict.seed}: {name} at {violation.time_s:.2f} s, {' '.join(violation.drones) or 'all'}: {violation.text}"
        for name, violation in first.items()
    ]
    return [*lines, f"  again: {replay_line(verdict.seed, course)}"] if lines else []


def write_summary(folder: Path, summary: Summary) -> list[Path]:
    """Write ``summary.json``, ``summary.md`` and ``kinds.png`` into a folder; return the files."""
    text = msgspec.json.format(msgspec.json.encode(summary), indent=2).decode() + "\n"
    write_text(folder / "summary.json", text)
    write_text(folder / "summary.md", table(summary))
    rows = [(row.kind, row.missions, row.violated, row.able - row.located) for row in summary.kinds]
    save(kinds_figure(rows, f"{summary.missions} random missions"), folder / "kinds.png")
    return [folder / name for name in ("summary.json", "summary.md", "kinds.png")]
