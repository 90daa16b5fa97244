"""Draws the mutations in ``drawn.toml`` by a fixed seed from the output of cosmic-ray. The tool has an environment of its own:

    python -m venv build/mutation && build/mutation/bin/pip install cosmic-ray==8.7.0 tomli-w==1.2.0
    build/mutation/bin/python tests/faults/planted/draw.py

Places in the code are drawn, each with the same probability, and then one of the mutations at each: otherwise a sum, which can
become eleven other operations, would count eleven times. The rules were fixed before the draw, and nothing is drawn again:

- Left out as equivalent: mutations in annotations and type aliases, and in texts (docstrings, f-strings, arguments of ``raise``).
- Left out because the first run of the code shows them: an operation that floats do not have (shifts, bits) in the place of
  arithmetic, ``is`` in the place of a comparison of values, a decorator removed.
"""

from __future__ import annotations

import ast
import random
import subprocess
import tempfile
from collections import defaultdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[3]
SEED = 20261122
NUMBER = 30
FOLDERS = (
    "protocol",
    *(f"agent/{room}" for room in ("fusion", "frames", "mission", "motion", "navigation", "vehicle", "localization", "sensing")),
)
_OBVIOUS = ("_RShift", "_LShift", "_BitOr", "_BitAnd", "_BitXor", "_Is", "_IsNot")
# Modules that only a process with a mesh runs.
_LIVE = ("protocol/mesh/inbox.py", "protocol/mesh/link.py", "protocol/mesh/session.py")
_HEAD = """# Mutations drawn by draw.py, seed {seed}, from {found} at {places} places of the code of {commit}, made by
# cosmic-ray {version}.
# Not edited, but for `old` and `new` where the code has changed: then the same mutation is written into the new code.

"""

Place = tuple[str, int, int, int, int]  # file, line and column of the beginning and of the end
Span = tuple[tuple[int, int], tuple[int, int]]


class Mutation(NamedTuple):
    """An operator of the tool, which of its places in the file it changes, and the function or class of that place."""

    operator: str
    occurrence: int
    within: str


def main() -> None:
    """Draw, and write ``drawn.toml``."""
    import tomli_w  # noqa: PLC0415

    found = _mutations()
    draw = random.Random(SEED)
    drawn = [(place, draw.choice(found[place])) for place in draw.sample(sorted(found), NUMBER)]
    bugs = [_bug(number, place, mutation) for number, (place, mutation) in enumerate(sorted(drawn), start=1)]
    total = sum(map(len, found.values()))
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    facts = {"commit": commit.stdout.strip(), "version": version("cosmic-ray")}
    head = _HEAD.format(seed=SEED, found=total, places=len(found), **facts)
    out = Path(__file__).with_name("drawn.toml")
    out.write_text(head + tomli_w.dumps({"bug": bugs}, multiline_strings=True), encoding="utf-8")
    print(f"{out.name}: {NUMBER} of {total} mutations at {len(found)} places")


def _mutations() -> dict[Place, list[Mutation]]:
    """All mutations that the tool lists, without the ones left out by the rules, by place."""
    # The tool is in an environment of its own.
    from cosmic_ray.commands import init  # type: ignore[import-not-found]  # noqa: PLC0415
    from cosmic_ray.work_db import WorkDB, use_db  # type: ignore[import-not-found]  # noqa: PLC0415

    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    left_out = {path: _left_out(path.read_text(encoding="utf-8")) for path in paths}
    found: defaultdict[Place, list[Mutation]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder, use_db(Path(folder) / "list.sqlite", WorkDB.Mode.create) as listed:
        init(paths, listed, {})
        for item in listed.work_items:
            for one in item.mutations:
                start, end = tuple(one.start_pos), tuple(one.end_pos)
                obvious = one.operator_name.endswith(_OBVIOUS) or one.operator_name == "core/RemoveDecorator"
                if obvious or any(first <= start and end <= last for first, last in left_out[one.module_path]):
                    continue
                place = (str(one.module_path.relative_to(ROOT)), *start, *end)
                found[place].append(Mutation(one.operator_name, one.occurrence, one.definition_name or "the module"))
    return {place: sorted(mutations) for place, mutations in found.items()}


def _left_out(text: str) -> list[Span]:
    """From where to where in a file there are annotations, type aliases and texts, by line (from 1) and column."""
    spans: list[Span] = []
    tree = ast.parse(text)
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        match node:
            case ast.arg(annotation=annotation):
                parts = [annotation]
            case ast.AnnAssign(annotation=annotation):
                parts = [annotation]
            case ast.FunctionDef(returns=returns) | ast.AsyncFunctionDef(returns=returns):
                parts = [returns]
            case ast.JoinedStr() | ast.Raise():
                parts = [node]
        spans += [_span(part) for part in parts if part is not None]
    unions = (node.value for node in tree.body if isinstance(node, ast.Assign) and isinstance(node.value, ast.BinOp))
    return spans + [_span(value) for value in unions if isinstance(value.op, ast.BitOr)]


def _span(node: Any) -> Span:
    return (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)


def _bug(number: int, place: Place, mutation: Mutation) -> dict[str, Any]:
    """The entry of a mutation: its changed lines, with as many around them as make the old text unique."""
    from cosmic_ray import plugins  # type: ignore[import-not-found]  # noqa: PLC0415
    from cosmic_ray.mutating import mutate_code  # type: ignore[import-not-found]  # noqa: PLC0415

    file = place[0]
    text = (ROOT / file).read_text(encoding="utf-8")
    changed = mutate_code(text, plugins.get_operator(mutation.operator)(), mutation.occurrence)
    old, new = text.splitlines(keepends=True), changed.splitlines(keepends=True)
    same = next(at for at, (before, after) in enumerate(zip(old, new, strict=False)) if before != after)
    rest = next(at for at, (before, after) in enumerate(zip(old[::-1], new[::-1], strict=False)) if before != after)
    first, after = same, len(old) - rest
    while text.count("".join(old[first:after])) != 1:
        first, after = (first - 1, after) if first > 0 and (same - first) <= after - len(old) + rest else (first, after + 1)
    name = mutation.operator.removeprefix("core/")
    folder = Path(file).parent.parts
    live = folder[:2] == ("agent", "vehicle") or file in _LIVE
    return {
        "id": f"drawn-{number:02d}",
        "subject": folder[1] if folder[0] == "agent" else folder[0],
        "title": f"{name} in {mutation.within}, {Path(file).name}",
        "file": file,
        "old": "".join(old[first:after]),
        "new": "".join(new[first : after + len(new) - len(old)]),
        **({"live": True} if live else {}),
    }


if __name__ == "__main__":
    main()
