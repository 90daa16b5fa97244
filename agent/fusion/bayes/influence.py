"""What one vehicle's measurements do to a search, bounded where others measure, too.

A camera may count wrongly, and a member may publish what is not so. Given the source, the measurements of the vehicles are
independent. With a small probability those of a vehicle v say nothing of the source, so

    P(z_v | hypothesis) is replaced by P(z_v | hypothesis) + eps max P(z_v | ..),    ln eps = -``limit``:

a vehicle changes the odds of two hypotheses by a factor of 1 / eps at most, however much it publishes; and what two others
measure outweighs it. In the logarithm, with t_v the sum of what it has said, and its greatest value 0,

    t_v <- max(t_v exp(-dt / ``_FADE_S``) + ln l, -limit),

scaled again to a greatest value of 0 before the limit is applied. What a source does meanwhile is why it fades.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Weights = NDArray[np.float32]

_FADE_S = 10.0
_MAX_APPLIED = 40.0  # that can be taken back: beyond, rounding would count
_TINY = 1e-30


class Influence(Struct, frozen=True, eq=False):
    """Of one vehicle, at a time. source: (A, Y, X) t_v of the hypotheses of a source, none: that of no source; the same of all
    that has been applied so far, without fading: applied_source, applied_none.
    """

    time_s: float
    source: Weights | float = 0.0
    none: float = 0.0
    applied_source: Weights | float = 0.0
    applied_none: float = 0.0

    def after(self, time_s: float, source: Weights, none: float, limit: float) -> tuple[Influence, Weights, float]:
        """The influence after a measurement with the likelihoods ``source`` (A, Y, X) and ``none``, up to a common factor, and
        the likelihoods that are left of them.
        """
        faded = math.exp(-max(time_s - self.time_s, 0.0) / _FADE_S)
        before, before_none = self.source * np.float32(faded), self.none * faded
        said = np.log(source)
        said += before
        said_none = before_none + math.log(max(none, _TINY))
        most = max(float(said.max()), said_none)
        said -= np.float32(most)
        np.maximum(said, np.float32(-limit), out=said)
        said_none = max(said_none - most, -limit)
        left, left_none = said - before, said_none - before_none
        applied = np.maximum(self.applied_source + left, np.float32(-_MAX_APPLIED))
        after = Influence(time_s, said, said_none, applied, max(self.applied_none + left_none, -_MAX_APPLIED))
        return after, np.exp(left), math.exp(left_none)
