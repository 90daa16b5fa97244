"""The regular messages of a drone."""

import numpy as np

from radron.agent.fusion.estimator import Exclusion, Hypothesis
from radron.agent.mission.reporter import Believed, Reporter
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codec import decode_from, encode
from radron.protocol.contamination import Block, Contamination, Finding, Range
from radron.protocol.keys import key_of
from radron.protocol.messages import Estimate, Pose, Stage, Status

SECOND = 1_000_000_000
NOW_NS = 1_767_225_600 * SECOND
STATUS = Status(stamp_ns=NOW_NS, drone="d1", mission="m" * 16, boot="0" * 16, stage=Stage.TRACK)


def no_pose(_: VehicleState) -> Pose:
    raise AssertionError("no telemetry, no pose")


def test_all_sources_of_an_estimate_are_published_with_their_nuclides() -> None:
    def source(x: float, nuclide: str, *others: Hypothesis) -> Hypothesis:
        place, spread = np.array((x, 2.0, 0.0)), np.diag((0.04, 0.09, 0.0))
        return Hypothesis(NOW_NS, place, spread, np.zeros(3), 7, NOW_NS, 2e9, 1e8, nuclide=nuclide, others=others)

    reporter = Reporter("d1", "m" * 16, "sources")
    first = source(1.0, "Cs-137", source(5.0, "Co-60"))
    cells = np.zeros(3, np.bool_)
    believed = Believed(first, "0" * 32, Exclusion({"Cs-137": 2e8, "Co-60": None}, cells, cells))
    due = reporter.due(NOW_NS, None, None, lambda: believed, no_pose, lambda: STATUS)
    (estimate,) = [one for one in due if isinstance(one, Estimate)]
    assert estimate.excluded_bq == {"Cs-137": 2e8}
    assert [(one.position_m[0], one.nuclide) for one in estimate.sources] == [(1.0, "Cs-137"), (5.0, "Co-60")]
    assert estimate.sources[1].covariance_m2 == (0.04, 0.0, 0.0, 0.09, 0.0, 0.0)
    assert estimate.flaw() is None


NONE = Range(0.0, 0.0, 0.0)
MAP = Contamination(
    nuclide="Cs-137",
    finding=Finding.AREA,
    evidences={Finding.NOTHING: 0.0, Finding.AREA: 12.0},
    total_bq=Range(4e8, 3e8, 5e8),
    least_bqm2=1.3e4,
    corner_m=(0.0, 0.0),
    block_m=10.0,
    across=2,
    unit_bqm2=200.0,
    blocks=(Block(0, 0, 1), Block(1, 0, 2), Block(2, 1, 3), Block(3, 2, 4)),
    highest_bqm2=Range(600.0, 400.0, 800.0),
    highest_m=(15.0, 15.0, 0.0),
    dose_svph=NONE,
    dose_m=(15.0, 15.0, 0.0),
)


def test_map_without_sources_is_published() -> None:
    reporter = Reporter("d1", "0" * 16, "field")
    believed = Believed(None, "0" * 32, contamination=MAP)
    (estimate,) = [
        one for one in reporter.due(NOW_NS, None, None, lambda: believed, no_pose, lambda: STATUS) if isinstance(one, Estimate)
    ]
    assert estimate.sources == ()
    key = key_of("s", estimate)
    assert decode_from(key, encode(estimate)) == estimate
