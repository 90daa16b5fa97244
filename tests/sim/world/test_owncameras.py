"""A camera that differs from the others': dead pixels, mounting, and the lines of its calibration in the drone file."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import ConfigError
from radron.sim.lockstep.flight import watched
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.truth import CameraTruth
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.moment import Moment
from radron.sim.world.cameras import Cameras
from radron.sim.world.frame import CameraMount
from radron.sim.world.owncameras import OwnCamera, drone_file
from radron.sim.world.streams import streams

AHEAD = SourceView((0.0, 0.0, 1.0), 2.0, 1e8)


def test_a_dead_block_has_no_hits_and_all_else_is_as_before() -> None:
    whole, holed = (
        Camera(CameraTruth(dead_block=share), "Cs-137", np.random.default_rng(1), 0).expose(0, 10**9, [AHEAD]).hits
        for share in (0.0, 0.198)
    )
    column, row = whole.index % 256, whole.index // 256
    alive = (column >= 114) | (row >= 114)  # 114^2 of 256^2: 19.8 %
    assert 0.1 < 1.0 - alive.mean() < 0.3
    np.testing.assert_array_equal(holed.index, whole.index[alive])
    np.testing.assert_array_equal(holed.tick, whole.tick[alive])


def test_a_camera_turned_in_heading_sees_a_source_ahead_beside_its_normal() -> None:
    rpy_deg = OwnCamera(turned_deg=(0.0, 8.0, 0.0)).mounting((90.0, 0.0, 90.0))
    view = CameraMount(rpy_deg).view(np.zeros(3), (1.0, 0.0, 0.0, 0.0), (10.0, 0.0, 0.0), 1e9)
    assert view.direction == pytest.approx((-np.sin(np.deg2rad(8.0)), 0.0, np.cos(np.deg2rad(8.0))), abs=1e-12)
    assert OwnCamera().mounting((90.0, 0.0, 90.0)) == (90.0, 0.0, 90.0)


def test_one_drone_of_the_scenario_has_it() -> None:
    scenario = load_scenario("mismatch-camera")
    drones = [DroneConfig(id=drone.id) for drone in scenario.mission.drones]
    cameras = Cameras(scenario, ["Cs-137"], drones, streams(1, 3), 0)
    assert cameras.calibrated(drones, None) == drones  # the drone file does not say so

    class Hovering:
        position_m = np.tile((0.0, 0.0, 3.0), (3, 1))
        velocity_mps = np.zeros((3, 3))

        def quaternion(self, drone: int) -> tuple[float, float, float, float]:
            return 1.0, 0.0, 0.0, 0.0

    class Ahead:
        place_m, activity_bq, nuclide = (5.0, 0.0, 3.0), 1e9, "Cs-137"

    sides = [cameras._view(drone, Hovering(), Ahead()).direction[0] for drone in range(3)]
    assert sides == pytest.approx([0.0, -np.sin(np.deg2rad(8.0)), 0.0], abs=1e-12)


def test_a_calibration_gives_the_drone_file_its_two_lines(tmp_path) -> None:
    (tmp_path / "result.json").write_text(json.dumps({"result": {"orientation": {"camera_rpy_deg": [90.1, 0.2, 97.9]}}}))
    cameras = {"d2": OwnCamera(calibrated=str(tmp_path))}
    found = drone_file(DroneConfig(id="d2"), cameras)
    assert (found.calibration, found.camera_rpy_deg) == (str(tmp_path), (90.1, 0.2, 97.9))
    assert drone_file(DroneConfig(id="d1"), cameras) == DroneConfig(id="d1")


@pytest.mark.parametrize(
    ("text", "problem"),
    [(None, "cannot be read"), ("{}", "is not the result of"), ('{"result": {"orientation": null}}', "has no orientation")],
)
def test_what_is_no_calibration_is_refused(tmp_path, text, problem) -> None:
    if text is not None:
        (tmp_path / "result.json").write_text(text)
    with pytest.raises(ConfigError, match=rf"cameras\.d2\.calibrated: .*result\.json: {problem}"):
        drone_file(DroneConfig(id="d2"), {"d2": OwnCamera(calibrated=str(tmp_path))})


def test_a_camera_of_an_unknown_drone_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"cameras\.d9: no such drone; there are d1, d2, d3"):
        override(load_scenario("mismatch-camera"), {"cameras": "{d9 = {dead_block = 0.1}}"})


@pytest.mark.slow
def test_in_flight_both_faults_are_reported() -> None:
    told: set[str] = set()

    def watch(moment: Moment) -> bool:
        told.update(text for pilot in moment.pilots for text in pilot.problems if "camera" in text or "cones" in text)
        return len(told) == 2 or moment.time_s > 100.0

    watched(load_scenario("mismatch-camera"), 1, watch)
    dead, turned = sorted(told)
    assert dead.startswith("camera: no hit in 9 of 64 blocks of the sensor")
    (angle,) = re.findall(r"^d2: its cones are turned by about (\d+) deg to the right", turned)
    assert 4 <= int(angle) <= 12  # 8 deg, as far as the cones of a minute tell
