"""Extras of the package: each optional library belongs to one, and a command names it where the library is missing."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from radron.agent.extras import LIBRARIES, remedy

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
# Starts a command in an environment without some libraries: an import of None fails as that of a missing one.
WITHOUT = "import sys; sys.modules |= dict.fromkeys(sys.argv.pop(1).split(',')); from {} import main; sys.argv[0] = 'x'; main()"


def names(requirements: list[str]) -> set[str]:
    """Normalised names of distributions."""
    return {re.match(r"[\w.-]+", each)[0].lower().replace("_", "-") for each in requirements}


@pytest.mark.parametrize("extra", LIBRARIES)
def test_each_extra_installs_its_libraries(extra: str) -> None:
    known = packages_distributions()
    wanted = {library: {name.lower().replace("_", "-") for name in known.get(library, [library])} for library in LIBRARIES[extra]}
    required = names(PROJECT["optional-dependencies"][extra])
    own = {library for library, from_ in wanted.items() if from_ & (required | {"distributed"})}  # with dask
    assert own == set(wanted)
    assert all(any(name in from_ for from_ in wanted.values()) for name in required), "an extra without an import name"


def test_all_has_each_extra_for_users() -> None:
    (everything,) = PROJECT["optional-dependencies"]["all"]
    assert set(everything.removeprefix("radron[").removesuffix("]").split(",")) == set(LIBRARIES)


def test_the_agent_needs_no_extra() -> None:
    modules = sorted(set().union(*LIBRARIES.values()))
    code = "import sys; sys.modules |= dict.fromkeys(sys.argv[1:]); import radron.agent.shell.node, radron.agent.preflight.check"
    subprocess.run([sys.executable, "-c", code, *modules], check=True)


def test_modules_of_no_extra_have_no_remedy() -> None:
    assert remedy("pymavlink.dialects.v20") == "pymavlink is not installed: pip install 'radron[sim]'"
    assert remedy("numpy") is None
    assert remedy("") is None


@pytest.mark.parametrize(
    ("without", "command", "main"),
    [
        ("numba", "radron-sim", ("radron.sim.cli", "run", "demo", "--out", "out")),
        ("xraylib", "radron-sim", ("radron.sim.cli", "run", "demo", "--out", "out")),
        ("pymavlink", "radron-sim", ("radron.sim.cli", "live", "demo", "--out", "out")),
        ("starlette", "radron-station", ("radron.station.cli", "serve", "x.toml", "--connect", "tcp/[::1]:9", "--insecure")),
    ],
)
def test_a_command_without_its_library_names_the_extra(tmp_path: Path, without: str, command: str, main: tuple[str, ...]) -> None:
    line = [sys.executable, "-c", WITHOUT.format(main[0]), without, *main[1:]]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    extra = command.removeprefix("radron-")
    assert done.stderr == f"{command}: {without} is not installed: pip install 'radron[{extra}]'\n"
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []
