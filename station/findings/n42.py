"""The measured spectra as ANSI N42.42-2012, the format of radiation instruments.

A measurement holds the counts of one drone's camera in ten seconds: single clusters and coincidences together, in the bins of
the exposures (``radron.protocol.spectrum``), with live time, real time and the camera's place.
"""

from __future__ import annotations

import uuid
from collections import defaultdict
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from radron.protocol.entries import Exposure
from radron.protocol.spectrum import BINS, EDGES_KEV
from radron.station.findings.facts import Findings
from radron.station.findings.tables import utc

MEASUREMENT_NS = 10_000_000_000
_MODEL = "Compton camera swarm"  # the schema has words and blanks only, and one run of other signs
_NAMESPACE = "http://physics.nist.gov/N42/2011/N42"


def n42(findings: Findings) -> str:
    """Return the spectra measured in a mission as an N42 document (ANSI N42.42-2012, the format of radiation instruments)."""
    ElementTree.register_namespace("", _NAMESPACE)
    root = ElementTree.Element(f"{{{_NAMESPACE}}}RadInstrumentData")
    root.set("n42DocUUID", str(uuid.uuid5(uuid.NAMESPACE_OID, findings.digest)))
    _child(root, "RadInstrumentDataCreatorName", f"radron {findings.source.versions.get('radron', '')}".strip())
    _about_instrument(root, findings)
    for drone in findings.drones:
        detector = _child(root, "RadDetectorInformation", identity=_detector(drone))
        _child(detector, "RadDetectorName", drone)
        _child(detector, "RadDetectorCategoryCode", "Gamma")
        _child(detector, "RadDetectorKindCode", "CdTe")
    calibration = _child(root, "EnergyCalibration", identity="radron.energies")
    _child(calibration, "EnergyBoundaryValues", " ".join(f"{edge:.6f}" for edge in EDGES_KEV))
    for (drone, window), members in sorted(_windows(findings).items()):
        _add_measurement(root, findings, drone, window, members)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def spectrum_of(exposures: Sequence[Exposure]) -> NDArray[np.int64]:
    """Return the summed spectrum of several exposures (counting intervals of cameras): 32 counts by energy bin.

    Single clusters (adjacent pixels hit by one particle) and coincidences (pairs of simultaneous clusters) are counted together.
    """
    counts = np.zeros(BINS, dtype=np.int64)
    for exposure in exposures:
        for each in exposure.spectrum:
            counts[each.place] += each.singles + each.coincidences
    return counts


def _windows(findings: Findings) -> dict[tuple[str, int], list[int]]:
    """Indices of the exposures by drone and ten seconds."""
    found: defaultdict[tuple[str, int], list[int]] = defaultdict(list)
    for index, exposure in enumerate(findings.exposures):
        found[exposure.drone, exposure.stamp_ns // MEASUREMENT_NS].append(index)
    return found


def _about_instrument(root: ElementTree.Element, findings: Findings) -> None:
    about = _child(root, "RadInstrumentInformation", identity="radron.swarm")
    _child(about, "RadInstrumentManufacturerName", "radron")
    _child(about, "RadInstrumentModelName", _MODEL)
    _child(about, "RadInstrumentDescription", "Swarm of Compton cameras: Timepix3 with CdTe sensors, one on each drone.")
    _child(about, "RadInstrumentClassCode", "Other")
    version = _child(about, "RadInstrumentVersion")
    _child(version, "RadInstrumentComponentName", "Software")
    _child(version, "RadInstrumentComponentVersion", findings.source.versions.get("radron", "unknown"))


def _add_measurement(root: ElementTree.Element, findings: Findings, drone: str, window: int, members: Sequence[int]) -> None:
    exposures = [findings.exposures[index] for index in members]
    name = f"{drone}-{window}"
    measured = _child(root, "RadMeasurement", identity=f"measurement.{name}")
    _child(measured, "MeasurementClassCode", "Foreground")
    _child(measured, "StartDateTime", utc(exposures[0].stamp_ns))
    _child(measured, "RealTimeDuration", _duration(sum(each.end_ns - each.stamp_ns for each in exposures) * 1e-9))
    spectrum = _child(measured, "Spectrum", identity=f"spectrum.{name}")
    spectrum.set("radDetectorInformationReference", _detector(drone))
    spectrum.set("energyCalibrationReference", "radron.energies")
    _child(spectrum, "LiveTimeDuration", _duration(sum(each.live_time_s for each in exposures)))
    _child(spectrum, "ChannelData", " ".join(map(str, spectrum_of(exposures).tolist())))
    place = next((found for index in members if (found := findings.places[index]) is not None), None)
    if place is not None and findings.mission.datum is not None:
        latitude_deg, longitude_deg, altitude_m = findings.on_earth(place)
        state = _child(measured, "RadInstrumentState")
        state.set("radInstrumentInformationReference", "radron.swarm")
        point = _child(_child(state, "StateVector"), "GeographicPoint")
        _child(point, "LatitudeValue", f"{latitude_deg:.8f}")
        _child(point, "LongitudeValue", f"{longitude_deg:.8f}")
        _child(point, "ElevationValue", f"{altitude_m:.2f}")


def _detector(drone: str) -> str:
    """Return a drone's id as an xs:ID: no leading digit; no drone's id has an underscore or a dot."""
    return drone if drone[0].isalpha() else f"_{drone}"


def _duration(seconds: float) -> str:
    return f"PT{seconds:.6f}S"


def _child(parent: ElementTree.Element, name: str, text: str = "", identity: str = "") -> ElementTree.Element:
    made = ElementTree.SubElement(parent, f"{{{_NAMESPACE}}}{name}")
    made.text = text or None
    if identity:
        made.set("id", identity)
    return made
