"""Files that a public forge reads: workflow, forms, citation. Whether the workflow runs there is not seen here."""

import re
import tomllib

import pytest
import yaml

from support import docs_pages

FORGE = docs_pages.ROOT / ".github"
PROJECT = tomllib.loads((docs_pages.ROOT / "pyproject.toml").read_text())["project"]
JOBS = yaml.safe_load((FORGE / "workflows/checks.yml").read_text())["jobs"]


def test_the_workflow_calls_targets_that_exist_on_pythons_that_are_supported():
    steps = [step["run"] for job in JOBS.values() for step in job["steps"] if "run" in step]
    called = [match[1] for step in steps if (match := re.match(r"make ([\w-]+)", step))]
    assert {"test", "lint", "docs"} <= set(called) <= set(docs_pages.TARGETS)
    pythons = JOBS["tests"]["strategy"]["matrix"]["python"]
    assert pythons == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["requires-python"] == f">={pythons[0]}"
    assert all(isinstance(job["timeout-minutes"], int) and "uses" in job["steps"][0] for job in JOBS.values())


@pytest.mark.parametrize("form", ["defect.yml", "proposal.yml"])
def test_each_form_asks_something(form):
    content = yaml.safe_load((FORGE / "ISSUE_TEMPLATE" / form).read_text())
    assert content["name"]
    assert content["description"]
    fields = content["body"]
    assert len({field["id"] for field in fields}) == len(fields)
    assert all(field["type"] in ("textarea", "input") and field["attributes"]["label"] for field in fields)


def test_the_citation_is_that_of_this_version():
    citation = yaml.safe_load((docs_pages.ROOT / "CITATION.cff").read_text())
    assert (citation["title"], citation["version"], citation["license"]) == tuple(
        PROJECT[k] for k in ("name", "version", "license")
    )
    paper = citation["references"][0]
    assert len(paper["authors"]) == 8
