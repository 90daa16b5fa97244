"""The computations whose results depend on their inputs alone, and so are the same in all agents with equal logs."""

from __future__ import annotations

from typing import NamedTuple

from agent.frames.estimate import Estimate, FrameEstimates
from agent.fusion.registry import Estimators, estimator_named
from protocol.codec import Read, decode_from
from protocol.signing import SignedRoot, signed_root


class Computing(NamedTuple):
    """Makes estimators by name, and what estimates the frames of a swarm; decodes messages, and works out what the proofs of log
    entries are signatures of. A simulation of many drones has them share the results.
    """

    estimators: Estimators = estimator_named
    frame_estimates: FrameEstimates = Estimate
    read: Read = decode_from
    signed_root: SignedRoot = signed_root


ALONE = Computing()
