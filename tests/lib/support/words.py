"""How plain the prose of the project is: ``make words``, or ``python tests/lib/support/words.py [--worst N] PATH ...``.

Read docstrings, comments and texts for people (string literals of three words and more) of Python files, Markdown, and the
page's texts. Print for each path the pronouns in place of a noun of the field ("who", "those", "one that", "what is ...") per
100 words, and the length below which nine tenths of the sentences are. The figures find places to look at, and judge no style.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import statistics
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
PATHS = ("protocol", "agent", "sim", "station", "deploy", "tests", "docs", "README.md", "CONTRIBUTING.md")
_PRONOUNS = re.compile(
    r"\b(?:who(?:m|se|ever)?|those|(?:one|ones) (?:that|which)|(?:that|another|which) one|(?:by|from|of) what"
    r"|what (?:is|was|has|it|they|an?|the)|(?:no|some|any)body|of which)\b",
    re.I,
)
_FIRST = re.compile(r"(?:one|who|what|those|so|nor|such|it|they|where|which)\b", re.I)
_CODE = re.compile(r"```.*?```|\$\$.*?\$\$|``?[^`]*``?", re.S)
_END = re.compile(r"(?<=[.;:!?])\s+(?=[A-Z\"'(])")
_LEAST_WORDS = 3


class Prose(NamedTuple):
    """One text and where it stands."""

    place: str
    text: str


class Measure(NamedTuple):
    """Of some prose. longest: words below which nine tenths of the sentences are."""

    words: int
    pronouns: int
    longest: float

    @property
    def per_100(self) -> float:
        return 100.0 * self.pronouns / max(self.words, 1)


def prose(path: Path) -> Iterator[Prose]:
    """The texts of a file, or of all files in a folder."""
    if path.is_dir():
        for file in sorted(path.rglob("*")):
            if file.suffix in (".py", ".md") or file.match("texts.*.json"):
                yield from prose(file)
        return
    source = path.read_text(encoding="utf-8")
    found = {".py": _of_python, ".md": _of_markdown, ".json": _of_json}[path.suffix]
    yield from (Prose(f"{path}:{line}", text) for line, text in found(source))


def _of_python(source: str) -> Iterator[tuple[int, str]]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value.split()) >= _LEAST_WORDS:
            yield node.lineno, node.value
    block: list[str] = []
    last = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        if block and token.start[0] != last + 1:
            yield last, " ".join(block)
            block = []
        block.append(token.string.lstrip("# "))
        last = token.start[0]
    if block:
        yield last, " ".join(block)


def _of_markdown(source: str) -> Iterator[tuple[int, str]]:
    kept = _CODE.sub(lambda match: "X" + "\n" * match[0].count("\n"), source)
    for line, text in enumerate(kept.splitlines(), 1):
        if not text.startswith(("#", "    ")):
            yield from ((line, cell) for cell in text.strip("| ").split(" | "))


def _of_json(source: str) -> Iterator[tuple[int, str]]:
    def texts(value: object) -> Iterator[str]:
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict | list):
            for one in value.values() if isinstance(value, dict) else value:
                yield from texts(one)

    yield from ((1, text) for text in texts(json.loads(source)))


def sentences(text: str) -> list[str]:
    """Its sentences of three words and more."""
    flat = " ".join(_CODE.sub("X", text).split())
    return [one for one in _END.split(flat) if len(one.split()) >= _LEAST_WORDS]


def pronouns(sentence: str) -> int:
    """How many stand in place of a noun, the first word included."""
    return len(_PRONOUNS.findall(sentence)) + bool(_FIRST.match(sentence))


def measured(texts: list[Prose]) -> Measure:
    """Of all sentences together."""
    every = [one for each in texts for one in sentences(each.text)]
    lengths = [len(one.split()) for one in every] or [0]
    longest = statistics.quantiles(lengths, n=10)[-1] if len(lengths) > 1 else float(lengths[0])
    return Measure(sum(lengths), sum(map(pronouns, every)), longest)


def main() -> None:
    parser = argparse.ArgumentParser(description="How plain the prose of the project is.")
    parser.add_argument("--worst", type=int, default=0, help="print so many sentences with most pronouns")
    parser.add_argument("paths", nargs="*", type=Path)
    given = parser.parse_args()
    for path in given.paths or [ROOT / name for name in PATHS]:
        texts = list(prose(path))
        whole = measured(texts)
        name = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
        share = f"{whole.per_100:5.2f} pronouns per 100 of {whole.words} words"
        print(f"{name!s:18}{share}; 90 % of the sentences under {whole.longest:.0f} words")
        every = [(pronouns(one) / len(one.split()) ** 0.5, each.place, one) for each in texts for one in sentences(each.text)]
        for _, place, sentence in sorted(every, reverse=True)[: given.worst]:
            print(f"  {place}: {sentence}")


if __name__ == "__main__":
    main()
