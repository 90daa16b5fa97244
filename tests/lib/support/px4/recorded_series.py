"""How a real PX4 followed setpoints (``tests/contract/recordings/series.npz.xz``), and the same setpoints flown in simulation."""

import functools
import io
import lzma
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth, Setpoints

RECORDINGS = Path(__file__).parents[3] / "contract" / "recordings"
UNITS = {
    "setpoint": [1e-4, 1.0] + [1e-3] * 11,
    "estimate": [1e-4] + [1e-3] * 7,
    "truth": [1e-4] + [1e-3] * 3 + [1e-2] * 3 + [1e-3] * 3,
}
TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# Parameters that were not PX4's own, as the vehicle's. MC_ROLL_P is not exactly its rate.
CHANGED = {
    "XYP1.4": {"position_gain_ps": 1.4},
    "VELP3": {"velocity_gain_ps": 3.0},
    "KDV0.3": {"drag_ps": 0.3},
    "ROLLP6.5": {"attitude_rate_ps": 6.5},
}
NOT_FITTED = ("ACCHOR", "KDV", "ROLLP", "VELP", "XYP", "hex", "yaw", "hover", "climb")


def is_for_fitting(name: str) -> bool:
    """Whether parameters may be fitted to a recording; the others are for checking. (``recordings/README.md`` has them.)"""
    return not any(part in name for part in NOT_FITTED)


@dataclass(frozen=True)
class Recording:
    """A recording, ENU. Times in seconds since its first packet, of sending or reception.

    setpoints: (M, 11) position, velocity, acceleration, yaw and its rate; NaN where PX4 was told to ignore them.
    estimates: (K, 7) position, velocity, yaw. truths: (L, 9) position, velocity, roll, pitch (FRD) and yaw.
    """

    name: str
    sent_s: np.ndarray
    setpoints: np.ndarray
    estimated_s: np.ndarray
    estimates: np.ndarray
    true_s: np.ndarray
    truths: np.ndarray

    @property
    def vehicle(self) -> MultirotorTruth:
        """The vehicle that flew."""
        changed = next((values for part, values in CHANGED.items() if part in self.name), {})
        return MultirotorTruth(gust_mps2=0.0, **changed)

    @property
    def begin_s(self) -> float:
        """The first setpoint with a known outcome."""
        return float(max(self.sent_s[0], self.true_s[0], self.estimated_s[0]))

    @property
    def end_s(self) -> float:
        """The last one."""
        return float(min(self.sent_s[-1], self.true_s[-1], self.estimated_s[-1]))

    def setpoint(self, time_s) -> np.ndarray:
        """Setpoints in force at these times."""
        return self.setpoints[np.maximum(np.searchsorted(self.sent_s, time_s, side="right") - 1, 0)]

    def truth(self, time_s) -> np.ndarray:
        """(T, 9), between its samples."""
        return _between(time_s, self.true_s, self.truths, 8)

    def estimate(self, time_s) -> np.ndarray:
        """(T, 7), between its samples."""
        return _between(time_s, self.estimated_s, self.estimates, 6)

    def error(self, time_s) -> np.ndarray:
        """(T, 6) of position and velocity, estimate minus truth."""
        return self.estimate(time_s)[:, :6] - self.truth(time_s)[:, :6]


@functools.cache
def recordings() -> dict[str, Recording]:
    """All by their names."""
    with np.load(io.BytesIO(lzma.decompress((RECORDINGS / "series.npz.xz").read_bytes()))) as file:
        arrays = {name: np.cumsum(file[name], axis=0) * UNITS[name.split("/")[1]] for name in file.files}
    return {name: _recording(name, arrays) for name in sorted({key.split("/")[0] for key in arrays})}


def _recording(name, arrays) -> Recording:
    setpoint, estimate, truth = (arrays[f"{name}/{series}"] for series in UNITS)
    mask = setpoint[:, 1].astype(int)
    wanted = np.hstack([setpoint[:, k : k + 3] @ TO_ENU for k in (2, 5, 8)] + [np.pi / 2 - setpoint[:, 11:12], -setpoint[:, 12:]])
    bits = np.array([2, 1, 4, 16, 8, 32, 128, 64, 256, 1024, 2048])
    wanted[(mask[:, None] & bits) != 0] = np.nan
    estimates = np.hstack((estimate[:, 1:4] @ TO_ENU, estimate[:, 4:7] @ TO_ENU, np.pi / 2 - estimate[:, 7:]))
    truths = np.hstack((truth[:, 1:4] @ TO_ENU, truth[:, 4:7] @ TO_ENU, truth[:, 7:9], np.pi / 2 - truth[:, 9:]))
    return Recording(name, setpoint[:, 0], wanted, estimate[:, 0], estimates, truth[:, 0], truths)


def _between(time_s, sampled_s, samples, angle) -> np.ndarray:
    unwrapped = samples.copy()
    unwrapped[:, angle] = np.unwrap(samples[:, angle])
    return np.column_stack([np.interp(time_s, sampled_s, column) for column in unwrapped.T])


def fly(flown, step_s, errors=None, vehicles=None):
    """Fly the setpoints of some recordings, all at once, from where their vehicles were.

    errors: (N, T, 6), of position and velocity; none: the recorded ones. Returns the times (N, T) of the recordings, and
    positions
    and velocities (N, T, 6) then and headings (N, T); samples after a recording's end count for nothing.
    """
    count = len(flown)
    begin = np.array([recording.begin_s for recording in flown])
    steps = int(max(recording.end_s - recording.begin_s for recording in flown) / step_s)
    times = begin[:, None] + step_s * np.arange(steps + 1)
    # Setpoints that come about once a step come just before it.
    sent = np.array(
        [
            recording.setpoint(time_s + (0.5 * step_s if step_s > 0.02 else 0.0))
            for recording, time_s in zip(flown, times, strict=True)
        ]
    )
    steered = ~np.isnan(sent[:, :, :3])
    sent[:, :, 9] = _held(sent[:, :, 9])
    sent = np.nan_to_num(sent)
    if errors is None:
        errors = np.array([recording.error(time_s) for recording, time_s in zip(flown, times, strict=True)])
    start = np.array([recording.truth(time_s[:1])[0] for recording, time_s in zip(flown, times, strict=True)])
    vehicles = [recording.vehicle for recording in flown] if vehicles is None else vehicles
    motion = Multirotors(vehicles, start[:, :3], start[:, 8], step_s, np.random.default_rng(1))
    motion.velocity_mps[:] = start[:, 3:6]
    course, heading = np.empty((count, steps + 1, 6)), np.empty((count, steps + 1))
    grounded = np.zeros(count, dtype=bool)
    for k in range(steps + 1):
        course[:, k, :3], course[:, k, 3:], heading[:, k] = motion.position_m, motion.velocity_mps, motion.yaw_rad
        now = sent[:, k]
        setpoints = Setpoints(now[:, :3], now[:, 3:6], now[:, 6:9], now[:, 9], now[:, 10])
        motion.step(setpoints, grounded, errors[:, k, :3], errors[:, k, 3:], ~steered[:, k])
    return times, course, heading


def _held(yaw):
    """(N, T): where no heading is asked for, the last one counts."""
    held = yaw.copy()
    held[np.isnan(held[:, 0]), 0] = 0.0
    for k in range(1, held.shape[1]):
        held[:, k] = np.where(np.isnan(held[:, k]), held[:, k - 1], held[:, k])
    return held
