"""Mission, drone and scenario files: ``ConfigError`` with one line, or a configuration from which a mission can begin."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import tomli_w

from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import load_mission, load_toml
from radron.agent.config.mission import DatumConfig, DroneInMission, MissionConfig
from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario, shipped
from support.flights.one_pilot import AREA
from tests.fuzz.mutation import HOSTILE_NUMBERS, HOSTILE_TEXTS, broken_text, mutated, nested
from tests.fuzz.target import Probe, Target, expect

SCENARIOS = Path(__file__).parents[2] / "sim" / "scenarios"
_MONSTERS = (
    b"",
    b"a = " + b"[" * 5000 + b"]" * 5000,
    b"a = " + b"{a=" * 2000 + b"1" + b"}" * 2000,
    b"a." * 5000 + b"a = 1",
    b"[" + b"a." * 5000 + b"a]",
    b"a = " + b"9" * 5000,
    b"a = 0x" + b"f" * 5000,
    b"a = 1e" + b"9" * 5000,
    b"a = 9999-99-99",
    b'a = "\\uD800"',
    b'a = "\\U0011ffff"',
    b"\xef\xbb\xbfa = 1",
    b"\xff\xfe",
    b"a = 1\r",
    b"[[a]]\n" * 20_000,
    b'a = """' + b"x" * 1_000_000,
)


class _Configs(Target):
    """Files made of examples: another value, another text, other bytes."""

    batch = 50
    limit_s = 2.0
    examples: tuple[bytes, ...]

    def case(self, rng: Random, probe: Probe) -> None:
        """A series of files, under the same name."""
        path = self.folder / "fuzzed.toml"
        for _ in range(self.batch):
            data = self._content(rng)
            path.write_bytes(data)
            probe.feed(data, self._load, path)

    def _content(self, rng: Random) -> bytes:
        example, pick = rng.choice(self.examples), rng.random()
        if pick < 0.003:
            return rng.choice(_MONSTERS)
        if pick < 0.6:
            document: dict[str, Any] = tomllib.loads(example.decode())
            for _ in range(rng.choice((1, 1, 1, 2, 3))):
                document = mutated(rng, document, _odd)
            try:
                return tomli_w.dumps(document).encode(errors="surrogateescape")
            except (TypeError, ValueError, AttributeError):  # values without a form in TOML
                return broken_text(rng, example)
        for _ in range(rng.choice((1, 1, 2, 4))):
            example = broken_text(rng, example)
        return example

    def _load(self, path: Path) -> None:
        try:
            self.load(path)
        except ConfigError as error:
            expect("\n" not in str(error), f"an error of several lines: {str(error)[:200]!r}")
            expect(
                any(name in str(error) for name in (path.name, "ground.grid", "buildings.file")),
                f"an error that names no file: {str(error)[:200]!r}",
            )

    def load(self, path: Path) -> None:
        """Read the file as a command would."""
        raise NotImplementedError


class Missions(_Configs):
    """Mission files."""

    name = "missions"
    inputs = 100_000

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        full = MissionConfig(
            name="fuzz",
            area=AREA,
            datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0),
            drones=(DroneInMission(id="d1", localization="gnss"), DroneInMission(id="d2", origin_m=(4.0, 0.0, 0.0))),
        )
        shipped_ones = (
            load_scenario(name, with_grid=False).mission for name in ("demo", "mixed-frames", "hilly", "stabilization")
        )
        self.examples = (_as_toml(full, whole=True), *(_as_toml(mission) for mission in (full, *shipped_ones)))
        (folder / "hilly.asc").write_bytes((SCENARIOS / "hilly.asc").read_bytes())

    def load(self, path: Path) -> None:
        """Load, and hash as every agent does."""
        expect(len(load_mission(path).mission_id) == 16, "a mission id of another length")


class Drones(_Configs):
    """Drone files."""

    name = "drones"
    inputs = 100_000

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.examples = (
            _as_toml(DroneConfig(id="d1"), whole=True),
            b"""id = "d2"
mission = "mission.toml"
state = "state"
calibration = "calibration"
[mesh]
endpoints = {d1 = "tls/10.7.1.11:7447", d2 = "tls/10.7.1.12:7447"}
identity = "identity"
others = ["anna"]
[vehicle]
address = "serial:///dev/ttyACM0:57600"
system_id = 2
vision = {address = "127.0.0.1:5000"}
[detector]
driver = "t3pa"
file = "a.t3pa"
[sightings]
address = "127.0.0.1:5001"
[recorder]
folder = "flight"
""",
        )

    def load(self, path: Path) -> None:
        """Load."""
        load_toml(path, DroneConfig)


class Scenarios(_Configs):
    """Scenario files, based on each other."""

    name = "scenarios"
    inputs = 100_000

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.examples = tuple(path.read_bytes() for path in sorted(SCENARIOS.glob("*.toml")) if path.stem in shipped())
        (folder / "hilly.asc").write_bytes((SCENARIOS / "hilly.asc").read_bytes())

    def load(self, path: Path) -> None:
        """Load with all that it is based on."""
        load_scenario(str(path))


def _odd(rng: Random) -> Any:
    """A value that TOML has a form for, and hardly any key."""
    choices: tuple[Callable[[], Any], ...] = (
        lambda: rng.choice(HOSTILE_NUMBERS),
        lambda: rng.choice(HOSTILE_TEXTS),
        lambda: rng.choice((True, False, [], {}, [[]], [[0.0, 0.0]] * 3, [[0.0, 0.0, 0.0]], "demo", "fuzzed", "hilly.asc")),
        lambda: nested(rng.choice((1, 5, 50)), 1),
        lambda: rng.uniform(-100.0, 100.0),
        lambda: rng.randrange(-10, 100),
    )
    return rng.choice(choices)()


def _as_toml(config: msgspec.Struct, whole: bool = False) -> bytes:
    return tomli_w.dumps(_given(config, whole)).encode()


def _given(value: Any, whole: bool) -> Any:
    """As a user would write it: without fields that have no value (TOML has no null), and without defaults unless ``whole``."""
    if isinstance(value, msgspec.Struct):
        fields = msgspec.structs.fields(value)
        given = ((field, getattr(value, field.name)) for field in fields)
        return {
            field.encode_name: _given(one, whole) for field, one in given if one is not None and (whole or one != field.default)
        }
    return [_given(one, whole) for one in value] if isinstance(value, list | tuple) else value
