"""Entries that come a little late: when their batch is folded, and what that saves."""

from radron.agent.fusion.lateness import Latecomers
from radron.protocol.entries import EntryId


def identity(number):
    return EntryId("m", 0, "d1", "0" * 16, number)


def test_a_batch_is_due_with_the_multiples_of_its_stride():
    waiting = Latecomers()
    waiting.add(identity(1), None, 1)
    waiting.add(identity(2), None, 5)  # 4 steps
    waiting.add(identity(3), None, 2)
    assert [len(waiting.taken(due - 1, due)) for due in range(9, 14)] == [0, 0, 0, 3, 0]
    assert not waiting
    waiting.add(identity(1), None, 1)
    assert len(waiting.taken(13, 13)) == 0
    assert len(waiting.taken(13, 14)) == 1


def test_what_is_very_late_does_not_wait_for_ever_nor_where_time_stands_still():
    waiting = Latecomers()
    waiting.add(identity(1), None, 10_000)
    assert len(waiting.taken(1, 17)) == 1
    waiting.add(identity(1), None, 3)
    assert [len(waiting.taken(20, 20)) for _ in range(9)] == [0] * 8 + [1]
    waiting.add(identity(1), None, 3)
    waiting.discard(identity(1))
    assert not waiting
