"""The MkDocs hook: adds the generated reference pages, the pages made of notebooks, and the tables of defects to the site."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_FOLDER = Path(__file__).parent
sys.path.insert(0, str(_FOLDER))

import defects  # noqa: E402
import notebooks  # noqa: E402
import pages  # noqa: E402


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are not written by hand."""
    for name, text in pages.pages().items():
        files.append(File.generated(config, f"reference/{name}", content=text))
    for notebook in sorted((_FOLDER.parent / "notebooks").glob("*.ipynb")):
        files.append(File.generated(config, f"notebooks/{notebook.stem}.md", content=notebooks.page(notebook)))
    return files


_FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\\`\w])\$([^$`\n]+(?:\n[^$`\n]+)?)\$(?!\w)", re.DOTALL)
_ELSEWHERE = "agent|benchmarks|deploy|protocol|sim|tests|README|CONTRIBUTING"
_BEYOND = re.compile(rf"\[([^\]]+)\]\((?:\.\./)+(?:{_ELSEWHERE})[^)]*\)")
_CODE = re.compile(r"(```.*?```|`[^`\n]+`)", re.DOTALL)


def _with_formulas(markdown: str) -> str:
    """LaTeX between dollar signs as MathML, which browsers show by themselves; code stays as it is."""

    def formula(match: re.Match[str]) -> str:
        return convert(match[1] or match[2], display="block" if match[1] else "inline")

    parts = _CODE.split(markdown)
    return "".join(part if place % 2 else _FORMULA.sub(formula, part) for place, part in enumerate(parts))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Insert the tables of defects, and formulas as MathML; links to code become text, links to notebooks lead to their pages."""
    if page.file.generated_by:
        return markdown
    linked = _BEYOND.sub(r"\1", defects.with_tables(_with_formulas(markdown)))
    return re.sub(r"(\]\([\w./-]+)\.ipynb\)", r"\1.md)", linked)
