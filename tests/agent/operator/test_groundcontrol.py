"""An operator's command over a real mesh, to stand-ins that publish statuses and obey, or do not."""

import asyncio
import itertools
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.operator import groundcontrol
from radron.agent.operator.groundcontrol import CommandError, Order
from radron.agent.operator.statuses import Statuses, Tickets
from radron.protocol.codec import decode, encode
from radron.protocol.codes import Code
from radron.protocol.elapsed import elapsed_s
from radron.protocol.identity import Identity, Role
from radron.protocol.keys import key_of
from radron.protocol.mesh.link import close_session, open_session
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Action, Command, Stage, Status, Ticket
from radron.protocol.signing import sign_status
from radron.protocol.texts import CodedText, Texts, coded
from radron.protocol.trust import trust_of
from support.live.agents import free_ports
from support.mesh.identities import DAY_NS, identity, new_issuer
from support.mesh.meshes import until

MISSION = "0123456789abcdef"
TELL_S, LISTEN_S = 0.02, 0.6  # how often a stand-in tells its status; how long it is waited for more of them
NOT_READY = "the vehicle is not ready to be armed"
STAGES = {Action.START: Stage.TAKEOFF, Action.HOLD: Stage.HOLD, Action.LAND: Stage.LANDING}


class Drone:
    """Reports its kind, and starts on command unless ``lame``."""

    def __init__(
        self,
        name: str,
        mission: str = MISSION,
        problems: tuple[CodedText, ...] = (),
        lame: bool = False,
        ahead_s: float = 0.0,
        own: Identity | None = None,
    ) -> None:
        self.name = name
        self.own = own
        self.ahead_s = ahead_s
        self.mission = mission
        self.problems = problems
        self.lame = lame
        self.notices: tuple[str, ...] = ()
        self.stage = Stage.PREFLIGHT
        self.is_contested, self.overtaken = False, 0
        self.is_taken_over, self.landing = False, 0  # by the pilot, once many statuses have shown that it lands
        self.commands: list[Command] = []
        self.received: list[Command] = []  # whether obeyed or not
        self.tells_ticket = True
        self.nonce = lambda: "0" * 16
        self.forges: tuple[Status, ...] = ()  # besides its own
        self.endpoint = f"{'tcp' if own is None else 'tls'}/127.0.0.1:{free_ports(1)[0]}"

    @property
    def ticket(self) -> Ticket:
        return Ticket(self.nonce(), 1 if self.lame else len(self.commands) + self.overtaken + 1)

    def receive(self, key: str, payload: bytes) -> None:
        message = decode(payload)
        if isinstance(message, Command) and self.is_contested:
            self.is_contested, self.overtaken = False, 1  # another operator's command has come first
        if isinstance(message, Command):
            self.received.append(message)
        if isinstance(message, Command) and message.to.get(self.name) == self.ticket:
            self.commands.append(message)
            if not self.lame:
                self.stage = STAGES[message.action]

    async def tell(self, mesh: Mesh) -> None:
        while True:
            status = Status(
                stamp_ns=time.time_ns() + round(self.ahead_s * 1e9), drone=self.name, mission=self.mission, boot="0" * 16,
                stage=self.stage, problems=tuple(map(str, self.problems)), notices=self.notices,
                codes=Texts(self.problems, None, coded("", self.notices)).codes,
                ticket=self.ticket if self.tells_ticket else None,
            )  # fmt: skip
            trust = trust_of(self.own)
            told = [*self.forges, status if trust is None else sign_status(status, trust)]
            for one in told:
                mesh.publish(key_of("test", one), encode(one))
            await asyncio.sleep(TELL_S)
            self.landing += status.stage is Stage.LANDING
            if self.is_taken_over and self.landing == 20:
                self.stage = Stage.HOLD

    @asynccontextmanager
    async def running(self, dial: tuple[str, ...]) -> AsyncIterator[None]:
        links = MeshConfig(listen=self.endpoint, connect=dial, identity=self.own)
        mesh = await Mesh.open(links, "test", self.name, receive=self.receive)
        telling = asyncio.create_task(self.tell(mesh))
        try:
            yield
        finally:
            telling.cancel()
            await mesh.close()


@pytest.fixture(autouse=True)
def _quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groundcontrol, "REPEAT_S", 0.3)


