"""The image and the computers of `make image-test`."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from radron.deploy.image.build import build_image
from radron.deploy.image.layout import ROOT_B
from radron.deploy.update.bundle import build_bundle
from support.computers.cutbench import IN_MESH, ON_TRIAL, UPDATED, Bench, Push
from support.computers.cutdisk import Content
from support.computers.dronedisk import BOOT_S, ROOT, Drone
from support.computers.machine import Machine

_KEPT = "bench.pickle"


@pytest.fixture(scope="session")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image: that of IMAGE, if it is set, else a new one."""
    if "IMAGE" in os.environ:
        return Path(os.environ["IMAGE"]).resolve()
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "radron/image"
    out = tmp_path_factory.mktemp("image") / "nuc.img"
    build_image(out, ROOT, cache, None, print)
    return out


@pytest.fixture(scope="session")
def fresh(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """A computer with a flashed disk, and a bundle for it; with BENCH=FOLDER that of an earlier run."""
    folder = Path(os.environ["BENCH"]).resolve() if "BENCH" in os.environ else tmp_path_factory.mktemp("bench")
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / _KEPT).exists():
        bench: Bench = pickle.loads((folder / _KEPT).read_bytes())
    else:
        image, drone, bundle = request.getfixturevalue("image"), Drone(folder), folder / "new.raucb"
        drone.flash(image)
        build_bundle(image, folder / "builder", bundle, print)
        bench = Bench(drone, image, bundle)
    yield bench
    bench.close()


@pytest.fixture(scope="session")
def bench(fresh: Bench) -> Bench:
    """The computer after its update by a push, kept at moments of that."""
    if "updated" not in fresh.kept:
        update(fresh)
        fresh.close()
        (fresh.drone.folder / _KEPT).write_bytes(pickle.dumps(fresh))
    return fresh


def update(fresh: Bench) -> None:
    """From a flashed disk to a confirmed update."""
    run, begun_s = fresh.run("flashed"), time.monotonic()

    def now(what: str) -> None:
        print(f"{what}: {time.monotonic() - begun_s:.0f} s after switching on")

    run.machine.wait_for(IN_MESH, BOOT_S)
    now("in the mesh")
    run.machine.wait_for(r"radron-settle.service: Deactivated", BOOT_S)
    assert fresh.drone.status().slot == "A"
    run.keep("in service")
    with Push(fresh.drone, fresh.bundle) as push:
        for percent in (30, 80):
            push.wait_for(f"copying, {percent} %")
            run.keep(f"copied {percent} %")
        push.wait_for("writing")
        now("copied")
        run.keep("writing")
        last = ROOT_B.start + fresh.root_bytes
        run.disk.watch(range(last - (1 << 20), last), any)
        assert run.disk.met.wait(BOOT_S), push.said
        run.keep("written")
        run.machine.wait_for(r"radron: booting slot B, attempt 1", BOOT_S)
        now("written")
        content = run.disk.content()
        run.keep("to be booted", uncounted(content, fresh.variables))
        run.machine.wait_for(ON_TRIAL, BOOT_S)
        run.keep("on trial")
        run.machine.wait_for(rf"{ON_TRIAL}[\s\S]*{IN_MESH}", BOOT_S)
        run.keep("in the mesh")
        run.machine.wait_for(UPDATED, BOOT_S)
        now("updated")
        assert push.ended() == 0, push.said
        assert "slot B" in push.said
    run.keep("updated")


def uncounted(content: Content, variables: range) -> Content:
    """As before the boot loader has counted its first attempt at slot B."""
    number, offset = divmod(variables.start, 4096)
    block = content.cached.get(number, content.stored.get(number))
    assert block is not None
    assert b"ORDER=B A" in block[offset:]
    changed = block.replace(b"B_TRY=1", b"B_TRY=0")
    cached = {at: data for at, data in content.cached.items() if at != number}
    return Content(content.stored | {number: changed}, cached)


@pytest.fixture
def drone(tmp_path: Path) -> Drone:
    return Drone(tmp_path)


@pytest.fixture
def machines() -> Iterator[list[Machine]]:
    on: list[Machine] = []
    yield on
    for machine in on:
        machine.power_off()
