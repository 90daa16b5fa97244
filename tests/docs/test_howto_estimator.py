"""The recipe for an own estimator, followed literally: written, installed, flown, replaced."""

import subprocess
import sys

import pytest

from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override
from support import docs_pages


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The page's package, installed by pip into a folder of its own."""
    docs_pages.files(docs_pages.DOCS / "how-to" / "estimator.md", tmp_path)
    site = tmp_path / "site"
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(site), str(tmp_path / "centroid")], check=True
    )
    monkeypatch.syspath_prepend(str(site))
    yield
    sys.modules.pop("centroid", None)


def test_the_page_shows_the_sample_package():
    shown = {block.title: block.text for block in docs_pages.blocks(docs_pages.DOCS / "how-to" / "estimator.md")}
    (code,) = [text for title, text in shown.items() if "centroid.py" in title]
    assert code == (docs_pages.ROOT / "tests/plugin/centroid.py").read_text(encoding="utf-8")


@pytest.mark.usefixtures("installed")
def test_the_estimator_of_the_page_flies():
    demo = override(load_scenario("paper-demo"), {"mission.track.duration_s": 2, "mission.limits.speed_mps": 6})
    flight = fly(demo, 1, estimator="centroid")
    assert flight.result.estimator == "centroid"
    assert flight.result.time_to_x0_s is not None
    assert flight.result.tracking_time_s > 1.0
    assert flight.result.error_median_m < 40.0  # somewhere in the area of 50 x 50 m: more it does not promise
