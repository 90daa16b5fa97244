"""Frames for an agent restarted in flight, in use until its log gives them: for ever if all agents have lost their logs."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from radron.agent.frames.graph import LAUNCH_EPOCH
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array

_Number = float | None  # JSON has finite numbers only: others become null
_LARGEST = np.array([7.0, 1e5, 1e5, 1e5])  # of a yaw (rad) and a translation (m): the limit of positions in messages
_LARGEST_VARIANCE = 1e10  # m^2


class KeptTransform(Struct, frozen=True, kw_only=True):
    """A transform from a local frame into the mission frame, as stored in a state file for a restarted agent.

    ``covariance``: 16 numbers by rows; None: exact. A number is None if it was not finite.
    """

    yaw_rad: _Number
    translation_m: tuple[_Number, _Number, _Number]
    covariance: Annotated[tuple[_Number, ...], Meta(min_length=16, max_length=16)] | None

    @property
    def mission_from_local(self) -> Transform | None:
        """The stored transform; None if the numbers cannot be a frame, because one is not finite, or too large."""
        pose = np.array([self.yaw_rad, *self.translation_m], dtype=np.float64)
        covariance = None if self.covariance is None else np.array(self.covariance, dtype=np.float64).reshape(4, 4)
        if not (np.abs(pose) <= _LARGEST).all() or (covariance is not None and not _is_plausible(covariance)):
            return None
        yaw_rad, x, y, z = pose.tolist()
        return Transform(yaw_rad, (x, y, z), covariance)


class KeptFrame(KeptTransform, frozen=True, kw_only=True):
    """The local frame of one epoch (period without a jump of the localisation) of a drone, as stored for a restarted agent.

    ``stamp_ns``: time for which the transform holds (0: stored by an older release). ``otherwise``: the same frame by the other
    explanation of a jump of the own localisation (``localization.knownframe``); None: there is no such doubt.
    """

    epoch: int
    stamp_ns: int = 0
    otherwise: KeptTransform | None = None

    @classmethod
    def of(
        cls, epoch: int, stamp_ns: int, mission_from_local: Transform | None, otherwise: Transform | None = None
    ) -> KeptFrame | None:
        """Return a frame in the form to store; None if the frame is unknown, or given by the mission, so that nothing must be
        stored.
        """
        if mission_from_local is None or (mission_from_local.covariance is None and epoch == LAUNCH_EPOCH):
            return None
        return cls(
            epoch=epoch,
            stamp_ns=stamp_ns,
            yaw_rad=mission_from_local.yaw_rad,
            translation_m=mission_from_local.translation,
            covariance=mission_from_local.covariance_rows,
            otherwise=None if otherwise is None else _kept(otherwise),
        )

    @property
    def is_plausible(self) -> bool:
        """Whether the stored values are valid for a frame."""
        return all(one is None or one.mission_from_local is not None for one in (self, self.otherwise))


def _kept(transform: Transform) -> KeptTransform:
    return KeptTransform(yaw_rad=transform.yaw_rad, translation_m=transform.translation, covariance=transform.covariance_rows)


def _is_plausible(covariance: Array) -> bool:
    return bool((np.abs(covariance) <= _LARGEST_VARIANCE).all() and (covariance.diagonal() >= 0.0).all())
