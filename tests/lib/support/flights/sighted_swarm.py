"""A swarm that flies, localises itself badly and sees itself: log entries for the estimate of the frames, and the truth of them.

Independent of the code under test but for the messages: true paths, local frames that drift or jump, sightings with false ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pymap3d

from radron.agent.config.frames import FramesConfig
from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.frames.swarm import SwarmFrames
from radron.protocol.codec import encode
from radron.protocol.entries import Counts, Entry, Exposure, Fix, PoseSample, Sighting

SECOND = 1_000_000_000
START_NS = 1_800_000_000 * SECOND
DATUM = DatumConfig(latitude_deg=49.2, longitude_deg=16.6, altitude_m=250.0)
GNSS_CORRELATION_S = 60.0
_FITTING = FramesConfig(gnss_sigma_m=1.0, gnss_correlation_s=GNSS_CORRELATION_S)  # a mission that knows its receivers
_BOOT = "0" * 16
_STEP_S = 0.1


@dataclass
class Drone:
    """How one drone localises itself, and what of it the mission file says. Drifts: 1 sigma, as the root
    of metres or seconds; upwards 0.3 of it."""

    id: str
    kind: str = "slam"
    told_origin_m: tuple[float, float, float] | None = None  # none: the truth
    origin_sigma_m: float = 1.0
    yaw_deg: float = 0.0  # true heading of its local frame at the start
    reported_yaw_deg: float | None = None
    yaw_sigma_deg: float = 5.0
    drift_m: float = 0.0
    yaw_drift_deg: float = 0.0
    wander_m: float = 0.0  # Gauss-Markov, 60 s, of the position
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # by which its positions and fixes lie, from shift_s on
    shift_s: float = -1.0
    shift_lasts_s: float = 0.0  # for so long it grows
    shift_back_s: float = math.inf  # from then on it goes back alike
    shift_lag_s: float = 0.0  # time constant with which its positions follow its fixes there
    shift_announced: bool = False  # the epoch grows with it
    shift_yaw_deg: float = 0.0  # and its frame's heading turns by
    fixes: bool = False
    false: float = 0.1  # share of its sightings


@dataclass
class Sensor:
    """Mutual sightings of the drones."""

    rate_hz: float = 2.0
    direction_deg: float | None = 2.0
    range_m: float | None = 0.3
    least_m: float = 0.0


@dataclass
class Flown:
    """Entries in the order of their stamps; truth by drone: (K, 3) places, (K,) headings, (K, 3) local positions, epochs."""

    mission: MissionConfig
    entries: list[Entry]
    place: dict[str, np.ndarray]
    yaw: dict[str, np.ndarray]
    local: dict[str, np.ndarray]
    epoch: dict[str, np.ndarray]
    stamps_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def at(self, seconds: float) -> int:
        return round(seconds / _STEP_S)

    def error(self, frames, drone: str, seconds: float, now: bool = False):
        """(4,) error of the drone's place and heading by the estimated frame then, and its covariance; None if unknown."""
        k = self.at(seconds)
        stamp_ns = None if now else int(self.stamps_ns[k])
        transform = frames.graph.mission_from_local(drone, int(self.epoch[drone][k]), stamp_ns)
        if transform is None:
            return None
        local = self.local[drone][k]
        off = np.append(
            transform.apply(local) - self.place[drone][k], math.remainder(transform.yaw_rad - self.yaw[drone][k], math.tau)
        )
        jacobian = np.eye(4)
        x, y, _ = transform.rotate(local)
        jacobian[:3, 3] = -y, x, 0.0
        return off, jacobian @ transform.covariance @ jacobian.T


def paths(count: int, seconds: float, rng: np.random.Generator, speed_mps: float = 3.0) -> np.ndarray:
    """(count, K, 3): orbits about wandering centres, all within some 40 m of each other."""
    t = np.arange(0.0, seconds + _STEP_S / 2, _STEP_S)
    result = []
    for number in range(count):
        radius = rng.uniform(8.0, 14.0)
        angle = 2.0 * np.pi * number / count + rng.uniform(-0.3, 0.3) + speed_mps / radius * t
        centre = rng.uniform(-3.0, 3.0, 2)
        height = 4.0 + number + 0.5 * np.sin(0.2 * t + number)
        result.append(np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), height], axis=1))
    return np.array(result)


