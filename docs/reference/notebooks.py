"""A notebook as a page: text, code, printed output and pictures as they stand in the file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def page(notebook: Path) -> str:
    """The Markdown of a notebook, with a link to the notebook itself under its title."""
    parts: list[str] = []
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            parts += _output(output)
    parts.insert(1, f"[Download this notebook]({notebook.name}){{ download }}")
    return "\n\n".join(parts) + "\n"


def _output(output: dict[str, Any]) -> Iterator[str]:
    data = output.get("data", {})
    if "image/png" in data:
        yield f"![Figure made by the cell above](data:image/png;base64,{''.join(data['image/png']).replace(chr(10), '')})"
    elif text := "".join(output.get("text", data.get("text/plain", ""))):
        yield f"```text\n{text.rstrip()}\n```"
