"""A station leaves the same entries out of the log as the drones."""

import pytest

from radron.protocol.codec import encode
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from radron.protocol.signing import Verifier, sign_status
from radron.station.picture.picture import Picture
from support.flights.members import AUTHORITY, FOREIGN, cones, credential, give, revocation, trusting
from support.flights.one_pilot import MISSION, START_NS

ENTRIES = [credential(), *cones(range(1, 11))]
REVOCATION = revocation(last={"2" * 16: 6})
BARE = Status(stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK)
STATUS = sign_status(BARE, AUTHORITY.trust("d2"))


def pictured(*revocations, first=()):
    picture = Picture(MISSION, Verifier(AUTHORITY))
    for key, payload in (*first, *((key_of(MISSION.swarm, entry), encode(entry)) for entry in ENTRIES), *revocations):
        picture.receive(key, payload, START_NS)
    picture.advance(START_NS)
    return picture


def test_the_digest_is_that_of_the_drones_whichever_came_first():
    pilot = trusting()
    give(pilot, *ENTRIES)
    assert pictured().log.fusion.digest == pilot.digest
    pilot.receive(*REVOCATION, START_NS)
    pilot.advance(START_NS)
    assert pictured(REVOCATION).log.fusion.digest == pictured(first=[REVOCATION]).log.fusion.digest == pilot.digest
    assert len(pictured(REVOCATION).log.fusion.log) == 7


def test_a_forged_revocation_changes_nothing():
    forged = revocation(trust=FOREIGN.trust("lockstep", Role.OPERATOR, may_revoke=True))
    assert pictured(forged).log.fusion.digest == pictured().log.fusion.digest


def test_news_of_the_revoked_are_dropped():
    for revocations, stage in (((), "track"), ((REVOCATION,), "")):
        picture = pictured(*revocations)
        picture.receive(key_of(MISSION.swarm, STATUS), encode(STATUS), START_NS)
        assert [drone.stage for drone in picture.frame(START_NS).drones if drone.id == "d2"] == [stage]


@pytest.mark.parametrize("forged", [BARE, sign_status(BARE, AUTHORITY.trust("d3")), sign_status(BARE, FOREIGN.trust("d2"))])
def test_a_status_that_its_drone_has_not_signed_is_dropped_and_counted(forged):
    for status, stage, count in ((STATUS, "track", 0), (forged, "", 1)):
        picture = pictured()
        picture.receive(key_of(MISSION.swarm, status), encode(status), START_NS)
        assert [drone.stage for drone in picture.frame(START_NS).drones if drone.id == "d2"] == [stage]
        assert picture.counters["forged"] == count
