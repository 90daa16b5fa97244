"""Faults of live flights that are not dealt to live missions, in one flight: bad links, a flood, a lost record."""

from __future__ import annotations

from pathlib import Path

import pytest

from radron.agent.errors import RadronError
from radron.sim.campaign.faults.course import LIVE
from radron.sim.campaign.faults.dealt import deal
from radron.sim.campaign.faults.mission import Mission
from radron.sim.live.faults.mission import TOO_BUSY, fly_live_mission

# MAVLink as bad as a radio's at the end of its range; the mesh links then stand still for less than a partition of `live-faults`.
FAULTS = (
    {"kind": "mavlink-impaired", "target": "d1", "at_s": 10.0, "for_s": 8.0, "delay_s": 0.03, "jitter_s": 0.03, "reorder": 0.1,
     "duplicate": 0.3, "corrupt": 0.05},
    {"kind": "disk", "target": "d3", "how": "record-removed", "at_s": 12.0},
    {"kind": "stall", "target": "d2", "at_s": 14.0, "for_s": 6.0},
    {"kind": "mavlink-impaired", "target": "d3", "direction": "to-vehicle", "cut": True, "at_s": 18.0, "for_s": 3.0},
    {"kind": "throttle", "target": "d1", "rate_kilobytes_ps": 20.0, "at_s": 21.0, "for_s": 6.0},
    {"kind": "flood", "target": "d2", "rate_mbps": 1.0, "message_bytes": 200, "at_s": 24.0, "for_s": 6.0},
)  # fmt: skip


@pytest.mark.long
def test_a_mission_with_all_faults_that_are_not_dealt_violates_nothing(tmp_path: Path) -> None:
    document = deal(0, LIVE) | {"fault": list(FAULTS)}
    try:
        verdict = fly_live_mission(Mission(0, LIVE, document), tmp_path)
    except RadronError as error:
        if TOO_BUSY not in str(error):
            raise
        pytest.skip(str(error))
    print(verdict)
    assert verdict.violations == []
    assert verdict.able == 3
    assert verdict.located
