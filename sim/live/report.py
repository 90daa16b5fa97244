"""Report on a live flight besides its scores: state of processes and links, and of each agent at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import Struct

from radron.protocol.messages import Stage
from radron.sim.live.faults.player import Played
from radron.sim.live.monitor import ObservedAgent
from radron.sim.vehicle.px4.fleet import VehicleReport


class AgentEnd(Struct, frozen=True, kw_only=True):
    """State of one agent at the end of a live flight: its source estimate, the digest (hash) of its log, and its counters.

    position_m: mission frame; None without an estimate. setpoints: position targets received by its vehicle (known only of
    emulated vehicles); computed_setpoints: targets that differ from the one before; largest_gap_s: longest time between two of
    these in offboard. failsafes: number of the autopilot's failsafes. truth: source of the vehicle's position: the emulated
    "world", PX4's own "simulation", or the vehicle's own "estimate".
    """

    drone: str
    alive: bool
    stage: Stage
    digest: str | None
    position_m: tuple[float, float, float] | None
    covariance_m2: tuple[float, ...] | None
    cones: int
    setpoints: int
    computed_setpoints: int
    largest_gap_s: float
    failsafes: int
    truth: str
    counters: dict[str, int]
    problems: tuple[str, ...]
    problem_codes: tuple[str, ...]


class LiveReport(Struct, frozen=True, kw_only=True):
    """Report on one live flight, besides its scores.

    agreed: all living agents ended with equal digests and, bit for bit, equal positions. ready_s: time from the start of the
    agents until all were ready for the start command. world_late_s: largest delay of the world behind the clock; truths_dropped:
    samples of the truth that the launcher missed; both since the start command. mesh: counters of the launcher's station. faults:
    the faults played.
    """

    agreed: bool
    ready_s: float
    world_late_s: float
    truths_dropped: int
    mesh: dict[str, int]
    agents: tuple[AgentEnd, ...]
    faults: tuple[Played, ...] = ()


def ends_of(agents: Sequence[ObservedAgent], vehicles: Sequence[VehicleReport]) -> tuple[AgentEnd, ...]:
    """Return the state of all agents at the end of a live flight."""
    return tuple(_end_of(agent, vehicle) for agent, vehicle in zip(agents, vehicles, strict=True))


def agreement(report: LiveReport) -> str:
    """Return a sentence on whether the agents agree at the end of a live flight."""
    living = [agent for agent in report.agents if agent.alive]
    missing = "".join(f"; {agent.drone} is gone" for agent in report.agents if not agent.alive)
    if report.agreed:
        digest = living[0].digest or ""
        return f"{len(living)} agents hold the same log (digest {digest[:8]}) and, bit for bit, the same hypothesis{missing}."
    told = ", ".join(f"{agent.drone} {_told(agent)}" for agent in living)
    return f"The agents disagree at the end: {told or 'no agent is left'}{missing}."


def judged_by(report: LiveReport) -> str:
    """Return a sentence on where the true positions of the vehicles came from; empty if the vehicles were emulated."""
    said = {"simulation": "by the true states of their simulation", "estimate": "by their own estimates"}
    told = [f"{agent.drone} {said[agent.truth]}" for agent in report.agents if agent.truth in said]
    if len({agent.truth for agent in report.agents}) == 1 and told:
        return f"The vehicles were scored {said[report.agents[0].truth]}."
    return f"Scored: {', '.join(told)}." if told else ""


def _told(agent: AgentEnd) -> str:
    if agent.position_m is None or agent.digest is None:
        return "has no hypothesis"
    return f"estimates ({agent.position_m[0]:.3f}, {agent.position_m[1]:.3f}) m from the log {agent.digest[:8]}"


def _end_of(agent: ObservedAgent, vehicle: VehicleReport) -> AgentEnd:
    estimate, status = agent.estimate, agent.status
    source = estimate.sources[0] if estimate is not None and estimate.sources else None
    counters: Mapping[str, int] = status.counters if status is not None else {}
    return AgentEnd(
        drone=agent.drone,
        alive=agent.alive,
        stage=agent.stage,
        digest=estimate.digest if estimate is not None else None,
        position_m=source.position_m if source is not None else None,
        covariance_m2=tuple(source.covariance_m2) if source is not None else None,
        cones=agent.cones,
        setpoints=vehicle.setpoints,
        computed_setpoints=vehicle.computed_setpoints,
        largest_gap_s=vehicle.largest_gap_s,
        failsafes=agent.failsafes,
        truth=vehicle.truth,
        counters=dict(counters),
        problems=tuple(map(str, agent.problems)),
        problem_codes=tuple(text.code for text in agent.problems),
    )
