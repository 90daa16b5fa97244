"""``radron-agent calibrate``: measures, evaluates, and writes the calibration."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec import Struct
from rich.console import Console

from radron.agent.calibration.collection import Collection
from radron.agent.calibration.facing import Facing, check_facings, parse_facing
from radron.agent.calibration.folder import check_folder, save
from radron.agent.calibration.measuring import BACKGROUND_S, BackgroundCount, file_readouts, measure_background, measure_facing
from radron.agent.calibration.page import table, verdict
from radron.agent.calibration.plan import Source, plan
from radron.agent.calibration.result import Result, evaluate
from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.drivers import open_detector
from radron.agent.detector.files.calibration import Calibration, load_flight_calibration
from radron.agent.detector.readout import Detector
from radron.agent.detector.spectroscopy.shapes import strongest_line_kev
from radron.agent.errors import ConfigError, DetectorError


class Order(Struct, frozen=True):
    """The request for a calibration: drone, source, its directions (with a file each, or measured live), background, and output
    folder.
    """

    drone: DroneConfig
    source: Source
    facings: tuple[tuple[Facing, Path | None], ...]
    background: Path | None
    folder: Path
    stamp: str


def parse_facings(texts: Sequence[str]) -> tuple[tuple[Facing, Path | None], ...]:
    """Parse directions of the source from ``BEARING[,ELEVATION][=FILE]``.

    Raises ConfigError if a text is not of this form, if there are too few, or if some have files and some have none.
    """
    found = []
    for text in texts:
        facing, equals, file = text.partition("=")
        found.append((parse_facing(facing), Path(file) if equals else None))
    check_facings([facing for facing, _ in found])
    if len({file is None for _, file in found}) > 1:
        raise ConfigError("--facing: give a file with each facing, or with none, to measure with the camera")
    return tuple(found)


def run_calibrate(order: Order, ask: Callable[[str], None]) -> bool:
    """Calibrate a camera with a known source, and write the result; return whether it is usable.

    ``ask``: shows a request to the operator, such as to turn the drone, and waits until it is done.

    Raises:
        RadronError: a file, the camera, or the folder cannot be used.
    """
    terminal = Console()
    check_folder(order.folder)
    path = order.drone.calibration
    calibration = load_flight_calibration(Path(path)) if path else Calibration.nominal()
    needed = plan(order.source)
    terminal.print(
        f"{order.source.activity_bq:g} Bq of {order.source.nuclide} at {order.source.distance_m:g} m: about "
        f"{needed.total_s / 60.0:.0f} minutes in all (pixels {needed.pixels_s / 60.0:.0f}, gain {needed.gain_s / 60.0:.0f}, "
        f"drift time {needed.drift_s / 60.0:.0f}, orientation {needed.orientation_s / 60.0:.0f})",
        highlight=False,
    )
    config = DetectionConfig()
    line_kev = strongest_line_kev(order.source.nuclide)
    collection = Collection(calibration, order.source.nuclide, line_kev, config)
    count = BackgroundCount(calibration, config)
    if order.background is not None:
        for readout in file_readouts(order.background):
            count.add(readout)
    if order.facings[0][1] is not None:
        _read(order, collection)
    else:
        asyncio.run(_measure(order, collection, count, needed.total_s, ask))
    facings = [facing for facing, _ in order.facings]
    result = evaluate(collection, order.source, facings, order.drone.camera_rpy_deg, count.result, order.stamp)
    own, is_drawn = save(order.folder, result, collection, calibration)
    terminal.print(table(result))
    terminal.print(closing(result, own), highlight=False, soft_wrap=True, markup=False)
    if not is_drawn:
        terminal.print("no picture: matplotlib is not installed", highlight=False)
    return verdict(result) == "usable"


def closing(result: Result, own: Path) -> str:
    """Return the operator's next step after a calibration, such as the lines for the drone file. own: folder of the
    calibration.
    """
    if verdict(result) != "usable" or result.orientation is None:
        return f"{own}: kept for the record; {verdict(result)}"
    rpy = ", ".join(f"{angle:.1f}" for angle in result.orientation.camera_rpy_deg)
    per_s = result.background_per_s
    mission = (
        "" if per_s is None else f"\nin the mission file, where it is flown here:\n[fusion.bayes]\nbackground_per_s = {per_s:.2f}"
    )
    return f'in the drone file:\ncamera_rpy_deg = [{rpy}]\ncalibration = "{own}"{mission}'


def _read(order: Order, collection: Collection) -> None:
    for _, file in order.facings:
        assert file is not None
        collection.begin_facing()
        for readout in file_readouts(file):
            collection.add(readout)
    collection.end_facing()


async def _measure(
    order: Order, collection: Collection, count: BackgroundCount, total_s: float, ask: Callable[[str], None]
) -> None:
    def opened() -> Detector:
        detector = open_detector(order.drone.detector)
        if detector is None:
            raise DetectorError("the drone file names no camera (detector.driver); give each --facing a file instead")
        return detector

    if order.background is None:
        ask(f"Take the source at least 20 m away: the background is counted for {BACKGROUND_S / 60.0:.0f} minutes.")
        await measure_background(opened, count)
    number = len(order.facings)
    for place, (facing, _) in enumerate(order.facings, start=1):
        ask(f"{place} of {number}: place the source at {order.source.distance_m:g} m from the camera, at {facing}.")
        await measure_facing(opened, collection, facing, (place, number), total_s / number, print)
