"""Nonces: valid for a while, and unknown to everybody before the drone publishes them."""

from radron.agent.config.drone import DroneConfig
from radron.agent.mission.orders import NONCE_NS, Orders
from radron.agent.owntime import Utc
from radron.agent.pilot import Pilot
from radron.protocol.messages import Action, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, command, messages, state
from support.flights.one_pilot import pilot as one_pilot


def nonces(key, boot_ns=START_NS, periods=50):
    orders = Orders("d1", MISSION.mission_id, key, None, Utc())
    return [orders.ticket(boot_ns + period * NONCE_NS).nonce for period in range(periods)]


def test_nonces_of_agents_started_at_the_same_time_have_nothing_in_common():
    first, second = nonces(b"1" * 16), nonces(b"2" * 16)
    assert len({*first, *second}) == 100


def test_the_same_key_gives_the_same_nonces_for_a_replay():
    assert nonces(b"1" * 16) == nonces(b"1" * 16)


def test_a_command_with_a_nonce_computed_from_boot_and_time_is_refused_and_one_with_the_told_nonce_obeyed():
    """The published boot and clock once sufficed to compute a valid nonce."""
    boot = "0" * 15 + "1"
    one = Pilot(MISSION, DroneConfig(id="d1"), boot=boot, nonce_key=b"drawn at random.")
    one.observe_vehicle(state(START_NS))
    predicted = command(Action.LAND, stamp_ns=START_NS, boot=boot)
    one.receive(*predicted, START_NS)
    assert (one.stage, one.counters["dropped_command_too_old"]) == (Stage.PREFLIGHT, 1)
    told = one_pilot(boot=boot)  # a pilot with a key known to the test
    told.observe_vehicle(state(START_NS))
    told.receive(*command(stamp_ns=START_NS, boot=boot), START_NS)
    assert told.stage is not Stage.PREFLIGHT


def test_a_status_tells_no_nonce_of_later():
    one = one_pilot()
    one.observe_vehicle(state(START_NS))
    (status,) = messages(one.step(START_NS), Status)
    later = one.ticket(START_NS + 2 * NONCE_NS + SECOND).nonce
    assert status.ticket is not None
    assert status.ticket.nonce != later
