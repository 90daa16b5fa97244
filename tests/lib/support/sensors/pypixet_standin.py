"""A stand-in for the vendor's module ``pypixet`` with the calls that its manual documents, and a camera that a test commands.

The stand-in is as strict as the manual: wrong arguments raise, pixels that are not released are counted.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

Row = tuple[int, int, int, int, int]  # matrix index, ToA, overflow, FToA, ToT


class Pixels:
    """Return value of ``lastAcqPixelsRefInc``."""

    def __init__(self, rows: Sequence[Row], released: Callable[[], None]) -> None:
        self._rows = rows
        self.destroy = released

    def totalPixelCount(self) -> int:  # noqa: N802
        return len(self._rows)

    def rawPixels(self) -> list[list[int]]:  # noqa: N802
        return [[row[column] for row in self._rows] for column in range(5)]


class Device:
    """A MiniPIX TPX3: ``deliver`` and ``lose`` are the test's, the rest is the manual's. ``reserved``: registerEvent of old."""

    def __init__(self, pixet: Any, reserved: bool = False) -> None:
        self._pixet = pixet
        self._reserved = reserved
        self._handlers: dict[int, tuple[str, Callable[[object], None]]] = {}
        self._ending = threading.Event()
        self._code = 0
        self._pixels: Sequence[Row] = ()
        self.measuring = threading.Event()
        self.name = "MiniPIX H08-W0028"
        self.calls: list[tuple[Any, ...]] = []
        self.parameters_set: dict[str, int] = {}
        self.unreleased = 0
        self.refused: dict[str, int] = {}

    def deliver(self, rows: Sequence[Row]) -> None:
        """The camera has new pixels."""
        self._pixels = rows
        self._raise(self._pixet.PX_EVENT_ACQ_NEW_DATA)

    def lose(self) -> None:
        """Someone pulls the plug."""
        self._code = -5
        self._ending.set()

    @property
    def handlers(self) -> int:
        """How many are registered."""
        return len(self._handlers)

    def _raise(self, event: str) -> None:
        for registered, call in list(self._handlers.values()):
            if registered == event:
                call(SimpleNamespace(obj=self, data=0))

    def fullName(self) -> str:  # noqa: N802
        return self.name

    def lastError(self) -> str:  # noqa: N802
        return "Device disconnected"

    def setOperationMode(self, mode: int) -> int:  # noqa: N802
        self.calls.append(("setOperationMode", mode))
        return self.refused.get("setOperationMode", 0)

    def setBias(self, volts: float) -> int:  # noqa: N802
        self.calls.append(("setBias", volts))
        return 0

    def doSensorRefresh(self) -> int:  # noqa: N802
        self.calls.append(("doSensorRefresh",))
        return 0

    def parameters(self) -> Any:
        def get(name: str) -> Any:
            return SimpleNamespace(setU32=lambda value: self.parameters_set.update({name: value}) or 0)

        return SimpleNamespace(get=get)

    def registerEvent(self, event: str, *rest: Any) -> int:  # noqa: N802
        if len(rest) != (2 if self._reserved else 1):
            raise TypeError("registerEvent: wrong number of arguments")
        number = max(self._handlers, default=0) + 1
        self._handlers[number] = (event, rest[-1])
        return number

    def unregisterEvent(self, *which: Any) -> int:  # noqa: N802
        if len(which) != (3 if self._reserved else 1):
            raise TypeError("unregisterEvent: wrong number of arguments")
        if self._reserved:
            which = tuple(number for number, (event, call) in self._handlers.items() if (event, call) == (which[0], which[2]))
        for number in which:
            del self._handlers[number]
        return 0

    def doAdvancedAcquisition(  # noqa: N802
        self, count: int, seconds: float, kind: int, mode: int, file_type: int, flags: int, file_name: str
    ) -> int:
        assert (count, kind, mode, flags, file_name) == (
            1,
            self._pixet.PX_ACQTYPE_DATADRIVEN,
            self._pixet.PX_ACQMODE_NORMAL,
            0,
            "",
        )
        assert file_type == self._pixet.PX_FTYPE_AUTODETECT
        self._code = 0
        self._ending.clear()
        self._raise(self._pixet.PX_EVENT_ACQ_MEAS_STARTED)
        self.measuring.set()
        self._ending.wait(seconds)
        self.measuring.clear()
        return self._code

    def abortOperation(self) -> int:  # noqa: N802
        self._code = -7
        self._ending.set()
        return 0

    def lastAcqPixelsRefInc(self) -> Pixels:  # noqa: N802
        def released() -> None:
            self.unreleased -= 1

        self.unreleased += 1
        return Pixels(self._pixels, released)


class Pypixet:
    """The module. ``plugged``: the devices that are there."""

    def __init__(self, plugged: int = 1, reserved: bool = False) -> None:
        self.pixet = SimpleNamespace(
            PX_DEVTYPE_TPX3=4,
            PX_TPX3_OPM_TOATOT=0,
            PX_ACQTYPE_DATADRIVEN=2,
            PX_ACQMODE_NORMAL=0,
            PX_FTYPE_AUTODETECT=255,
            PX_EVENT_ACQ_MEAS_STARTED="AcqMeasStarted",
            PX_EVENT_ACQ_NEW_DATA="AcqNewData",
            refreshDevices=lambda: 0,
            devicesByType=self._devices,
        )
        self.plugged = [Device(self.pixet, reserved) for _ in range(plugged)]
        self.starts = self.exits = 0
        self.start_code = 0

    def _devices(self, kind: int) -> list[Device]:
        assert kind == self.pixet.PX_DEVTYPE_TPX3
        return list(self.plugged)

    def start(self) -> int:
        self.starts += 1
        return self.start_code

    def exit(self) -> int:
        self.exits += 1
        return 0
