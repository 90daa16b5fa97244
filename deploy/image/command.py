"""``radron-deploy image``: build of the onboard computer's disk image, and writing of it to a drone's disk."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.agent.outputs import cache_folder
from radron.deploy.image.errors import ImageError
from radron.deploy.pki.command import KeyOption, PkiOption, drone_issuer

if TYPE_CHECKING:
    from rich.progress import TaskID

    from radron.deploy.fleet.loading import Fleet
    from radron.deploy.image.target import Target

app = typer.Typer(no_args_is_help=True, help="The onboard computer's disk (docs/nuc.md).")
SnapshotOption = Annotated[
    str | None, typer.Option(metavar="TIME", help="Debian's archive as it was then, such as 20261101T000000Z.")
]
CACHE = cache_folder() / "image"
CacheOption = Annotated[Path, typer.Option("--cache", metavar="FOLDER", help="For packages and intermediate files, 2 GB.")]


@app.command()
def build(
    out: Annotated[Path, typer.Option(metavar="FILE", help="The image to make.")] = Path("nuc.img"),
    source: Annotated[Path, typer.Option(metavar="FOLDER", help="The checkout to build from.")] = Path(),
    snapshot: SnapshotOption = None,
    cache: CacheOption = CACHE,
    twice: Annotated[bool, typer.Option("--twice", help="Build it a second time, and name every file that differs.")] = False,
) -> None:
    """Build a bootable disk image with the agent of a checkout. There are no secrets in it: it is the same for all drones."""
    from radron.deploy.image.build import build_image, manifest_file  # noqa: PLC0415

    made = build_image(out, source.resolve(), cache.resolve(), snapshot, _say)
    print(f"{out}: radron {made.version} ({made.commit}), SHA-256 {made.sha256}; what is in it: {manifest_file(out)}")
    if twice:
        again = out.with_name(f"{out.stem}-again{out.suffix}")
        build_image(again, source.resolve(), cache.resolve(), snapshot, _say)
        compare(out, again)


def _say(step: str) -> None:
    print(step, flush=True)  # also for a reader who follows the output in a file


@app.command()
def compare(
    one: Annotated[Path, typer.Argument(metavar="IMAGE")],
    other: Annotated[Path, typer.Argument(metavar="IMAGE")],
) -> None:
    """Compare two images byte by byte, and name the partitions and files that differ. Exit code 1 if any does."""
    from radron.deploy.image.compare import differences  # noqa: PLC0415

    found = differences(one, other)
    for line in found:
        print(line)
    if found:
        raise typer.Exit(1)
    print(f"{one} and {other} are equal, byte for byte")


@app.command("flash")
def flash_disk(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="Made by `radron-deploy image build`.")],
    disk: Annotated[Path, typer.Argument(metavar="/dev/DISK", help="The disk to erase; or a file of the size of one.")],
    drone: Annotated[str, typer.Option(metavar="ID", help="Id of the drone.")],
    fleet: Annotated[Path, typer.Option(metavar="FLEET.toml", help="The fleet file.")],
    pki: PkiOption = Path("pki"),
    key: KeyOption = None,
    internal: Annotated[bool, typer.Option("--internal", help="Also a disk that is built into this computer.")] = False,
    erase: Annotated[
        str | None, typer.Option(metavar="DISK", help="The disk's name, instead of typing it when asked; for scripts.")
    ] = None,
) -> None:
    """Write an image to a drone's disk, with this drone's configuration and a new certificate, and verify it."""
    from radron.deploy.fleet.loading import load_fleet  # noqa: PLC0415
    from radron.deploy.image.flash import check_image, flash  # noqa: PLC0415
    from radron.deploy.image.target import find_target  # noqa: PLC0415

    loaded = load_fleet(fleet)
    loaded.drone(drone)
    check_image(image)
    _check_version(image, loaded)
    target = find_target(disk, internal)
    _confirm(target, drone, erase)
    with tempfile.TemporaryDirectory(prefix="radron-flash-") as name:  # mode 700: the drone's key is in it for a moment
        config = Path(name) / "config.fat"
        _make_config(config, loaded, drone, pki, key)
        try:
            with _progress_bar() as progress:
                flash(image, config, disk, progress)
        except KeyboardInterrupt:
            raise ImageError(
                f"interrupted: {disk} is erased but not complete, and no computer starts from it; run this again"
            ) from None
    print(f"{disk}: is {drone} now, written and verified; put it into the drone, and switch on")


def _check_version(image: Path, fleet: Fleet) -> None:
    from radron.deploy.image.build import read_manifest  # noqa: PLC0415

    wanted = fleet.config.version
    if wanted is None:
        return
    made = read_manifest(image)
    if made.version != wanted:
        raise ImageError(f"{image}: is radron {made.version}, and {fleet.path} wants version = {wanted!r}; correct one of them")


def _confirm(target: Target, drone: str, erase: str | None) -> None:
    print(f"This erases, and makes {drone} of:")
    for line in target.described():
        print(f"  {line}")
    typed = erase if erase is not None else typer.prompt(f"To go on, type its name ({target.path.name})", err=True)
    if typed.strip() not in (target.path.name, str(target.path)):
        raise ImageError(f"{typed.strip()!r} is not {target.path.name!r}: nothing was written")


def _make_config(file: Path, fleet: Fleet, drone: str, pki: Path, key: Path | None) -> None:
    from radron.deploy.image.configpartition import make_config  # noqa: PLC0415
    from radron.deploy.pki.authority import PkiFolder  # noqa: PLC0415

    issue = drone_issuer(PkiFolder(pki, key), drone, fleet.config.certificate_days)
    make_config(file, file.parent, fleet, fleet.drone(drone), issue, int(time.time()))


@contextmanager
def _progress_bar() -> Iterator[Callable[[str, int, int], None]]:
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn  # noqa: PLC0415

    columns = TextColumn("{task.description:9}"), BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn()
    with Progress(*columns) as bar:
        tasks: dict[str, TaskID] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done)

        yield progress
