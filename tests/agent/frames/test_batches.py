"""When late entries are taken: at borders that are the same for all, at rest for as long as the last batch took."""

from agent.frames.batches import Batches

TICK_NS = 50_000_000


def due(batches, ticks):
    return [tick for tick in ticks if batches.are_due(tick * TICK_NS)]


def test_batches_are_due_at_the_same_times_whenever_one_began():
    one, other = Batches(), Batches()
    assert due(one, range(1, 130)) == [40, 80, 120]
    assert due(other, range(63, 130)) == [63, 80, 120]  # who has just started may take what there is at once


def test_a_batch_that_took_long_has_borders_left_out():
    batches = Batches()
    due(batches, range(1, 81))
    batches.took(39)
    assert due(batches, range(81, 161)) == [120, 160]
    batches.took(41)
    assert due(batches, range(161, 241)) == [240]


def test_where_time_stands_still_batches_are_taken_all_the_same():
    batches = Batches()
    assert sum(batches.are_due(TICK_NS) for _ in range(200)) == 4
