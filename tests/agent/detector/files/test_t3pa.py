import lzma
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from radron.agent.detector.files import t3pa
from radron.agent.detector.files.t3pa import T3paReader, readouts
from radron.agent.errors import DetectorError

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
        sum(piece.lost_hits for piece in pieces),
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
    toa = np.sort(rng.integers(0, 10**9, 3000))
    rows = np.column_stack((rng.integers(0, 65536, 3000), toa, rng.integers(0, 1023, 3000), rng.integers(0, 32, 3000)))
    write(path, [(*row, 0) for row in rows.tolist()])
    reader = T3paReader(path)
    pieces = list(reader)
    assert len(pieces) > 20
    assert max(len(piece.hits) for piece in pieces[1:]) < 30  # memory goes with the piece, not with the file
    assert reader.rows == 3000
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
    with pytest.raises(DetectorError, match=r"line 4: ToA falls back by 10 s, .* a file of its own"):
        read(write(path, [(7, value, 9, 0, 0) for value in toa]))


def test_a_time_beyond_the_counter_is_refused(path):
    with pytest.raises(DetectorError, match=r"line 3: ToA does not fit a counter of 14 bits"):
        read(write(path, [(7, 5, 9, 0, 0), (7, 16384, 9, 0, 0)]), toa_bits=14)


@pytest.mark.filterwarnings("error")
def test_blank_lines_are_skipped(path):
    path.write_text(write(path, [(5, 100, 30, 0, 0)]).read_text() + 9 * "\n" + "1\t6\t101\t30\t0\t0\n" + "  \n")
    tick, index, *_ = read(path)
    assert (tick.tolist(), index.tolist()) == ([1600, 1616], [5, 6])


