"""README and the documentation: links lead somewhere, commands exist, files load, Python compiles."""

import pkgutil
import re
import shlex

import msgspec
import pytest
import typer
import typer.main

import radron.agent.cli
import radron.deploy.cli
import radron.sim.cli
import radron.station.cli
from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import convert
from radron.agent.config.mission import MissionConfig
from radron.deploy.fleet.config import FleetConfig
from support import docs_pages

PROGRAMS = {
    "radron-agent": radron.agent.cli.app,
    "radron-sim": radron.sim.cli.app,
    "radron-deploy": radron.deploy.cli.app,
    "radron-station": radron.station.cli.app,
}
APPS = {name: typer.main.get_command(app) for name, app in PROGRAMS.items()}
NAMES = [str(page.relative_to(docs_pages.ROOT)) for page in docs_pages.written()]


def page_named(name):
    return docs_pages.ROOT / name


@pytest.mark.parametrize("name", NAMES)
def test_links_and_anchors_resolve(name, reference):
    page = page_named(name)
    text = page.read_text(encoding="utf-8")
    for target in docs_pages.links(text):
        if re.match(r"(https?|mailto):", target):
            continue
        file, _, anchor = target.partition("#")
        other = page if not file else page.parent / file
        if other.parent.resolve() == docs_pages.DOCS / "reference" and other.name in reference:
            content = reference[other.name]
        else:
            assert other.resolve().is_file(), f"{name}: {target}"
            content = other.read_text(encoding="utf-8") if other.suffix == ".md" else ""
        assert not anchor or anchor in docs_pages.anchors(content), f"{name}: {target}"


def command_lines(page):
    """The lines of a page's console blocks that call a program, continued lines joined, comments off."""
    for block in docs_pages.blocks(page):
        if block.language in ("console", "") and not block.title:
            for line in block.text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True) if line.count("'") % 2 == 0 else []
                while words and re.match(r"^[A-Z_]+[=]|^nice$", words[0]):
                    words.pop(0)
                if words:
                    yield words


@pytest.mark.parametrize("name", NAMES)
def test_commands_and_their_options_exist(name):
    for words in command_lines(page_named(name)):
        program = words[0].rpartition("/")[2]
        if program in APPS:
            parse(APPS[program], words[1:], f"{name}: {' '.join(words)}")
        elif program == "make":
            wanted = [word for word in words[1:] if "=" not in word]
            assert set(wanted) <= set(docs_pages.TARGETS), f"{name}: {' '.join(words)}"


def parse(app, words, where):
    """Let the command's own parser read the words; nothing is run."""
    command = app.commands.get(words[0]) if words else None
    assert command is not None, f"{where}: no such command"
    try:
        command.make_context(words[0], list(words[1:]))
    except typer.Exit:  # --help
        return
    except Exception as error:  # of Typer's own copy of Click, whichever that is
        pytest.fail(f"{where}: {error}")


@pytest.mark.parametrize("name", NAMES)
def test_toml_blocks_hold_keys_that_exist(name):
    """Complete files load; of parts of a file every key must exist in the kind of file that the block's first line names."""
    for block in docs_pages.blocks(page_named(name)):
        if block.language != "toml" or block.title:
            continue
        kind = DroneConfig if "drone.toml" in block.text.partition("\n")[0] else None
        check_toml(block.text, kind, name)


def check_toml(text, kind, where):
    document = docs_pages.toml(text)
    if kind is DroneConfig:
        convert({"id": "d1", **document}, DroneConfig, where)
        return
    unknown = [
        root for root in (MissionConfig, DroneConfig, FleetConfig, sim_scenario()) if set(document) <= set(root.__struct_fields__)
    ]
    assert unknown, f"{where}: no kind of file has the keys {', '.join(document)}"
    errors = []
    for root in unknown:
        try:
            msgspec.convert(completed(document, root), root)
        except msgspec.ValidationError as error:
            errors.append(str(error))
        else:
            return
    pytest.fail(f"{where}: {'; '.join(errors)}")


def sim_scenario():
    from radron.sim.scenario import Scenario  # noqa: PLC0415

    return Scenario


def completed(document, root):
    """A part of a file with the least that is missing to make it a whole."""
    area = {"polygon_m": [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]]}
    mission = {"name": "part", "drones": [{"id": "d1"}], "area": area}
    if root is MissionConfig:
        return {**mission, **document, "area": {**area, **document.get("area", {})}}
    if root is DroneConfig:
        return {"id": "d1", **document}
    if root is FleetConfig:
        return {"mission": "mission.toml", "network": {"subnet": "10.7.1.0/24"}, **document}
    return {"name": "part", "description": "a part", "mission": {**mission, **document.get("mission", {})}, **document}


@pytest.mark.parametrize("name", NAMES)
def test_python_blocks_compile(name):
    for block in docs_pages.blocks(page_named(name)):
        if block.language == "python":
            compile(block.text, name, "exec")


def named_in(name):
    """Files, folders and objects of the code that a page names in backticks."""
    text = docs_pages.FENCE.sub("", page_named(name).read_text(encoding="utf-8"))
    for span in re.findall(r"`([^`\s]+)`", text):
        if re.match(r"(agent|sim|protocol|deploy|tests|benchmarks|docs)/", span) and not re.search(r"[{*<A-Z]", span):
            yield span, None
        elif re.match(r"(agent|sim|protocol)(\.[A-Za-z]\w*)+$", span) and not span.endswith(".toml"):
            yield None, span


@pytest.mark.parametrize("name", NAMES)
def test_the_code_that_a_page_names_is_there(name):
    for path, dotted in named_in(name):
        if path is not None:
            assert (docs_pages.ROOT / path).exists(), f"{name}: {path}"
        else:
            assert pkgutil.resolve_name(dotted) is not None, f"{name}: {dotted}"
