"""The drones' tracks and the Compton cones of a mission as CSV tables."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from datetime import UTC, datetime

from radron.station.findings.facts import Findings


def tracks_csv(findings: Findings) -> str:
    """Return the drones' tracks as a CSV table, with a line for each drone and second.

    Columns: time (UTC), position (mission frame, metres; geographic if the mission has a datum), hits per second.
    """
    earth = findings.mission.datum is not None
    rows = []
    for frame in findings.frames:
        for drone in frame.drones:
            if drone.place is not None:
                place = findings.on_earth(drone.place) if earth else ("", "", "")
                hits = drone.rates_ps[0] if drone.rates_ps is not None else ""
                rows.append((utc(frame.at_ms * 1_000_000), drone.id, *drone.place, *place, hits))
    return _written(("time_utc", "drone", "x_m", "y_m", "z_m", "latitude_deg", "longitude_deg", "altitude_m", "hits_ps"), rows)


def cones_csv(findings: Findings) -> str:
    """Return the Compton cones as a CSV table, with a line for each of the two possible readings of a cone.

    A reading takes one of the two clusters of pixels for the recoil electron. Columns: apex and axis (mission frame), opening
    angle and its 1-sigma error (degrees), probability of the reading.
    """
    rows = [
        (
            utc(cone.stamp_ns),
            cone.identity.drone,
            place + 1,
            *reading.apex,
            *reading.axis,
            math.degrees(reading.theta_rad),
            math.degrees(reading.sigma_rad),
            reading.probability,
        )
        for cone in findings.cones
        for place, reading in enumerate(cone.readings)
    ]
    apex, axis = ("apex_x_m", "apex_y_m", "apex_z_m"), ("axis_x", "axis_y", "axis_z")
    return _written(("time_utc", "drone", "reading", *apex, *axis, "theta_deg", "sigma_deg", "probability"), rows)


def utc(at_ns: int) -> str:
    """Return a time (nanoseconds UTC) as ISO 8601 text with milliseconds."""
    return datetime.fromtimestamp(at_ns // 1_000_000 / 1000.0, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _written(head: tuple[str, ...], rows: Sequence[tuple[object, ...]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()
