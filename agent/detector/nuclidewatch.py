"""The nuclide in the spectrum of the own camera, in flight, against the mission's: one, or several candidates; and whether the
camera still reads its lines where they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agent.detector.recognition import Recogniser, Recognition, moved, prepare
from agent.detector.residuals import told
from agent.detector.windows import candidates_of
from agent.geometry import Array
from protocol.messages import Recognised

LOOK_NS = 10_000_000_000
_SAME_SCALE = 0.03  # relative: scales are told apart by steps of 2 %
# Between two looks at the energy scale: enough to tell it to 1 %, and mostly from before or after it has moved.
_SCALE_NS, _SCALE_EVENTS = 2_000_000_000, 400


class NuclideWatch:
    """Recognises the nuclide every LOOK_NS, and compares it with the mission's.

    Where there are several candidates, there may be several sources, whose spectrum is that of no one nuclide; so only lines are
    told that no mixture of candidates explains.

    Where there is one nuclide, its lines are also a reference for the camera's energy scale, as in spectrometers with gain
    stabilisation: a camera that has seen them where they are, and later finds them elsewhere, has a scale that has moved.
    ``scale``: by which the energies of the calibration are to be multiplied.
    """

    def __init__(self, expected: str | tuple[str, ...]) -> None:
        """``expected``: as in the mission."""
        self._expected = candidates_of(expected)
        self._recogniser = Recogniser()
        self._recent, self._since_ns = Recogniser(), 0  # since the last look at the scale: energies by the calibration
        self._is_seen = False  # the mission's nuclide, as it is
        self.scale = 1.0
        prepare(self._expected)
        self._looked_ns: int | None = None
        self.recognised: Recognition | None = None
        self._unknown_kev: tuple[int, ...] = ()

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events, by the present scale."""
        self._recogniser.add(energies_kev)
        if len(self._expected) == 1:
            self._recent.add(np.asarray(energies_kev, dtype=np.float64) / self.scale)

    def look(self, now_ns: int) -> None:
        """Evaluate again, if it is time."""
        if now_ns - self._since_ns >= _SCALE_NS and self._recent.events >= _SCALE_EVENTS:
            self._since_ns = now_ns
            self._look_at_scale()
        if self._looked_ns is None:
            self._looked_ns = now_ns
        elif now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            found = self._recogniser.look()
            self.recognised = found if found is not None and found.certain else None
            if len(self._expected) == 1:
                self._unknown_kev = self._recogniser.unknown_lines_kev(found)
            else:
                self._unknown_kev = self._recogniser.foreign_lines_kev(self._expected)

    def _look_at_scale(self) -> None:
        """Correct the scale where it has moved since the look before. What was read in between is forgotten."""
        recent, self._recent = self._recent, Recogniser()
        gain = moved(recent.counts, self._expected[0])
        self._is_seen = self._is_seen or gain == 1.0
        if gain is not None and self._is_seen and abs(gain * self.scale - 1.0) > _SAME_SCALE:
            self.scale = 1.0 / gain
            self._recogniser = Recogniser()

    @property
    def message(self) -> Recognised | None:
        """The result for the status message."""
        found = self.recognised
        return None if found is None else Recognised(found.nuclide, found.evidence)

    @property
    def problems(self) -> tuple[str, ...]:
        """Lines where the spectrum contradicts the mission's nuclide, or its lines have moved."""
        if self.scale != 1.0:
            corrected = f"camera: it reads {1.0 / self.scale:.2f} of all energies, by the lines of its nuclide; corrected"
            return (corrected, *self._strange)
        return self._strange

    @property
    def _strange(self) -> tuple[str, ...]:
        found, expected = self.recognised, ", ".join(self._expected)
        if found is not None and found.nuclide not in self._expected:
            return (
                f"the camera's spectrum is that of {found.nuclide} (evidence {found.evidence:.0f}), the mission is after "
                f"{expected}; set its nuclide",
            )
        if self._unknown_kev and len(self._expected) == 1:
            lines = told(self._unknown_kev)
            return (f"the camera's spectrum has lines at {lines}, of no one known nuclide; the mission is after {expected}",)
        if self._unknown_kev:
            return (f"unknown nuclide: the camera's spectrum has lines at {told(self._unknown_kev)}, of none of {expected}",)
        return ()
