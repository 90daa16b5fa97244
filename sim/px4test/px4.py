"""The real PX4 for a flight test: the binary of a local build, or an image with docker."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from radron.agent.errors import VehicleError

_IN_IMAGE = "/opt/px4/bin/px4"


@dataclass(frozen=True, slots=True)
class Px4:
    """The PX4 program for a flight test: the binary of a local build, or an image with docker (``image``)."""

    binary: Path | None = None
    image: str | None = None

    @classmethod
    def found(cls, environment: Mapping[str, str]) -> Px4 | None:
        """Return the PX4 named by the environment variables PX4_BIN or PX4_IMAGE; None without either.

        Raises:
            VehicleError: the named program does not exist.
        """
        if binary := environment.get("PX4_BIN"):
            path = Path(binary).expanduser().resolve()
            if not os.access(path, os.X_OK) or not path.is_file():
                raise VehicleError(f"PX4_BIN: {binary} is no program; give that of a PX4 build, build/px4_sitl_default/bin/px4")
            return cls(binary=path)
        if image := environment.get("PX4_IMAGE"):
            if shutil.which("docker") is None:
                raise VehicleError(f"PX4_IMAGE: {image} needs docker, which is not installed")
            return cls(image=image)
        return None

    def describe(self) -> str:
        """Return a short description of the program."""
        return str(self.binary) if self.binary is not None else f"image {self.image}"

    def command(self, instance: int, variables: Mapping[str, str]) -> list[str]:
        """Return the command line that starts a PX4 instance; for docker, with its environment variables."""
        if self.binary is not None:
            etc = self.binary.parents[1] / "etc"
            return [str(self.binary), "-d", "-i", str(instance), *([str(etc)] if etc.is_dir() else [])]
        assert self.image is not None
        told = [word for name, value in variables.items() for word in ("--env", f"{name}={value}")]
        run = ["docker", "run", "--rm", "--init", "--network", "host", "--name", container(instance), *told]
        return [*run, "--entrypoint", _IN_IMAGE, self.image, "-d", "-i", str(instance)]


def container(instance: int) -> str:
    """Return the name of a PX4 instance's docker container."""
    return f"radron-px4-{os.getpid()}-{instance}"
