"""The table of a fleet's computers: what differs stands out."""

from __future__ import annotations

import re

import msgspec
import pytest
from rich.console import Console

from radron.agent.errors import ConfigError
from radron.deploy.fleet.loading import load_fleet
from radron.deploy.remote import Host
from radron.deploy.update.errors import UpdateError
from radron.deploy.update.hosts import find_hosts
from radron.deploy.update.status import Answer, Cell, rows, table
from radron.protocol.onboard import Computer, Needs, Outcome, Trial
from support.computers.fleets import KEY, MISSION, make_fleet
from support.computers.onboard import NEW, OLD, well

NOW_NS = 1_800_000_000_000_000_000
DAY_NS = 86_400_000_000_000
FINE = Computer(
    name="radron-d1",
    release=NEW,
    slot="B",
    slots={"A": OLD, "B": NEW},
    attempts=0,
    trial=None,
    busy=False,
    outcome=Outcome(kind="good", slot="B", release=NEW, text="updated", stamp_ns=NOW_NS),
    report=msgspec.structs.replace(well(), px4="1.17.0", parameters={"COM_OF_LOSS_T": 0.5}),
    agent="active",
    disk_free_mb=20_000,
    disk_mb=30_000,
    clock_ns=NOW_NS,
    clock_offset_s=0.0002,
    certificate_ns=NOW_NS + 20 * DAY_NS,
)


def seen(*computers: Computer, fleet=None) -> list[dict[str, Cell]]:  # type: ignore[no-untyped-def]
    answers = [
        (Host(f"d{number}", f"10.7.1.{number}"), Answer(one, NOW_NS, NOW_NS)) for number, one in enumerate(computers, start=1)
    ]
    return rows(answers, fleet)


def marked(row: dict[str, Cell]) -> set[str]:
    return {column for column, cell in row.items() if cell.stands_out}


def test_a_fleet_without_differences_has_nothing_that_stands_out() -> None:
    found = seen(FINE, FINE)
    assert [marked(row) for row in found] == [set(), set()]
    assert [str(cell) for cell in found[0].values()] == [
        "d1", "0.2.0 (bbbbbbbbbbbb)", "B", "good, 2027-01-15 08:00 UTC", "preflight", "d2, d3", "answers", "answers", "1.17.0",
        "20.0 of 30.0 GB free", "+0.2 ms from its servers", "20 days left",
    ]  # fmt: skip


