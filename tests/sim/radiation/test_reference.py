"""Agreement with the measured facts of the project's reference, within 15 %."""

import math

import numpy as np
import pytest

from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.transport import projected_area_mm2
from radron.sim.radiation.truth import CameraTruth
from support.sensors.event_quality import clusters, complete, cones, fwhm

LINE = 661.657


def beam(angle_deg: float, interactions: int, *, fluorescence: bool = True, quota: tuple[int, int, int] | None = None) -> Events:
    cosine = math.cos(math.radians(angle_deg))
    rng = np.random.default_rng(17)
    camera = response(CameraTruth())
    return simulate([(LINE, 1.0)], interactions, camera, rng, cosine=(cosine, cosine), fluorescence=fluorescence, quota=quota)


def shadow_mm2(angle_deg: float) -> float:
    polar = math.radians(angle_deg)
    turns = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    return float(
        np.mean(
            [projected_area_mm2((math.sin(polar) * math.cos(t), math.sin(polar) * math.sin(t), math.cos(polar))) for t in turns]
        )
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "hit_percent", "full_percent", "area_mm2", "later_percent"),
    [(0, 8.0, 0.27, 15.8, 38.0), (60, 11.8, 0.45, 15.3, 46.0), (90, 35.9, 1.38, 12.9, 50.0), (180, 8.0, 0.27, 15.9, 63.0)],
)
def test_efficiencies(angle: int, hit_percent: float, full_percent: float, area_mm2: float, later_percent: float) -> None:
    events = beam(angle, 60_000)
    found = clusters(events, merge_satellites=True)
    area = float(events.area_mm2.sum())
    percent = 100.0 * area / shadow_mm2(angle)
    hits = float((found.number > 0).mean())
    assert percent * hits == pytest.approx(hit_percent, rel=0.15)
    assert area * hits == pytest.approx(area_mm2, rel=0.15)
    assert percent * complete(found, LINE).mean() == pytest.approx(full_percent, rel=0.15)
    later = cones(events, found, LINE, 86.0).later_is_electron
    assert 100.0 * later.mean() == pytest.approx(later_percent, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "two_percent"), [(0, 0.72), (60, 1.25), (90, 4.0), (180, 0.71)])
def test_coincidences_without_fluorescence_and_what_it_adds(angle: int, two_percent: float) -> None:
    """The reference's model had no fluorescence; with it, single deposits grow satellites."""
    percent = 100.0 / shadow_mm2(angle)
    plain, real = (beam(angle, 40_000, fluorescence=fluorescence) for fluorescence in (False, True))
    without = percent * plain.area_mm2.sum() * (clusters(plain).number == 2).mean()
    assert without == pytest.approx(two_percent, rel=0.15)
    assert 1.0 < percent * real.area_mm2.sum() * (clusters(real).number == 2).mean() / without < 1.2


@pytest.mark.slow
def test_angular_resolution_at_30_degrees() -> None:
    events = beam(30.0, 300_000, quota=(0, 0, 300_000))
    degrees = np.degrees(cones(events, clusters(events, merge_satellites=True), LINE, 86.0).arm_rad)
    assert fwhm(degrees, 1.0) == pytest.approx(9.5, rel=0.15)
    assert abs(np.median(degrees)) < 1.0
