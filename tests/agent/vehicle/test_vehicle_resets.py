"""Epochs: a new one after a reset that moved the autopilot's frame, and only then."""

from math import pi

import pytest

from radron.agent.vehicle.resets import LATE_S, SETTLE_S, Resets

STEP_S = 1 / 30
STILL = (0.0, 0.0, 0.0)


class Rig:
    """A vehicle that flies north at 2 m/s and turns at 0.5 rad/s, by 30 positions a second and as many counts."""

    def __init__(self, resets: Resets | None = None) -> None:
        self.resets = resets or Resets()
        self.time_s = 100.0
        self.count = 7
        self.offset_m = self.offset_rad = 0.0
        self.judged: list[bool | None] = []

    def fly(self, seconds: float, counting: bool = True) -> list[bool | None]:
        self.judged = []
        for _ in range(round(seconds / STEP_S)):
            self.time_s += STEP_S
            if counting:
                self.resets.take_count(self.count, self.time_s)
            north_m, yaw = 2.0 * self.time_s + self.offset_m, 0.5 * self.time_s + self.offset_rad
            self.judged.append(self.resets.judge(self.time_s, (north_m, 0.0, -3.0), (2.0, 0.0, 0.0), yaw, 0.5))
        return self.judged


@pytest.mark.parametrize("count_first", [True, False])
@pytest.mark.parametrize(("metres", "radians"), [(15.0, 0.0), (0.6, 0.0), (0.0, 0.1), (0.0, pi)])
def test_a_jump_with_a_reset_is_another_frame_once(count_first: bool, metres: float, radians: float) -> None:
    rig = Rig()
    assert set(rig.fly(1.0)) == {False}
    rig.count += 1
    if count_first:
        rig.resets.take_count(rig.count, rig.time_s)
    rig.offset_m, rig.offset_rad = metres, radians
    first = rig.fly(2 * STEP_S, counting=count_first)
    assert first[0] is None  # no action on a position of unknown origin
    rest = [*first, *rig.fly(1.0)]
    assert rest.count(True) == 1
    assert rig.resets.moved == (metres > 0.0)
    assert 0 < rest.index(True) * STEP_S <= SETTLE_S + 3 * STEP_S
    assert set(rest[rest.index(True) + 1 :]) == {False}


@pytest.mark.parametrize("radians", [0.1, pi])
def test_heading_reset_turns_no_frame_whose_axes_are_fixed(radians: float) -> None:
    rig = Rig(Resets(axes_fixed=True))
    rig.fly(0.5)
    rig.count, rig.offset_rad = 8, radians
    assert set(rig.fly(1.0)) == {False}  # no position is held back either
    rig.count, rig.offset_m = 9, 15.0
    assert rig.fly(1.0).count(True) == 1


def test_a_reset_that_moves_nothing_is_none() -> None:
    rig = Rig()
    rig.fly(0.5)
    rig.count = 10
    assert set(rig.fly(1.0)) == {False}


def test_a_jump_without_a_reset_is_passed_on_after_a_moment() -> None:
    rig = Rig()
    rig.fly(0.5)
    rig.offset_m = 15.0
    judged = rig.fly(1.0)
    assert set(judged) == {None, False}
    assert judged.count(None) * STEP_S <= LATE_S + STEP_S
    assert judged[-1] is False


def test_an_autopilot_that_counts_no_resets_is_never_held_back() -> None:
    rig = Rig()
    rig.fly(0.5, counting=False)
    rig.offset_m = 15.0
    assert set(rig.fly(0.5, counting=False)) == {False}


def test_a_reset_when_satellites_are_lost_is_another_frame() -> None:
    rig = Rig()
    rig.resets.take_satellites(True)
    rig.fly(0.5)
    rig.resets.take_satellites(False)
    assert set(rig.fly(0.5)) == {False}  # still flying by its former knowledge
    rig.count += 1
    assert rig.fly(1.0).count(True) == 1
    rig.count += 1
    assert set(rig.fly(1.0)) == {False}
    rig.resets.take_satellites(True)  # satellites come a little later than the reset, once a second
    assert rig.fly(1.0).count(True) == 1


def test_a_gap_in_the_telemetry_is_no_jump() -> None:
    rig = Rig()
    rig.fly(0.5)
    rig.count += 1
    rig.time_s += 1.0
    rig.offset_m = 3.0  # braked and turned meanwhile
    rig.offset_rad = 1.0
    assert set(rig.fly(0.5)) == {False}


def test_the_count_wraps_and_may_be_remembered_over_a_restart() -> None:
    assert set(Rig(Resets(7)).fly(0.5)) == {False}
    assert Rig(Resets(6)).fly(0.5).count(True) == 1  # one for any number of unobserved resets
    rig = Rig()
    rig.count = 255
    rig.fly(0.5)
    rig.count, rig.offset_m = 0, 3.0
    assert rig.fly(0.5).count(True) == 1
