"""Drag, lags and tracking error of the simulation, identified from a recorded flight and printed for the drone file."""

import sys
import tomllib

import numpy as np
import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from radron.agent.cli import app
from radron.agent.config.drone import ResponseConfig
from radron.agent.config.loading import convert
from radron.agent.errors import FlightRecordError, OutputError
from radron.agent.flight.identify import identify
from radron.agent.flight.identify_command import run_identify, section
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.response_records import read
from support.flights.recorded_flights import fly_recorded

TRUE_LAG_S = 1.0 / 4.2  # of the attitude, in the simulation


@pytest.fixture(scope="module", params=[pytest.param(drag_ps, marks=pytest.mark.slow) for drag_ps in (0.3, 1.0)])
def flight(request, tmp_path_factory):
    """Drag, and a record of the demo with it; the drone file says 0.5."""
    folder = tmp_path_factory.mktemp("flights")
    return request.param, fly_recorded(folder, vehicle__drag_ps=request.param, mission__track__duration_s=25.0)[0]


def fitted(path):
    told = []
    records = read(RecordedFlight(path), told.append)
    found = identify(records, ResponseConfig(), told.append)
    assert told == [*sorted(told[:-4]), *told[-4:]]  # reading, and then twice through the pieces
    assert max(told) == 1.0
    return found


def test_the_truth_of_the_simulation_is_found(flight):
    drag_ps, path = flight
    found = fitted(path)
    assert found.drag_found
    assert found.response.drag_ps == pytest.approx(drag_ps, abs=0.1)
    assert found.response.attitude_lag_s == pytest.approx(TRUE_LAG_S, abs=0.06)
    assert found.response.lag_s == pytest.approx(0.03 + 0.025, abs=0.03)  # the simulation's delay, and half a period
    assert found.fit_mps2 < 0.5
    assert found.late_s == pytest.approx(0.0, abs=0.1)
    assert found.gain == pytest.approx(1.0, abs=0.05)
    assert 0.0 < found.response.tracking_error_m < 0.6
    assert found.flown_s > 25.0


def test_the_section_is_one_that_a_drone_file_takes(flight):
    _, path = flight
    found = fitted(path)
    document = tomllib.loads(section(found, "d1"))
    assert convert(document["vehicle"]["response"], ResponseConfig, "printed") == found.response


def test_the_command_prints_the_section_and_draws(flight, tmp_path):
    _, path = flight
    picture = tmp_path / "picture.png"
    ended = CliRunner().invoke(app, ["identify", str(path), "--out", str(picture)])
    assert ended.exit_code == 0, ended.output
    assert "[vehicle.response]" in ended.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_picture_never_overwrites_the_recording(flight, tmp_path):
    _, path = flight
    file = next(path.rglob("*.mcap")) if path.is_dir() else path
    link = tmp_path / "picture.png"
    link.symlink_to(file)
    before = file.read_bytes()
    with pytest.raises(OutputError, match="is the input"):
        run_identify(file, link)
    assert file.read_bytes() == before


def test_without_matplotlib_only_the_picture_is_refused(flight, tmp_path, monkeypatch):
    _, path = flight
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ModuleNotFoundError, match="matplotlib"):
        run_identify(path, tmp_path / "picture.png")
    run_identify(path, None)


def test_without_plans_it_is_fitted_by_what_the_vehicle_was_told(flight):
    drag_ps, path = flight
    records = read(RecordedFlight(path), lambda done: None)
    records.plans.clear()
    found = identify(records, ResponseConfig(), lambda done: None)
    assert (found.late_s, found.gain) == (None, None)
    assert found.response.drag_ps == pytest.approx(drag_ps, abs=0.1)
    assert found.response.tracking_error_m == ResponseConfig().tracking_error_m


def test_who_was_never_led_by_setpoints_tells_nothing(flight):
    _, path = flight
    records = read(RecordedFlight(path), lambda done: None)
    records.setpoints.clear()
    with pytest.raises(FlightRecordError, match="never flew by setpoints"):
        identify(records, ResponseConfig(), lambda done: None)


def test_pieces_end_where_the_frame_jumps(flight):
    _, path = flight
    records = read(RecordedFlight(path), lambda done: None)
    (whole,) = records.pieces()
    middle_ns = whole.began_ns + round(0.5e9 * whole.seen_s[-1])
    records.telemetry = [
        state if state.stamp_ns < middle_ns else replace(state, epoch=state.epoch + 1) for state in records.telemetry
    ]
    first, second = records.pieces()
    assert first.seen_s[-1] + second.seen_s[-1] == pytest.approx(whole.seen_s[-1], abs=0.1)
    assert np.isnan(second.planned).all()  # these plans are of the frame before
