"""The reference pages, made from the types: ``pages()`` gives their Markdown by file name. ``mkdocs.yml`` names ``hook.py``."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

import fields
import files
import msgspec

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.deploy.fleet.config import FleetConfig
from radron.protocol import codec, contamination, keys, messages, summary
from radron.protocol.codes import Code
from radron.sim import api
from radron.sim.result import ConeTrace, RunResult, Trace
from radron.sim.scenario import Scenario

_MISSION = """# Mission file

A TOML file, the same on every drone: what the swarm is to do. Its content is hashed into the mission id; drones whose ids
differ refuse to start together. In a [scenario](scenario.md) it is the table `[mission]`. Positions are in the mission
frame: metres east, north and up of the mission's origin. A key that is not listed here is an error. A complete example is in
[An agent on a drone](../drone.md).

This page is generated from `{type}` and the types within it.
"""
_DRONE = """# Drone file

A TOML file for each drone: what is particular to one vehicle. Relative paths in it start from the file's own folder. An
environment variable overrides a key: `RADRON_` and the key's path in upper case, with `__` for the dot, such as
`RADRON_VEHICLE__ADDRESS`. A complete example is in [An agent on a drone](../drone.md).

This page is generated from `{type}` and the types within it.
"""
_FLEET = """# Fleet file

A TOML file for all drones of a fleet, from which `radron-deploy` makes each drone's files. Relative paths in it start from the
file's own folder. The tables `[vehicle]`, `[detector]` and `[sightings]` are those of the [drone file](drone.md), for all
drones; each entry of `[[drones]]` may have its own, also a `[drones.px4]`, which replace single keys. A key that is not listed
here is an error. A complete example is in [The onboard computer](../nuc.md).

This page is generated from `{type}` and the types within it.
"""
_SCENARIO = """# Scenario file

A TOML file for a simulated flight: the `[mission]` that the drones know, and beside it the truth that they meet.
`base = "demo"` takes everything that the file does not set from another scenario: a file next to it, a shipped scenario, or
a path; `base = ["one", "other"]` takes several, and the later ones win. The keys of `[mission]` are those of the [mission
file](mission.md). How to write a scenario: [Add a scenario](../how-to/scenario.md).

This page is generated from `{type}` and the types within it.
"""
_PROTOCOL = """# Wire protocol

What crosses a link between drones, and from an operator. The types, limits and fields on this page are generated from
`protocol/`.

## Encoding { #encoding }

Each message is one msgpack map, at most {most} bytes, published under its Zenoh key. The field `kind` holds the type's name
in lower case. Types that are marked *array* travel as msgpack arrays: their fields in the order given here. Receivers ignore
unknown fields; a missing required field, a field given twice, a value out of range, NaN or infinity makes the message
invalid. An invalid message is counted (`rejected_malformed`) and dropped.

## Keys { #keys }

| key | what |
|---|---|
| `{root}/SWARM/DRONE/KIND` | a message of a drone; KIND is one of {kinds} |
| `{root}/SWARM/station/NAME/command` | a command of the operator's station NAME |
| `{root}/SWARM/DRONE/alive` | liveliness token of a drone |
| `{root}/SWARM/DRONE/log` | query: a drone answers with log entries that the asker lacks |

SWARM, DRONE and NAME: up to 32 of `a-z`, `0-9` and `-`, beginning with a letter or digit. No drone may be called `station`.

## Log query { #log-query }

{summary}
"""
_CODES = """# Codes of texts

