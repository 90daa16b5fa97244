"""An operator revokes a drone over a real, encrypted mesh, to pilots that put it into effect, or do not."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace as replace_in
from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.cli import main
from radron.agent.config.drone import DroneConfig
from radron.agent.operator import revocation
from radron.agent.operator.revocation import Request, RevocationError, revoke
from radron.agent.pilot import Pilot
from radron.protocol.codec import encode
from radron.protocol.entries import Credential
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Identity, Role, load_identity
from radron.protocol.issuing import Issuer, write_identity
from radron.protocol.keys import key_of, log_query_key
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Stage, Status
from radron.protocol.signing import sign_entries, sign_status
from radron.protocol.summary import Held, encode_summary
from radron.protocol.trust import trust_of
from radron.protocol.units import STATION
from support.flights.one_pilot import MISSION, cone_of
from support.live.agents import free_ports
from support.mesh.identities import identity, new_issuer

BOOT = "2" * 16


@pytest.fixture(autouse=True)
def _quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(revocation, "LISTEN_S", 0.0)  # for more than one drone


@pytest.fixture
def soon_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """For drones that are not heard, or refuse."""
    monkeypatch.setattr(revocation, "FIND_S", 1.0)
    monkeypatch.setattr(revocation, "EFFECT_S", 3.0)  # a status with the reason comes once a second


@pytest.fixture(scope="module")
def issuer() -> Issuer:
    return new_issuer()


@pytest.fixture(scope="module")
def folder(issuer: Issuer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identities")
    for name in ("d1", "d2"):
        identity(issuer, folder, name)
    identity(issuer, folder, "bert", Role.OPERATOR)
    write_identity(folder / "anna", issuer.authority, issuer.issue("anna", Role.OPERATOR, time.time_ns(), may_revoke=True))
    return folder


def entries_of_d2(own: Identity) -> list[tuple[str, bytes]]:
    """Twenty signed cones, with keys."""
    trust, now_ns = trust_of(own), time.time_ns()
    assert trust is not None
    cones = [replace(cone_of("d2", number, now_ns), boot=BOOT) for number in range(1, 21)]
    first = Credential(
        stamp_ns=now_ns, drone="d2", mission=MISSION.mission_id, boot=BOOT, sequence=0, certificate=trust.certificate
    )
    signed = sign_entries([first, *cones], trust.sign)
    return [(key_of(MISSION.swarm, entry), encode(entry)) for entry in signed]


@asynccontextmanager
async def flying(own: Identity, listen: str) -> AsyncIterator[Pilot]:
    """A drone in the mesh."""
    trust = trust_of(own)
    pilot = Pilot(MISSION, DroneConfig(id=own.own.name), boot="1" * 16, trust=trust, nonce_key=b"")
    config = MeshConfig(listen=listen, identity=own, drones=("d1", "d2"))
    mesh = await Mesh.open(
        config, MISSION.swarm, own.own.name, answer=pilot.log_answer,
        receive=lambda key, payload: pilot.receive(key, payload, time.time_ns()),
    )  # fmt: skip

    async def step() -> None:
        while True:
            for key, payload in pilot.step(time.time_ns()).publications:
                mesh.publish(key, payload)
            await asyncio.sleep(0.05)

    stepping = asyncio.create_task(step())
    try:
        yield pilot
    finally:
        stepping.cancel()
        await mesh.close()


def carried_out(folder: Path, request: Request, own: Identity | None = None, confirmed: bool = True) -> tuple[Pilot, list[str]]:
    """d1 after a request, and the messages."""
    said: list[str] = []

    def confirm(text: str) -> bool:
        said.append(text)
        return confirmed

    async def course() -> Pilot:
        async with AsyncExitStack() as stack:
            pilot = await stack.enter_async_context(flying(own or load_identity(folder / "d1"), request.connect[0]))
            for key, payload in entries_of_d2(load_identity(folder / "d2")):
                pilot.receive(key, payload, time.time_ns())
            await revoke(request, confirm, said.append)
            return pilot

    return asyncio.run(course()), said


def asked(folder: Path, member: str = "d2", by: str = "anna", **values: object) -> Request:
    endpoint = f"tls/127.0.0.1:{free_ports(1)[0]}"
    return Request(member, MISSION.swarm, (endpoint,), folder / by, **values)  # type: ignore[arg-type]


def test_a_drone_is_revoked_and_what_is_held_of_it_counts(folder: Path) -> None:
    pilot, said = carried_out(folder, asked(folder))
    assert said == [
        f"d2: its log entries count up to number 20 of boot {BOOT}; heard by d1",
        "d2 is revoked: in effect at d1; drones that join later learn it from them",
        "then, where the authority's key is: radron-deploy pki revoke d2",
    ]
    (one,) = pilot.revocations
    assert (one.member, one.station, one.last) == ("d2", "anna", {BOOT: 20})
    assert len(pilot.fusion.log) == 21


@pytest.mark.parametrize(("values", "left"), [({"nothing": True}, 0), ({"last": {BOOT: 7}}, 8)])
def test_less_of_it_counts_if_the_operator_says_so(folder: Path, values: dict[str, object], left: int) -> None:
    pilot, _ = carried_out(folder, asked(folder, **values))
    pilot.advance(time.time_ns())
    assert len(pilot.fusion.log) == left


@pytest.mark.parametrize(
    ("member", "by", "confirmed", "error"),
    [
        ("anna", "anna", True, "anna is the name of your own certificate"),
        (
            "d2",
            "bert",
            True,
            r"certificate.pem: bert has no right to revoke others; run `radron-deploy pki issue .*--may-revoke`",
        ),
        ("d2", "d1", True, "d1 has no right to revoke others"),
        ("d2", "anna", False, "not revoked: confirm it, or give --yes"),
        ("D2!", "anna", True, "is not a name for a certificate"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_revoked(folder: Path, member: str, by: str, confirmed: bool, error: str) -> None:
    with pytest.raises((RevocationError, ProtocolError), match=error):
        carried_out(folder, asked(folder, member, by), confirmed=confirmed)


@pytest.mark.usefixtures("soon_given_up")
def test_where_no_other_drone_is_heard_nothing_is_revoked(folder: Path) -> None:
    with pytest.raises(RevocationError, match="nothing heard from any other drone of the swarm 'radron'"):
        carried_out(folder, asked(folder, "d1"))


def test_only_drones_that_have_signed_their_statuses_are_asked(folder: Path) -> None:
    heard = revocation._Heard(load_identity(folder / "anna"))
    trust = trust_of(load_identity(folder / "d1"))
    assert trust is not None
    for drone in ("d1", "d2"):
        bare = Status(stamp_ns=1, drone=drone, mission=MISSION.mission_id, boot=BOOT, stage=Stage.TRACK)
        heard.receive(key_of(MISSION.swarm, bare), encode(sign_status(bare, trust)))
    assert list(heard.statuses) == ["d1"]


def test_a_stolen_drone_does_not_tell_up_to_where_its_own_entries_count(folder: Path) -> None:
    """The stolen drone answers for d1's log too; only d1's own answer counts. The twin is the test above, without it."""
    request, listen = asked(folder), f"tls/127.0.0.1:{free_ports(1)[0]}"
    endless = encode_summary(MISSION.mission_id, {("d2", BOOT): Held(((0, 2**40),))})

    async def course() -> Pilot:
        async with AsyncExitStack() as stack:
            own = load_identity(folder / "d2")
            thief = await Mesh.open(
                MeshConfig(listen=listen, connect=request.connect, identity=own, drones=("d1", "d2")),
                MISSION.swarm,
                "d2",
                receive=lambda *_: None,
            )
            stack.push_async_callback(thief.close)
            session, asked_of = thief._session, log_query_key(MISSION.swarm, "d1", STATION)
            forging = session.declare_queryable(asked_of, lambda query: query.reply(asked_of, endless))
            stack.callback(forging.undeclare)
            pilot = await stack.enter_async_context(flying(load_identity(folder / "d1"), request.connect[0]))
            for key, payload in entries_of_d2(own):
                pilot.receive(key, payload, time.time_ns())
            await revoke(replace_in(request, connect=(listen, *request.connect)), lambda _: True, lambda _: None)
            return pilot

    assert asyncio.run(course()).revocations[0].last == {BOOT: 20}


@pytest.mark.usefixtures("soon_given_up")
def test_a_drone_that_refuses_is_named(folder: Path, issuer: Issuer, tmp_path: Path) -> None:
    """The authority itself has revoked anna, and d1 has its list."""
    write_identity(tmp_path / "d1", issuer.authority, issuer.issue("d1", Role.DRONE, time.time_ns()))
    serial = load_identity(folder / "anna").own.serial
    (tmp_path / "d1" / "revoked.crl").write_bytes(issuer.revocation_list({serial: "someone"}, time.time_ns()))
    with pytest.raises(RevocationError, match=r"d1 has not put it into effect: it refuses it \(with revoked certificate\)"):
        carried_out(folder, asked(folder), own=load_identity(tmp_path / "d1"))


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--nothing", "--last", f"{BOOT}=3"], "--nothing and --last exclude each other"),
        (["--last", "x=3"], "--last x=3: expected BOOT=N"),
        (["--last", f"{BOOT}=-1"], "expected BOOT=N"),
    ],
)
def test_options_that_do_not_fit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], options: list[str], error: str
) -> None:
    words = ["revoke", "d2", "--swarm", "s", "--connect", "tls/127.0.0.1:1", "--identity", "x", *options]
    monkeypatch.setattr("sys.argv", ["radron-agent", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert error in capsys.readouterr().err
