"""The sources of many flights, summed up."""

import csv
import io

import msgspec
import pytest

from radron.sim.campaign.report import case_sentence, cases_csv
from radron.sim.campaign.sources import SourceSummary, sources_markdown, summarise_sources
from support.flights import synthetic


def run(seed, **fields):
    return msgspec.structs.replace(synthetic.synthetic_result("near", seed), **fields)


RUNS = [
    run(1, sources_true=3, sources_found=3, number_right=True, false_sources=0, nuclides_right=3, matched_error_median_m=0.1,
        matched_error_p90_m=0.2, activity_error_median=0.02, in_region_90=2 / 3),
    run(2, sources_true=2, sources_found=2, number_right=False, false_sources=1, nuclides_right=0, matched_error_median_m=0.3,
        matched_error_p90_m=0.3, activity_error_median=0.06, in_region_90=1.0, height_error_median_m=0.4),
    run(3, sources_true=0, sources_found=0, number_right=True, false_sources=0, nuclides_right=0),
    run(4),  # of a radron that did not compare them
]  # fmt: skip


def test_numbers_are_added_up_and_errors_are_medians_over_the_runs():
    assert summarise_sources(RUNS) == SourceSummary(
        runs=3,
        number_right=2,
        with_false=1,
        true=5,
        matched=4,
        nuclides_right=3,
        in_90=3,
        error_median_m=pytest.approx(0.2),
        error_p90_m=pytest.approx(0.25),
        activity_error_median=pytest.approx(0.04),
        height_error_median_m=pytest.approx(0.4),
    )


def test_the_tables_hold_a_line_for_each_case():
    rows = [({"scenario": "many"}, summarise_sources(RUNS)), ({"scenario": "old"}, summarise_sources(RUNS[3:]))]
    table = list(csv.DictReader(io.StringIO(cases_csv(rows))))
    assert [(row["scenario"], row["runs"], row["number_right"]) for row in table] == [("many", "3", "2"), ("old", "0", "0")]
    lines = [line for line in sources_markdown(rows).splitlines() if line.startswith("|")]
    assert len(lines) == 3
    assert lines[-1] == "| many | 3 | 2 of 3 | 1 of 3 | 4 of 5 | 3 of 4 | 0.20 m | 0.25 m | 4.0 % | 3 of 4 | 0.40 m |"
    assert sources_markdown(rows[1:]) == ""


def test_a_case_with_several_sources_tells_how_often_their_number_was_right():
    assert case_sentence("many", RUNS).endswith("number of sources right in 2")
    assert "number of sources" not in case_sentence("near", RUNS[3:])