@pytest.fixture
def soon_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """For drones that are not heard, or do not obey."""
    monkeypatch.setattr(groundcontrol, "FIND_S", 1.0)
    monkeypatch.setattr(groundcontrol, "OBEY_S", 1.0)


def order(
    action: Action,
    *drones: Drone,
    only: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    anyway: bool = False,
    folder: Path | None = None,
    mission: str = "",
) -> list[str]:
    """Carry out an order to running drones; return the messages."""
    said: list[str] = []

    async def run() -> None:
        async with AsyncExitStack() as stack:
            endpoints: tuple[str, ...] = ()
            for drone in drones:
                await stack.enter_async_context(drone.running(endpoints))
                endpoints += (drone.endpoint,)
            asked = Order(action, "test", endpoints, only, without, anyway, folder, mission)
            await groundcontrol.command(asked, said.append)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(groundcontrol, "LISTEN_S", LISTEN_S * (len(drones) - 1))  # that is for the others
        asyncio.run(run())
    return said


def refused(
    action: Action,
    *drones: Drone,
    only: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    anyway: bool = False,
    mission: str = "",
) -> str:
    with pytest.raises(CommandError) as caught:
        order(action, *drones, only=only, without=without, anyway=anyway, mission=mission)
    return str(caught.value)


def test_a_swarm_is_started() -> None:
    d1, d2 = Drone("d1"), Drone("d2")
    assert order(Action.START, d1, d2) == [f"start: to d1, d2, mission {MISSION}", "start: d1 takeoff, d2 takeoff"]
    assert d1.commands[0].mission == MISSION


def test_a_command_to_one_drone_leaves_the_others_alone() -> None:
    d1, d2 = Drone("d1"), Drone("d2")
    assert order(Action.HOLD, d1, d2, only=("d2",))[-1] == "hold: d2 hold"
    assert d1.stage is Stage.PREFLIGHT


def test_nobody_starts_while_one_has_a_problem() -> None:
    d1, d2 = (
        Drone("d1"),
        Drone("d2", problems=coded(Code.NOT_READY_TO_ARM, (NOT_READY, "Preflight Fail: heading estimate not stable"))),
    )
    text = refused(Action.START, d1, d2)
    assert "d2: the vehicle is not ready to be armed, Preflight Fail: heading estimate not stable" in text
    assert not d1.commands


@pytest.mark.usefixtures("soon_given_up")
def test_those_that_can_start_anyway_and_the_other_says_why_not() -> None:
    d1, d2 = Drone("d1"), Drone("d2", problems=coded(Code.NOT_READY_TO_ARM, [NOT_READY]), lame=True)
    assert refused(Action.START, d1, d2, anyway=True) == "d2: the vehicle is not ready to be armed"
    assert d1.stage is Stage.TAKEOFF


def test_a_drone_of_another_version_is_named_and_prevents_a_start_but_no_landing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groundcontrol, "LISTEN_S", 0.0)
    d1, d2, statuses = Drone("d1"), Drone("d2"), Statuses()
    start, land = (Order(action, "test", (d1.endpoint, d2.endpoint), anyway=True) for action in (Action.START, Action.LAND))

    async def run() -> None:
        async with d1.running(()), AsyncExitStack() as stack:
            former = await open_session(MeshConfig(listen=d2.endpoint), dial_all=False)
            stack.push_async_callback(close_session, former)
            mesh = await Mesh.open(MeshConfig(connect=start.connect), "test", None, receive=statuses.receive)
            stack.push_async_callback(mesh.close)
            token = former.liveliness().declare_token("radron/1/test/d2/alive")
            await until(lambda: mesh.differing)
            with pytest.raises(CommandError, match=r"^not started: d2 speaks version 1 of the protocol, here 2: give all"):
                await groundcontrol.carry_out(start, mesh, None, statuses, print)
            await groundcontrol.carry_out(land, mesh, None, statuses, print)
            token.undeclare()
            await until(lambda: not mesh.differing)
            await groundcontrol.carry_out(start, mesh, None, statuses, print)

    asyncio.run(run())
    assert [command.action for command in d1.commands] == [Action.LAND, Action.START]


