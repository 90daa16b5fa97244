"""The image and the computers of `make image-test`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from dronedisk import ROOT, Drone
from machine import Machine

from deploy.image.build import build_image


@pytest.fixture(scope="session")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image: that of IMAGE, if it is set, else a new one."""
    if "IMAGE" in os.environ:
        return Path(os.environ["IMAGE"]).resolve()
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "radron/image"
    out = tmp_path_factory.mktemp("image") / "nuc.img"
    build_image(out, ROOT, cache, None, print)
    return out


@pytest.fixture
def drone(tmp_path: Path) -> Drone:
    return Drone(tmp_path)


@pytest.fixture
def machines() -> Iterator[list[Machine]]:
    on: list[Machine] = []
    yield on
    for machine in on:
        machine.power_off()
