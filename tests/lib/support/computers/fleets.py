"""A small fleet on disk: fleet file, mission, calibration."""

from __future__ import annotations

from pathlib import Path

KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIF3Tn0tMbLIIRlmqkBbKHz2XLS0zqp6IU2ONIO9Wq4kG anna@laptop"
MISSION = """
name = "yard"
swarm = "radron"
drones = [{ id = "d1", origin_m = [10, 2, 0] }, { id = "d2", origin_m = [16, 2, 0] }]

[area]
polygon_m = [[0, 0], [50, 0], [50, 50], [0, 50]]
"""
PIXELS = 256 * f"{' '.join(256 * ['1'])}\n"  # of a calibration: the same number for all
FLEET = f"""
version = "0.1.0"
mission = "mission.toml"
ssh_keys = ["{KEY}"]
others = ["anna"]

[network]
subnet = "10.7.1.0/24"
interface = "enp*"
gateway = "10.7.1.1"
ntp = ["10.7.1.2"]

[vehicle]
address = "serial:///dev/ttyACM0:57600"
position_sigma_m = 0.3

[detector]
driver = "pypixet"
pixet_folder = "/var/lib/radron/pixet"

[[drones]]
id = "d1"
address = "10.7.1.11"
calibration = "cameras/1"

[[drones]]
id = "d2"
address = "10.7.1.12"
camera_rpy_deg = [90, 0, 0]

[drones.vehicle]
address = "udpin://10.41.10.1:14540"
source = "10.41.10.2"
"""


def make_fleet(folder: Path, fleet: str = FLEET, mission: str = MISSION) -> Path:
    """Write the files; returns the fleet file."""
    (folder / "fleet.toml").write_text(fleet)
    (folder / "mission.toml").write_text(mission)
    (folder / "cameras/1").mkdir(parents=True, exist_ok=True)
    for name in "abct":
        (folder / f"cameras/1/{name}.txt").write_text(PIXELS)
    return folder / "fleet.toml"
