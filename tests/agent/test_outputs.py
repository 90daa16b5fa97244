import errno
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from radron.agent.errors import OutputError
from radron.agent.outputs import check_output, replacing, write_durably


def test_a_file_is_written_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    path.write_text("old")

    def fail_half_way() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_half_way()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.png"]
    with replacing(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new"


def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "cones.csv"
    path.write_text("old")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device"), replacing(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["cones.csv"]


@pytest.mark.parametrize("link", [None, "symlink_to", "hardlink_to"])
def test_an_input_is_never_overwritten(tmp_path: Path, link: str | None) -> None:
    source = tmp_path / "recording.t3pa"
    source.write_text("hits")
    out = source
    if link is not None:
        out = tmp_path / "out.csv"
        getattr(out, link)(source)
    with pytest.raises(OutputError, match="is the input"):
        check_output(out, (source,))


def test_what_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for special in (Path("/dev/null"), tmp_path / "pipe"):
        with pytest.raises(OutputError, match="device or another special file"):
            check_output(special)
    with pytest.raises(OutputError, match="is a folder"):
        check_output(tmp_path)
    with pytest.raises(OutputError, match="create it first"):
        check_output(tmp_path / "none" / "file")


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "map.png").symlink_to(tmp_path / "disk/map.png")
    with replacing(tmp_path / "map.png") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "map.png").is_symlink()
    assert (tmp_path / "disk/map.png").read_text() == "new"


def test_a_link_to_nowhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.png").symlink_to("/nowhere/map.png")
    with pytest.raises(OutputError, match=r"is a link to /nowhere/map\.png, which cannot be written"):
        check_output(tmp_path / "map.png")
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(OutputError, match="is a link to"):
        check_output(tmp_path / "a")


def test_a_folder_in_which_nobody_makes_files_is_refused_at_once() -> None:
    with pytest.raises(OutputError, match=r"/proc/result\.json: no file can be created in /proc: "):
        check_output(Path("/proc/result.json"))


def test_a_protected_file_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.png"
    path.write_text("old")
    monkeypatch.setattr(os, "access", lambda place, mode: place != path)  # root may write anything
    with pytest.raises(OutputError, match="no permission to overwrite it"):
        check_output(path)


def test_a_file_that_is_written_durably_has_its_name_on_the_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The new content is on the disk before it gets the name, and the folder with the name before the call returns."""
    path, synced = tmp_path / "trial.json", []

    def fsync(file: int) -> None:
        synced.append((Path(f"/proc/self/fd/{file}").readlink().name, path.exists() and path.read_text()))

    monkeypatch.setattr(os, "fsync", fsync)
    for content in (b"old", b"new"):
        write_durably(path, content)
    fresh = "trial.json.new"
    assert synced == [(fresh, False), (tmp_path.name, "old"), (fresh, "old"), (tmp_path.name, "new")]


def test_files_whose_names_differ_in_the_suffix_only_may_be_written_at_the_same_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A revocation in flight changes a drone's state and its revocations at once; each is written in a thread of its own."""
    files = {tmp_path / "d1.json": b"state", tmp_path / "d1.revoked": b"revocations"}
    written, synced = threading.Barrier(len(files), timeout=10.0), os.fsync

    def fsync(file: int) -> None:
        if Path(f"/proc/self/fd/{file}").readlink() != tmp_path:
            written.wait()  # neither has its name before both have been written
        synced(file)

    monkeypatch.setattr(os, "fsync", fsync)
    with ThreadPoolExecutor(len(files)) as threads:
        list(threads.map(write_durably, files.keys(), files.values()))
    assert {path: path.read_bytes() for path in files} == files
