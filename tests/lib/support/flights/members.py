"""The members of a swarm with certificates, for tests of one pilot."""

from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.pilot import Pilot
from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Credential
from radron.protocol.keys import key_of
from radron.protocol.revocations import Revocation
from radron.protocol.signing import sign_command, sign_entries, sign_revocation
from radron.sim.lockstep.members import SimulatedAuthority, operator_of
from support.flights.one_pilot import MISSION, START_NS, boot_of, command, cone_of, nonce_key_of

AUTHORITY, FOREIGN = SimulatedAuthority(1), SimulatedAuthority(2)
OPERATOR = operator_of(AUTHORITY)
BOOT, LATER, NUMBERS = "2" * 16, "3" * 16, range(1, 11)  # of d2 in ``full``: its two boots, and the numbers of its cones


def trusting(drone="d1", boot=None, memory=None):
    """A pilot of a swarm with certificates."""
    trust = AUTHORITY.trust(drone)
    boot = boot or boot_of(drone)
    return Pilot(MISSION, DroneConfig(id=drone), boot=boot, memory=memory, trust=trust, nonce_key=nonce_key_of(boot))


def credential(drone="d2", boot=BOOT, trust=None, **changes):
    """The first entry of a boot, signed."""
    trust = trust or AUTHORITY.trust(drone)
    entry = Credential(
        stamp_ns=START_NS, drone=drone, mission=MISSION.mission_id, boot=boot, sequence=0, certificate=trust.certificate
    )
    return next(sign_entries([replace(entry, **changes)], trust.sign))


def cones(numbers, drone="d2", boot=BOOT, sign=None):
    """Cones published together."""
    entries = [cone_of(drone, number, START_NS + number * 200_000_000, boot) for number in numbers]
    return list(sign_entries(entries, sign or AUTHORITY.trust(drone).sign))


def give(one, *entries, now_ns=START_NS):
    """Deliver entries to a pilot."""
    for entry in entries:
        one.receive(*keyed(entry), now_ns)


def order(action, now_ns, trust=OPERATOR, **changes):
    """A signed command."""
    key, payload = command(action, stamp_ns=now_ns)
    message = replace(decode_from(key, payload), **{"station": "lockstep", **changes})
    message = sign_command(message, trust)
    return keyed(message)


def revocation(
    member="d2", last=None, stamp_ns=START_NS, trust=OPERATOR, until_ns=2 * START_NS, station=None, altered=None, **changes
):
    """A signed revocation, with its key; ``altered``, ``changes``: after it was signed."""
    station, last = station or trust.name, last or {}
    bare = Revocation(stamp_ns=stamp_ns, station=station, member=member, until_ns=until_ns, last=last, certificate=b"")
    message = replace(sign_revocation(bare, trust), **(altered or {}), **changes)
    return keyed(message)


def full(*, boot=None):
    """A pilot with the entries of d2, which has run twice."""
    one = trusting(boot=boot)
    give(one, credential(), *cones(NUMBERS), credential(boot=LATER), *cones(NUMBERS, boot=LATER))
    return one


def passed_on(one, now_ns=START_NS):
    """Keys and payloads that a pilot passes on."""
    return [(key, payload) for key, payload in one.step(now_ns).publications if key.endswith("/revoked")]


def keyed(message):
    """A message with its key."""
    return key_of(MISSION.swarm, message), encode(message)