def test_an_absent_drone_does_not_hold_up_the_others_if_the_operator_says_so() -> None:
    missed = (CodedText(Code.NO_CONTACT, "no contact with d3 (tcp/10.0.0.3:7447)", "d3"),)
    d1, d2 = Drone("d1", problems=missed), Drone("d2", problems=missed)
    assert "no contact with d3" in refused(Action.START, d1, d2)
    assert order(Action.START, d1, d2, without=("d3",))[-1] == "start: d1 takeoff, d2 takeoff"
    assert set(d1.commands[-1].to) == {"d1", "d2"}


def test_one_that_is_there_but_left_behind_gets_no_command() -> None:
    differs = CodedText(Code.MISSION_DIFFERS, "d2 has another mission (f, here 0)", "d2")
    d1, d2 = Drone("d1", problems=(differs,)), Drone("d2", mission="f" * 16)
    assert order(Action.START, d1, d2, without=("d2",))[0] == f"start: to d1, mission {MISSION}"
    assert not d2.commands


def test_a_problem_of_a_drone_that_is_to_start_is_one_without_the_absent_too() -> None:
    d1 = Drone("d1", problems=[CodedText(Code.NO_CONTACT, f"no contact with {name} (none)", name) for name in ("d3", "d30")])
    assert refused(Action.START, d1, without=("d3",)).startswith("not started: d1: no contact with d30 (none) (")


@pytest.mark.usefixtures("soon_given_up")
def test_a_landing_does_not_fail_because_another_command_came_first_as_a_hold_does() -> None:
    d1, d2 = Drone("d1"), Drone("d1")
    d1.is_contested = d2.is_contested = True
    assert order(Action.LAND, d1)[-1] == "land: d1 landing"
    assert refused(Action.HOLD, d2) == "d1: another command came first: give this one again"


@pytest.mark.usefixtures("soon_given_up")
def test_a_drone_that_a_pilot_has_taken_over_while_it_landed_is_not_told_to_land_again() -> None:
    d1, d2 = Drone("d1"), Drone("d2", lame=True)
    d1.is_taken_over = True
    refused(Action.LAND, d1, d2)  # d2 does not obey, so that the command is repeated to the end
    assert (len(d1.commands), d1.stage) == (1, Stage.HOLD)
    assert len(d2.commands) > 1


def test_land_once_more_reaches_a_drone_that_is_landing_as_it_disarms_there() -> None:
    d1 = Drone("d1")
    d1.stage = Stage.LANDING
    assert order(Action.LAND, d1)[-1] == "land: d1 landing"
    assert [command.action for command in d1.commands] == [Action.LAND]


@pytest.mark.parametrize("ahead_s", [-8.0, 8.0])
def test_a_drone_whose_clock_is_off_can_be_commanded_all_the_same(ahead_s: float) -> None:
    assert order(Action.HOLD, Drone("d1", ahead_s=ahead_s))[-1] == "hold: d1 hold"


@pytest.mark.usefixtures("soon_given_up")
def test_a_wrong_clock_is_the_reason_given_for_a_drone_that_does_not_obey() -> None:
    assert f"d1: its clock differs by {-20.0:+.1f} s" in refused(Action.START, Drone("d1", lame=True, ahead_s=-20.0))


def test_drones_of_different_missions_get_no_command() -> None:
    d1, d2 = Drone("d1"), Drone("d2", mission="f" * 16)
    text = refused(Action.START, d1, d2)
    assert text.startswith(f"not started: the drones have different missions (d1: {MISSION}; d2: {'f' * 16})")
    assert not d1.commands


def test_drones_of_different_missions_can_be_landed_all_the_same() -> None:
    d1, d2 = Drone("d1"), Drone("d2", mission="f" * 16)
    assert order(Action.LAND, d1, d2)[-1] == "land: d1 landing, d2 landing"
    assert (d1.commands[0].mission, d2.commands[0].mission) == (MISSION, "f" * 16)


def test_a_start_that_names_its_mission_is_refused_where_the_drones_have_another_one() -> None:
    d1 = Drone("d1")
    text = refused(Action.START, d1, mission="f" * 16)
    assert text == f"start: the mission meant is {'f' * 16}, and the drones have another one (d1: {MISSION})"
    assert not d1.commands
    assert order(Action.START, d1, mission=MISSION)[-1] == "start: d1 takeoff"


@pytest.mark.usefixtures("soon_given_up")
def test_a_swarm_that_is_not_there() -> None:
    d1 = Drone("d1")
    assert "nothing heard from d7 at tcp/127.0.0.1:" in refused(Action.LAND, d1, only=("d7",))


