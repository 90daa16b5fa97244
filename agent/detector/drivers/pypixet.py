"""The MiniPIX TPX3 through ``pypixet``, the Python module of the vendor's Pixet SDK.

Calls and constants are from Advacam's Python API manual and its examples: ``pypixet.start``, ``exit``,
``pixet.devicesByType(PX_DEVTYPE_TPX3)``, ``refreshDevices``; of a device ``setOperationMode(PX_TPX3_OPM_TOATOT)``, ``setBias``,
``parameters().get("DDBlockSize").setU32``, ``doSensorRefresh``, ``registerEvent``, ``doAdvancedAcquisition`` with
``PX_ACQTYPE_DATADRIVEN``, ``lastAcqPixelsRefInc().rawPixels()`` and ``abortOperation``. ``rawPixels`` gives five columns: matrix
index, ToA, overflow, FToA, ToT, with the same meaning as in a .t3pa file.

ToA counts from the start of an acquisition. Its time is taken when ``PX_EVENT_ACQ_MEAS_STARTED`` arrives, late by the transfer
from the camera to the host, some ms. Every minute the acquisition is ended and a new one begun, so that a camera clock with an
error of 50 ppm is off by at most 3 ms. The pause between two acquisitions is a gap between readouts.
"""

from __future__ import annotations

import asyncio
import importlib
import sys
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from radron.agent.detector.drivers.acquisition import Acquisition, AcquisitionReader, block_of
from radron.agent.detector.readout import Readout
from radron.agent.errors import DetectorError

ACQUISITION_S = 60.0
READOUT_SLICE_S = 0.2
CAMERA_RETRY_S = 2.0
ACQUISITION_END_S = 1.0  # time that the camera is given to end its acquisition
BLOCK_BYTES = 6000  # "DDBlockSize" of the vendor's data-driven example; the default of 66000 delays sparse hits
_NO_DEVICE = "FileDevice 0"  # listed by Pixet where no camera is connected


def load_pypixet(folder: Path | None) -> Any:
    """Import ``pypixet``, the vendor's module for the camera, from ``folder`` (None: from Python's search path).

    Raises:
        DetectorError: the folder or the module is missing, or made for another Python.
    """
    if folder is not None:
        if not folder.is_dir():
            raise DetectorError(f"detector.pixet_folder = {str(folder)!r}: no such folder; unpack the vendor's Pixet SDK there")
        if str(folder) not in sys.path:
            sys.path.append(str(folder))
    try:
        return importlib.import_module("pypixet")
    except ImportError as error:
        where = "on Python's path" if folder is None else f"in {folder}"
        raise DetectorError(
            f"detector.driver = 'pypixet': no usable module pypixet {where} ({error}); install Advacam's Pixet SDK for this "
            "Python and name its folder in detector.pixet_folder"
        ) from None


