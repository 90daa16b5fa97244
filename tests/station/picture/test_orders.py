"""Origin of commands at a station: from signed orders and from the drones' statuses."""

import pytest
from msgspec.structs import replace

from radron.protocol.codec import encode
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Answer, Obeyed, Stage, Status, Ticket, Upload
from radron.protocol.signing import Verifier, sign_command, sign_status
from radron.station.findings.facts import BY_DRONES, UNHEARD, of_station
from radron.station.picture.orders import MAX_OBEYED_OF_DRONE, MAX_REFUSED_ORDERS, OBEYED, OVERTAKEN, TAKEN, UNSURE
from radron.station.picture.picture import Picture
from support.flights.members import AUTHORITY, FOREIGN, OPERATOR, order, revocation
from support.flights.one_pilot import MISSION, SECOND, START_NS

D1, D2 = {"d1": Ticket("0" * 16, 5)}, {"d2": Ticket("0" * 16, 9)}
TOWER = AUTHORITY.trust("tower", Role.OPERATOR)


@pytest.fixture
def picture():
    return Picture(MISSION, Verifier(AUTHORITY))


def status(drone, number, after_s, **changes):
    told = {"mission": MISSION.mission_id, "boot": "0" * 16, "stage": Stage.HOLD, "ticket": Ticket("0" * 16, number), **changes}
    return sign_status(Status(stamp_ns=START_NS + after_s * SECOND, drone=drone, **told), AUTHORITY.trust(drone))


def hear(picture, message, after_s):
    picture.receive(key_of(MISSION.swarm, message), encode(message), START_NS + after_s * SECOND)


def told(picture):
    """By action and drone, what became of each order."""
    return {(one.action, drone): one.results.get(drone) for one in picture.orders.heard for drone in one.numbers}


def hold(after_s=0, **changes):
    return order(Action.HOLD, START_NS + after_s * SECOND, **{"to": D1 | D2, **changes})


def test_an_order_that_names_number_0_is_an_old_one(picture):
    picture.receive(*hold(to={"d1": Ticket("0" * 16, 0)}), START_NS)
    assert told(picture) == {("hold", "d1"): UNSURE}


def test_who_commanded_what_and_which_drones_have_obeyed(picture):
    picture.receive(*hold(), START_NS)
    picture.receive(*hold(), START_NS + SECOND)  # a copy
    assert told(picture) == {("hold", "d1"): None, ("hold", "d2"): None}
    hear(picture, status("d1", 6, 1), 1)
    hear(picture, status("d2", 9, 1), 1)
    assert told(picture) == {("hold", "d1"): OBEYED, ("hold", "d2"): None}
    (heard,) = picture.orders.heard
    assert (heard.station, heard.copies, heard.last_ns - heard.first_ns) == ("lockstep", 2, SECOND)
    rows = of_station({}, picture.orders).commands
    assert [(drone, row.station, row.result) for drone, row in rows] == [
        ("d1", "lockstep", OBEYED),
        ("d2", "lockstep", UNHEARD),
    ]
    assert rows[0][1].signer.startswith("operator lockstep, serial ")


def test_orders_that_come_together_are_not_told_apart_beyond_what_is_known(picture):
    picture.receive(*hold(), START_NS)
    picture.receive(*order(Action.RESUME, START_NS, TOWER, station="tower", to=D1), START_NS)
    hear(picture, status("d1", 6, 1), 1)  # either of the two
    assert told(picture)["hold", "d1"] == told(picture)["resume", "d1"] == UNSURE
    later = {"d1": Ticket("0" * 16, 6)}
    picture.receive(*order(Action.LAND, START_NS + 2 * SECOND, to=later), START_NS + 2 * SECOND)
    hear(picture, status("d1", 7, 3), 3)
    assert told(picture)["land", "d1"] == OBEYED


def test_an_order_that_was_carried_out_before_or_is_long_over_is_not_told_to_be_obeyed(picture):
    hear(picture, status("d1", 6, 0), 0)
    picture.receive(*hold(to=D1), START_NS)
    assert told(picture) == {("hold", "d1"): UNSURE}
    picture.receive(*order(Action.LAND, START_NS, to=D2), START_NS)
    hear(picture, status("d2", 10, 40), 40)  # after some other command
    assert told(picture)["land", "d2"] is None