def fly(
    drones: list[Drone],
    seconds: float,
    seed: int,
    sensor: Sensor | None = None,
    place: np.ndarray | None = None,
    frames: FramesConfig | None = None,
    datum: bool = False,
) -> Flown:
    """Fly; ``place``: (N, K, 3) true paths (none: ``paths``). Local frames begin with their origin at the drone's true place less
    what its track says there."""
    rng = np.random.default_rng(seed)
    sensor = sensor or Sensor()
    place = paths(len(drones), seconds, rng) if place is None else place
    count = place.shape[1]
    stamps = START_NS + (np.arange(count) * round(_STEP_S * 1e9)).astype(np.int64)
    members, entries = [], []
    locals_, yaws, epochs = [], [], []
    for drone, path in zip(drones, place, strict=True):
        local, yaw, epoch = _localised(drone, path, rng)
        locals_.append(local)
        yaws.append(yaw)
        epochs.append(epoch)
        members.append(
            DroneInMission(
                id=drone.id,
                origin_m=tuple(float(x) for x in (_origin(drone, path) if drone.told_origin_m is None else drone.told_origin_m)),
                yaw_deg=drone.yaw_deg if drone.reported_yaw_deg is None else drone.reported_yaw_deg,
                localization=drone.kind,
                origin_sigma_m=drone.origin_sigma_m,
                yaw_sigma_deg=drone.yaw_sigma_deg,
            )
        )
    area = AreaConfig(polygon_m=((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)))
    mission = MissionConfig(
        name="test", drones=tuple(members), area=area, frames=frames or _FITTING, datum=DATUM if datum else None
    )
    numbers = {drone.id: iter(range(1, 1_000_000)) for drone in drones}

    def identity(drone: Drone, k: int) -> dict:
        return {
            "stamp_ns": int(stamps[k]),
            "drone": drone.id,
            "mission": mission.mission_id,
            "boot": _BOOT,
            "sequence": next(numbers[drone.id]),
        }

    for i, drone in enumerate(drones):
        heading = _headings(place[i]) - yaws[i]
        entries += _exposures(drone, identity, stamps, locals_[i], heading, epochs[i])
        if drone.fixes:
            entries += _fixes(drone, identity, place[i], locals_[i], yaws[i], epochs[i], stamps)
    every = max(1, round(1.0 / sensor.rate_hz / _STEP_S))
    for k in range(1, count, every):
        for i, drone in enumerate(drones):
            for j, other in enumerate(drones):
                if i != j:
                    seen = _sighting(sensor, drone.false, place[j, k] - place[i, k], yaws[i][k], rng)
                    position = tuple(locals_[i][k].tolist())
                    entries.append(
                        Sighting(**identity(drone, k), epoch=int(epochs[i][k]), target=other.id, position_m=position, **seen)
                    )
    ids = [drone.id for drone in drones]
    return Flown(
        mission,
        sorted(entries, key=lambda entry: entry.entry_id),
        dict(zip(ids, place, strict=True)),
        dict(zip(ids, yaws, strict=True)),
        dict(zip(ids, locals_, strict=True)),
        dict(zip(ids, epochs, strict=True)),
        stamps,
    )


def _origin(drone: Drone, path: np.ndarray) -> np.ndarray:
    """Of the local frame: below where it was launched."""
    return np.array([path[0, 0], path[0, 1], 0.0])


def _turn(yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _headings(path: np.ndarray) -> np.ndarray:
    velocity = np.gradient(path, axis=0)
    return np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))


