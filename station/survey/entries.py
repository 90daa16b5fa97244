"""A recorded survey as exposures of one drone of a mission, and their fold by the mission's estimator."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pymap3d
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.channels import Channels, energies_of
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError
from radron.agent.terrain.ground import Ground
from radron.protocol.codec import encode
from radron.protocol.contamination import Contamination
from radron.protocol.entries import MAX_LOGGED_EXPOSURE_NS, Counts, Exposure, PoseSample
from radron.station.picture.swarmlog import SwarmLog
from radron.station.survey.table import Array, Survey

BEGIN_NS = 1_000_000_000_000_000_000  # of the fold's time: a survey's own may be of any clock
END_NS = 5_000_000_000  # after the last record: estimators wait for entries that are late
_BOOT = "0" * 16


def edges_kev_of(survey: Survey, energy_kev: tuple[float, ...]) -> Array:
    """Return the energies at the edges of the survey's channels, (R + 1,) keV; energy_kev: as in the drone file."""
    return energies_of(survey.counts.shape[1], energy_kev)


def places_m(survey: Survey, mission: MissionConfig) -> Array:
    """Return the records' places in the mission frame, (N, 3) metres: at the records' heights above the mission's ground.

    Raises ConfigError if the survey has longitudes and latitudes, and the mission no datum.
    """
    east, north = survey.place[:, 0], survey.place[:, 1]
    if survey.on_earth:
        datum = mission.datum
        if datum is None:
            raise ConfigError("the survey has longitudes and latitudes: give the mission a datum")
        place = datum.latitude_deg, datum.longitude_deg, datum.altitude_m
        east, north, _ = pymap3d.geodetic2enu(north, east, datum.altitude_m, *place)
    ground = Ground.from_config(mission)
    heights = [ground.height_m(x, y) for x, y in zip(east.tolist(), north.tolist(), strict=True)]
    return np.column_stack((east, north, np.array(heights) + survey.height_m))


def exposures(survey: Survey, mission: MissionConfig, drone: str, detector: DetectorConfig) -> Iterator[Exposure]:
    """Yield the exposures of a survey as of one drone of the mission; records without live time are left out.

    detector: the energies of its channels and its dead time, as in a drone file.

    Raises:
        ConfigError: the drone has no ordinary detector, the places have no datum, or the records are too long.
        DetectorError: the channels do not fit the drone's table of response.
    """
    table = mission.table(drone)
    if table is None:
        raise ConfigError(f"{drone} has a Compton camera in the mission; give it detector and response")
    longest_s = float(survey.live_s.max())
    if longest_s > MAX_LOGGED_EXPOSURE_NS * 1e-9:
        raise ConfigError(f"the survey has records of {longest_s:g} s; at most {MAX_LOGGED_EXPOSURE_NS * 1e-9:g} s can be folded")
    channels = Channels(detector, table)
    local = places_m(survey, mission) - np.array(mission.member(drone).origin_m)
    since_s = survey.time_s - survey.time_s[0]
    usual_s = float(np.median(np.diff(since_s)))
    spans_s = np.minimum(np.append(np.diff(since_s), usual_s), max(usual_s, longest_s))
    for number, (place, span_s) in enumerate(zip(local.tolist(), spans_s.tolist(), strict=True)):
        start_ns, span_ns = BEGIN_NS + round(float(since_s[number]) * 1e9), int(min(span_s * 1e9, MAX_LOGGED_EXPOSURE_NS))
        live_s = min(float(survey.live_s[number]), span_ns * 1e-9)
        if live_s <= 0.0:
            continue
        readout = Readout(start_ns, start_ns + span_ns, start_ns, live_s, PixelHits.none(), counts=survey.counts[number])
        found = channels.detections(readout)
        yield Exposure(
            stamp_ns=start_ns,
            drone=drone,
            mission=mission.mission_id,
            boot=_BOOT,
            sequence=number,
            epoch=0,
            end_ns=start_ns + span_ns,
            live_time_s=found.live_time_s,
            counts=Counts(found.hits, 0, 0),
            poses=(PoseSample(0, tuple(place), (1.0, 0.0, 0.0, 0.0)),),
            position_sigma_m=1.0,
            yaw_sigma_rad=0.05,
            bins=found.bins or (),
        )


class Estimate(Struct, frozen=True):
    """The estimate of a mission's estimator from a survey. exposures: number of those in its log; text: for people.
    contamination: map of the ground, of an estimator that makes one.
    """

    estimator: str
    exposures: int
    text: str
    position_m: tuple[float, ...] | None = None
    rms_m: float | None = None
    contamination: Contamination | None = None


def folded(mission: MissionConfig, found: list[Exposure]) -> Estimate:
    """Fold exposures by the mission's estimator; return the estimate at the end of the survey.

    The drones' frames are exact: the records' places are in the mission frame.
    """
    mission = replace(mission, drones=tuple(replace(drone, localization="exact", yaw_deg=0.0) for drone in mission.drones))
    log = SwarmLog(mission, None)
    log.start(BEGIN_NS)
    now_ns, taken = BEGIN_NS, 0
    for exposure in found:
        entry = replace(exposure, mission=mission.mission_id)
        now_ns = max(now_ns, entry.end_ns)
        taken += sum(1 for _ in log.take(entry, encode(entry), now_ns))
    log.advance(now_ns + END_NS)
    while log.pending:
        log.advance(now_ns + END_NS)
    name, hypothesis, ground = log.fusion.estimator.name, log.fusion.hypothesis, log.fusion.contamination
    found_text = [] if ground is None else [_ground_text(ground)]
    if hypothesis is None:
        found_text.append("no source")
        return Estimate(name, taken, f"{', '.join(found_text)}, by {name} from {taken} exposures", contamination=ground)
    place = tuple(hypothesis.position.tolist())
    where = ", ".join(f"{one:.1f}" for one in place)
    found_text.append(f"source at {where} m, 1 sigma {hypothesis.rms_m:.1f} m")
    text = f"{', '.join(found_text)}, by {name} from {taken} exposures"
    return Estimate(name, taken, text, place, hypothesis.rms_m, ground)


def _ground_text(ground: Contamination) -> str:
    total, highest = ground.total_bq, ground.highest_bqm2
    return (
        f"{ground.nuclide}: {ground.finding}; on the area {total.median:.3g} Bq ({total.low:.3g} to {total.high:.3g}), highest "
        f"{highest.median:.3g} Bq/m2 ({highest.low:.3g} to {highest.high:.3g})"
    )
