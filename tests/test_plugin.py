"""A package of others, with an estimator and a detector: installed beside radron, and chosen by their names."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.wheels import PIP, ROOT, radron_wheel, wheel_of

# An estimate in two seconds of tracking.
MISSION = """base = "demo"
name = "sample"

[mission.fusion]
estimator = "centroid"

[mission.track]
duration_s = 2

[mission.limits]
speed_mps = 6
"""
DRONE = 'id = "d1"\n\n[detector]\ndriver = "pulser"\n'
FIRST = """
import asyncio
from pathlib import Path
from radron.agent.shell.overrides import load_drone_file
from radron.agent.detector.drivers import open_detector

async def first():
    detector = open_detector(load_drone_file(Path("drone.toml"), {}).detector)
    async for readout in detector.readouts():
        await detector.close()
        return readout

readout = asyncio.run(first())
print(*readout.hits.index, *readout.hits.tot, readout.live_time_s == (readout.end_ns - readout.start_ns) * 1e-9)
"""


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the two packages, and the libraries of this one."""
    folder = tmp_path_factory.mktemp("plugin")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "env"], check=True)
    (site,) = (folder / "env").glob("lib/python3*/site-packages")
    (site / "libraries.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    shutil.copytree(ROOT / "tests/plugin", folder / "plugin")
    (folder / "sample").mkdir()
    wheels = (radron_wheel(folder), wheel_of(folder / "plugin", folder / "sample"))
    install = (*PIP, "--python", folder / "env/bin/python", "install", "--no-deps", "--ignore-installed", "--no-index")
    subprocess.run([*install, *wheels], check=True)
    return folder


@pytest.mark.slow
def test_a_mission_names_the_estimator(environment: Path) -> None:
    (environment / "sample.toml").write_text(MISSION)
    done = run(environment / "env/bin/radron-sim", "run", "sample.toml", "--seed", "1", "--json", "out.json", cwd=environment)
    assert done.returncode == 0, done.stderr
    result = json.loads((environment / "out.json").read_text())
    assert result["estimator"] == "centroid"
    assert result["error_median_m"] < 40.0  # somewhere in the area of 50 x 50 m: more it does not promise


@pytest.mark.slow
def test_a_drone_file_names_the_detector(environment: Path) -> None:
    (environment / "drone.toml").write_text(DRONE)
    done = run(environment / "env/bin/python", "-c", FIRST, cwd=environment)
    assert done.stdout == "32896 200 True\n", done.stderr
    (environment / "drone.toml").write_text(DRONE.replace("pulser", "pulsar"))
    done = run(environment / "env/bin/python", "-c", FIRST, cwd=environment)
    assert done.stderr.endswith(
        "ConfigError: detector.driver: unknown detector 'pulsar'; known: none, feed, t3pa, pypixet, pulser\n"
    )
