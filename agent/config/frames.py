"""The ``[frames]`` section of a mission file: how the drones' local frames are estimated in flight."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from radron.agent.config.section import NonNegative, Positive, Section


class FramesConfig(Section, frozen=True, kw_only=True):
    """Settings for the estimation in flight of the drones' local frames that are not known exactly. Drifts and sigmas are 1 sigma
    per axis.

    ``keyframe_s``: interval between two estimates of all frames; ``settle_s``: how long to wait for the measurements of a
    keyframe (the time of such an estimate), because an exposure lasts half a second, and takes time to arrive.
    """

    keyframe_s: Annotated[float, Meta(ge=0.2, le=10.0)] = 1.0
    settle_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.9
    gnss_sigma_m: Positive = 1.5  # of the correlated error of a GNSS position
    rtk_sigma_m: Positive = 0.05
    gnss_correlation_s: Positive = 40.0  # of both errors
    compass_drift_deg: NonNegative = 0.3  # random walk of the heading of an autopilot with GNSS, after a second
    slam_drift_m: NonNegative = 0.1  # horizontal, after a metre flown; grows as the root of the distance: 1 % of 100 m
    slam_climb_m: NonNegative = 0.03  # the same vertically; less with a barometer or rangefinder
    slam_turn_deg: NonNegative = 0.1  # of the heading, after a metre flown
    slam_yaw_drift_deg: NonNegative = 0.1  # of the heading, after a second; grows as the root of the time
    wander_m: NonNegative = 0.03  # random walk of any position, after a second
    jump_m: NonNegative = 0.2  # uncertainty of the frame after a jump of the localisation, and again for each second that it took
    jump_yaw_deg: NonNegative = 2.0
    window_s: Positive = 30.0  # of the sightings from which an unknown frame is found
    lead: Positive = 10.0  # least log-likelihood ratio of the best pose to every other one, for it to be accepted
    aligned_sigma_m: Positive = 1.5  # largest 1 sigma of a pose that is accepted
    aligned_yaw_deg: Positive = 5.0
    suspect_s: Positive = 30.0  # without a contradiction, until a drone that was contradicted is trusted again
