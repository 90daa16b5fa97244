"""Random strength of each kind of fault, from hardly felt to the end of a drone's flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

Numbers = dict[str, Any]  # the kind's own keys
V = TypeVar("V")


class Strike(NamedTuple):
    """The data from which the numbers of a fault are drawn: random numbers, drones of the mission, and affected drones."""

    rng: np.random.Generator
    drones: Sequence[str]
    target: Sequence[str]

    def uniform(self, low: float, high: float) -> float:
        """Draw a uniform random number, rounded for a file."""
        return round(float(self.rng.uniform(low, high)), 3)

    def scale(self, low: float, high: float) -> float:
        """Draw a random number with a uniform logarithm, to three digits."""
        return float(f"{np.exp(self.rng.uniform(np.log(low), np.log(high))):.3g}")

    def one(self, *values: V) -> V:
        """Choose one of the values at random."""
        return values[int(self.rng.integers(len(values)))]


def _none(_: Strike) -> Numbers:
    return {}


def _partition(strike: Strike) -> Numbers:
    """Draw a split into two or three groups, each drone in one group."""
    count = 2 if len(strike.drones) < 4 or strike.rng.random() < 0.7 else 3
    while True:
        places = strike.rng.integers(count, size=len(strike.drones))
        groups = [[name for name, place in zip(strike.drones, places, strict=True) if place == k] for k in range(count)]
        if all(groups):
            return {"groups": groups}


def _cut(strike: Strike) -> Numbers:
    """Cut the links with all others, or with one of them, so that a third drone hears both."""
    direction, others = strike.one("both", "send", "receive"), [name for name in strike.drones if name not in strike.target]
    if not others or strike.rng.random() < 0.5:
        return {"direction": direction}
    return {"direction": direction, "peers": strike.one(*others)}


def _delay(strike: Strike) -> Numbers:
    return {"delay_s": strike.scale(0.02, 1.5), "jitter_s": strike.uniform(0.0, 0.5)}


def _flood(strike: Strike) -> Numbers:
    return {"rate_mbps": strike.scale(0.05, 1.0), "message_bytes": int(strike.scale(200, 60_000))}


def _lie(strike: Strike) -> Numbers:
    return {
        "what": strike.one("pose", "plan", "cone", "counts", "sighting"),
        "how": strike.one("false", "replayed", "mistimed"),
        "shift_m": strike.scale(2.0, 40.0),
        "factor": strike.scale(0.1, 20.0),
        "ago_s": strike.scale(0.5, 30.0),
    }


def _poisoned(strike: Strike) -> Numbers:
    return {
        "counts": strike.one("none", "many"),
        "place": strike.one("estimate", "elsewhere"),
        "beside": bool(strike.rng.random() < 0.5),
        "lasts_s": strike.scale(0.1, 60.0),
        "burst": int(strike.scale(1.0, 26.0)),
    }


def _noisy(strike: Strike) -> Numbers:
    column = bool(strike.rng.random() < 0.4)
    pixels = 128 if column else int(strike.scale(1, 100))
    return {"pixels": pixels, "rate_hz": strike.scale(5.0, 300.0), "energy_kev": strike.uniform(10.0, 200.0), "column": column}


def _gain(strike: Strike) -> Numbers:
    return {"factor": strike.scale(0.7, 1.4)}


def _clock(strike: Strike) -> Numbers:
    jump_s = strike.scale(0.02, 30.0) * (1.0 if strike.rng.random() < 0.5 else -1.0)
    if strike.rng.random() < 0.3:
        return {"drift_ppm": strike.scale(50.0, 20_000.0)}
    return {"jump_s": jump_s}


def _jump(strike: Strike) -> Numbers:
    turn_deg = strike.uniform(0.0, 60.0) if strike.rng.random() < 0.3 else 0.0
    return {"jump_m": strike.scale(1.0, 30.0), "turn_deg": turn_deg, "announced": bool(strike.rng.random() < 0.5)}


def _battery(strike: Strike) -> Numbers:
    return {
        "level": strike.uniform(0.1, 0.5),
        "drain_ps": strike.scale(0.0003, 0.003),
        "lies": bool(strike.rng.random() < 0.3),
    }


STRENGTHS: dict[str, Callable[[Strike], Numbers]] = {
    "kill": _none,
    "freeze": _none,
    "late": _none,
    "slow-cpu": lambda strike: {"late_s": strike.scale(0.03, 0.8)},
    "disk": lambda strike: {"how": strike.one("full", "slow", "state-torn", "state-flipped")},
    "partition": _partition,
    "cut": _cut,
    "loss": lambda strike: {"probability": strike.scale(0.05, 0.7)},
    "delay": _delay,
    "reorder": lambda strike: {"probability": strike.uniform(0.05, 0.7), "held_s": strike.scale(0.1, 2.0)},
    "duplicate": lambda strike: {"probability": strike.uniform(0.05, 1.0), "within_s": strike.scale(0.1, 5.0)},
    "corrupt": lambda strike: {"probability": strike.scale(0.01, 0.5)},
    "range": lambda strike: {"range_m": strike.uniform(10.0, 40.0)},
    "flood": _flood,
    "lie": _lie,
    "equivocating": _none,
    "revoked": _none,
    "camera-dead": _none,
    "camera-noisy": _noisy,
    "camera-stuck": _none,
    "camera-gain": _gain,
    "clock": _clock,
    "satellites-lost": lambda strike: {"drift_mps2": strike.scale(0.01, 0.3)},
    "position-jump": _jump,
    "spoofed": lambda strike: {"speed_mps": strike.scale(0.1, 3.0), "most_m": strike.scale(3.0, 60.0)},
    "gust": lambda strike: {"acceleration_mps2": strike.scale(0.5, 6.0)},
    "motor": lambda strike: {"descent_mps": strike.uniform(1.0, 5.0)},
    "battery": _battery,
    "mavlink-loss": lambda strike: {"probability": strike.scale(0.05, 1.0)},
    "takeover": lambda strike: {"mode": strike.one("manual", "hold", "return", "land")},
    "refusal": _none,
    "stream-lost": lambda strike: {
        "message": strike.one("ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GPS_RAW_INT", "HEARTBEAT")
    },
    "mavlink-impaired": lambda strike: {
        "delay_s": strike.uniform(0.0, 0.1),
        "jitter_s": strike.uniform(0.0, 0.1),
        "reorder": strike.uniform(0.0, 0.3),
        "duplicate": strike.uniform(0.0, 0.5),
        "corrupt": strike.uniform(0.0, 0.2),
    },
    "stall": lambda strike: {"direction": strike.one("both", "send", "receive")},
    "throttle": lambda strike: {"rate_kilobytes_ps": strike.scale(1.0, 50.0)},
    "disarm": _none,
    "forged": lambda strike: {"what": strike.one("impossible", "impersonated", "other-mission", "two-versions")},
    "copied-key": lambda strike: {
        "beside_m": strike.one(0.0, strike.scale(0.3, 50.0)),
        "place": strike.one("beside", "frozen", "ground"),
        "epochs": strike.one(0, 1),
        "boot": strike.one("same", "other"),
        "stage": strike.one("landed", "preflight", "return", "hold", None),
        "lead_s": strike.uniform(-0.1, 0.099),
        "period_s": strike.one(0.05, 0.1, 0.2),
    },
    "old-entries": lambda strike: {"per_s": strike.scale(1.0, 10.0), "ago_s": strike.scale(10.0, 100.0)},
    "dense-entries": lambda strike: {"what": strike.one("exposure", "cone", "coverage"), "per_s": strike.scale(200.0, 1000.0)},
    "old-command": _none,
    "heading-reset": lambda strike: {"turn_deg": strike.scale(1.0, 12.0)},  # the largest of 15 recorded ones: 9.3
    "poisoned": _poisoned,
}
