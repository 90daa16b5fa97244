from itertools import pairwise

import numpy as np
import pytest

from agent.detector import t3pa
from agent.detector.t3pa import T3paReader, readouts
from agent.errors import DetectorError

HEADER = "Index\tMatrix Index\tToA\tToT\tFToA\tOverflow"


def write(path, rows, header=HEADER, end="\n"):
    """(matrix index, toa, tot, ftoa, overflow) rows."""
    lines = [header, *("\t".join(map(str, (number, *row))) for number, row in enumerate(rows))]
    path.write_bytes((end.join(lines) + end).encode())
    return path


def read(path, **options):
    pieces = list(T3paReader(path, **options))
    return (
        np.concatenate([piece.hits.tick for piece in pieces]),
        np.concatenate([piece.hits.index for piece in pieces]),
        np.concatenate([piece.hits.tot for piece in pieces]),
        sum(piece.overflow_rows for piece in pieces),
        sum(piece.lost_ns for piece in pieces),
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / "hits.t3pa"


@pytest.fixture
def small_pieces(monkeypatch):
    monkeypatch.setattr(t3pa, "_PIECE_BYTES", 200)


def test_rows_become_hits(path):
    tick, index, tot, overflow, lost = read(write(path, [(5, 100, 30, 0, 0), (65535, 101, 1022, 31, 0)]))
    assert tick.tolist() == [1600, 16 * 101 - 31]
    assert index.tolist() == [5, 65535]
    assert tot.tolist() == [30, 1022]
    assert (overflow, lost) == (0, 0)


def test_pieces_join_without_seams(path, small_pieces):
    rng = np.random.default_rng(1)
    rows = np.column_stack(
        (rng.integers(0, 65536, 300), np.sort(rng.integers(0, 10**9, 300)), rng.integers(0, 1023, 300), rng.integers(0, 32, 300))
    )
    write(path, [(*row, 0) for row in rows.tolist()])
    reader = T3paReader(path)
    pieces = list(reader)
    assert len(pieces) > 20
    assert max(len(piece.hits) for piece in pieces) < 30  # memory goes with the piece, not with the file
    assert reader.rows == 300
    assert reader.position_bytes == reader.size_bytes == path.stat().st_size
    tick, index, tot, *_ = read(path)
    np.testing.assert_array_equal(tick, 16 * rows[:, 1] - rows[:, 3])
    np.testing.assert_array_equal(index, rows[:, 0])
    np.testing.assert_array_equal(tot, rows[:, 2])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_columns_are_found_by_name(path, end):
    header = end.join(["\ufeffToA\tFToA\tToT\tNote\tMatrix Index\tOverflow", "100\t3\t20\t9\t513\t0", ""])
    path.write_bytes(header.encode())
    tick, index, tot, *_ = read(path)
    assert (tick.tolist(), index.tolist(), tot.tolist()) == ([1597], [513], [20])


def test_a_file_without_hits(path):
    write(path, [])
    assert list(T3paReader(path)) == []
    assert list(readouts(T3paReader(path))) == []


def test_rows_of_lost_data_are_no_hits(path):
    rows = [(1, 1_000_000, 9, 0, 0), (0x74, 5, 0, 0, 1), (0x75, 400_000, 0, 0, 1), (2, 1_500_000, 9, 0, 0)]
    tick, index, _, overflow, lost = read(write(path, rows))
    assert index.tolist() == [1, 2]
    assert tick.tolist() == [16_000_000, 24_000_000]
    assert (overflow, lost) == (2, 400_000 * 25)


def test_readouts_are_gap_free_and_count_the_missing_time(path, small_pieces):
    rows = [(i, 1_000_000 + 40_000 * i, 9, 0, 0) for i in range(100)]
    rows.insert(50, (0x75, 400_000, 0, 0, 1))
    parts = list(readouts(T3paReader(write(path, rows)), clock_ns=777))
    start_ns = 777 + 1_000_000 * 25
    assert parts[0].start_ns == start_ns  # of the first hit, however long the detector's clock ran before
    assert all(a.end_ns == b.start_ns for a, b in pairwise(parts))
    assert parts[-1].end_ns == 777 + (1_000_000 + 40_000 * 99) * 25 + 1
    assert sum(len(part.hits) for part in parts) == 100
    assert sum(part.lost_hits for part in parts) == 1
    assert sum(part.live_time_s for part in parts) == pytest.approx((parts[-1].end_ns - start_ns) * 1e-9 - 0.01)


@pytest.mark.parametrize("bits", [14, 30])
@pytest.mark.parametrize("told", [True, False])
def test_a_wrapping_time_goes_on(path, small_pieces, bits, told):
    rng = np.random.default_rng(bits)
    gaps = rng.integers(0, (1 << bits) // 3, 200)
    true = (1 << (bits - 1)) + np.cumsum(gaps) + rng.integers(-40, 40, 200)  # nearly in order
    write(path, [(7, int(toa) % (1 << bits), 9, 0, 0) for toa in true])
    tick, *_ = read(path, toa_bits=bits if told else None)
    np.testing.assert_array_equal(tick, 16 * true)


def test_disorder_is_no_wrap(path):
    toa = [500, 40_000, 38_000, 41_000, 33_000, 42_000]  # back by less than 2^13
    tick, *_ = read(write(path, [(7, value, 9, 0, 0) for value in toa]))
    assert tick.tolist() == [16 * value for value in toa]


def test_a_time_that_starts_anew_is_refused(path):
    toa = [1_000_000, 400_000_000, 3_000, 4_000]
    with pytest.raises(DetectorError, match=r"line 4: ToA falls back by 10 s, .* one measurement"):
        read(write(path, [(7, value, 9, 0, 0) for value in toa]))


def test_a_time_beyond_the_counter_is_refused(path):
    with pytest.raises(DetectorError, match=r"line 3: ToA does not fit a counter of 14 bits"):
        read(write(path, [(7, 5, 9, 0, 0), (7, 16384, 9, 0, 0)]), toa_bits=14)


@pytest.mark.filterwarnings("error")
def test_empty_lines_are_no_rows(path):
    path.write_text(write(path, []).read_text() + 9 * "\n")
    with pytest.raises(DetectorError, match=r"line 2: not a row of whole numbers"):
        read(path)


def spoiled(path, line, text):
    """A file of 100 rows of which the given line (from 1, the header) reads otherwise."""
    write(path, [(i, 1000 * i, 9, 0, 0) for i in range(100)])
    lines = path.read_text().split("\n")
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("line", "text", "expected"),
    [
        (57, "55\t3\t1\t2\t3", "line 57: not a row of whole numbers.*'55.*3'"),
        (57, "", "line 57: not a row of whole numbers.*''"),
        (2, "\x00\x01\x02", "line 2: not a row of whole numbers"),
        (100, "98\t3\t1.5\t2\t3\t0", "line 100: not a row of whole numbers"),
        (60, "58\t-3\t1\t2\t3\t0", "line 60: the matrix index is not in"),
        (60, "58\t65536\t1\t2\t3\t0", "line 60: the matrix index is not in 0 .. 65535"),
        (60, "58\t3\t1\t2\t32\t0", "line 60: FToA is not in 0 .. 31"),
        (60, "58\t3\t1\t99999\t3\t0", "line 60: ToT is out of range"),
        (60, "58\t3\t1\t2\t3\t2", "line 60: Overflow is not 0 or 1"),
        (60, "58\t3\t123456789012345678901234567890\t2\t3\t0", "line.? .*too large"),
        (1, "Index\tMatrix Index\tToT", "line 1: not the header of a .t3pa file .no column 'toa'"),
        (1, "\x89PNG", "line 1: not the header"),
    ],
)
def test_a_foreign_row_is_named_by_its_line(path, small_pieces, line, text, expected):
    with pytest.raises(DetectorError, match=expected):
        read(spoiled(path, line, text))


@pytest.mark.parametrize("missing", [2, 6, 9])
def test_an_interrupted_last_row_is_left_out_and_told(path, small_pieces, missing):
    write(path, [(i, 1000 * i, 9, 0, 0) for i in range(100)])
    path.write_bytes(path.read_bytes()[:-missing])
    reader = T3paReader(path)
    assert sum(len(piece.hits) for piece in reader) == 99
    assert reader.torn
    assert reader.rows == 99
    assert reader.position_bytes == reader.size_bytes


def test_a_whole_file_is_not_torn(path):
    reader = T3paReader(write(path, [(1, 2, 3, 4, 0)]))
    list(reader)
    assert not reader.torn


@pytest.mark.parametrize(
    ("header", "tail"), [(HEADER, "\t"), (HEADER + "\tComment", "\tfirst light"), (HEADER + "\tx", "\t1.5\t\t7"), (HEADER, "\t0")]
)
def test_further_columns_are_ignored(path, header, tail):
    path.write_text(f"{header}\n0\t5\t100\t30\t0\t0{tail}\n1\t6\t101\t31\t0\t0\n")
    tick, index, *_ = read(path)
    assert tick.tolist() == [1600, 1616]
    assert index.tolist() == [5, 6]


def test_a_last_row_without_its_newline_is_whole(path):
    write(path, [(1, 2, 3, 4, 0), (5, 6, 7, 8, 0)])
    path.write_bytes(path.read_bytes().rstrip())
    assert len(read(path)[0]) == 2


def test_a_missing_file(path):
    with pytest.raises(DetectorError, match="cannot be read: No such file"):
        T3paReader(path)
