"""Fusions whose frames are those of the launch layout."""

from agent.frames.graph import FrameGraph
from agent.fusion.engine import Fusion


def fusion_of(mission, estimator=None):
    """With the mission's estimator, or another one."""
    return Fusion(mission, FrameGraph.from_launch_layout(mission), estimator)
