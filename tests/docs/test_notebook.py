"""The notebook runs as it stands, on the kernel of this environment."""

import importlib.util
import json

import pytest

from support import docs_pages

NOTEBOOK = docs_pages.DOCS / "notebooks" / "first-flight.ipynb"


def run_notebook():
    spec = importlib.util.spec_from_file_location("run_notebook", docs_pages.DOCS / "reference" / "run_notebook.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def outputs(notebook):
    """Printed text, and how many pictures there are."""
    found = [output for cell in notebook["cells"] for output in cell.get("outputs", [])]
    text = "".join("".join(output.get("text", "")) for output in found)
    return text, sum("image/png" in output.get("data", {}) for output in found)


@pytest.mark.slow
def test_it_runs_and_prints_what_it_is_about():
    text, pictures = outputs(run_notebook().executed(NOTEBOOK))
    assert "Source estimate: (" in text
    assert "grid" in text
    assert "sum" in text
    assert all(name in text for name in ("bayes  {'time_to_x0_s'", "paper  {'time_to_x0_s'"))
    assert pictures == 3


def test_it_stands_there_with_the_outputs_of_a_whole_run():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    text, pictures = outputs(notebook)
    assert "Source estimate: (" in text
    assert pictures == 3
