"""Duration of the measurement of a known source, from its activity and distance."""

from __future__ import annotations

import math

from msgspec import Struct

from radron.agent.calibration.collection import BLOCKS, Collection
from radron.agent.detector.lines import GAMMAS
from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, SENSOR_THICKNESS_MM
from radron.agent.detector.sensor import attenuation_per_mm
from radron.agent.detector.spectroscopy.shapes import peak_area_mm2, strongest_line_kev
from radron.agent.errors import ConfigError

HITS_PER_PIXEL = 8.0  # one healthy pixel in 3,000 has none of them: 22 are masked in vain
PEAK_EVENTS = 40 * BLOCKS * BLOCKS  # 3 % in each block: the resolution is 2.5 %, and the peak is found beside a continuum
PAIRS = 600  # coincidences: 5 % of the drift time
CONES = 600  # 1 degree: a cone is 10 degrees wide, and some are of scattered photons
MAX_MINUTES = 240.0
_PAIRS_PER_PEAK_EVENT = 0.4  # measured with Cs-137 in the simulation; of cones there are rather more
_HITS_PER_EVENT = 9.0  # pixel hits for each direct photon, scattered photons included
_MARGIN = 1.15


class Source(Struct, frozen=True):
    """The sealed source of a calibration: nuclide, activity, and distance from the sensor."""

    nuclide: str
    activity_bq: float
    distance_m: float


class Plan(Struct, frozen=True):
    """Measuring times (s), summed over all directions of the source, until each quantity of a calibration is accurate enough."""

    pixels_s: float
    gain_s: float
    drift_s: float
    orientation_s: float

    @property
    def total_s(self) -> float:
        """Time (s) for the whole calibration: the longest of the times for the single quantities, with a margin."""
        return _MARGIN * max(self.pixels_s, self.gain_s, self.drift_s, self.orientation_s)


def plan(source: Source) -> Plan:
    """Return the times for which a source must be measured, from its activity and distance.

    Raises:
        ConfigError: numbers out of range, an unknown nuclide, or a source that is too weak or too far away.
    """
    if not 1e3 <= source.activity_bq <= 1e12 or not 0.1 <= source.distance_m <= 100.0:
        raise ConfigError(
            f"a source of {source.activity_bq:g} Bq at {source.distance_m:g} m: allowed are 1e3 to 1e12 Bq, and 0.1 to 100 m"
        )
    line = strongest_line_kev(source.nuclide)
    photons = dict(GAMMAS[source.nuclide])[line]
    per_mm2_s = source.activity_bq / (4e6 * math.pi * source.distance_m**2)
    sensor_mm2 = (SENSOR_PIXELS * PIXEL_PITCH_MM) ** 2
    events_s = per_mm2_s * sensor_mm2 * sum(
        share * (1.0 - math.exp(-SENSOR_THICKNESS_MM * attenuation_per_mm(energy)[1])) for energy, share in GAMMAS[source.nuclide]
    )  # fmt: skip
    peak_s = per_mm2_s * photons * peak_area_mm2(line)
    found = Plan(
        pixels_s=HITS_PER_PIXEL * SENSOR_PIXELS**2 / (_HITS_PER_EVENT * events_s),
        gain_s=PEAK_EVENTS / peak_s,
        drift_s=PAIRS / (_PAIRS_PER_PEAK_EVENT * peak_s),
        orientation_s=CONES / (_PAIRS_PER_PEAK_EVENT * peak_s),
    )
    if found.total_s > 60.0 * MAX_MINUTES:
        nearer = source.distance_m * math.sqrt(60.0 * MAX_MINUTES / found.total_s)
        raise ConfigError(
            f"{source.activity_bq:g} Bq of {source.nuclide} at {source.distance_m:g} m: a calibration would take "
            f"{found.total_s / 60.0:.0f} minutes, at most {MAX_MINUTES:.0f} are allowed; put the source at {nearer:.2f} m"
        )
    return found


def is_enough(collection: Collection, share: float) -> bool:
    """Return whether a share (0 .. 1) of the source's directions has yielded its share of the events that a calibration needs."""
    return (
        collection.hits >= share * HITS_PER_PIXEL * SENSOR_PIXELS**2
        and collection.pairs >= share * max(PAIRS, _PAIRS_PER_PEAK_EVENT * PEAK_EVENTS)
        and sum(map(len, collection.cones)) >= share * CONES
    )
