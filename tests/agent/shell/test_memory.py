from pathlib import Path

import pytest

from radron.agent.shell.memory import Memory, MemoryWatch, read_memory


@pytest.mark.parametrize(
    ("total_mb", "available_mb", "warns"),
    [
        (1000.0, 310.0, False),
        (1000.0, 290.0, True),  # under 300 MB
        (8000.0, 1210.0, False),
        (8000.0, 1190.0, True),  # under 15 %
    ],
)
def test_it_warns_before_memory_runs_out(total_mb, available_mb, warns):
    watch = MemoryWatch(lambda: Memory(total_mb, available_mb))
    assert bool(watch.problems) == warns


def test_the_warning_says_what_and_what_to_do_and_stays_the_same():
    """Its text is logged whenever it changes."""
    available = iter((500.0, 299.0, 250.0, 310.0, 290.0, 340.0))
    watch = MemoryWatch(lambda: Memory(1900.0, next(available)))
    seen = [watch.problems for _ in range(6)]
    assert seen[0] == seen[5] == ()
    assert len({*seen[1:5]}) == 1
    assert "less than 300 of 1900 MB available" in seen[1][0]
    assert "end other programs or land soon" in seen[1][0]
    assert len(seen[1][0]) <= 256  # of a status message


def test_meminfo_is_read(tmp_path: Path):
    path = tmp_path / "meminfo"
    path.write_text("MemTotal:        1000000 kB\nMemFree:  9 kB\nMemAvailable:     250000 kB\nHugePages_Total:    0\n")
    assert read_memory(path) == Memory(1024.0, 256.0)
    path.write_text("MemTotal:        1000000 kB\n")
    assert read_memory(path) is None
    assert read_memory(tmp_path / "none") is None


def test_where_memory_is_unknown_nothing_is_said():
    assert MemoryWatch(lambda: None).problems == ()


def test_this_computer_has_memory():
    memory = read_memory()
    assert memory is not None
    assert 0.0 < memory.available_mb <= memory.total_mb
