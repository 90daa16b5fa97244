"""Fusions with the frames of the launch layout."""

from radron.agent.frames.graph import FrameGraph
from radron.agent.fusion.engine import Fusion


def fusion_of(mission, estimator=None):
    """With the mission's estimator, or another."""
    return Fusion(mission, FrameGraph.from_launch_layout(mission), estimator)