class PixetDetector:
    """Measures with the first connected Timepix3 camera; a missing or lost camera is reported in ``problems``, and searched for
    again.

    All calls into the vendor's module are made on a thread of their own.
    """

    def __init__(self, module: Any, bias_v: float | None = None, clock_ns: Callable[[], int] = time.time_ns) -> None:
        """Set up the driver; it searches for the camera when ``readouts`` is iterated.

        ``module``: the vendor's module pypixet. ``bias_v``: bias voltage (V) of the sensor; None keeps the value of the camera's
        own configuration. ``clock_ns``: own time.
        """
        self._module = module
        self._bias_v = bias_v
        self._clock_ns = clock_ns
        self._problem: str | None = "the camera is starting"
        self._acquisitions: deque[Acquisition] = deque()
        self._device: Any = None
        self._stop = threading.Event()
        self._closed = asyncio.Event()
        self._worker: threading.Thread | None = None
        self._reader = AcquisitionReader()

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems of the camera, one line each."""
        problem = self._problem
        return () if problem is None else (problem,)

    async def readouts(self) -> AsyncIterator[Readout]:
        """Yield the camera's pixel hits in readouts of about 0.2 s as they arrive, until ``close`` is called."""
        if self._worker is None:  # one camera, one worker, however often its readouts are iterated
            self._worker = threading.Thread(target=self._work, name="pypixet", daemon=True)
            self._worker.start()
        while not self._closed.is_set():
            for readout in self._reader.read(self._acquisitions, self._clock_ns()):
                yield readout
            try:
                async with asyncio.timeout(READOUT_SLICE_S):
                    await self._closed.wait()
            except TimeoutError:
                continue

    async def close(self) -> None:
        """End the measurement and release the camera, so that ``readouts`` ends."""
        self._closed.set()
        self._stop.set()
        if self._worker is not None:
            threading.Thread(target=self._abort, args=(self._worker,), name="pypixet-abort", daemon=True).start()
            await asyncio.to_thread(self._worker.join, ACQUISITION_END_S)

    def _abort(self, worker: threading.Thread) -> None:
        """Abort the camera's operation repeatedly: an acquisition may be just about to begin."""
        while worker.is_alive():
            device = self._device
            if device is not None:
                device.abortOperation()
            worker.join(0.1)

    def _work(self) -> None:
        """Measure until stopped, whatever errors the camera has."""
        running = False
        while not self._stop.is_set():
            try:
                if not running:
                    self._start()
                    running = True
                self._measure()
            except DetectorError as error:
                self._problem = str(error)
            except Exception as error:  # a vendor module may raise anything; the flight continues
                self._problem = f"pypixet: {type(error).__name__}: {error}"
            self._device = None
            self._stop.wait(CAMERA_RETRY_S)
        if running:
            self._module.exit()

    def _start(self) -> None:
        code = self._module.start()
        if code != 0:
            raise DetectorError(f"Pixet failed to start (code {code}); run the agent in the folder with the SDK's pixet.ini")

    def _measure(self) -> None:
        """Find the camera and measure until stopped. Raises DetectorError on failure."""
        device = self._found()
        self._configure(device)
        pixet = self._module.pixet
        endings = [_subscribe(device, pixet.PX_EVENT_ACQ_MEAS_STARTED, self._started)]
        endings.append(_subscribe(device, pixet.PX_EVENT_ACQ_NEW_DATA, self._arrived))
        self._device = device
        try:
            while not self._stop.is_set():
                self._acquire(device)
        finally:
            for unsubscribe in endings:
                unsubscribe()

    def _found(self) -> Any:
        pixet = self._module.pixet
        pixet.refreshDevices()
        devices = [device for device in pixet.devicesByType(pixet.PX_DEVTYPE_TPX3) if device.fullName() != _NO_DEVICE]
        if not devices:
            raise DetectorError("Pixet finds no Timepix3 camera; plug it in, and end other programs that use it")
        return devices[0]

    def _configure(self, device: Any) -> None:
        _done(device, "setOperationMode", device.setOperationMode(self._module.pixet.PX_TPX3_OPM_TOATOT))
        if self._bias_v is not None:
            _done(device, "setBias", device.setBias(self._bias_v))
        device.parameters().get("DDBlockSize").setU32(BLOCK_BYTES)
        _done(device, "doSensorRefresh", device.doSensorRefresh())

    def _acquire(self, device: Any) -> None:
        """One acquisition; blocks until it ends."""
        pixet = self._module.pixet
        acquisition = Acquisition(self._clock_ns(), round(ACQUISITION_S * 1e9))
        self._acquisitions.append(acquisition)
        try:
            code = device.doAdvancedAcquisition(
                1, ACQUISITION_S, pixet.PX_ACQTYPE_DATADRIVEN, pixet.PX_ACQMODE_NORMAL, pixet.PX_FTYPE_AUTODETECT, 0, ""
            )
        finally:
            acquisition.ended_ns = self._clock_ns()
        if not self._stop.is_set():
            _done(device, "doAdvancedAcquisition", code)

    def _started(self, _event: object) -> None:
        with suppress(IndexError):  # an event that arrives after the end of its acquisition; nothing may be raised here
            self._acquisitions[-1].started_ns = self._clock_ns()
            self._problem = None

    def _arrived(self, _event: object) -> None:
        """Fetch new pixels; called on one of the vendor's threads, where nothing may be raised."""
        try:
            pixels = self._device.lastAcqPixelsRefInc()
            try:
                columns = [np.array(column, np.int64) for column in pixels.rawPixels()]
            finally:
                pixels.destroy()
            acquisition = self._acquisitions[-1]
            if acquisition.started_ns is None:
                acquisition.started_ns = acquisition.called_ns
            acquisition.blocks.append(block_of(columns, acquisition.repair))
        except Exception as error:  # see above
            self._problem = f"the camera's data cannot be read: {type(error).__name__}: {error}"


def _subscribe(device: Any, event: Any, call: Callable[[object], None]) -> Callable[[], object]:
    """Subscribe ``call`` to an event; returns the function that unsubscribes. Older SDKs take a reserved 0 between the two."""
    try:
        number = device.registerEvent(event, call)
    except TypeError:
        device.registerEvent(event, 0, call)
        return lambda: device.unregisterEvent(event, 0, call)
    return lambda: device.unregisterEvent(number)


def _done(device: Any, call: str, code: int) -> None:
    """Raise DetectorError if the return code of a call reports a failure."""
    if code != 0:
        raise DetectorError(f"camera {device.fullName()}: {call} failed (code {code}): {device.lastError()}")