def test_an_order_that_only_its_effect_tells_of_is_another_stations(picture):
    for after_s, number in ((0, 5), (1, 6), (3, 6), (7, 6), (9, 6)):
        hear(picture, status("d1", number, after_s), after_s)
    (heard,) = picture.orders.heard
    assert (heard.station, heard.action, heard.results) == ("another station", "an order, then hold", {"d1": OBEYED})
    assert heard.first_ns == START_NS + SECOND


def test_an_order_that_comes_after_the_status_of_its_drone_is_that_stations(picture):
    hear(picture, status("d1", 5, 0), 0)
    hear(picture, status("d1", 6, 1), 1)
    picture.receive(*hold(to=D1), START_NS + 2 * SECOND)
    hear(picture, status("d1", 6, 9), 9)
    assert [(one.station, one.results) for one in picture.orders.heard] == [("lockstep", {"d1": OBEYED})]


def test_orders_that_no_drone_obeys_are_told_with_the_reason(picture):
    picture.receive(*hold(trust=AUTHORITY.trust("lockstep", Role.OBSERVER)), START_NS)
    picture.receive(*hold(trust=FOREIGN.trust("lockstep", Role.OPERATOR)), START_NS)
    picture.receive(*revocation(member="tower"), START_NS)
    picture.receive(*order(Action.LAND, START_NS, TOWER, station="tower", to=D1), START_NS)
    hear(picture, status("d1", 6, 1), 1)
    results = {(row.station, row.result) for _, row in of_station({}, picture.orders).commands}
    assert results == {
        ("lockstep", "refused: its certificate is not an operator's, but of the role observer"),
        ("lockstep", "refused: its certificate is none of this swarm's"),
        ("tower", "refused: its certificate has been revoked"),
    }
    events = picture.events(picture.frame(START_NS))
    assert [(event.text, event.level) for event in events if "order" in event.text] == [("order refused", "warning")] * 3


def test_orders_are_news_once_except_the_own_ones(picture):
    picture.orders.own = "tower"
    picture.receive(*order(Action.LAND, START_NS, TOWER, station="tower", to=D1), START_NS)
    for _ in range(2):
        picture.receive(*hold(), START_NS)
    news = [event.values for event in picture.events(picture.frame(START_NS)) if event.text == "order"]
    assert news == [{"station": "lockstep", "action": "hold", "drones": "d1, d2"}]
    assert not any(event.text == "order" for event in picture.events(picture.frame(START_NS + 1)))
    assert len(picture.orders.heard) == 2


@pytest.mark.parametrize(("refused", "result"), [("", TAKEN), ("its vehicle is armed", "refused: its vehicle is armed")])
def test_an_upload_is_told_with_the_drones_answers(picture, refused, result):
    mission = replace(MISSION, name="other")
    bare = Upload(stamp_ns=START_NS, station="lockstep", mission=mission.mission_id, to=D1, parts=(bytes(32),))
    hear(picture, sign_command(bare, OPERATOR), 0)
    hear(picture, status("d1", 5, 0), 0)
    answer = Answer(START_NS, mission.mission_id, refused)
    hear(picture, status("d1", 6, 1, upload=answer, obeyed=Obeyed("upload", "lockstep", START_NS, 5)), 1)
    assert told(picture.of(mission)) == {(f"upload {mission.mission_id}", "d1"): result}


def test_an_upload_by_another_station_that_a_drone_then_refuses_is_not_told_as_obeyed(picture):
    hear(picture, status("d1", 5, 0), 0)
    answer = Answer(START_NS + SECOND, MISSION.mission_id, "its parts do not come")
    hear(picture, status("d1", 6, 1, upload=answer, obeyed=obeyed(5, "upload", after_s=1)), 1)
    ((_, row),) = of_station({}, picture.orders).commands
    assert (row.action, row.result) == ("upload", "refused: its parts do not come")


def test_a_flood_of_orders_that_nobody_obeys_is_kept_in_bounds(picture):
    trust = AUTHORITY.trust("d1")
    for number in range(MAX_REFUSED_ORDERS + 20):
        picture.receive(*hold(station=f"s{number}", trust=trust), START_NS)
        picture.receive(*hold(station=f"s{number}", trust=trust, after_s=1), START_NS)
    assert len(picture.orders.heard) == MAX_REFUSED_ORDERS


