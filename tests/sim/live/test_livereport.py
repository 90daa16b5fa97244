"""The report on the agents at the end of a live flight."""

from __future__ import annotations

from typing import Any

from radron.protocol.messages import Stage
from radron.sim.live.report import AgentEnd, LiveReport, agreement


def end(drone: str, **changed: Any) -> AgentEnd:
    values: dict[str, Any] = {
        "drone": drone, "alive": True, "stage": Stage.LANDED, "digest": "abcdef0123456789" * 2, "position_m": (1.0, 2.0, 0.0),
        "covariance_m2": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0), "cones": 5, "setpoints": 9, "computed_setpoints": 9,
        "largest_gap_s": 0.1, "failsafes": 0, "truth": "world", "counters": {}, "problems": (), "problem_codes": (),
    }  # fmt: skip
    return AgentEnd(**{**values, **changed})


def report(agreed: bool, *agents: AgentEnd) -> LiveReport:
    return LiveReport(agreed=agreed, ready_s=5.0, world_late_s=0.0, truths_dropped=0, mesh={}, agents=agents)


def test_agreement_names_log_and_number_of_agents() -> None:
    text = agreement(report(True, end("d1"), end("d2")))
    assert text == "2 agents hold the same log (digest abcdef01) and, bit for bit, the same hypothesis."


def test_an_agent_that_is_gone_is_named() -> None:
    assert agreement(report(True, end("d1"), end("d2", alive=False))).endswith("; d2 is gone.")


def test_disagreement_says_who_says_what() -> None:
    text = agreement(report(False, end("d1"), end("d2", position_m=None, digest=None), end("d3", digest="0" * 32)))
    assert text == (
        "The agents disagree at the end: d1 estimates (1.000, 2.000) m from the log abcdef01, d2 has no hypothesis, "
        "d3 estimates (1.000, 2.000) m from the log 00000000."
    )
