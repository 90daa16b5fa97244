"""A run of all targets on all cores: chunk by chunk, resumable, with its findings in a folder."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.target import Finding, Target, run_case
from tests.fuzz.targets import TARGETS

CHUNKS = 100  # of each target
MEMORY_BYTES = 4_000_000_000  # address space of a worker: an input that wants more is a finding, too
_KEPT = 3  # findings of one kind that are kept


@dataclass(frozen=True)
class Chunk:
    """Cases ``first`` to ``last`` of a target, in a run with this seed."""

    target: str
    seed: int
    first: int
    last: int


@dataclass
class Outcome:
    """``cpu_s``: processor time."""

    chunk: Chunk
    inputs: int = 0
    cpu_s: float = 0.0
    slowest_s: float = 0.0
    findings: list[Finding] = field(default_factory=list)


def chunks(names: list[str], share: float, seed: int) -> list[Chunk]:
    """The run's chunks, the first of every target first: so that all have had a share whenever it is interrupted."""
    made: list[tuple[int, Chunk]] = []
    for name in names:
        target = TARGETS[name]
        cases = max(1, math.ceil(share * target.inputs / target.batch))
        count = min(CHUNKS, cases)
        bounds = [cases * place // count for place in range(count + 1)]
        made += [(place * CHUNKS // count, Chunk(name, seed, bounds[place], bounds[place + 1])) for place in range(count)]
    return [chunk for _, chunk in sorted(made, key=lambda one: one[0])]


_made: dict[str, Target] = {}  # of this process


def run_chunk(chunk: Chunk) -> Outcome:
    """Run the cases of a chunk, in this process."""
    if chunk.target not in _made:
        _made[chunk.target] = TARGETS[chunk.target](Path(tempfile.mkdtemp(prefix="radron-fuzz-")))
    outcome, began_s, kinds = Outcome(chunk), time.process_time(), Counter[str]()
    for number in range(chunk.first, chunk.last):
        probe, finding = run_case(_made[chunk.target], chunk.seed, number)
        outcome.inputs += probe.count
        outcome.slowest_s = max(outcome.slowest_s, probe.slowest_s)
        if finding is not None and kinds[finding.kind] < _KEPT:
            kinds[finding.kind] += 1
            outcome.findings.append(finding)
    outcome.cpu_s = time.process_time() - began_s
    return outcome


def run(todo: list[Chunk], workers: int, folder: Path) -> Iterator[Outcome]:
    """Run chunks in processes. A process that dies is a finding of the chunk that killed it, and the others go on."""
    context = multiprocessing.get_context("spawn")
    waiting = list(reversed(todo))
    suspects: list[Chunk] = []  # under way when a process died: again, one at a time, to find the cause
    while waiting or suspects:
        alone = bool(suspects)
        running: dict[Future[Outcome], Chunk] = {}
        with ProcessPoolExecutor(1 if alone else workers, context, initializer=_limit_memory, initargs=(str(folder),)) as pool:
            try:
                while waiting or suspects or running:
                    source = suspects if alone else waiting
                    while source and len(running) < (1 if alone else 2 * workers):
                        chunk = source.pop()
                        running[pool.submit(run_chunk, chunk)] = chunk
                    if not running:
                        break
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        outcome = future.result()
                        del running[future]
                        yield outcome
            except BrokenProcessPool:
                if alone:
                    yield from (_died(chunk) for chunk in running.values())
                else:
                    suspects = list(running.values())


def _limit_memory(folder: str) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    os.nice(10)
    tempfile.tempdir = folder


def _died(chunk: Chunk) -> Outcome:
    finding = Finding(
        chunk.target, chunk.seed, chunk.first, "the process died", f"in one of the cases up to {chunk.last - 1}", b""
    )
    return Outcome(chunk, findings=[finding])


class Journal:
    """The chunks that are done, of a run with the same seed and share, in ``folder``/progress.jsonl."""

    def __init__(self, folder: Path, seed: int, share: float) -> None:
        self._path = folder / "progress.jsonl"
        self._run = {"seed": seed, "share": share}
        self.done: dict[Chunk, int] = {}
        for line in self._path.read_text().splitlines() if self._path.exists() else ():
            entry = json.loads(line)
            if entry["run"] == self._run:
                self.done[Chunk(**entry["chunk"])] = entry["inputs"]

    def add(self, outcome: Outcome) -> None:
        """A chunk without findings is done; one with findings is run again the next time."""
        if outcome.findings:
            return
        with self._path.open("a") as file:
            file.write(json.dumps({"run": self._run, "chunk": vars(outcome.chunk), "inputs": outcome.inputs}) + "\n")


def keep(finding: Finding, folder: Path) -> Path:
    """Write a finding's input and trace; returns the file of the input."""
    path = folder / f"{finding.target}-{finding.seed}-{finding.case}.input"
    path.write_bytes(finding.data)
    path.with_suffix(".txt").write_text(f"{finding.replay}\n{finding.kind}\n\n{finding.trace}")
    return path
