import pytest

from radron.station.outbox import MAX_AHEAD, MAX_PASSING, MAX_WAITING, Page


def taken(page):
    """All that is sent now."""
    return list(iter(page.take, None))


def test_of_what_is_replaced_only_the_newest_is_sent_and_what_must_come_comes_first():
    page = Page()
    for number in range(100):
        page.show("frame", b"frame %d" % number)
        page.show("dose", b"dose %d" % number)
    page.send(b"event")
    assert taken(page) == [b"event", b"frame 99", b"dose 99"]


def test_a_page_that_does_not_draw_gets_a_few_frames_and_goes_on_once_it_does():
    page = Page()
    for number in range(10):
        page.show("frame", b"%d" % number)
        page.pass_by(b"cone")
        assert taken(page) == ([b"cone", b"%d" % number] if number < MAX_AHEAD else [])
    page.send(b"event")
    assert taken(page) == [b"event"]
    page.drawn()
    assert taken(page) == [b"cone"] * (10 - MAX_AHEAD) + [b"9"]


def test_of_what_it_can_do_without_the_oldest_is_dropped():
    page = Page()
    for number in range(2 * MAX_PASSING):
        page.pass_by(b"%d" % number)
    assert taken(page) == [b"%d" % number for number in range(MAX_PASSING, 2 * MAX_PASSING)]
    assert not page.left.is_set()


@pytest.mark.parametrize(("count", "gone"), [(MAX_WAITING, False), (MAX_WAITING + 1, True)])
def test_a_page_that_is_far_behind_with_what_must_come_is_let_go(count, gone):
    page = Page()
    for _ in range(count):
        page.send(b"event")
    assert page.left.is_set() is gone
