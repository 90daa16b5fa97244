"""`docker compose up --build`: images, a flight in containers, an agent that is killed in it. Run by `make docker-test`."""

import json
import os
import shutil
from collections.abc import Iterator

import pytest

from support.computers.composition import ROOT, Composition, Onlooker, until

pytestmark = pytest.mark.skipif("DOCKER_TEST" not in os.environ, reason="needs a docker engine: `make docker-test` runs it")

BUILD_S = 400.0  # nothing cached, on two busy cores
TRACK_S = 90.0  # boot and readiness 15 s, takeoff 10 s, search of 50 x 50 m
RESPACED_S = 40.0  # a step of the spacing has settled after 25 s
FLOWN_S = 150.0  # the rest of the 60 s of tracking, return and landing


@pytest.fixture(scope="module")
def composition(request: pytest.FixtureRequest) -> Iterator[Composition]:
    """The composition with its images built; its results and logs are kept where a test failed."""
    project = os.environ["DOCKER_TEST"]
    folder = ROOT / "results" / project
    folder.mkdir(parents=True)
    composition = Composition(project, folder)
    failed_before = request.session.testsfailed
    try:
        composition.compose("build", "--quiet", within_s=BUILD_S)
        yield composition
    finally:
        try:
            composition.save_logs()
        finally:
            composition.remove()
    if request.session.testsfailed == failed_before:
        shutil.rmtree(folder)
    else:
        print(f"what the containers said and recorded is in {folder}")


@pytest.mark.parametrize(("name", "limit_mb"), [("radron-agent", 550.0), ("radron-sim", 1000.0)])  # with an event bank of 142 MB
def test_an_image_is_small(composition: Composition, name: str, limit_mb: float) -> None:
    assert composition.image_mb(name) < limit_mb


def test_the_swarm_flies_and_closes_the_gap_of_a_killed_agent(composition: Composition) -> None:
    composition.compose("up", "--detach", "--no-build", within_s=90.0)
    onlooker = Onlooker(composition, "agent-1")
    try:
        until(lambda: onlooker.tracking() == ["d1", "d2", "d3"], TRACK_S, "all three track the source that they found")
        until(lambda: (onlooker.smallest_gap_deg() or 0.0) > 80.0, RESPACED_S, "they spread around it")  # some before they circle
        assert [composition.state(f"agent-{i}")["Health"]["Status"] for i in (1, 2, 3)] == ["healthy"] * 3

        composition.compose("kill", "agent-2", within_s=20.0)
        until(lambda: onlooker.tracking() == ["d1", "d3"], 10.0, "nobody hears the killed one any more")
        # Less than 180 is the gap from three: at 160 and more the two have spread around the circle anew.
        until(lambda: (onlooker.smallest_gap_deg() or 0.0) > 160.0, RESPACED_S, "the two that are left re-space")
    finally:
        onlooker.close()

    until(lambda: composition.state("sim")["Status"] == "exited", FLOWN_S, "the flight ends")
    assert composition.state("sim")["ExitCode"] == 0
    assert composition.state("agent-2")["Status"] == "exited"  # killed by hand: the engine does not restart it

    results = composition.folder / "compose"
    flown = json.loads((results / "result.json").read_text())
    assert flown["drones"] == 3
    assert flown["time_to_x0_s"] is not None
    assert flown["error_median_m"] < 10.0  # lockstep's is 2-4 m; lost would be 20 m
    ends = json.loads((results / "agents.json").read_text())
    assert ends["agreed"]
    assert [agent["alive"] for agent in ends["agents"]] == [True, False, True]
    for drone in ("d1", "d2", "d3"):
        assert list((results / "agents" / drone / "flight").glob("*.mcap"))


def test_an_agent_has_nothing_of_the_simulation_and_few_rights(composition: Composition) -> None:
    for module in ("radron.sim", "pymavlink", "numba", "matplotlib"):
        found = composition.compose("run", "--rm", "--no-deps", "--entrypoint", "python", "agent-4", "-c",
            f"import importlib.util; print(importlib.util.find_spec({module!r}))", within_s=30.0)  # fmt: skip
        assert found.strip() == "None"
    rights = composition.compose("run", "--rm", "--no-deps", "--entrypoint", "sh", "agent-4", "-c",
        "id -u; touch /x 2>&1; grep CapEff /proc/self/status", within_s=30.0)  # fmt: skip
    user, refused, capabilities = rights.strip().splitlines()
    assert user != "0"
    assert "Read-only file system" in refused
    assert int(capabilities.split()[1], 16) == 0


def test_nothing_is_left_behind(composition: Composition) -> None:
    composition.compose("down", "--volumes", "--timeout", "3", within_s=60.0)
    assert composition.left_over() == ""