A drone tells its operator problems, notices and the finding of a search in words. Beside the words it publishes a code for
each text ([`codes`](protocol.md#codes) of a status): programs decide by the code, and the words may change in any release. The
page has the code as `data-code` of the line, Foxglove as `problem_codes` and `notice_codes`, `radron-sim live --json` as
`problem_codes`, the agent's log as `code`. A text of a release without codes has none.

This page is generated from `protocol/codes.py`.

| code | told when | what to do |
|---|---|---|
{rows}
"""
_API = """# Python API

{intro}

The page is generated from the docstrings of `radron.sim.api`.
"""


_LONG = 80  # characters of a signature; a longer one gets a line for each parameter


def pages() -> dict[str, str]:
    """File name -> Markdown."""
    return {
        "mission.md": _config(_MISSION, MissionConfig),
        "drone.md": _config(_DRONE, DroneConfig),
        "fleet.md": _config(_FLEET, FleetConfig),
        "scenario.md": _config(_SCENARIO, Scenario, elsewhere={MissionConfig: "mission.md"}),
        "protocol.md": _protocol(),
        "api.md": _api(),
        "codes.md": _codes(),
        "files.md": files.page(),
    }


def _config(intro: str, kind: type[msgspec.Struct], elsewhere: dict[type, str] | None = None) -> str:
    """A configuration file: the keys at its top, then its tables."""
    parts, known = [intro.replace("{type}", f"{kind.__module__}.{kind.__name__}")], set()
    for section in fields.sections(kind, leave_out=tuple(elsewhere or ())):
        name = section.kind.__name__
        anchor = name.lower() if name not in known else section.path.replace("[]", "").replace(".", "-").lower()
        known.add(name)
        parts.append(
            f"## {_header(section)} {{ #{anchor} }}\n\n{fields.markdown(section.kind.__doc__)}\n\n{fields.table(section)}\n"
        )
    text = re.sub(r"\[\w+\]\((#\w+)\)", r"[table](\1)", "\n".join(parts))
    for other, page in (elsewhere or {}).items():
        text = text.replace(f"(#{other.__name__.lower()})", f"({page})")
    return text


def _header(section: fields.Section) -> str:
    path = section.path
    if not path:
        return "Top level"
    table = f"`[[{path.removesuffix('[]')}]]`" if path.endswith("[]") else f"`[{path}]`"
    tag = section.kind.__struct_config__.tag
    return table if tag is None else f'{table} with `kind = "{tag}"`'


def _protocol() -> str:
    kinds = ", ".join(f"`{kind}`" for kind in messages.DRONE_KINDS)
    text = _PROTOCOL.replace("{most}", f"{codec.MAX_PAYLOAD_BYTES:,}".replace(",", " ")).replace("{root}", keys.ROOT)
    parts = [text.replace("{kinds}", kinds).replace("{summary}", fields.markdown(summary.__doc__))]
    modules = dict.fromkeys(kind.__module__ for kind in reversed(messages.KINDS.values()))
    told = "\n\n".join(inspect.cleandoc(sys.modules[name].__doc__ or "") for name in modules)
    parts.append(f"## Conventions {{ #conventions }}\n\n{fields.markdown(told)}\n")
    inner: dict[type[msgspec.Struct], None] = {}
    for kind in messages.KINDS.values():
        outer, *within = fields.sections(kind)
        inner |= dict.fromkeys(section.kind for section in within if section.kind not in messages.KINDS.values())
        parts.append(_message(outer, 2))
    parts.append("## Types within messages { #types-within-messages }\n")
    parts += [_message(next(fields.sections(kind)), 3) for kind in inner]
    parts += [_enum(kind) for kind in (messages.Stage, messages.Action, messages.Reaction, contamination.Finding)]
    return "\n".join(parts)


def _message(section: fields.Section, level: int) -> str:
    name = section.kind.__name__
    array = " (*array*)" if section.kind.__struct_config__.array_like else ""
    head = f"{'#' * level} {name}{array} {{ #{name.lower()} }}"
    return f"{head}\n\n{fields.markdown(section.kind.__doc__)}\n\n{fields.table(section)}\n"


def _enum(kind: type[Enum]) -> str:
    values = ", ".join(f"`{member.value}`" for member in kind)
    return f"### {kind.__name__} {{ #{kind.__name__.lower()} }}\n\n{fields.markdown(kind.__doc__)} One of {values}.\n"


def _codes() -> str:
    return _CODES.replace("{rows}", "\n".join(f"| `{code}` | {code.when} | {code.action} |" for code in Code))


def _api() -> str:
    parts = [_API.replace("{intro}", _code_block(api.__doc__))]
    for name in api.__all__:
        parts.append(_member(getattr(api, name)))
    parts.append("## Results { #results }\n")
    parts += [_member(kind, 3) for kind in (RunResult, Trace, ConeTrace)]
    return "\n".join(parts)


def _member(member: Any, level: int = 2) -> str:
    name = member.__name__
    head, doc = f"{'#' * level} {name} {{ #{name.lower()} }}", fields.markdown(member.__doc__)
    if not isinstance(member, type):
        return f"{head}\n\n```python\n{name}{_signature(member)}\n```\n\n{doc}\n"
    names = ", ".join(f"`{field}`" for field in _field_names(member))
    properties = [f"- `{key}`: {fields.markdown(value.__doc__)}" for key, value in vars(member).items() if _told(key, value)]
    told = "" if "Attributes:" in doc else f"Fields: {names}.\n"
    return "\n".join([head, "", doc, "", told, *properties, ""])


def _signature(function: Callable[..., object]) -> str:
    """As it is written in the code: without the quotes that postponed annotations get."""
    signature = inspect.signature(function)
    line = str(signature).replace("'", "")
    if len(line) < _LONG:
        return line
    parameters, before = [], None
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and before is not parameter.kind:
            parameters.append("*")
        parameters.append(str(parameter).replace("'", ""))
        before = parameter.kind
    return f"(\n    {f',{chr(10)}    '.join(parameters)},\n){line[line.rindex(' -> ') :]}"


def _field_names(kind: type) -> Iterable[str]:
    return (field.name for field in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else kind.__struct_fields__


def _told(name: str, value: object) -> bool:
    return isinstance(value, property) and not name.startswith("_")


def _code_block(docstring: str | None) -> str:
    """A module's docstring; its example, the indented lines, as a block of Python."""
    before, _, rest = inspect.cleandoc(docstring or "").partition("\n    ")
    example, _, after = f"    {rest}".rpartition("\n\n")
    code = "\n".join(line.removeprefix("    ") for line in example.splitlines())
    return f"{fields.markdown(before)}\n```python\n{code}\n```\n\n{fields.markdown(after)}"
