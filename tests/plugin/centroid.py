"""The estimator ``centroid``: the mean of the places where a camera was, each weighted by the square of its count rate there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis
from radron.agent.fusion.observation import CountObservation, Observation
from radron.protocol.entries import Exposure

LEAST_HITS = 200  # before the first estimate


class State(NamedTuple):
    """Sums over the exposures so far; never changed, only replaced."""

    hits: int = 0
    weight: float = 0.0
    place: np.ndarray = np.zeros(2)  # weighted sum of (x, y), metres
    square: np.ndarray = np.zeros((2, 2))  # of their outer products
    x0_stamp_ns: int = 0


class Centroid:
    name = "centroid"
    reads = (Exposure,)  # the log entries that it wants to see
    grid_s = None  # the mission's time grid
    hold_s = 0.0

    def __init__(self, mission: MissionConfig) -> None:
        pass  # this one needs nothing of the mission

    def initial(self, start_ns: int | None) -> State:
        return State()

    def step(self, state: State, step: GridStep, observations: Sequence[Observation]) -> State:
        for exposure in observations:
            if not isinstance(exposure, CountObservation):
                continue
            hits, place = exposure.counts[0], np.array(exposure.position[:2])
            weight = (hits / exposure.live_time_s) ** 2
            state = State(
                state.hits + int(hits),
                state.weight + weight,
                state.place + weight * place,
                state.square + weight * np.outer(place, place),
                state.x0_stamp_ns,
            )
        if state.hits >= LEAST_HITS and not state.x0_stamp_ns:
            state = state._replace(x0_stamp_ns=step.start_ns)
        return state

    def work(self, state: State, observations: int) -> int:
        return 1 + observations

    def hypothesis(self, state: State, step: GridStep) -> Hypothesis | None:
        if not state.x0_stamp_ns:
            return None
        mean = state.place / state.weight
        covariance = np.diag([1.0, 1.0, 0.0])
        covariance[:2, :2] += state.square / state.weight - np.outer(mean, mean)
        return Hypothesis(
            stamp_ns=step.middle_ns,
            position=np.array([*mean, 0.0]),
            covariance=covariance,
            velocity=np.zeros(3),
            cones=0,
            x0_stamp_ns=state.x0_stamp_ns,
        )

    def outlook(self, state: State, step: GridStep) -> None:
        return None
