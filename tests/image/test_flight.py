"""`make image-test`: the image's agent flies as one of three.

Its root file system is a container's here: an emulated computer is too slow for a flight. Differences from a drone's computer:
the kernel, and no systemd that starts the agent.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from radron.deploy.image.compare import unpack_root
from radron.deploy.image.layout import ROOT_A
from radron.sim.live.processes import Child
from radron.sim.live.swarm import fly_live
from radron.sim.live.view import View
from radron.sim.scenario import load_scenario
from support.computers.machine import lacking

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
    pytest.mark.skipif(os.geteuid() != 0, reason="a container needs root"),
]
# The folder of the flight is seen in the container at its own place. Nothing of this computer's environment is.
CONTAINER = """
set -eu
root=$1 folder=$2; shift 2
mount --make-rprivate /
mount -t tmpfs tmpfs "$root/tmp"
mkdir -p "$root$folder"
mount --bind "$folder" "$root$folder"
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin OMP_NUM_THREADS=1 chroot "$root" /opt/radron/bin/radron-agent "$@"
"""


def test_the_images_agent_flies_as_one_of_three(image: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, folder = tmp_path / "root", tmp_path / "flight"
    folder.mkdir()
    unpack_root(image, ROOT_A, root)
    begin, contained = Child.start, []

    async def start(name: str, command: Sequence[str], **options: object) -> Child:
        if name == second and Path(command[0]).name == "radron-agent":
            contained.append(name)
            command = ["unshare", "--mount", "sh", "-c", CONTAINER, "sh", str(root), str(folder), *command[1:]]
        return await begin(name, command, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Child, "start", start)
    scenario = load_scenario("paper-demo")
    second = scenario.mission.drones[1].id
    flight, report = asyncio.run(fly_live(scenario, 1, folder, None, View()))
    assert contained == [second]
    assert report.agreed
    assert [(agent.stage, agent.problems) for agent in report.agents] == [("landed", ())] * 3
    assert not flight.result.lost
    assert flight.result.error_median_m is not None
    assert flight.result.error_median_m < 10.0
    assert list((folder / "agents" / second / "flight").glob("*.mcap"))
