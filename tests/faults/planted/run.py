"""``make planted``: which of the planted bugs the missions with faults find, and by what.

Each bug flies the same seeds until one finds it, 20 at most: missions in lockstep with dealt faults and with drawn ones, and
live ones, in which the agents are real processes. Bugs in code that lockstep does not run fly live only. A bug is found where an
invariant is violated that holds in the same mission without it, or the mission dies or does not end; live missions, no two the
same, must show it twice. Every mission is kept in OUT/found.jsonl, so that an interrupted run goes on, as long as the
packages are the same. The table is also written to OUT/table.md. Exit code 1 where less than 85 % of the written bugs are found.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shlex
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from bugs import LISTS, NAMESPACE, ROOT, Bug, BugError, copy_packages, fingerprint, load_bugs
from flown import CRASH, HANG, LIVE, STAGES, Flights, Flown, Memo, Record, Stage, only_with_bug

FLOOR = 0.85
CONTROL = ""


@dataclass(frozen=True, slots=True)
class Score:
    """Outcome for a bug. ``by``: the invariants that found it, empty: not found; ``flown``: missions until then."""

    bug: Bug
    by: tuple[str, ...] = ()
    stage: str = ""
    seed: int | None = None
    text: str = ""
    flown: int = 0


class Hunt:
    """Flies the bugs of one state of the packages, from copies of its own while others edit them."""

    def __init__(self, folder: Path, flights: Flights, record: Record, stages: Sequence[Stage]) -> None:
        """``folder``: an empty one, for the copies.

        The control of the first seed is flown at once, so that the copies with a bug share its compiled code.

        Raises:
            BugError: it gives no result: there is nothing to compare with.
        """
        self._tree, self._flights, self._record = folder / "packages" / NAMESPACE, flights, record
        copy_packages(ROOT, self._tree)
        self._sources = fingerprint(self._tree)
        first = self._flown(stages[0], self._tree, CONTROL, stages[0].seed, self._sources)
        if first is not None and {CRASH, HANG} & set(first.violated):
            raise BugError(f"seed {first.seed} without any bug: {', '.join(first.violated)}: {first.text}")
        self._control_tree = folder / "control" / NAMESPACE  # a flight writes into its packages, so none flies in the copied ones
        copy_packages(self._tree, self._control_tree)
        self._controls = Memo()

    def score(self, before: Score, stage: Stage) -> Score | None:
        """Fly a bug in one more stage, until it is found; None where that was stopped."""
        bug = before.bug
        sources = hashlib.blake2b(f"{self._sources}\0{bug.file}\0{bug.old}\0{bug.new}".encode(), digest_size=8).hexdigest()
        with tempfile.TemporaryDirectory(prefix="planted-") as folder:
            tree: Path | None = None

            def fly(seed: int, attempt: int = 0) -> Flown | None:
                nonlocal tree
                if self._record.find(bug.id, seed, sources, attempt) is None and tree is None:
                    tree = Path(folder) / "tree" / NAMESPACE
                    copy_packages(self._tree, tree)
                    bug.plant(tree)
                return self._flown(stage, tree, bug.id, seed, sources, attempt)

            for count, seed in enumerate(stage.seeds(bug), start=1):
                flown = fly(seed)
                found = self._found(stage, flown, fly) if flown is not None else None
                if flown is None or found is None:
                    return None
                if found:
                    return Score(bug, found, stage.name, seed, flown.text, before.flown + count)
        return replace(before, flown=before.flown + stage.missions)

    def _found(self, stage: Stage, flown: Flown, fly: Callable[[int, int], Flown | None]) -> tuple[str, ...] | None:
        """Invariants that find the bug in a mission; None where that was stopped."""
        if not flown.violated:
            return ()
        control = self._control(stage, flown.seed)
        if control is None:
            return None
        found = only_with_bug(flown, control)
        if not found and stage.quick:  # ended with a violation that the control has, too
            whole = fly(flown.seed, 1)
            return None if whole is None else only_with_bug(whole, control)
        if not found or not stage.repeats:
            return found
        for attempt in range(1, stage.repeats + 1):
            again = fly(flown.seed, attempt)
            if again is None:
                return None
            if both := tuple(name for name in found if name in again.violated):
                return both
        return ()

    def _control(self, stage: Stage, seed: int) -> Flown | None:
        """The mission without any bug."""
        with self._controls.lock(seed):
            return self._flown(stage, self._control_tree, CONTROL, seed, self._sources)

    def _flown(self, stage: Stage, tree: Path | None, bug: str, seed: int, sources: str, attempt: int = 0) -> Flown | None:
        known = self._record.find(bug, seed, sources, attempt)
        if known is not None or tree is None:
            return known
        command = (*stage.command, *stage.quick) if bug and not attempt else stage.command
        flown = self._flights.fly(command, tree, bug, seed, sources, attempt)
        if flown is not None:
            self._record.add(flown)
        return flown


def main() -> None:
    """Read the options, hunt, print the table."""
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell starts background jobs deaf to SIGINT
        signal.signal(number, signal.default_int_handler)
    options = _options()
    try:
        bugs = [bug for bug in load_bugs() if not options.only or bug.id in options.only]
        for bug in bugs:
            bug.changed((ROOT / bug.file).read_text(encoding="utf-8"))
    except (BugError, OSError) as error:
        print(f"planted: {error}", file=sys.stderr)
        sys.exit(2)
    if not bugs:
        print(f"planted: none of these ids is in {' or '.join(LISTS.values())}", file=sys.stderr)
        sys.exit(2)
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        scores = _hunt(bugs, options)
    except BugError as error:
        print(f"planted: {error}", file=sys.stderr)
        sys.exit(2)
    table = "\n".join(table_of(scores))
    (options.out / "table.md").write_text(table + "\n", encoding="utf-8")
    print(table)
    written = [score for score in scores if score.bug.origin == "written"]
    sys.exit(1 if sum(bool(score.by) for score in written) < FLOOR * len(written) else 0)


def _hunt(bugs: Sequence[Bug], options: argparse.Namespace) -> list[Score]:
    """The scores in the order of the bugs; progress goes to standard error."""
    stages = _stages(options)
    if not stages:
        raise BugError("no missions: give a number above 0 to one of --dealt, --drawn, --live")
    flights = Flights(options.longest)
    scores = {bug.id: Score(bug) for bug in bugs}
    with tempfile.TemporaryDirectory(prefix="planted-") as folder, ThreadPoolExecutor(options.jobs) as pool:
        try:
            hunt = Hunt(Path(folder), flights, Record(options.out / "found.jsonl"), stages)
            for stage in stages:
                live = stage.name == LIVE.name  # real time: one after the other
                waiting = [score for score in scores.values() if not score.by and (live or not score.bug.live)]
                flying = (hunt.score(score, stage) for score in waiting) if live else _all(pool, hunt, waiting, stage)
                for count, score in enumerate(flying, start=1):
                    if score is not None:
                        scores[score.bug.id] = score
                        print(f"planted: {stage.name}: {count} of {len(waiting)}: {_told(score)}", file=sys.stderr, flush=True)
        except BaseException as error:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # all that follows takes a moment
            pool.shutdown(wait=False, cancel_futures=True)
            flights.stop()
            if isinstance(error, KeyboardInterrupt):
                print(f"planted: interrupted; what was flown is in {options.out / 'found.jsonl'}", file=sys.stderr)
                sys.exit(130)
            raise
    return [scores[bug.id] for bug in bugs]


def _all(pool: ThreadPoolExecutor, hunt: Hunt, waiting: Sequence[Score], stage: Stage) -> Iterator[Score | None]:
    """The scores of a stage as they become known."""
    for ended in as_completed([pool.submit(hunt.score, score, stage) for score in waiting]):
        yield ended.result()


def _stages(options: argparse.Namespace) -> list[Stage]:
    """Bugs with missions; ``--command`` flies them all."""
    numbers = (options.dealt, options.drawn, options.live)
    stages = [replace(stage, missions=number) for stage, number in zip(STAGES, numbers, strict=True) if number]
    command = tuple(shlex.split(options.command)) if options.command else ()
    return [replace(stage, command=command or stage.command) for stage in stages]


def table_of(scores: Sequence[Score]) -> list[str]:
    """The table, in Markdown, with the shares that are found."""
    lines = ["| bug | subject | mistake | found by | in | seed | missions |", "|---|---|---|---|---|---|---|"]
    for score in scores:
        bug = score.bug
        title = bug.title.replace("|", "\\|") + (" (live)" if bug.live else "")
        found = ", ".join(score.by) or "**not found**"
        where = f"{score.stage} | {score.seed}" if score.by else " | "
        lines.append(f"| `{bug.id}` | {bug.subject} | {title} | {found} | {where} | {score.flown} |")
    lines.append("")
    for origin in LISTS:
        every = [score for score in scores if score.bug.origin == origin]
        if every:
            lines.append(f"{origin.capitalize()}: {_share(every)}; without those that only live flights run: "
                         f"{_share([score for score in every if not score.bug.live])}.")  # fmt: skip
    return lines


def _share(scores: Sequence[Score]) -> str:
    found = sum(bool(score.by) for score in scores)
    return f"{found} of {len(scores)} found" + (f" ({found / len(scores):.0%})" if scores else "")


def _told(score: Score) -> str:
    if not score.by:
        return f"{score.bug.id} not found in {score.flown} missions"
    return f"{score.bug.id} found by {', '.join(score.by)}, seed {score.seed}: {score.text}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0], prog="planted")
    parser.add_argument("--only", nargs="+", metavar="ID", help="these bugs; default: all")
    for stage in STAGES:
        told = f"{stage.name} missions of a bug at most, {stage.missions} by default"
        parser.add_argument(f"--{stage.name}", type=int, default=stage.missions, metavar="N", help=told)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="missions at the same time; default: all cores")
    parser.add_argument("--longest", type=float, default=3600.0, metavar="S", help="a mission that takes longer has no end")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "planted")
    parser.add_argument("--command", help="in the place of radron-sim, for tests")
    return parser.parse_args()


if __name__ == "__main__":
    main()
