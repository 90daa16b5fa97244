"""The nuclide in the spectrum of the own camera, in flight, against the mission's: one, or several candidates."""

from __future__ import annotations

from collections.abc import Sequence

from radron.agent.detector.spectroscopy.energyscale import EnergyScale
from radron.agent.detector.spectroscopy.recognition import Recogniser, Recognition, prepare
from radron.agent.detector.spectroscopy.residuals import told
from radron.agent.detector.windows import candidates_of
from radron.agent.geometry import Array
from radron.protocol.codes import Code
from radron.protocol.messages import Recognised
from radron.protocol.texts import CodedText

RECOGNITION_PERIOD_NS = 10_000_000_000


class NuclideWatch:
    """Recognises the nuclide in the spectrum of this drone's camera during the flight, and compares it with the mission's.

    It evaluates the spectrum every RECOGNITION_PERIOD_NS. With several candidates there may be several sources, whose spectrum is
    that of no single nuclide. So only lines are reported that no mixture of candidates explains.

    The nuclides in view are the reference for the camera's energy scale: the mission's nuclide, until another is recognised; of
    several candidates the ones present. Energies from before a jump of that scale are forgotten.
    """

    def __init__(self, expected: str | tuple[str, ...]) -> None:
        """Start with an empty spectrum. ``expected``: nuclide or candidates, as in the mission."""
        self._expected = candidates_of(expected)
        self._recogniser = Recogniser()
        self._scale = EnergyScale(self._expected[0] if len(self._expected) == 1 else None)
        prepare(self._expected)
        self._looked_ns: int | None = None
        self.recognised: Recognition | None = None
        self._unknown_kev: tuple[int, ...] = ()

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events, corrected by the present energy scale, to the camera's spectrum."""
        self._recogniser.add(energies_kev)
        self._scale.add(energies_kev)

    @property
    def scale(self) -> float:
        """Factor by which the energies of the calibration must be multiplied, since the camera's gain has drifted."""
        return self._scale.factor

    def look(self, now_ns: int) -> None:
        """Evaluate the camera's spectrum if RECOGNITION_PERIOD_NS have passed since the last evaluation."""
        if self._scale.look(now_ns):
            self._recogniser = Recogniser()
        if self._looked_ns is None:
            self._looked_ns = now_ns
        elif now_ns - self._looked_ns >= RECOGNITION_PERIOD_NS:
            self._looked_ns = now_ns
            found = self._recogniser.look()
            self.recognised = found if found is not None and found.certain else None
            if len(self._expected) == 1:
                self._unknown_kev = self._recogniser.unknown_lines_kev(found)
                if self.recognised is not None:
                    self._scale.follow((self.recognised.nuclide,))
            else:
                self._unknown_kev = self._recogniser.foreign_lines_kev(self._expected)
                self._scale.follow(self._recogniser.present(self._expected))

    @property
    def message(self) -> Recognised | None:
        """The recognised nuclide for the drone's status message; None without one."""
        found = self.recognised
        return None if found is None else Recognised(found.nuclide, found.evidence)

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Lines for the operator: the spectrum contradicts the mission's nuclide, or its lines have moved."""
        return (*self._scale.problems, *self._strange)

    @property
    def _strange(self) -> tuple[CodedText, ...]:
        found, expected = self.recognised, ", ".join(self._expected)
        if found is not None and found.nuclide not in self._expected:
            text = f"the camera's spectrum is that of {found.nuclide} (evidence {found.evidence:.0f}), the mission is after "
            return (CodedText(Code.NUCLIDE_OTHER, f"{text}{expected}; set its nuclide"),)
        if not self._unknown_kev:
            return ()
        lines = told(self._unknown_kev)
        if len(self._expected) == 1:
            text = f"the camera's spectrum has lines at {lines}, of no one known nuclide; the mission is after {expected}"
        else:
            text = f"unknown nuclide: the camera's spectrum has lines at {lines}, of none of {expected}"
        return (CodedText(Code.LINES_UNKNOWN, text),)
