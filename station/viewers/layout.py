"""The layout in which Foxglove shows a mission ("Layouts", "Import from file"): 3D view and map, plots, spectra, events, numbers.

The form is Foxglove's export and import format of all versions; "RosOut" is its name of the log panel.
"""

from __future__ import annotations

import json

from radron.station.picture.frame import MissionFrame
from radron.station.viewers import topics
from radron.station.viewers.scene import COLOURS, RED

Panels = dict[str, dict[str, object]]
Split = dict[str, object] | str


def layout(about: MissionFrame) -> str:
    """Return the arrangement of Foxglove's panels for a mission's drones, as JSON to be imported into Foxglove."""
    panels: Panels = {
        "3D!scene": _scene(about),
        "Plot!source": _plot("Uncertainty of the source (1 sigma), m", [("rms", f"{topics.SOURCE}.rms_m", _hex(RED))]),
        "Plot!hits": _plot("Hits per second", _of_drones(about, topics.STATE, "hits_ps")),
        "Plot!spectrum": _spectrum(about),
        "Plot!sigma": _plot("The drones' own uncertainty (1 sigma), m", _of_drones(about, topics.STATE, "sigma_m")),
        "RosOut!events": {"minLogLevel": 1, "searchTerms": [], "nameFilter": {}, "topicToRender": topics.EVENTS},
        "RawMessages!source": {"topicPath": topics.SOURCE, "diffEnabled": False, "expansion": "all"},
    }
    charts = _stack(["Plot!source", "Plot!hits", "Plot!spectrum", "Plot!sigma"])
    views: Split = "3D!scene"
    if about.datum_deg is not None:
        panels["map!earth"] = _map(about)
        views = _split("row", "3D!scene", "map!earth", 60)
    below = _split("row", "RosOut!events", "RawMessages!source", 60)
    whole = _split("row", _split("column", views, below, 72), charts, 65)
    content = {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": whole}
    return json.dumps(content, indent=1) + "\n"


def _scene(about: MissionFrame) -> dict[str, object]:
    xs, ys = zip(*about.fence, strict=True)
    middle = [0.5 * (min(xs) + max(xs)), 0.5 * (min(ys) + max(ys)), 0.0]
    scenes = (topics.AREA, topics.SWARM_SCENE, topics.SOURCE_SCENE, topics.CONES)
    shown: dict[str, object] = {name: {"visible": True} for name in scenes}
    shown |= {topics.POSTERIOR: _heat("density_pm2", True), topics.DOSE: _heat("dose_usvph", False)}
    for index, drone in enumerate(about.drones):
        line = {"visible": True, "type": "line", "lineWidth": 0.1, "gradient": [_colour(index), _colour(index)]}
        shown[topics.PLAN.format(drone)] = line
    return {
        "followMode": "follow-none",
        "followTf": topics.MISSION,
        "cameraState": {
            "perspective": True,
            "distance": 1.6 * max(max(xs) - min(xs), max(ys) - min(ys)),
            "phi": 35,
            "thetaOffset": 0,
            "target": middle,
            "targetOffset": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.5,
            "far": 5000,
        },
        "scene": {"backgroundColor": "#eef1ee", "transforms": {"showLabel": False, "axisScale": 0}},
        "transforms": {},
        "topics": shown,
        "layers": {},
    }


def _heat(field: str, visible: bool) -> dict[str, object]:
    return {"visible": visible, "colorField": field, "colorMode": "gradient", "gradient": ["#fff7bc00", "#8c2d04e0"]}


def _plot(title: str, paths: list[tuple[str, str, str]]) -> dict[str, object]:
    drawn = [
        {"value": path, "label": label, "color": colour, "enabled": True, "timestampMethod": "receiveTime"}
        for label, path, colour in paths
    ]
    return {
        "title": title,
        "paths": drawn,
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "minYValue": 0,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "sidebarDimension": 240,
    }


def _spectrum(about: MissionFrame) -> dict[str, object]:
    """Counts over energy: an axis for each drone's own message, all with the same energies."""
    plot = _plot("Spectrum of the last 10 s: counts over keV", _of_drones(about, topics.SPECTRUM, "counts[:]"))
    axis = {"value": f"{topics.SPECTRUM.format(about.drones[0])}.energy_kev[:]", "enabled": True}
    return {**plot, "xAxisVal": "currentCustom", "xAxisPath": axis, "isSynced": False}


def _map(about: MissionFrame) -> dict[str, object]:
    fixes = [topics.FIX.format(drone) for drone in about.drones]
    colours = {fix: _colour(index) for index, fix in enumerate(fixes)} | {topics.SOURCE_FIX: _hex(RED)}
    return {
        "center": {"lat": about.datum_deg[0], "lon": about.datum_deg[1]} if about.datum_deg is not None else {},
        "zoomLevel": 18,
        "customTileUrl": "",
        "layer": "map",
        "followTopic": "",
        "disabledTopics": [],
        "topicColors": colours,
        "topicConfig": {fix: {"historyMode": "previous", "timeWindowSeconds": 60} for fix in fixes},
        "maxNativeZoom": 18,
    }


def _of_drones(about: MissionFrame, topic: str, field: str) -> list[tuple[str, str, str]]:
    return [(drone, f"{topic.format(drone)}.{field}", _colour(index)) for index, drone in enumerate(about.drones)]


def _stack(names: list[str]) -> Split:
    first, *others = names
    return _split("column", first, _stack(others), 100 // len(names)) if others else first


def _split(direction: str, first: Split, second: Split, percentage: int) -> Split:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}


def _colour(index: int) -> str:
    return _hex(COLOURS[index % len(COLOURS)])


def _hex(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)
