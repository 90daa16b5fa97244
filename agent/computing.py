"""Computations that depend on their inputs alone, with equal results in all agents with equal logs."""

from __future__ import annotations

from typing import NamedTuple

from radron.agent.frames.estimate import Estimate, FrameEstimates
from radron.agent.fusion.registry import Estimators, estimator_named
from radron.protocol.codec import Read, decode_from
from radron.protocol.signing import SignedRoot, signed_root


class Computing(NamedTuple):
    """The functions for expensive computations whose results depend on their inputs alone, so that simulated drones can share
    them.

    ``estimators``: makes an estimator by its name. ``frame_estimates``: makes an estimate of the drones' frames. ``read``:
    decodes a message. ``signed_root``: returns the signature in a log entry's proof, with the bytes that the signature must
    cover.
    """

    estimators: Estimators = estimator_named
    frame_estimates: FrameEstimates = Estimate
    read: Read = decode_from
    signed_root: SignedRoot = signed_root


ALONE = Computing()