def spoiled(path, line, text):
    """A file of 100 rows with the given line (from 1, the header) replaced."""
    write(path, [(i, 1000 * i, 9, 0, 0) for i in range(100)])
    lines = path.read_text().split("\n")
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("line", "text", "expected"),
    [
        (57, "55\t3\t1\t2\t3", "line 57: not a row of whole numbers.*'55.*3'"),
        (2, "\x00\x01\x02", "line 2: not a row of whole numbers"),
        (100, "98\t3\t1.5\t2\t3\t0", "line 100: not a row of whole numbers"),
        (60, "58\t-3\t1\t2\t3\t0", "line 60: the matrix index is not in"),
        (60, "58\t65536\t1\t2\t3\t0", "line 60: the matrix index is not in 0 .. 65535: .*several chips; choose one with --chip"),
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
    assert reader.notes == ("ends in the middle of a row, which was left out (an interrupted measurement?)",)
    assert reader.rows == 99
    assert reader.position_bytes == reader.size_bytes


def test_a_whole_file_is_not_torn(path):
    reader = T3paReader(write(path, [(1, 2, 3, 4, 0)]))
    list(reader)
    assert reader.notes == ()


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


RECORD = np.dtype([("matrix", "<u4"), ("toa", "<u8"), ("overflow", "u1"), ("ftoa", "u1"), ("tot", "<u2")])


def test_binary_records_are_read_like_rows(tmp_path):
    """Pixet's .t3p, with a record torn off at its end."""
    rows = [(5, 100, 30, 3, 0), (0x75, 400, 0, 0, 1), (6, 16 << 30, 31, 0, 0)]
    path = tmp_path / "hits.t3p"
    records = np.array([(index, toa, overflow, ftoa, tot) for index, toa, tot, ftoa, overflow in rows], RECORD)
    path.write_bytes(records.tobytes() + b"\1\2\3")
    reader = T3paReader(path)
    pieces = list(reader)
    assert np.concatenate([piece.hits.tick for piece in pieces]).tolist() == [1597, 256 << 30]
    assert sum(piece.lost_ns for piece in pieces) == 10_000
    assert (reader.rows, reader.measurements, len(reader.notes)) == (3, 1, 1)


def test_other_formats_are_refused_by_name(path):
    path.write_text("Frame 1 (1533.2, 0.1 s)\n[23, 45, 123, 22.3] [24, 45, 99, 23.0]\n")
    with pytest.raises(DetectorError, match=r"a cluster log \(.clog\), .* export the measurement as .t3pa"):
        read(path)
    path.write_bytes(bytes(range(256)) * 64)
    with pytest.raises(DetectorError, match=r"neither a .t3pa nor a .t3p file"):
        read(path)


CAMERA = Path(__file__).parents[5] / "shared" / "camera"  # files of real cameras, which are not part of the project
BORDER = 1 << 14  # of a period of the chip's counter, 25 ns steps


@pytest.mark.parametrize("delimiter", ["\t", ";", ",", "   ", " ;", "\t  "])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_columns_may_be_separated_and_padded_in_any_usual_way(path, delimiter, mark):
    lines = [
        mark + HEADER.replace("\t", delimiter),
        *(delimiter.join(row) for row in (["0", "5", "100", "30", "3", "0"], ["1", "6", "90", "9", "0", "0"])),
    ]
    path.write_text("\r\n".join(lines), encoding="utf-8")
    tick, index, tot, *_ = read(path)
    assert (tick.tolist(), index.tolist(), tot.tolist()) == ([1597, 1440], [5, 6], [30, 9])


def test_a_hit_put_into_the_period_before_joins_its_event_again(path):
    """Both hits lie 175 ns apart beside the border; the second one has the number of the period before."""
    for period in (0, 100_000):
        rows = [
            (7, period * BORDER + BORDER - 4, 9, 0, 0),
            (8, period * BORDER + 3, 9, 0, 0),
            (9, period * BORDER + 3 * BORDER, 9, 0, 0),
        ]
        pieces = list(T3paReader(write(path, rows)))
        toa = np.concatenate([piece.hits.tick for piece in pieces]) // 16
        assert (toa - period * BORDER).tolist() == [BORDER - 4, BORDER + 3, 3 * BORDER]
        assert sum(piece.repaired_hits for piece in pieces) == 1


def test_a_repaired_hit_is_counted_in_the_readouts(path):
    rows = [(7, 5 * BORDER - 4, 9, 0, 0), (8, 4 * BORDER + 3, 9, 0, 0)]
    assert sum(part.repaired_hits for part in readouts(T3paReader(write(path, rows)))) == 1


def test_a_late_hit_within_the_first_period_is_no_wrap(path):
    """As in the manufacturer's own sample: a hit comes 0.35 ms late, the file ends beyond the first period."""
    toa = [24_519, 24_519, 10_520, 25_256, 163_756]
    tick, *_ = read(write(path, [(7 + k, value, 9, 0, 0) for k, value in enumerate(toa)]))
    assert (tick // 16).tolist() == toa
    early = [16_000, 2_000, 16_100, 20_000]
    tick, *_ = read(write(path, [(7 + k, value, 9, 0, 0) for k, value in enumerate(early)]))
    assert (tick // 16).tolist() == early


def appended(path, *measurements):
    """Rows (matrix index, toa, tot, ftoa, overflow) of several measurements, each with an index from 0."""
    lines = [HEADER] + ["\t".join(map(str, (number, *row))) for rows in measurements for number, row in enumerate(rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_appended_measurements_follow_each_other(path):
    """Two measurements of a second, each with the counter from its start; the second one begins 30 s late."""
    first = [(7, 40_000 * k, 9, 0, 0) for k in range(1001)]
    second = [(8, 1_200_000_000 + 40_000 * k, 9, 0, 0) for k in range(1001)]
    reader = T3paReader(appended(path, first, second))
    parts = list(readouts(reader))
    assert reader.measurements == 2
    assert (parts[-1].end_ns - parts[0].start_ns) * 1e-9 == pytest.approx(2.0, abs=1e-4)
    assert sum(part.live_time_s for part in parts) == pytest.approx(2.0, abs=1e-4)
    tick = np.concatenate([part.hits.tick for part in parts])
    assert (np.diff(tick) > 0).all()
    assert tick[1001] - tick[1000] == 6400  # 10 us, more than any event lasts


def test_short_appended_measurements_keep_their_events_apart(path):
    """Twenty measurements of 50 ms with one hit a millisecond: 19.6 ms apart at the nearest otherwise."""
    rows = [(k, 100 + 40_000 * k, 9, 0, 0) for k in range(50)]
    reader = T3paReader(appended(path, *[rows] * 20))
    tick = np.concatenate([piece.hits.tick for piece in reader])
    assert reader.measurements == 20
    assert (np.diff(tick) > 1600).all()
    assert (tick[-1] - tick[0]) * 25e-9 / 16 == pytest.approx(20 * 0.049, rel=1e-3)


def test_one_of_the_measurements_is_chosen(path):
    appended(path, [(1, 100, 9, 0, 0), (2, 200, 9, 0, 0)], [(3, 50, 9, 0, 0)])
    reader = T3paReader(path, measurement=2)
    assert np.concatenate([piece.hits.index for piece in reader]).tolist() == [3]
    assert reader.rows == 1
    assert read(path, measurement=2)[0].tolist() == [800]
    with pytest.raises(DetectorError, match="holds 2 measurements, no measurement 3"):
        read(path, measurement=3)


def test_rows_of_three_values_are_matrix_index_toa_and_tot(path):
    """Sorted by pixel, as such a file is: without Index nothing tells the order, so the rows are sorted by time."""
    path.write_text(HEADER + "\n5\t100\t30\n5\t4000000000\t31\n6\t101\t32\n")
    reader = T3paReader(path)
    hits = [piece.hits for piece in reader]
    assert np.concatenate([one.index for one in hits]).tolist() == [5, 6, 5]
    assert np.concatenate([one.tick for one in hits]).tolist() == [1600, 1616, 64_000_000_000]
    assert reader.notes == ("rows of three values: matrix index, ToA and ToT; FToA is taken as 0",)


def test_a_large_file_without_index_is_refused(path, monkeypatch):
    monkeypatch.setattr(t3pa, "MAX_UNNUMBERED_ROWS", 2)
    path.write_text(HEADER + "\n" + "5\t100\t30\n" * 3)
    with pytest.raises(DetectorError, match="more than 2 rows without a column Index"):
        read(path)


def test_one_chip_of_several_is_read(path):
    write(path, [(5, 100, 9, 0, 0), (65536 + 6, 101, 9, 0, 0), (3 * 65536 + 7, 102, 9, 0, 0)])
    assert read(path, chip=1)[1].tolist() == [6]
    assert read(path, chip=3)[1].tolist() == [7]
    with pytest.raises(DetectorError, match=r"line 3: .* several chips; choose one with --chip"):
        read(path)


@pytest.mark.skipif(not CAMERA.is_dir(), reason="the files of real cameras are not there")
def test_the_files_of_real_cameras_are_read(tmp_path):
    sample = read(CAMERA / "pydpe-tot_toa.t3pa")
    assert len(sample[0]) == 1491
    assert sample[0].max() * 25e-9 / 16 == pytest.approx(163_756 * 25e-9, abs=1e-6)
    quad = tmp_path / "quad.t3pa"
    quad.write_bytes(lzma.decompress((CAMERA / "tpx3_clustering-testa.t3pa.xz").read_bytes()))
    assert [len(read(quad, chip=chip)[0]) for chip in range(4)] == [99_811, 100, 45, 43]