def test_what_is_no_obstacle_is_told_at_a_start() -> None:
    d1 = Drone("d1")
    d1.notices = ("links are not encrypted",)
    assert order(Action.START, d1)[0] == "d1: links are not encrypted"
    assert d1.commands


@pytest.mark.parametrize("forged", ["of another mission", "repeated"])
def test_statuses_forged_or_repeated_by_a_member_keep_no_command_from_a_drone(tmp_path: Path, forged: str) -> None:
    issuer = new_issuer("test")
    d1, d2 = (Drone(name, own=identity(issuer, tmp_path, name)) for name in ("d1", "d2"))
    identity(issuer, tmp_path, "anna", Role.OPERATOR)
    status = Status(stamp_ns=time.time_ns(), drone="d1", mission=MISSION, boot="0" * 16, stage=Stage.PREFLIGHT)
    altered = replace(status, stamp_ns=status.stamp_ns + 60_000_000_000, mission="f" * 16, ticket=Ticket("f" * 16, 9))
    trust = trust_of(d1.own)
    assert trust is not None
    d2.forges = (altered,) if forged == "of another mission" else (sign_status(status, trust),)
    assert order(Action.HOLD, d1, d2, folder=tmp_path / "anna")[-1] == "hold: d1 hold, d2 hold"


@pytest.mark.usefixtures("soon_given_up")
def test_a_drone_whose_status_has_no_ticket_is_named(tmp_path: Path) -> None:
    issuer = new_issuer("test")
    d1 = Drone("d1", own=identity(issuer, tmp_path, "d1"))
    identity(issuer, tmp_path, "anna", Role.OPERATOR)
    d1.tells_ticket = False
    with pytest.raises(CommandError, match=r"^d1: its status tells no nonce, without which no command is obeyed$"):
        order(Action.LAND, d1, folder=tmp_path / "anna")


@pytest.mark.usefixtures("soon_given_up")
def test_who_only_hears_statuses_that_their_drone_has_not_signed_is_told(tmp_path: Path) -> None:
    issuer = new_issuer("test")
    d2 = Drone("d2", own=identity(issuer, tmp_path, "d2"))
    identity(issuer, tmp_path, "anna", Role.OPERATOR)
    d2.forges = (Status(stamp_ns=1, drone="d1", mission=MISSION, boot="0" * 16, stage=Stage.PREFLIGHT),)
    with pytest.raises(CommandError, match=r"nothing heard from d1 .*; statuses were left out that d1 did not sign"):
        order(Action.LAND, d2, only=("d1",), folder=tmp_path / "anna")


@pytest.mark.parametrize("role", [Role.DRONE, Role.OBSERVER, Role.STATION])
def test_only_an_operators_certificate_commands(tmp_path: Path, role: Role) -> None:
    identity(new_issuer(), tmp_path, "anna", role)
    order = Order(Action.LAND, "test", ("tls/127.0.0.1:1",), identity=tmp_path / "anna")
    with pytest.raises(
        CommandError, match=rf"certificate\.pem: is the certificate of anna, whose role is {role}, not operator; run `"
    ):
        asyncio.run(groundcontrol.command(order, print))


@pytest.mark.usefixtures("soon_given_up")
def test_a_certificate_that_has_expired_is_named_once_nobody_is_heard(tmp_path: Path) -> None:
    identity(new_issuer(), tmp_path, "anna", Role.OPERATOR, from_ns=-100 * DAY_NS)
    order = Order(Action.LAND, "test", (f"tls/127.0.0.1:{free_ports(1)[0]}",), identity=tmp_path / "anna")
    with pytest.raises(CommandError, match=r"nothing heard .*anna/certificate\.pem is valid until .*this computer's clock shows"):
        asyncio.run(groundcontrol.command(order, print))


