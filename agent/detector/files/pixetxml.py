"""Pixet's configuration of a camera: an XML file with the energy calibration, the masked pixels and the sensor.

The section of a chip holds ``caliba``, ``calibb``, ``calibc`` and ``calibt``, each the base64 text of 65,536 little-endian
doubles, row by row; ``BinaryPixelCfg``, the base64 text of a byte for each pixel, whose lowest bit masks it; and
``SensorThickness`` in micrometres. The section ``Settings`` holds ``Bias``, the sensor's bias voltage in volts.
"""

from __future__ import annotations

import binascii
from base64 import b64decode
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS, SENSOR_THICKNESS_MM
from radron.agent.errors import DetectorError

MAX_XML_BYTES = 32 << 20  # ten times as large as a camera's file
_CONSTANTS = ("caliba", "calibb", "calibc", "calibt")
_PIXELS = SENSOR_PIXELS**2
_MASK_BIT = 1
MIN_BIAS_V, MAX_BIAS_V = 4.0, 1000.0  # the maker's smallest voltage, and the largest one that the drone file takes


@dataclass(frozen=True, slots=True)
class PixetConfiguration:
    """A camera's calibration and settings, as found in the configuration file of the manufacturer's software (Pixet).

    constants: a, b, c and t of the energy calibration, (65536,) each by matrix index; masked: (65536,) mask of pixels that are
    switched off; bias_v: bias voltage (V), None if the file states none.
    """

    constants: tuple[NDArray[np.float64], ...]
    masked: NDArray[np.bool_]
    thickness_mm: float
    bias_v: float | None


def read_pixet_xml(path: Path) -> PixetConfiguration:
    """Read calibration, masked pixels and bias voltage of a camera from a configuration file of Pixet (XML).

    Raises:
        DetectorError: the file cannot be read, is no such configuration, has no calibration, or is of several chips.
    """
    try:
        if path.stat().st_size > MAX_XML_BYTES:
            raise DetectorError(f"{path}: larger than {MAX_XML_BYTES >> 20} MB; not a configuration of Pixet")
        root = ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise DetectorError(f"{path}: cannot be read: {error.strerror}") from None
    except ElementTree.ParseError as error:
        raise DetectorError(f"{path}: not a calibration: neither a folder nor an XML file of Pixet ({error})") from None
    chips = [section for section in root if section.find(_CONSTANTS[0]) is not None]
    if len(chips) != 1:
        what = "no chip with a calibration (caliba)" if not chips else f"{len(chips)} chips, and a camera has one"
        raise DetectorError(f"{path}: {what}")
    chip = chips[0]
    constants = tuple(np.frombuffer(_binary(path, chip, name, 8 * _PIXELS), "<f8").astype(np.float64) for name in _CONSTANTS)
    masked = np.zeros(_PIXELS, np.bool_)
    if chip.find("BinaryPixelCfg") is not None:
        masked = np.frombuffer(_binary(path, chip, "BinaryPixelCfg", _PIXELS), np.uint8) & _MASK_BIT != 0
    return PixetConfiguration(constants, masked, _thickness_mm(path, chip), _bias_v(path, root))


def _binary(path: Path, chip: ElementTree.Element, name: str, size: int) -> bytes:
    try:
        data = b64decode(chip.findtext(name) or "", validate=False)
    except binascii.Error as error:
        raise DetectorError(f"{path}: {chip.tag}/{name}: not base64: {error}") from None
    if len(data) != size:
        raise DetectorError(f"{path}: {chip.tag}/{name}: holds {len(data):,} bytes, {size:,} are needed")
    return data


def _thickness_mm(path: Path, chip: ElementTree.Element) -> float:
    text = chip.findtext("SensorThickness")
    if text is None:
        return SENSOR_THICKNESS_MM
    try:
        thickness_mm = 1e-3 * float(text)
    except ValueError:
        thickness_mm = 0.0
    if not 0.0 < thickness_mm < 100.0:
        raise DetectorError(f"{path}: {chip.tag}/SensorThickness: {text[:20]!r} is not a thickness in micrometres")
    return thickness_mm


def _bias_v(path: Path, root: ElementTree.Element) -> float | None:
    text = root.findtext("Settings/Bias")
    if text is None:
        return None
    try:
        bias_v = float(text)
    except ValueError:
        bias_v = 0.0
    if not MIN_BIAS_V <= abs(bias_v) <= MAX_BIAS_V:
        raise DetectorError(f"{path}: Settings/Bias: {text[:20]!r} is not a bias voltage of {MIN_BIAS_V:g} to {MAX_BIAS_V:g} V")
    return bias_v
