"""Types of vectors and attitudes in the simulation, which shares no mathematics with the agents."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z
