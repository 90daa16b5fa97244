"""Sentences, tables and figures."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from matplotlib.patches import Ellipse

from radron.protocol.messages import Source
from radron.sim.campaign.flights import Campaign, Flown, fly_campaign
from radron.sim.campaign.report import (
    case_sentence,
    faults_of,
    flight_figures,
    result_json,
    sentence,
    write_campaign,
    write_flight,
)
from radron.sim.campaign.workers import attempt
from radron.sim.figures.campaign import boxes_figure, ecdf_figure, tuning_figure
from radron.sim.figures.cones import ground_curve
from radron.sim.figures.ellipse import draw_regions
from radron.sim.figures.error import error_figure
from radron.sim.figures.faultmarks import rows_of
from radron.sim.figures.map import CONES_SHOWN, last_tracking, map_figure
from radron.sim.figures.posterior import INSTANTS, posterior_figure
from radron.sim.figures.sources import sources_figure
from radron.sim.figures.spacing import spacing_figure
from radron.sim.figures.style import ESTIMATE, new_figure
from radron.sim.result import EstimateTrace, FaultTrace, Flight, SourceTrace
from radron.sim.scoring.statistics import median
from support.flights import synthetic


def fly(campaign: Campaign, folder: Path) -> Flown:
    return fly_campaign(campaign, folder, lambda jobs, one: (attempt(one, job) for job in jobs), synthetic.fly_synthetic)


def is_png(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG\r\n") and path.stat().st_size > 10_000


def test_the_sentence_gives_estimate_sigma_and_error() -> None:
    flight = synthetic.synthetic_flight()
    x, y = flight.trace.hypothesis_m[-1, 0, :2]
    off = np.hypot(x - 60.0, y - 45.0)
    said = sentence(flight.result, flight.trace)
    assert f"({x:.1f}, {y:.1f}) m" in said
    assert f"1 sigma = {flight.trace.sigma_m[-1]:.1f} m" in said
    assert f"{off:.2f} m from the truth" in said if off < 1.0 else f"{off:.1f} m from the truth" in said
    assert "\n" not in said


def test_the_sentence_speaks_of_the_end_of_the_tracking_not_of_the_way_home() -> None:
    flight = synthetic.synthetic_flight()
    flight.trace.stage[-50:] = "return"
    flight.trace.hypothesis_m[-50:] = 500.0
    assert last_tracking(flight.trace) == len(flight.trace.time_s) - 51
    assert "500" not in sentence(flight.result, flight.trace)


def test_the_sentence_where_nothing_was_found_or_nothing_was_there() -> None:
    lost = synthetic.synthetic_flight(found=False)
    assert "did not find the source" in sentence(lost.result, lost.trace)
    given = synthetic.synthetic_flight(steps=True, drones=5)
    assert "no source in this scenario" in sentence(given.result, given.trace)


def test_the_sentence_says_what_a_search_for_nothing_excludes() -> None:
    nothing = synthetic.synthetic_flight(found=False)
    result = msgspec.structs.replace(nothing.result, nothing_found=True, excluded_bq=8.04e7)
    assert sentence(result, nothing.trace) == (
        "The swarm found no source, though there is one; one of 80.4 MBq or more would have been found anywhere."
    )
    nothing.trace.source_m[:] = np.nan
    assert "and there is none; one of 80.4 MBq" in sentence(result, nothing.trace)


def test_the_sentence_calls_a_hypothesis_without_a_source_what_it_is() -> None:
    false = synthetic.synthetic_flight()
    false.trace.source_m[:] = np.nan
    said = sentence(msgspec.structs.replace(false.result, false_hypothesis=True), false.trace)
    assert said.startswith("False source estimate: (")
    assert said.endswith("there is no source in this scenario.")


def test_the_result_is_one_flat_object_on_one_line() -> None:
    result = synthetic.synthetic_result("near", 1)
    text = result_json(result)
    assert text.endswith("}\n")
    assert text.count("\n") == 1
    assert json.loads(text) == msgspec.structs.asdict(result)


@pytest.mark.parametrize(
    ("kind", "error_too"),
    [
        ({}, True),
        ({"moving": True}, True),
        ({"drones": 1}, True),
        ({"found": False}, True),
        ({"steps": True, "drones": 5}, False),
    ],
)
def test_a_flight_is_written_whatever_came_of_it(tmp_path: Path, kind: dict[str, object], error_too: bool) -> None:
    flight = synthetic.synthetic_flight(**kind)  # type: ignore[arg-type]
    flight.listened["bayes"] = synthetic.synthetic_result("near", 1, estimator="bayes")
    written = write_flight(tmp_path, flight)  # type: ignore[arg-type]
    figures = {"map.png", "spacing.png"} | ({"error.png", "posterior.png"} if error_too else set())
    assert {path.name for path in written} == {path.name for path in tmp_path.iterdir()}
    assert {path.name for path in written} == {"result.json", "result-bayes.json"} | figures
    assert all(is_png(tmp_path / name) for name in figures)
    assert json.loads((tmp_path / "result-bayes.json").read_text())["estimator"] == "bayes"


def with_three_sources() -> Flight:
    """Two of the three are found from some time on, one of them as another nuclide; and a false source."""
    flight = synthetic.synthetic_flight()
    x, y, _ = flight.trace.hypothesis_m[-1, 0]

    def told(x: float, y: float, nuclide: str) -> Source:
        return Source(position_m=(x, y, 0.0), covariance_m2=(0.04, 0.0, 0.0, 0.01, 0.0, 0.0), nuclide=nuclide, activity_bq=1e9)

    found = (told(x, y, "Cs-137"), told(20.3, 80.0, "Ir-192"), told(90.0, 10.0, "Cs-137"))
    truths = (
        SourceTrace("Cs-137", 3e9, (60.0, 45.0, 0.0)),
        SourceTrace("Co-60", 1e9, (20.0, 80.0, 5.0)),
        SourceTrace("Co-60", 1e9, (80.0, 80.0, 0.0)),
    )
    estimates = tuple(EstimateTrace(45.0 + k, found[: 1 + (k > 20) + (k > 50)]) for k in range(100))
    trace = dataclasses.replace(flight.trace, truths=truths, estimates=estimates)
    counts = {"sources_true": 3, "sources_found": 3, "number_right": False, "false_sources": 1, "nuclides_right": 1}
    return Flight(msgspec.structs.replace(flight.result, **counts), trace, {})


def test_a_flight_with_several_sources_is_told_and_drawn_with_all_of_them() -> None:
    flight = with_three_sources()
    assert sentence(flight.result, flight.trace).endswith(" 2 of 3 sources found, 1 with the right nuclide; 1 false.")
    assert list(flight_figures(flight)) == ["map", "spacing", "error", "posterior", "sources"]
    axes = map_figure(flight.trace, ("title",)).axes[0]
    stars = {(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_marker() == "*"}
    assert stars == {source.place_m[:2] for source in flight.trace.truths}
    crosses = {(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_marker() == "X"}
    assert crosses == {source.position_m[:2] for source in flight.trace.estimates[-1].sources}


def test_the_figure_of_sources_names_what_was_not_found_and_draws_each_error() -> None:
    flight = with_three_sources()
    number, *courses = sources_figure(flight.trace, ("title",)).axes
    assert [axes.get_title(loc="left") for axes in courses] == [
        "Cs-137, 3 GBq, (60, 45) m", "Co-60, 1 GBq, (20, 80) m, 5 m high", "Co-60, 1 GBq, (80, 80) m: not found"
    ]  # fmt: skip
    errors = [line.get_ydata() for line in courses[1].lines if line.get_marker() == "."]
    assert sorted(len(each) for each in errors) == [0, 0, 79]
    assert max(errors, key=len) == pytest.approx(0.3)
    assert {text.get_text() for text in number.get_legend().get_texts()} == {"Cs-137", "Co-60", "Ir-192", "truth"}


def test_the_map_shows_tracks_estimate_and_few_cones() -> None:
    flight = synthetic.synthetic_flight()
    axes = map_figure(flight.trace, ("title",)).axes[0]
    x, y = flight.trace.hypothesis_m[-1, 0, :2]
    marks = [line for line in axes.lines if line.get_marker() == "X"]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in marks] == [(x, y)]
    assert {patch.center for patch in axes.patches if isinstance(patch, Ellipse)} == {(x, y)}
    assert marks[0].get_color() == ESTIMATE
    assert len(flight.trace.cones) > CONES_SHOWN
    assert sum(len(line.get_xdata()) == 361 for line in axes.lines) == CONES_SHOWN


def test_the_regions_hold_what_they_say() -> None:
    """Points drawn from the posterior: half of them are in the smaller ellipse, nine tenths in the larger."""
    axes = new_figure(4.0, 4.0).add_subplot()
    covariance = np.array([[4.0, -1.5], [-1.5, 1.0]])
    draw_regions(axes, (3.0, -2.0), covariance)
    points = np.random.default_rng(1).multivariate_normal([3.0, -2.0], covariance, 40_000)
    filled = sorted((patch for patch in axes.patches if patch.get_fill()), key=lambda patch: patch.width)
    shares = [
        float(np.mean(patch.get_path().contains_points(patch.get_patch_transform().inverted().transform(points))))
        for patch in filled
    ]
    assert shares == pytest.approx([0.5, 0.9], abs=0.01)


def test_the_posterior_figure_shows_what_the_estimator_knows() -> None:
    trace = synthetic.synthetic_flight().trace
    whole = posterior_figure(trace, ("title",))
    labels = [axes.get_ylabel() for axes in whole.axes if axes.get_ylabel()]
    assert labels == ["distance (m)", "activity (Bq)", "source : none (ln)"]
    errors = next(axes for axes in whole.axes if axes.get_ylabel() == "distance (m)")
    assert [line.get_label() for line in errors.lines] == [
        "error (d1)", "stated RMS", "bound (median)", "error in d1's own frame", "bound of that",
    ]  # fmt: skip
    assert sum(any(isinstance(patch, Ellipse) for patch in axes.patches) for axes in whole.axes) == INSTANTS
    nothing = np.full(trace.time_s.shape, np.nan)
    plain = posterior_figure(dataclasses.replace(trace, activity_bq=nothing, evidence=nothing, own_error_m=nothing), ("title",))
    (errors,) = (axes for axes in plain.axes if axes.get_ylabel())
    assert len(errors.lines) == 3


def test_the_posterior_figure_follows_the_next_drone_where_the_first_ones_agent_has_died() -> None:
    trace = synthetic.synthetic_flight().trace
    died = trace.hypothesis_m.copy()
    half = len(died) // 2
    died[half:, 0] = np.nan
    judged = np.where(np.arange(len(died)) < half, 0, 1)
    figure = posterior_figure(dataclasses.replace(trace, hypothesis_m=died, judged=judged), ("title",))
    assert sum(any(isinstance(patch, Ellipse) for patch in axes.patches) for axes in figure.axes) == INSTANTS


def test_the_stabilisation_figure_has_a_line_at_every_step_and_says_how_fast() -> None:
    flight = synthetic.synthetic_flight(steps=True, drones=5)
    speed, spacing = spacing_figure(flight.trace, "stabilization").axes
    for axes in (speed, spacing):
        upright = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2 and np.ptp(line.get_xdata()) == 0.0]
        assert upright == pytest.approx([60.0, 120.0, 180.0, 240.0], abs=0.21)
    title = speed.get_title(loc="left")
    assert "within 5 deg" in title
    assert "worst 9." in title or "worst 10" in title


def test_the_spacing_is_drawn_on_with_those_that_are_left() -> None:
    trace = synthetic.synthetic_flight().trace
    third = len(trace.time_s) // 3
    trace.spacing_error_deg[third:] = [30.0, np.nan, -30.0]
    speed, spacing = spacing_figure(trace, "near").axes
    ends_s = [line.get_xdata()[np.isfinite(line.get_ydata())][-1] for line in spacing.lines[:3]]
    assert ends_s == [trace.time_s[-1], trace.time_s[third - 1], trace.time_s[-1]]
    assert "is 30.0 deg from it in the median" in speed.get_title(loc="left").replace("\n", " ")


def test_an_unquiet_filter_gets_no_lines() -> None:
    flight = synthetic.synthetic_flight()
    flight.trace.hypothesis_m[400:500:3] += 8.0
    axes = spacing_figure(flight.trace, "near").axes[0]
    assert len(axes.lines) == 3  # the drones' speeds


def test_ground_curve_lies_on_the_cone_and_on_the_ground() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        apex = np.array([*rng.uniform(-20, 20, 2), rng.uniform(1, 10)])
        axis = rng.normal(size=3)
        theta = rng.uniform(0.1, 3.0)
        curve = ground_curve(apex, axis, theta, reach_m=200.0)
        points = curve[np.isfinite(curve[:, 0])]
        rays = np.column_stack([points, np.zeros(len(points))]) - apex
        cosine = rays @ axis / np.linalg.norm(rays, axis=1) / np.linalg.norm(axis)
        assert np.arccos(cosine.clip(-1, 1)) == pytest.approx(np.full(len(points), theta), abs=1e-6)
        assert (np.hypot(*rays[:, :2].T) <= 200.0).all()


def test_ground_curve_straight_down_is_a_circle_and_upwards_is_nothing() -> None:
    apex = np.array([1.0, 2.0, 3.0])
    curve = ground_curve(apex, np.array([0.0, 0.0, -2.0]), np.pi / 4, reach_m=100.0)
    assert np.hypot(*(curve - apex[:2]).T) == pytest.approx(np.full(361, 3.0))
    assert np.isnan(ground_curve(apex, np.array([0.0, 0.0, 1.0]), np.pi / 4, reach_m=100.0)).all()


def test_a_campaign_is_summed_up_in_tables_and_figures(tmp_path: Path) -> None:
    cases = tuple(synthetic.case(name, radius_m=radius) for name in ("near", "far") for radius in (8.0, 12.0))
    flown = fly(Campaign(cases, 8, "paper"), tmp_path)
    written = write_campaign(tmp_path, flown)
    assert [path.name for path in written] == ["summary.csv", "sources.csv", "summary.md", "boxes.png", "ecdf.png", "tuning.png"]
    assert all(is_png(path) for path in written if path.suffix == ".png")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "summary.csv").read_text())))
    assert [(row["scenario"], row["radius_m"]) for row in rows] == [(n, r) for n in ("far", "near") for r in ("8.0", "12.0")]
    here = [synthetic.synthetic_result("far", seed, 8.0) for seed in range(8)]
    errors = [run.error_median_m for run in here if run.error_median_m is not None]
    assert float(rows[0]["error_median_m"]) == median(errors)
    assert (rows[0]["runs"], rows[0]["found"], rows[0]["lost"]) == ("8", "7", "1")
    markdown = (tmp_path / "summary.md").read_text()
    assert f"{median(errors):.2f} m" in markdown
    assert len({line.count("|") for line in markdown.splitlines() if line.startswith("|")}) == 1


def test_a_campaign_without_a_sweep_has_no_tuning_figure(tmp_path: Path) -> None:
    written = write_campaign(tmp_path, fly(Campaign((synthetic.case(),), 3), tmp_path))
    assert "tuning.png" not in {path.name for path in written}


def test_a_campaign_of_which_nothing_came_through_is_no_error(tmp_path: Path) -> None:
    campaign = Campaign((synthetic.case(),), 1)
    assert write_campaign(tmp_path, Flown(campaign, (), ())) == []


def test_figures_stand_runs_without_numbers() -> None:
    never = [synthetic.synthetic_result("near", 6), synthetic.synthetic_result("near", 13)]
    groups = [(synthetic.case("near", radius_m=8.0), never), (synthetic.case("near", radius_m=9.0), never[:1])]
    for make in (boxes_figure, ecdf_figure, tuning_figure):
        figure = make(groups, "title")
        figure.canvas.draw()
        assert "title" in figure.get_suptitle()
    assert "3 of 3 runs never found the source" in boxes_figure(groups, "title").get_suptitle()


def test_a_title_names_the_best_case_only_if_there_is_one() -> None:
    near, far = synthetic.synthetic_result("near", 1), synthetic.synthetic_result("near", 2)
    assert near.error_median_m is not None
    assert far.error_median_m is not None
    best = "near" if near.error_median_m < far.error_median_m else "far"
    title = ecdf_figure([(synthetic.case("near"), [near]), (synthetic.case("far"), [far])], "title").get_suptitle()
    assert f"least error: {best}" in title.replace("\n", " ")
    title = ecdf_figure([(synthetic.case("near"), [near]), (synthetic.case("far"), [near])], "title").get_suptitle()
    assert "least error" not in title


def test_a_case_in_one_line() -> None:
    runs = [synthetic.synthetic_result("near", seed) for seed in range(7)]
    said = case_sentence("near radius_m=8", runs)
    assert said.startswith("near radius_m=8: initial estimate after ")
    assert "(in 6 of 7 runs)" in said
    assert said.endswith("lost in 1")
    searched = [msgspec.structs.replace(runs[6], lost=False, nothing_found=True, excluded_bq=1e8 * k) for k in (1, 2, 3)]
    said = case_sentence("empty", [*searched, msgspec.structs.replace(runs[0], false_hypothesis=True)])
    assert said.endswith("nothing found in 3, 200 MBq or more excluded (median); a false hypothesis in 1")
    said = case_sentence("near", runs)
    assert "times the bound (medians)" in said
    assert case_sentence("near", []) == "near: all runs failed"


def test_the_faults_are_told_and_drawn_with_their_times_and_places() -> None:
    flight = synthetic.synthetic_flight()
    end_s = float(flight.trace.time_s[-1])
    faults = (FaultTrace("kill d2", (1,), 50.0, 70.0), FaultTrace("loss", (0, 1, 2), 60.0, end_s))
    trace = dataclasses.replace(flight.trace, faults=faults)
    assert faults_of(flight.trace) == ""
    assert faults_of(trace) == "Faults: kill d2 from 50 s to 70 s; loss from 60 s on."
    main, bars = error_figure(trace, ("near",)).axes
    assert [text.get_text() for text in bars.texts] == ["1  kill d2", "2  loss"]
    assert main.get_xlim() == bars.get_xlim()
    assert len(error_figure(flight.trace, ("near",)).axes) == 1
    places = {text.get_text(): text.xy for text in map_figure(trace, ("near",)).axes[0].texts}
    struck = np.argmin(np.abs(trace.time_s - 50.0))
    np.testing.assert_allclose(places["1"], trace.position_m[struck, 1, :2], atol=1.0)


def test_neither_bars_nor_names_of_faults_overlap() -> None:
    """A name takes the room of its letters, and one at the end of the time axis stands before its end."""
    long, short = "partition d1 d2 | d3", "gust"
    faults = [FaultTrace(long, (0,), 10.0, 12.0), FaultTrace(short, (0,), 13.0, 90.0), FaultTrace(short, (0,), 60.0, 61.0)]
    faults.append(FaultTrace(long, (0,), 99.0, 100.0))
    rows = rows_of(faults, 0.0, 100.0)
    assert [[number for number, _ in row] for row in rows] == [[1, 3, 4], [2]]