def test_the_one_that_differs_stands_out_also_without_colours() -> None:
    fallen = Outcome(kind="fell back", slot="B", release=NEW, text="the update to 0.2.0 failed", stamp_ns=NOW_NS)
    odd = msgspec.structs.replace(FINE, release=OLD, slot="A", outcome=fallen)
    found = seen(FINE, odd, FINE)
    assert [marked(row) for row in found] == [set(), {"release", "last update"}, set()]
    drawn = Console(width=300, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    drawn.print(table(found))
    text = drawn.export_text()
    assert "! 0.1.0 (aaaaaaaaaaaa)" in text
    assert "! fell back, 2027-01-15 08:00 UTC: the update to 0.2.0 failed" in text


@pytest.mark.parametrize(
    ("change", "column", "text"),
    [
        ({"report": None, "agent": "activating, waiting: no autopilot"}, "agent", "activating, waiting: no autopilot"),
        ({"clock_ns": NOW_NS - 3_000_000_000}, "clock", "-3.0 s from this computer's"),
        ({"certificate_ns": NOW_NS + 2 * DAY_NS}, "certificate", "2 days left"),
        ({"certificate_ns": NOW_NS - 1}, "certificate", "expired"),
        ({"disk_free_mb": 300}, "disk", "0.3 of 30.0 GB free"),
        (
            {"attempts": 2, "trial": Trial(slot="B", release=NEW, before=OLD, needs=Needs(), begun_ns=1)},
            "slot",
            "B, on trial, attempt 2 of 3",
        ),
        (
            {"trial": Trial(slot="A", release=NEW, before=OLD, needs=Needs(), begun_ns=1)},
            "last update",
            "0.2.0 (bbbbbbbbbbbb) is being installed",
        ),
    ],
)
def test_what_needs_a_look_stands_out(change: dict[str, object], column: str, text: str) -> None:
    cell = seen(msgspec.structs.replace(FINE, **change))[0][column]
    assert cell == Cell(text, stands_out=True)


def test_versions_and_parameters_are_judged_by_the_fleet_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    file = make_fleet(tmp_path)
    wanted = '[px4]\nversion = "1.17.1"\nparameters = { COM_OF_LOSS_T = 1.0 }\n\n[network]'
    file.write_text(file.read_text().replace("[network]", wanted, 1))
    row = seen(FINE, fleet=load_fleet(file))[0]
    assert row["release"] == Cell("0.2.0 (bbbbbbbbbbbb), the fleet file wants 0.1.0", stands_out=True)
    assert row["PX4"] == Cell("1.17.0; not 1.17.1; COM_OF_LOSS_T is 0.5, not 1", stands_out=True)


def with_parameters(**values: float) -> Computer:
    assert FINE.report is not None
    return msgspec.structs.replace(FINE, report=msgspec.structs.replace(FINE.report, parameters=values))


def test_a_parameter_that_the_fleet_file_names_and_a_drone_does_not_tell_stands_out(tmp_path) -> None:  # type: ignore[no-untyped-def]
    file = make_fleet(tmp_path)
    wanted = "[px4]\nparameters = { COM_OF_LOSS_T = 0.5, SYS_HITL = 0 }\n\n[network]"
    file.write_text(file.read_text().replace("[network]", wanted, 1))
    fleet = load_fleet(file)
    alike, lacking = with_parameters(COM_OF_LOSS_T=0.5, SYS_HITL=0.0), with_parameters(COM_OF_LOSS_T=0.500000001)
    assert [row["PX4"] for row in seen(alike, lacking, alike, fleet=fleet)] == [
        Cell("1.17.0"),
        Cell("1.17.0; SYS_HITL is not told", stands_out=True),
        Cell("1.17.0"),
    ]
    silent = msgspec.structs.replace(FINE, report=well())
    assert seen(silent, fleet=fleet)[0]["PX4"] == Cell("?", stands_out=True)


def test_parameters_that_no_file_names_are_compared_with_those_of_the_other_drones() -> None:
    usual = with_parameters(COM_OF_LOSS_T=0.5, RTL_RETURN_ALT=30.0, MPC_Z_V_AUTO_UP=3.0)
    odd = with_parameters(COM_OF_LOSS_T=1.0, RTL_RETURN_ALT=35.0)  # each drone returns in a layer of its own
    assert [row["PX4"] for row in seen(usual, odd, usual)] == [
        Cell("1.17.0"),
        Cell("1.17.0; COM_OF_LOSS_T is 1, elsewhere 0.5", stands_out=True),
        Cell("1.17.0"),
    ]


MIXED = """
mission = "mission.toml"
ssh_keys = ["KEY"]
network = { subnet = "10.7.1.0/24" }
px4 = { parameters = { COM_OF_LOSS_T = 0.5 } }
detector = { driver = "t3pa", file = "events.t3pa" }

[[drones]]
id = "d1"
address = "10.7.1.1"

[[drones]]
id = "d2"
address = "10.7.1.2"

[[drones]]
id = "d3"
address = "10.7.1.3"
detector = { driver = "none" }
vehicle = { gnss = false }
px4 = { version = "1.16.0", parameters = { SENS_EXTERNAL = 3 } }
"""


def test_a_drone_that_the_fleet_file_has_otherwise_is_right_as_it_is(tmp_path) -> None:  # type: ignore[no-untyped-def]
    drones = [f'{{ id = "d{number}", origin_m = [{6 * number}, 2, 0] }}' for number in (1, 2, 3)]
    mission = re.sub(r"drones = .*", f"drones = [{', '.join(drones)}]", MISSION)
    fleet = load_fleet(make_fleet(tmp_path, MIXED.replace("KEY", KEY), mission))
    satellites = with_parameters(COM_OF_LOSS_T=0.5, NAV_RCL_ACT=2.0)
    vision = with_parameters(COM_OF_LOSS_T=0.5, NAV_RCL_ACT=3.0, EKF2_GPS_CTRL=0.0, SENS_EXTERNAL=3.0)
    assert vision.report is not None
    vision = msgspec.structs.replace(vision, report=msgspec.structs.replace(vision.report, px4="1.16.0"))
    blind = msgspec.structs.replace(vision, report=msgspec.structs.replace(vision.report, camera=False))
    found = seen(satellites, satellites, blind, fleet=fleet)
    assert [marked(row) for row in found] == [set()] * 3
    assert found[2]["camera"] == Cell("none")
    assert [row["PX4"] for row in found] == [
        Cell("1.17.0"),
        Cell("1.17.0"),
        Cell("1.16.0"),
    ]
    assert seen(satellites, vision, satellites, fleet=fleet)[1]["PX4"] == Cell(
        "1.16.0; NAV_RCL_ACT is 3, elsewhere 2", stands_out=True
    )
    assert seen(satellites, satellites, satellites, fleet=fleet)[2]["PX4"] == Cell(
        "1.17.0; not 1.16.0; SENS_EXTERNAL is not told", stands_out=True
    )


def test_hosts_are_addresses_or_the_fleets_drones(tmp_path) -> None:  # type: ignore[no-untyped-def]
    file = make_fleet(tmp_path)
    assert [(host.name, host.address) for host in find_hosts([], file, ())[0]] == [("d1", "10.7.1.11"), ("d2", "10.7.1.12")]
    assert [host.address for host in find_hosts(["d2"], file, ("A=b",))[0]] == ["10.7.1.12"]
    assert [host.address for host in find_hosts(["10.7.1.12", "nuc.local"], file, ())[0]] == ["10.7.1.12", "nuc.local"]
    with pytest.raises(ConfigError, match=r"fleet.toml: there is no drone 'd9'; its drones are d1, d2"):
        find_hosts(["d9"], file, ())
    with pytest.raises(UpdateError, match="which computers"):
        find_hosts([], None, ())
    with pytest.raises(UpdateError, match=r"^10\.7\.1\.11: is named twice"):
        find_hosts(["10.7.1.11", "root@10.7.1.11"], None, ())
