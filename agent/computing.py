"""Computations that depend on their inputs alone, with equal results in all agents with equal logs."""

from __future__ import annotations

from typing import NamedTuple

from agent.frames.estimate import Estimate, FrameEstimates
from agent.fusion.registry import Estimators, estimator_named
from protocol.codec import Read, decode_from
from protocol.signing import SignedRoot, signed_root


class Computing(NamedTuple):
    """Factories of estimators (by name) and frame estimates, decoder of messages, and the signed roots of log entries' proofs.
    The drones of a large simulation share the results.
    """

    estimators: Estimators = estimator_named
    frame_estimates: FrameEstimates = Estimate
    read: Read = decode_from
    signed_root: SignedRoot = signed_root


ALONE = Computing()
