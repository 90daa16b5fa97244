"""Configuration partition of a drone's disk: the drone's files from the fleet file, and its certificate."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from radron.deploy.fleet.config import FleetDrone
from radron.deploy.fleet.files import files_of, write_files
from radron.deploy.fleet.loading import Fleet
from radron.deploy.image.fat import make_fat
from radron.deploy.image.layout import CONFIG


def make_config(file: Path, work: Path, fleet: Fleet, drone: FleetDrone, issue: Callable[[Path], None], epoch: int) -> None:
    """Make the file system of a drone's configuration partition.

    Args:
        file: the file to make; it holds the drone's private key.
        work: an empty folder readable by this user only; the key is in it for a moment.
        fleet: the fleet file.
        drone: the drone in this fleet.
        issue: writes a new certificate and key of the drone into the given folder.
        epoch: date of the files, seconds since 1970.

    Raises:
        ConfigError: an error in the fleet file.
        IdentityError: the certificate cannot be issued.
        ImageError: the files do not fit into the partition.
    """
    content = work / "config"
    content.mkdir(mode=0o700)
    write_files(content, files_of(fleet, drone))
    issue(content / "identity")
    file.touch(mode=0o600)
    make_fat(file, CONFIG.size, CONFIG.name, content, epoch)
