from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from radron.sim.radiation import store
from radron.sim.radiation.bank import EventBank
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth
from support.sensors.partial_bank import partial_bank


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """The cache in a folder of its own, a small bank instead of the whole, and a list of the parts built."""
    names: list[str] = []

    def build(source: object, camera: object, seed: int, progress: object) -> EventBank:
        names.append(getattr(source, "name", ""))
        return partial_bank("Cs-137")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "build_bank", build)
    store._load.cache_clear()
    yield names
    store._load.cache_clear()


def test_a_bank_is_built_once_and_then_read_from_disk(built: list[str], tmp_path: Path) -> None:
    first = store.load_bank("Cs-137", CameraTruth())
    assert store.load_bank("Cs-137", CameraTruth()) is first
    store._load.cache_clear()  # as another process
    again = store.load_bank("Cs-137", CameraTruth())
    assert built == ["Cs-137"]
    for name in ("pixels", "first", "line", "start", "count", "area_mm2"):
        assert np.array_equal(getattr(again, name), getattr(partial_bank("Cs-137"), name))
    assert [path.name[:12] for path in (tmp_path / "cache" / "radron").glob("*bank-*/")] == ["bank-Cs-137-"]


def test_another_sensor_is_another_bank_and_other_electronics_are_not() -> None:
    def key(truth: CameraTruth, name: str = "Cs-137") -> str:
        return store.bank_key(nuclide(name), response(truth))

    assert key(CameraTruth()) == key(CameraTruth(background_hits_per_s=9.0, calibration_error=0.1))
    assert key(CameraTruth()) != key(CameraTruth(gain_noise=0.05))
    assert key(CameraTruth()) != key(CameraTruth(), "Co-60")


def test_other_code_is_another_bank_with_the_same_random_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    cs137, camera = nuclide("Cs-137"), response(CameraTruth())
    key, seed = store.bank_key(cs137, camera), store.bank_seed(cs137, camera)
    monkeypatch.setattr(store, "MADE_BY", store.MADE_BY[1:])
    assert store.bank_key(cs137, camera) != key
    assert store.bank_seed(cs137, camera) == seed
    assert store.bank_seed(nuclide("Co-60"), camera) != seed


def test_a_cache_that_cannot_be_written_is_said_and_done_without(
    built: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert len(store.load_bank("Cs-137", CameraTruth()).pixels) > 0
    assert "could not be stored" in capsys.readouterr().err


def test_the_other_process_was_first(built: list[str]) -> None:
    """Two processes build the same bank: the later one's rename finds a full folder and leaves it."""
    bank = store.load_bank("Cs-137", CameraTruth())
    (folder,) = store.cache_folder().glob("*bank-*/")
    store._save(store.as_arrays(bank), folder)
    assert list(folder.parent.glob("*bank-*/")) == [folder]


def test_who_comes_second_waits_and_does_not_build(built: list[str]) -> None:
    source, camera = nuclide("Cs-137"), response(CameraTruth())
    folder = store.cache_folder() / f"bank-Cs-137-{store.bank_key(source, camera)}"
    with ThreadPoolExecutor(1) as other:
        with store._alone(folder):
            second = other.submit(store.load_bank, "Cs-137", CameraTruth())
            with pytest.raises(TimeoutError):
                second.result(timeout=0.2)
            store._save(store.as_arrays(partial_bank("Cs-137")), folder)
        assert len(second.result(timeout=30).pixels) > 0
    assert built == []


def test_the_default_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert store.cache_folder() == Path.home() / ".cache" / "radron"
