"""Counts of ordinary detectors in the channels of their table, and their dead time."""

from __future__ import annotations

import numpy as np
import pytest

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.responses import ResponseTable
from radron.agent.detector.channels import Channels
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import DetectorError

EDGES = (0.0001, 100.0, 250.0, 1000.0)


def table(kind: str = "spectrum", edges: tuple[float, ...] = EDGES) -> ResponseTable:
    channels = len(edges) - 1
    return ResponseTable(
        format="radron-response-1", name="t", kind=kind, edges_kev=edges, fwhm_kev2=(0.0, 1.0, 0.0), energies_kev=(100.0, 200.0),
        angles_deg=(0.0,), peak_cm2=((1.0,), (1.0,)), rest_cm2=(((0.0,) * channels,),) * 2,
    )  # fmt: skip


def readout(counts: list[int] | None, live_s: float = 1.0) -> Readout:
    return Readout(0, 1_000_000_000, 0, live_s, PixelHits.none(), counts=None if counts is None else np.array(counts))


def test_channels_of_the_device_go_to_those_of_the_table() -> None:
    """Channels of 100 keV from 0; the third, 200 to 300 keV, has half of its counts on each side of 250 keV."""
    channels = Channels(DetectorConfig(energy_kev=(0.0, 100.0)), table())
    found = channels.detections(readout([4, 3, 10, 1, 0, 0, 0, 0, 0, 0, 7]))  # the last one is above the table
    assert found.bins == (4, 8, 6)
    assert found.hits == 18


def test_no_count_is_lost_in_divided_channels() -> None:
    """Single counts in a channel with three tenths below an edge: three of ten go there, by turns and without chance."""
    channels = Channels(DetectorConfig(energy_kev=(70.0, 100.0)), table())
    found = [channels.detections(readout([1])).bins for _ in range(100)]
    assert found == [Channels(DetectorConfig(energy_kev=(70.0, 100.0)), table()).detections(readout([1])).bins, *found[1:]]
    sums = np.sum([bins for bins in found if bins is not None], axis=0)
    assert sums.tolist() == pytest.approx([30, 70, 0], abs=1)


def test_spectra_in_the_channels_of_the_table() -> None:
    assert Channels(DetectorConfig(), table()).detections(readout([1, 2, 3])).bins == (1, 2, 3)
    with pytest.raises(DetectorError, match=r"spectra of 4 channels, its table of response has 3; give detector\.energy_kev"):
        Channels(DetectorConfig(), table()).detections(readout([1, 2, 3, 4]))


def test_unusable_readouts_are_refused() -> None:
    with pytest.raises(DetectorError, match="pixel hits instead of counts"):
        Channels(DetectorConfig(), table()).detections(readout(None))
    with pytest.raises(DetectorError, match="does not rise"):
        Channels(DetectorConfig(energy_kev=(0.0, 100.0, -20.0)), table()).detections(readout([1] * 8))


def test_counter_counts_all_channels() -> None:
    found = Channels(DetectorConfig(), table("counts", (30.0, 3000.0))).detections(readout([3, 4]))
    assert found.bins == (7,)


@pytest.mark.parametrize("true_ps", [100.0, 1000.0, 5000.0])
def test_constant_dead_time_gives_the_true_rate(true_ps: float) -> None:
    """A detector with 150 us that counts do not extend measures n / (1 + n tau)."""
    tau_s = 150e-6
    counted = round(true_ps / (1.0 + true_ps * tau_s))
    config = DetectorConfig(dead_time_us=150.0)
    found = Channels(config, table("counts", (30.0, 3000.0))).detections(readout([counted]))
    assert found.hits / found.live_time_s == pytest.approx(true_ps, rel=1.0 / counted * (1.0 + true_ps * tau_s))


def test_live_time_of_the_device() -> None:
    assert Channels(DetectorConfig(), table()).detections(readout([1, 2, 3], 0.7)).live_time_s == 0.7
