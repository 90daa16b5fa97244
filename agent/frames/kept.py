"""Frames that an agent restarted in flight goes on with until its log tells them: never, where all agents have lost theirs."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from agent.frames.transform import Transform
from agent.geometry import Vector3


class KeptFrame(Struct, frozen=True):
    """The local frame of one epoch of a drone in the mission frame, as a state file holds it (``Transform``).

    ``covariance``: the 16 numbers of the matrix, by rows.
    """

    epoch: int
    yaw_rad: float
    translation_m: Vector3
    covariance: Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]

    @classmethod
    def of(cls, epoch: int, mission_from_local: Transform | None) -> KeptFrame | None:
        """None where the frame is not known, or exact: then the mission tells it."""
        if mission_from_local is None or mission_from_local.covariance is None:
            return None
        rows = tuple(mission_from_local.covariance.ravel().tolist())
        return cls(epoch, mission_from_local.yaw_rad, mission_from_local.translation, rows)

    @property
    def mission_from_local(self) -> Transform:
        """As it was when it was kept."""
        return Transform(self.yaw_rad, self.translation_m, np.array(self.covariance).reshape(4, 4))
