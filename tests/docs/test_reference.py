"""The generated reference has every field of every type, where a reader looks for it."""

import re
import types
import typing

import msgspec
import pytest

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.deploy.fleet.config import FleetConfig
from radron.protocol.messages import KINDS, Action, Stage
from radron.sim import api
from radron.sim.result import RunResult, Trace
from radron.sim.scenario import Scenario
from support import docs_pages


def struct_types(kind, leave_out=()):
    """A struct type and all struct types within its fields, by their annotations."""
    found, waiting = [], [kind]
    while waiting:
        hint = waiting.pop()
        if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            if hint not in found and hint not in leave_out:
                found.append(hint)
                waiting += typing.get_type_hints(hint).values()
        else:
            waiting += [part for part in typing.get_args(hint) if not isinstance(part, str | int)]
    return found


def rows(page, kind):
    """The table under the heading of a type: the cells of each row by key."""
    start = page.index(f"{{ #{kind.__name__.lower()} }}")
    section = re.split(r"^#+ ", page[start:], maxsplit=1, flags=re.M)[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    return {line.split("`")[1]: [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines}


CONFIGS = [
    ("mission.md", MissionConfig, ()),
    ("drone.md", DroneConfig, ()),
    ("fleet.md", FleetConfig, ()),
    ("scenario.md", Scenario, (MissionConfig,)),
]


@pytest.mark.parametrize(("page", "root", "leave_out"), [*CONFIGS, *(("protocol.md", kind, ()) for kind in KINDS.values())])
def test_every_field_of_every_type_is_there(reference, page, root, leave_out):
    for kind in struct_types(root, leave_out):
        assert list(rows(reference[page], kind)) == list(kind.__struct_fields__)


def test_a_row_has_type_limits_unit_default_and_meaning(reference):
    area = rows(reference["mission.md"], struct_types(MissionConfig)[0])
    assert area["swarm"][3] == '`"radron"`'
    by_name = {kind.__name__: kind for kind in struct_types(MissionConfig)}
    climb = rows(reference["mission.md"], by_name["LimitsConfig"])["climb_mps"]
    assert climb[1:4] == ["number, 0 < x ≤ 1e+06", "m/s", "`2`"]
    steps = rows(reference["mission.md"], by_name["EncirclementConfig"])["steps"]
    assert steps[1:] == ["integer, 2 ≤ x ≤ 63", "", "`30`", "K"]


def test_every_choice_of_stage_and_action_is_there(reference):
    for value in (*Stage, *Action):
        assert f"`{value}`" in reference["protocol.md"]


def test_all_of_the_api_and_its_results_are_there(reference):
    page = reference["api.md"]
    for name in api.__all__:
        assert f"{{ #{name.lower()} }}" in page
    for field in (*RunResult.__struct_fields__, *Trace.__dataclass_fields__):
        assert f"`{field}`" in page
    public = {
        name
        for name, value in vars(api).items()
        if isinstance(value, types.FunctionType) and value.__module__ == "radron.sim.api"
    }
    assert {name for name in public if not name.startswith("_")} <= set(api.__all__)


def test_links_within_the_generated_pages_resolve(reference):
    for name, page in reference.items():
        here = docs_pages.anchors(page)
        for target in docs_pages.links(page):
            file, _, anchor = target.partition("#")
            if not file:
                assert anchor in here, f"{name}: #{anchor}"
            else:
                assert file in reference or (docs_pages.DOCS / "reference" / file).resolve().exists(), f"{name}: {file}"
