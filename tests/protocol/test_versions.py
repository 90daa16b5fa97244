"""Versions of the formats: named once, and told on the page."""

import re
from pathlib import Path

from radron.protocol import versions
from radron.protocol.keys import ROOT


def test_the_page_has_the_versions_of_this_release() -> None:
    page = (Path(__file__).parents[2] / "docs/protocol.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (messages|state|readouts)[^|]*\| (\d+) \| \2 \|$", page, re.M))
    assert rows == {"messages": str(versions.PROTOCOL), "state": str(versions.STATE), "readouts": str(versions.READOUT)}
    assert f"radron/{versions.PROTOCOL}" == ROOT
