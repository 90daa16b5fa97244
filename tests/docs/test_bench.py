"""The technician's pages: the fleet file entries in them are right."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from radron.deploy.fleet.loading import load_fleet
from support.computers.fleets import KEY, make_fleet

DOCS = Path(__file__).parents[2] / "docs"
FLU = {"forward": (1, 0, 0), "left": (0, 1, 0), "up": (0, 0, 1), "down": (0, 0, -1)}


def test_the_cameras_orientations() -> None:
    rows = re.findall(r"^\| (\w+) \| (\w+) \| `\[(.*)\]` \|$", (DOCS / "bench.md").read_text(), re.MULTILINE)
    assert len(rows) == 3
    for window, up_the_rows, angles in rows:
        body_from_camera = Rotation.from_euler("xyz", [float(angle) for angle in angles.split(",")], degrees=True)
        np.testing.assert_allclose(body_from_camera.apply([[0, 0, 1], [0, 1, 0]]), [FLU[window], FLU[up_the_rows]], atol=1e-12)


def example(page: str, file: str) -> str:
    """The file that a page shows."""
    (text,) = re.findall(rf"^```toml\n# {file}\n(.*?)^```", (DOCS / page).read_text(), re.MULTILINE | re.DOTALL)
    return text


def test_the_fleet_file(tmp_path: Path) -> None:
    text, mission = example("nuc.md", "fleet.toml"), example("drone.md", "mission.toml")
    text = re.sub(r'"ssh-ed25519 [^"]*"', f'"{KEY}"', text)
    for name in re.findall(r'calibration = "(.*)"', text):
        (tmp_path / name).mkdir(parents=True)
        for file in "abct":
            (tmp_path / name / f"{file}.txt").touch()
    first, second, third = load_fleet(make_fleet(tmp_path, text, mission)).config.drones
    assert (first.vehicle.gnss, second.vehicle.gnss) == (True, False)
    assert first.vehicle.address != second.vehicle.address
    assert second.px4.parameters == first.px4.parameters | {"EKF2_HGT_REF": 3.0}
    assert second.px4.version == first.px4.version
    assert third.vehicle == first.vehicle