def test_a_certificate_that_the_drones_refuse_is_named_with_what_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    issuer = new_issuer()
    identity(issuer, tmp_path, "anna", Role.OPERATOR)
    identity(new_issuer("elsewhere"), tmp_path, "bert", Role.OPERATOR)
    monkeypatch.setattr(groundcontrol, "FIND_S", 0.6)
    monkeypatch.setattr(groundcontrol, "LISTEN_S", 0.5)
    with pytest.raises(CommandError) as refused:
        order(Action.LAND, Drone("d1", own=identity(issuer, tmp_path, "d1")), folder=tmp_path / "bert")
    assert f": its certificate is not of the authority in {tmp_path}/bert/ca.pem: take a folder of" in str(refused.value)
    assert "\n" not in str(refused.value)
    monkeypatch.setattr(groundcontrol, "FIND_S", 3.0)
    assert order(Action.LAND, Drone("d1", own=identity(issuer, tmp_path, "d1")), folder=tmp_path / "anna")[-1].endswith("landing")


@pytest.mark.usefixtures("soon_given_up")
def test_copies_keep_the_nonces_of_when_the_command_was_given_and_end_with_its_life(monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies with newer nonces would be obeyed long after the operator has given the command."""
    monkeypatch.setattr(groundcontrol, "REPEAT_S", 0.1)
    monkeypatch.setattr(groundcontrol, "LAPSE_S", 0.6)
    d1, periods = Drone("d1", lame=True), itertools.count()
    d1.nonce = lambda: f"{next(periods):016x}"
    assert "d1: land is not possible in preflight, or came too late and was dropped" in refused(Action.LAND, d1)
    assert len(d1.received) > 2
    assert len({message.to["d1"].nonce for message in d1.received}) == 1
    assert len(d1.received) <= 7  # none in the last 0.4 s of the wait


def test_a_ticket_is_that_of_the_time_at_which_the_command_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    statuses, clock_s = Statuses(), [100.0]
    monkeypatch.setattr("radron.agent.operator.statuses.elapsed_s", lambda: clock_s[0])
    for number in range(1, 6):
        ticket = Ticket(f"{number:016x}", number)
        status = Status(stamp_ns=number, drone="d1", mission=MISSION, boot="0" * 16, stage=Stage.TRACK, ticket=ticket)
        statuses.receive(key_of("test", status), encode(status))
        clock_s[0] += 1.0
    tickets = Tickets(statuses, ["d1", "d2"], 102.5)
    assert tickets.to(["d1", "d2"]) == {"d1": Ticket(f"{3:016x}", 3)}
    assert tickets.is_overtaken("d1")
    tickets.renumber(["d1"])
    assert tickets.to(["d1"]) == {"d1": Ticket(f"{3:016x}", 5)}  # the nonce ages on
    assert Tickets(statuses, ["d1"], 99.0).to(["d1"]) == {}  # it was not heard then


def test_a_command_is_not_repeated_to_a_drone_that_has_been_given_a_later_one() -> None:
    d1, d2, statuses, withdrawn = Drone("d1", lame=True), Drone("d2"), Statuses(), set[str]()
    said: list[str] = []

    async def run() -> None:
        async with d1.running(()), d2.running((d1.endpoint,)):
            mesh = await Mesh.open(MeshConfig(connect=(d1.endpoint, d2.endpoint)), "test", None, receive=statuses.receive)
            land = Order(Action.LAND, "test", (), ("d1", "d2"))
            landing = asyncio.create_task(groundcontrol.carry_out(land, mesh, None, statuses, said.append, withdrawn))
            await until(lambda: bool(d1.received))
            withdrawn.add("d1")
            await landing
            await mesh.close()

    asyncio.run(run())
    assert said[-1] == "land: d2 landing"


def test_a_command_whose_computer_sleeps_before_it_is_sent_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lid is closed while the drones are looked for, and opened ten minutes later."""
    slept_s = [0.0]
    monkeypatch.setattr(groundcontrol, "elapsed_s", lambda: elapsed_s() + slept_s[0])
    monkeypatch.setattr(groundcontrol, "LISTEN_S", 0.3)
    statuses, d1 = Statuses(), Drone("d1")

    async def run() -> None:
        async with d1.running(()):
            mesh = await Mesh.open(MeshConfig(connect=(d1.endpoint,)), "test", None, receive=statuses.receive)
            land = Order(Action.LAND, "test", ())
            landing = asyncio.create_task(groundcontrol.carry_out(land, mesh, None, statuses, print))
            await until(lambda: bool(statuses.heard()))
            slept_s[0] = 600.0
            try:
                with pytest.raises(CommandError, match=r"^land: nothing heard"):
                    await landing
            finally:
                await mesh.close()

    asyncio.run(run())
    assert d1.received == []
