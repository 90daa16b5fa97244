"""When late entries are taken: at borders that are the same for all, at rest for as long as the last batch took."""

from radron.agent.frames.batches import Batches

TICK_NS = 50_000_000


def due(batches, ticks, free=True):
    return [tick for tick in ticks if batches.are_due(tick * TICK_NS, free=free)]


def test_batches_are_due_at_the_same_times_whenever_one_began():
    one, other = Batches(), Batches()
    assert due(one, range(11, 140)) == [50, 90, 130]
    assert due(other, range(73, 140)) == [73, 90, 130]  # after a start, all there is may be taken at once


def test_who_is_not_free_at_a_border_takes_the_batch_as_soon_as_it_is():
    batches = Batches()
    assert due(batches, range(11, 55), free=False) == []
    assert due(batches, range(55, 140)) == [55, 90, 130]


def test_a_batch_rests_for_as_long_as_the_last_one_took():
    batches = Batches()
    due(batches, range(11, 91))
    batches.took(39)
    assert due(batches, range(91, 171)) == [130, 170]
    batches.took(44)
    assert batches.is_resting
    assert due(batches, range(171, 251)) == [214, 250]


def test_where_time_stands_still_batches_are_taken_all_the_same():
    batches = Batches()
    assert sum(batches.are_due(TICK_NS, free=True) for _ in range(200)) == 5  # the first at once