def obeyed(number=5, order="hold", station="bert", after_s=0):
    return Obeyed(order, station, START_NS + after_s * SECOND, number)


def events(picture, after_s):
    return [event.values for event in picture.events(picture.frame(START_NS + after_s * SECOND)) if event.text == "order told"]


def test_drones_name_the_operator_whose_station_is_not_linked_to_this_one(picture):
    for drone, number in (("d1", 5), ("d2", 9)):
        hear(picture, status(drone, number, 0), 0)
    hear(picture, status("d1", 6, 2, obeyed=obeyed(5, after_s=1)), 2)
    assert events(picture, 2) == []  # the other drones may have obeyed too
    hear(picture, status("d2", 10, 3, obeyed=obeyed(9, after_s=1)), 3)
    hear(picture, status("d1", 6, 3, obeyed=obeyed(5, after_s=1)), 3)
    assert events(picture, 4) == [{"station": "bert", "action": "hold", "drones": "d1, d2"}]
    assert events(picture, 5) == []
    rows = of_station({}, picture.orders).commands
    assert [(drone, row.first_ns, row.station, row.signer, row.action, row.result, row.copies) for drone, row in rows] == [
        (drone, START_NS + 2 * SECOND, "bert", BY_DRONES, "hold", OBEYED, 1) for drone in ("d1", "d2")
    ]


def test_what_was_obeyed_before_the_station_came_has_the_time_of_the_order(picture):
    hear(picture, status("d1", 6, 60, obeyed=obeyed(5, after_s=10)), 60)
    hear(picture, status("d2", 6, 61, obeyed=obeyed(5, "land", after_s=500)), 61)  # by a wrong clock
    assert [(one.action, one.first_ns - START_NS) for one in picture.orders.heard] == [
        ("hold", 10 * SECOND),
        ("land", 61 * SECOND),
    ]
    told_ms = [event.at_ms for event in picture.events(picture.frame(START_NS + 70 * SECOND)) if event.text == "order told"]
    assert told_ms == [(START_NS + after_s * SECOND) // 1_000_000 for after_s in (10, 61)]


def test_an_order_that_comes_before_or_after_what_the_drones_tell_of_it_is_one_order(picture):
    hear(picture, status("d1", 6, 1, obeyed=obeyed(5, station="lockstep")), 1)
    picture.receive(*hold(), START_NS + SECOND)
    hear(picture, status("d2", 10, 2, obeyed=obeyed(9, station="lockstep")), 2)
    (heard,) = picture.orders.heard
    assert (heard.results, heard.copies, heard.told) == ({"d1": OBEYED, "d2": OBEYED}, 1, False)
    assert heard.signer.name == "lockstep"
    assert events(picture, 9) == []  # reported like any received order


@pytest.mark.parametrize("is_late", [False, True])
def test_of_two_orders_at_once_the_drone_names_the_one_that_it_obeys(picture, is_late):
    picture.receive(*hold(to=D1), START_NS)
    other = order(Action.RESUME, START_NS, TOWER, station="tower", to=D1)
    if not is_late:
        picture.receive(*other, START_NS)
    hear(picture, status("d1", 6, 1, obeyed=obeyed(5, station="lockstep")), 1)
    if is_late:
        picture.receive(*other, START_NS + 2 * SECOND)
    assert told(picture) == {("hold", "d1"): OBEYED, ("resume", "d1"): OVERTAKEN}


def test_an_obeyed_order_that_its_drone_has_not_signed_or_that_does_not_fit_is_not_believed(picture):
    hear(picture, status("d1", 5, 0), 0)
    signed = status("d1", 6, 1, obeyed=obeyed(5))
    hear(picture, replace(signed, obeyed=replace(signed.obeyed, station="anna")), 1)
    hear(picture, status("d1", 6, 2, obeyed=obeyed(4)), 2)  # of another number than the status
    assert picture.orders.heard == ()


def test_a_drone_that_names_one_operator_after_another_is_kept_in_bounds(picture):
    for number in range(1, MAX_OBEYED_OF_DRONE + 20):
        hear(picture, status("d1", number + 1, number, obeyed=obeyed(number, station=f"s{number}")), number)
    assert len(picture.orders.heard) == MAX_OBEYED_OF_DRONE
