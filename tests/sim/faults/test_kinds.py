"""Fault entries of scenario files: the values read, and the errors of wrong entries."""

from pathlib import Path

import msgspec
import pytest

from radron.agent.errors import ConfigError
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.schedule import Schedule
from radron.sim.scenario import load_scenario, override

DRONES = ("d1", "d2", "d3")


def scenario_with(folder: Path, *entries: str) -> Path:
    path = folder / "own.toml"
    tables = "".join(f"[[fault]]\n{entry}\n" for entry in entries)
    path.write_text(f'base = "demo"\nname = "own"\ndescription = "own"\n{tables}')
    return path


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("at_s = 3", "fault[0]: the key 'kind' is missing; known: kill, freeze"),
        ('kind = "kil"\nat_s = 3', "fault[0]: unknown kind 'kil'; known: kill, freeze"),
        ('kind = "loss"\nat_s = 3', "fault[0] (loss): the key 'probability' is missing"),
        ('kind = "loss"\nat_s = -3\nprobability = 0.5', "fault[0] (loss): at_s: expected `float` >= 0.0"),
        ('kind = "loss"\nat_s = 3\nprobability = 2', "fault[0] (loss): probability: expected `float` <= 1.0"),
        ('kind = "kill"\nat_s = 3\nfor_s = 0', "fault[0] (kill): for_s: expected `float` > 0.0"),
        ('kind = "kill"\nat_s = 3\ntarget = "d9"', "fault[0] (kill): no drone 'd9' in the mission; there are d1, d2, d3"),
        ('kind = "kill"\nat_s = 3\ntarget = []', "fault[0] (kill): target: name at least one drone, or leave it out for all"),
        ('kind = "kill"\nat_s = 3\nprob = 1', "fault[0] (kill): unknown key 'prob'"),
        ('kind = "motor"\nat_s = 3\nfor_s = 9', "fault[0] (motor): for_s: a failed motor stays; remove it"),
        (
            'kind = "partition"\nat_s = 3\ngroups = [["d1"], ["d1", "d2"]]',
            "fault[0] (partition): groups: d1 in more than one group; give each drone once",
        ),
        ('kind = "cut"\nat_s = 3\npeers = "d7"', "fault[0] (cut): no drone 'd7' in the mission"),
        (
            'kind = "mavlink-impaired"\nat_s = 3',
            "fault[0] (mavlink-impaired): cut, delay_s, jitter_s, reorder, duplicate, corrupt: give at least one",
        ),
        ('kind = "cut"\nat_s = 3\ndirection = "up"', "fault[0] (cut): direction: invalid enum value 'up' (allowed: "),
    ],
)
def test_a_wrong_entry_is_named_with_what_is_allowed(tmp_path: Path, entry: str, told: str) -> None:
    path = scenario_with(tmp_path, entry)
    with pytest.raises(ConfigError) as error:
        load_scenario(str(path))
    text = str(error.value)
    assert text.startswith(f"{path}: {told}")
    assert "\n" not in text


def test_entries_are_kept_when_other_values_of_the_scenario_change(tmp_path: Path) -> None:
    path = scenario_with(tmp_path, 'kind = "kill"\nat_s = 3\ntarget = "d2"', 'kind = "delay"\nat_s = 1\nfor_s = 2\njitter_s = 1')
    scenario = load_scenario(str(path))
    assert [fault.strikes(DRONES) for fault in scenario.fault] == [["d2"], ["d1", "d2", "d3"]]
    assert override(scenario, {"radius_m": 9.0}).fault == scenario.fault


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_written_and_read(kind: str) -> None:
    numbers = {
        "partition": {"groups": [["d1"], ["d2", "d3"]]},
        "slow-cpu": {"late_s": 0.2},
        "delay": {"delay_s": 0.2},
        "range": {"range_m": 50.0},
        "lie": {"what": "pose"},
        "clock": {"jump_s": 0.5},
        "disk": {"how": "full"},
        "stream-lost": {"message": "HEARTBEAT"},
        "mavlink-impaired": {"corrupt": 0.1},
        "throttle": {"rate_kilobytes_ps": 5.0},
        "forged": {"what": "impossible"},
        **{name: {"probability": 0.5} for name in ("loss", "reorder", "duplicate", "corrupt", "mavlink-loss")},
    }.get(kind, {})
    fault = msgspec.convert({"kind": kind, "at_s": 5.0, **numbers}, KINDS[kind])
    assert fault.check() is None
    written = msgspec.to_builtins(fault)
    assert written["kind"] == kind
    assert msgspec.convert(written, KINDS[kind]) == fault


def flown(faults: list[Fault], times_s: list[float], seed: int = 1) -> list[tuple[list[str], list[str], int]]:
    """Kinds that began and ended at each time, and how many were active."""
    schedule = Schedule(faults, DRONES, seed)
    seen = []
    for time_s in times_s:
        schedule.advance(time_s)
        began, ended = ([type(one.fault).__name__ for one in list_] for list_ in (schedule.begun, schedule.ended))
        seen.append((began, ended, len(schedule.active(Fault))))
    return seen


def test_a_fault_begins_and_ends_on_time() -> None:
    kill = msgspec.convert({"kind": "kill", "at_s": 0.1, "for_s": 0.1, "target": "d2"}, KINDS["kill"])
    gust = msgspec.convert({"kind": "gust", "at_s": 0.05}, KINDS["gust"])
    seen = flown([kill, gust], [0.0, 0.05, 0.1, 0.15, 0.2, 0.25])
    assert seen == [
        ([], [], 0), (["Gust"], [], 1), (["Kill"], [], 2), ([], [], 2), ([], ["Kill"], 1), ([], [], 1),
    ]  # fmt: skip


def test_a_fault_strikes_its_targets_and_draws_its_own_numbers() -> None:
    loss = msgspec.convert({"kind": "loss", "at_s": 0.0, "target": ["d1", "d3"], "probability": 0.5}, KINDS["loss"])
    other = msgspec.convert({"kind": "gust", "at_s": 0.0}, KINDS["gust"])
    alone, both = Schedule([loss], DRONES, 7), Schedule([other, loss], DRONES, 7)
    alone.advance(0.0)
    both.advance(0.0)
    kind = KINDS["loss"]
    (_, one), (_, same) = alone.active(kind)[0], both.active(kind)[0]
    assert one.drones == {0, 2}
    assert [alone.active(kind, drone) != [] for drone in range(3)] == [True, False, True]
    assert one.rng.random(4).tolist() == same.rng.random(4).tolist()
