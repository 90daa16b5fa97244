"""The nuclide in the spectrum of the own camera, in flight, against that of the mission."""

from __future__ import annotations

from collections.abc import Sequence

from agent.detector.recognition import Recogniser, Recognition, prepare
from agent.detector.residuals import told
from agent.geometry import Array
from protocol.messages import Recognised

LOOK_NS = 10_000_000_000


class NuclideWatch:
    """Recognises the nuclide every LOOK_NS, and compares it with the mission's."""

    def __init__(self, expected: str) -> None:
        self._expected = expected
        self._recogniser = Recogniser()
        prepare()
        self._looked_ns: int | None = None
        self.recognised: Recognition | None = None
        self._unknown_kev: tuple[int, ...] = ()

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events."""
        self._recogniser.add(energies_kev)

    def look(self, now_ns: int) -> None:
        """Evaluate again, if it is time."""
        if self._looked_ns is None:
            self._looked_ns = now_ns
        elif now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            found = self._recogniser.look()
            self.recognised = found if found is not None and found.certain else None
            self._unknown_kev = self._recogniser.unknown_lines_kev(found)

    @property
    def message(self) -> Recognised | None:
        """The result for the status message."""
        found = self.recognised
        return None if found is None else Recognised(found.nuclide, found.evidence)

    @property
    def problems(self) -> tuple[str, ...]:
        """A line where the spectrum contradicts the mission's nuclide, or none."""
        found = self.recognised
        if found is not None and found.nuclide != self._expected:
            return (
                f"the camera's spectrum is that of {found.nuclide} (evidence {found.evidence:.0f}), the mission is after "
                f"{self._expected}; set its nuclide",
            )
        if self._unknown_kev:
            lines = told(self._unknown_kev)
            return (
                f"the camera's spectrum has lines at {lines}, of no one known nuclide; the mission is after {self._expected}",
            )
        return ()
