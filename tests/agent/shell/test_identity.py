"""A drone's certificate as its file names it, and the report to the operator as its end comes nearer."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from radron.agent.config.drone import DroneConfig, PeerMeshConfig
from radron.agent.errors import ConfigError
from radron.agent.shell.identity import own_identity, validity
from radron.protocol.identity import Identity, IdentityError, Revoked
from support.mesh.identities import DAY_NS, identity, new_issuer, now_ns

HOUR_NS = DAY_NS // 24


@pytest.fixture
def own(tmp_path: Path) -> Identity:
    return identity(new_issuer(), tmp_path, "d1", days=60)


@pytest.mark.parametrize(
    ("left_ns", "notice"),
    [
        (40 * DAY_NS, None),
        (29 * DAY_NS + HOUR_NS, ", 29 days left"),
        (6 * DAY_NS + HOUR_NS, ", renew it this week: 6 days left"),
        (23 * HOUR_NS, ", renew it now: 23 hours left"),
    ],
)
def test_a_month_a_week_and_a_day_before_its_end_it_is_told_and_stops_nothing(
    own: Identity, left_ns: int, notice: str | None
) -> None:
    state = validity(own, own.own.not_after_ns - left_ns)
    assert state.fault is None
    assert state.text.startswith("d1, drone, until ")
    assert (state.notice is None) == (notice is None)
    assert state.notice is None or state.notice.endswith(str(notice))


@pytest.mark.parametrize(
    ("at_ns", "fault"),
    [
        (
            lambda own: own.not_after_ns - HOUR_NS,
            "expires at .*, in less than the 2 h that a flight may need; run `radron-deploy pki",
        ),
        (lambda own: own.not_after_ns + 1, r"expired at .* \(this computer's clock shows .*\); run `radron-deploy pki issue d1 "),
        (
            lambda own: own.not_before_ns - 1,
            "not valid before .*, and this computer's clock shows .*: set it, such as by `chronyc",
        ),
    ],
)
def test_one_that_is_not_valid_is_a_fault_with_what_to_do(own: Identity, at_ns: object, fault: str) -> None:
    assert callable(at_ns)
    state = validity(own, at_ns(own.own))
    assert state.fault is not None
    assert state.notice is None
    assert re.match(rf"{re.escape(str(own.folder))}/certificate\.pem: {fault}", state.fault)


def test_one_that_was_revoked_is_a_fault(own: Identity) -> None:
    revoked = replace(own, revoked=Revoked(frozenset({own.own.serial}), frozenset({"d1"})))
    fault = validity(revoked, now_ns()).fault
    assert fault is not None
    assert "has been revoked" in fault
    assert validity(own, now_ns()).fault is None


def drone(**mesh: object) -> DroneConfig:
    return DroneConfig(id="d1", mesh=PeerMeshConfig(**mesh))  # type: ignore[arg-type]


def test_a_drone_flies_encrypted_unless_its_file_says_otherwise(own: Identity) -> None:
    found = own_identity(drone(identity=str(own.folder)))
    assert found is not None
    assert found.own == own.own
    assert own_identity(drone(insecure=True)) is None
    with pytest.raises(ConfigError, match=r"mesh\.identity is missing.*run `radron-deploy pki issue d1 --role drone`"):
        own_identity(drone())
    with pytest.raises(ConfigError, match="exclude each other"):
        own_identity(drone(identity=str(own.folder), insecure=True))
    with pytest.raises(IdentityError, match=r"nowhere: there is no such folder; make one with `radron-deploy pki issue"):
        own_identity(drone(identity=str(own.folder / "nowhere")))