def _localised(drone: Drone, path: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local positions, heading of the local frame in the mission frame, epochs."""
    count = len(path)
    flown = np.linalg.norm(np.diff(path, axis=0), axis=1)
    yaw = math.radians(drone.yaw_deg) + np.concatenate(
        [[0.0], np.cumsum(math.radians(drone.yaw_drift_deg) * math.sqrt(_STEP_S) * rng.standard_normal(count - 1))]
    )
    local = np.empty((count, 3))
    local[0] = _turn(-yaw[0]) @ (path[0] - _origin(drone, path))
    noise = drone.drift_m * np.array([1.0, 1.0, 0.3]) * np.sqrt(flown)[:, None] * rng.standard_normal((count - 1, 3))
    for k in range(1, count):
        local[k] = local[k - 1] + _turn(-yaw[k]) @ (path[k] - path[k - 1] + noise[k - 1])
    if drone.wander_m:
        keep = math.exp(-_STEP_S / GNSS_CORRELATION_S)
        wander = drone.wander_m * rng.standard_normal(3)
        for k in range(count):
            local[k] += _turn(-yaw[k]) @ wander
            wander = keep * wander + drone.wander_m * math.sqrt(1.0 - keep**2) * rng.standard_normal(3)
    epoch = np.zeros(count, dtype=int)
    shifted = np.arange(count) * _STEP_S >= drone.shift_s
    grown = _followed(_grown(drone, count), drone.shift_lag_s)[:, None]
    turn = math.radians(drone.shift_yaw_deg)
    local[shifted] = local[shifted] @ _turn(-turn).T + grown[shifted] * np.array(drone.shift_m) @ _turn(yaw[0]) @ _turn(-turn).T
    yaw = yaw + turn * shifted
    if drone.shift_announced:
        epoch[shifted] = 1
    return local, yaw, epoch


def _grown(drone: Drone, count: int) -> np.ndarray:
    """(K,) how much of its shift has come to its receiver."""
    grown_s, back_s = (np.arange(count) * _STEP_S - at_s for at_s in (drone.shift_s, drone.shift_back_s))
    return _share(grown_s, drone.shift_lasts_s) - _share(back_s, drone.shift_lasts_s)


def _followed(grown: np.ndarray, lag_s: float) -> np.ndarray:
    """A first-order lag behind the input, with a time constant."""
    followed, share = grown.copy(), 1.0 - math.exp(-_STEP_S / lag_s) if lag_s else 1.0
    for k in range(1, len(grown)):
        followed[k] = followed[k - 1] + share * (grown[k] - followed[k - 1])
    return followed


def _share(since_s: np.ndarray, lasts_s: float) -> np.ndarray:
    """How much of a shift has come, seconds after its beginning: all at once, or evenly for as long as it lasts."""
    return np.clip(since_s / lasts_s, 0.0, 1.0) if lasts_s else (since_s >= 0.0).astype(float)


def _exposures(drone, identity, stamps, local, heading, epoch):
    entries = []
    k = 0
    while k < len(stamps) - 1:
        end = k + 1
        while end < min(k + 5, len(stamps) - 1) and epoch[end] == epoch[k]:
            end += 1
        poses = tuple(
            PoseSample(int(stamps[m] - stamps[k]), tuple(local[m].tolist()), (math.cos(h / 2), 0.0, 0.0, math.sin(h / 2)))
            for m in range(k, end)
            for h in [heading[m]]
        )
        entries.append(
            Exposure(
                **identity(drone, k),
                epoch=int(epoch[k]),
                end_ns=int(stamps[end]),
                live_time_s=0.0,
                counts=Counts(0, 0, 0),
                poses=poses,
                position_sigma_m=0.1,
                yaw_sigma_rad=0.01,
            )
        )
        k = end
    return entries


def _fixes(drone, identity, place, local, yaw, epoch, stamps):
    """1 Hz; of its own localisation (an autopilot that follows its receiver), plus the part not followed yet."""
    entries = []
    origin, start = _origin(drone, place), math.radians(drone.yaw_deg)
    grown = _grown(drone, len(stamps))
    ahead = (grown - _followed(grown, drone.shift_lag_s))[:, None] * np.array(drone.shift_m)
    for k in range(5, len(stamps), 10):
        said = origin + _turn(start) @ local[k] + ahead[k]
        latitude, longitude, altitude = pymap3d.enu2geodetic(
            *said.tolist(), DATUM.latitude_deg, DATUM.longitude_deg, DATUM.altitude_m
        )
        sigma = max(drone.wander_m, 0.02)
        entries.append(
            Fix(
                **identity(drone, k),
                epoch=int(epoch[k]),
                position_m=tuple(local[k].tolist()),
                latitude_deg=float(latitude),
                longitude_deg=float(longitude),
                altitude_m=float(altitude),
                horizontal_sigma_m=sigma * math.sqrt(2.0),
                vertical_sigma_m=sigma,
            )
        )
    return entries


def _sighting(sensor: Sensor, false_share: float, apart: np.ndarray, yaw: float, rng: np.random.Generator) -> dict:
    false = rng.random() < false_share
    result: dict = {}
    if sensor.direction_deg is not None:
        sigma = math.radians(sensor.direction_deg)
        direction = _turn(-yaw) @ apart / np.linalg.norm(apart)
        across = rng.standard_normal(3) * sigma
        direction = rng.standard_normal(3) if false else direction + across - direction * (across @ direction)
        direction /= np.linalg.norm(direction)
        result |= {"direction": tuple(direction.tolist()), "direction_sigma_rad": sigma}
    if sensor.range_m is not None:
        distance = rng.uniform(1.0, 60.0) if false else np.linalg.norm(apart) + sensor.range_m * rng.standard_normal()
        result |= {"range_m": float(max(distance, 0.0)), "range_sigma_m": sensor.range_m}
    return result


def run(flown: Flown, until_s: float | None = None):
    """The frames after all entries up to a time, each given when it was made, advanced every half second."""
    frames = SwarmFrames(flown.mission)
    end_ns = int(flown.stamps_ns[-1]) if until_s is None else START_NS + round(until_s * SECOND)
    entries = [entry for entry in flown.entries if arrival_ns(entry) <= end_ns]
    entries.sort(key=lambda entry: (arrival_ns(entry), entry.entry_id))
    now_ns, place = START_NS, 0
    while now_ns < end_ns + SECOND:
        now_ns += SECOND // 2
        while place < len(entries) and arrival_ns(entries[place]) <= now_ns:
            frames.receive(entries[place], encode(entries[place]))
            place += 1
        frames.advance(now_ns)
    settle(frames, end_ns + SECOND)
    return frames


def arrival_ns(entry: Entry) -> int:
    return entry.end_ns if isinstance(entry, Exposure) else entry.stamp_ns


def settle(frames, now_ns: int) -> None:
    frames.advance(now_ns)
    while frames.pending:
        frames.advance(now_ns)
