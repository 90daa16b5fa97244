"""The report on a mission for people to read: one HTML file without scripts, which prints well."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape

from radron.agent.config.beyond import towards
from radron.agent.flight.audit import Audited
from radron.station.findings.facts import Findings, Located
from radron.station.findings.figures import charts, flight_map
from radron.station.findings.tables import utc
from radron.station.picture.frame import SourceFrame
from radron.station.picture.shapes import CORDON_USVPH, cordon_radius_m

_STYLE = """
body { font: 11pt/1.4 system-ui, sans-serif; color: #111; max-width: 48rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 1.6rem; }
table { border-collapse: collapse; width: 100%; } th, td { text-align: left; vertical-align: top; padding: .2rem .5rem; }
th { width: 14rem; font-weight: 600; } tr { border-bottom: 1px solid #ccc; }
svg { width: 100%; height: auto; border: 1px solid #767676; } .warning { color: #a33b00; font-weight: 600; }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; } tr, figure { break-inside: avoid; } }
"""
Row = tuple[str, str]


def report_html(findings: Findings) -> str:
    """Return the report on a mission as an HTML document."""
    mission, frames = findings.mission, findings.frames
    title = f"Findings: {mission.name}"
    began, ended = (utc(frames[place].at_ms * 1_000_000) for place in (0, -1))
    parts = [
        f"<h1>{escape(title)}</h1>",
        *(f'<p class="warning">Incomplete: {escape(flaw)}</p>' for flaw in findings.source.flaws),
        _section("Result", _result(findings)),
        flight_map(findings),
        _section("Search", _search(findings)),
        *charts(findings),
        _section(
            "Mission",
            [
                ("Mission id", mission.mission_id),
                ("Swarm", mission.swarm),
                ("Recorded", f"{began} to {ended} (UTC, the drones' clocks)"),
                ("Drones", ", ".join(f"{drone.id} ({drone.localization})" for drone in mission.drones)),
                ("Estimator", mission.fusion.estimator),
            ],
        ),
        _section("Commands", _commands(findings)),
        _section(
            "Evidence",
            [
                ("Log", f"{findings.entries} entries, {len(findings.cones)} cones"),
                ("Digest of the log", findings.digest),
                ("Software", ", ".join(f"{name} {version}" for name, version in sorted(findings.source.versions.items()))),
            ],
        ),
    ]
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(parts) + "\n</body></html>\n"


def _commands(findings: Findings) -> list[Row]:
    source = findings.source
    rows = [_command(drone, each) for drone, each in source.commands] or [("None", "")]
    if source.heard:
        rows.append(
            ("As heard by", "the station on the ground, while it was there. What each drone made of them is in its record.")
        )
    return rows


def _command(drone: str, audited: Audited) -> Row:
    signer = audited.signer or "no certificate"
    return utc(audited.first_ns), f"{drone}: {audited.action or '?'} by {audited.station} ({signer}): {audited.result}"


def _result(findings: Findings) -> list[Row]:
    if findings.best is None or findings.last is None:
        return [("Source", findings.finding or "none found")]
    best = findings.best
    rows = [("Most certain estimate", f"{_at(best)}, {f'{len(best.sources)} sources' if best.others else _cones(best.source)}")]
    for source in best.sources:
        rows += [(f"Source {source.number}", _cones(source))] if best.others else []
        rows += _source(findings, source)
    last = findings.last
    if last.at_ms != findings.best.at_ms:
        told = (f"({source.place[0]:.2f}, {source.place[1]:.2f}) m, 1 sigma {source.rms_m:.2f} m" for source in last.sources)
        rows.append(("At the end of the records", f"{_at(last)}: {'; '.join(told)} (RMS radius)"))
    if findings.recognised is not None:
        nuclide, evidence = findings.recognised
        rows.append(("Spectrum shows", f"{nuclide}, log likelihood ratio to any other or none: {evidence:.0f}"))
    return rows


def _cones(source: SourceFrame) -> str:
    return f"from {source.cones} cones"


def _outside(source: SourceFrame) -> list[Row]:
    bearing_deg = source.bearing_deg
    return [] if bearing_deg is None else [("Outside the fence", f"{towards(bearing_deg)}, from the area's centre")]


def _source(findings: Findings, source: SourceFrame) -> list[Row]:
    (x, y, z), (xx, xy, _, yy, _, zz) = source.place, source.covariance_m2
    rows = [
        ("Position, mission frame", f"{x:.2f} m east, {y:.2f} m north, {z:.2f} m up; 1 sigma {source.rms_m:.2f} m (RMS radius)"),
        ("Covariance", f"east {xx:.4f}, north {yy:.4f}, east-north {xy:.4f}, up {zz:.4f} m²"),
        *_outside(source),
        ("90 % region", f"ellipse of {source.region[0]:.2f} m by {source.region[1]:.2f} m (semi-axes)"),
        ("Velocity", f"{math.hypot(*source.velocity_mps):.2f} m/s"),
    ]
    if findings.mission.datum is not None:
        latitude, longitude, height = findings.on_earth(source.place)
        rows.insert(0, ("Position, WGS84", f"{latitude:.7f}°, {longitude:.7f}°, {height:.1f} m above the ellipsoid"))
    if source.activity_bq is not None:
        sigma = f" ± {source.activity_sigma_bq:.3g}" if source.activity_sigma_bq is not None else ""
        rows.append(("Activity", f"{source.nuclide}: {source.activity_bq:.3g}{sigma} Bq (1 sigma), unshielded"))
    else:
        rows.append(("Nuclide", source.nuclide))
    if source.dose_usvph is not None:
        rows.append(("Dose rate at 1 m", f"{source.dose_usvph:.3g} µSv/h (ambient dose equivalent, H*(10))"))
    radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
    if radius_m is not None:
        rows.append(("Cordon", f"{CORDON_USVPH:g} µSv/h at 1 m above the ground: {radius_m:.1f} m around the source"))
    return rows


def _search(findings: Findings) -> list[Row]:
    area = findings.mission.area
    rows = [
        ("Area", " ".join(f"({x:g}, {y:g})" for x, y in area.polygon_m) + " m"),
        ("Nuclide searched", findings.mission.nuclide_text),
        *_excluded(findings),
    ]
    if findings.surveyed is not None:
        rows.insert(1, ("Surveyed in lanes", f"{100.0 * findings.surveyed:.0f} % of the area"))
    return [*rows, ("Finding", findings.finding)] if findings.finding else rows


def _excluded(findings: Findings) -> list[Row]:
    search, excluded = findings.search, findings.excluded_bq
    if search is None or search.nuclides_bq is None:
        text = f"sources above {excluded:.3g} Bq" if excluded is not None else "nothing"
        return [("Excluded before a source was found", text)]
    limits = ", ".join(f"{nuclide} {limit_bq:.3g} Bq" for nuclide, limit_bq in search.nuclides_bq.items())
    rows = [("Further sources excluded from these activities on", limits or "none")]
    if search.glare:
        rows.append(("But not beside those found", f"{100.0 * search.glare:.0f} % of the area"))
    if search.left:
        rows.append(("Not searched to the end", f"{100.0 * search.left:.0f} % of the area"))
    return rows


def _section(title: str, rows: Iterable[Row]) -> str:
    return f"<h2>{escape(title)}</h2>\n{_table(rows)}"


def _table(rows: Iterable[Row]) -> str:
    lines = "\n".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows)
    return f"<table>\n{lines}\n</table>"


def _at(located: Located) -> str:
    return utc(located.at_ms * 1_000_000)
