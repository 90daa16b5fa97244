"""The engine and the frames: entries measured in local frames that become known, or change, while they are in the log."""

import msgspec
import numpy as np
import pytest

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.fusion import observations
from radron.agent.fusion.engine import Fusion
from radron.protocol.entries import Cone
from support.flights.fusions import fusion_of


def test_observations_that_are_made_again_have_the_same_bits(kit, mission, entries, in_order, monkeypatch):
    monkeypatch.setattr(observations, "MAX_HELD_OBSERVATIONS", 3)
    fusion = fusion_of(mission)
    kit.feed(fusion, entries[::-1])
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert kit.agrees(fusion, in_order)
    with pytest.raises(KeyError):
        fusion._observations.of(entries[0].entry_id._replace(sequence=5000))


def test_a_frame_that_is_lost_while_late_entries_wait_ends_no_flight(kit, mission, entries, monkeypatch):
    """Measurements in it go with the next change of the frames; a step that is computed again before leaves it out."""
    monkeypatch.setattr(observations, "MAX_HELD_OBSERVATIONS", 0)
    graph = FrameGraph.from_launch_layout(mission)
    fusion = Fusion(mission, graph)
    now_ns = max(entry.stamp_ns for entry in entries) + 10**9
    kit.feed(fusion, entries)
    kit.settle(fusion, now_ns)
    graph.replace_from("b", 0, 0, [(0, None)])
    recent = [entry for entry in entries if entry.stamp_ns > now_ns - 5 * 10**9]
    gone = [entry.entry_id for entry in recent if entry.drone == "a"]
    assert any(entry.drone == "b" and entry.stamp_ns > min(one.stamp_ns for one in gone) for entry in recent)
    fusion.forget(gone)  # their steps are computed again
    fusion.advance(now_ns, takes_late=False)
    assert fusion.pending
    kit.settle(fusion, now_ns)
    without, plain = FrameGraph.from_launch_layout(mission), [one for one in entries if one.entry_id not in gone]
    without.replace_from("b", 0, 0, [(0, None)])
    other = Fusion(mission, without)
    kit.feed(other, plain)
    kit.settle(other, now_ns)
    np.testing.assert_array_equal(fusion.hypothesis.position, other.hypothesis.position)


def test_drones_with_their_own_frames_agree_with_one_common_frame(kit, entries, mission):
    """The same flight, written down in frames that are turned and shifted, is the same flight."""
    layout = {"a": (30.0, (5.0, -3.0, 0.0)), "b": (-120.0, (-20.0, 8.0, 0.0)), "c": (0.0, (0.0, 0.0, 0.0))}
    drones = tuple(DroneInMission(id=name, yaw_deg=yaw, origin_m=origin) for name, (yaw, origin) in layout.items())
    turned_mission = kit.mission_of(drones=drones, initial_cones=6)
    turned = []
    for entry in entries:
        if entry.sequence >= 1000:
            continue
        yaw_deg, origin = layout[entry.drone]
        c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
        back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # local from mission
        local = kit.cone_entry(
            turned_mission,
            (entry.stamp_ns - kit.T0_NS) / 1e9,
            back @ (np.array(entry.apex_m) - origin),
            back @ np.array(entry.orders[0].axis),
            entry.orders[0].theta_rad,
            drone=entry.drone,
            sequence=entry.sequence,
            boot=entry.boot,
        )
        turned.append(msgspec.structs.replace(local, stamp_ns=entry.stamp_ns))
    fusion, plain = fusion_of(turned_mission), fusion_of(mission)
    kit.feed(fusion, turned)
    kit.feed(plain, entries)
    hypothesis = kit.settle(fusion, kit.T0_NS + kit.END_NS)
    np.testing.assert_allclose(hypothesis.position, kit.settle(plain, kit.T0_NS + kit.END_NS).position, atol=1e-5)


@pytest.mark.parametrize("learnt_at", [0, 10, 40, None])
def test_entries_of_an_unknown_epoch_join_when_the_frame_is_known(kit, mission, entries, learnt_at):
    """Drone b's cones after 10 s are of epoch 1, in a frame that is 7 m off."""
    jump_ns = kit.T0_NS + 10_000_000_000
    moved = [
        msgspec.structs.replace(e, epoch=1, apex_m=(e.apex_m[0] - 7.0, *e.apex_m[1:]))
        if e.drone == "b" and e.stamp_ns > jump_ns and e.sequence < 1000
        else e
        for e in entries
    ]
    assert sum(entry.epoch for entry in moved) > 5
    frames = FrameGraph.from_launch_layout(mission)
    fusion = Fusion(mission, frames)
    for index, entry in enumerate(moved):
        if index == learnt_at:
            frames.place("b", 1, Transform(0.0, (7.0, 0.0, 0.0)))
        kit.feed(fusion, [entry])
        fusion.advance(entry.stamp_ns)
    without = kit.settle(fusion, kit.T0_NS + kit.END_NS)
    if learnt_at is None:
        digest = fusion.digest
        frames.place("b", 1, Transform(1.0, (0.0, 0.0, 0.0)))  # wrong at first: the newest replaces it
        kit.settle(fusion, kit.T0_NS + kit.END_NS)
        frames.place("b", 1, Transform(0.0, (7.0, 0.0, 0.0)))
        kit.settle(fusion, kit.T0_NS + kit.END_NS)
        assert fusion.digest == digest
        assert fusion.hypothesis.cones > without.cones
    reference = fusion_of(mission)
    kit.feed(reference, entries)
    np.testing.assert_allclose(fusion.hypothesis.position, kit.settle(reference, kit.T0_NS + kit.END_NS).position, atol=1e-6)
    assert fusion.hypothesis.cones == reference.hypothesis.cones


def test_a_frame_that_changes_between_two_entries_moves_the_earlier_one_too(kit, mission):
    """No advance in between: the earlier entry must not keep the older transform."""
    cones = kit.flight(mission, np.random.default_rng(8), 20.0, lambda _: (50.0, 50.0))
    frames, final = FrameGraph.from_launch_layout(mission), FrameGraph.from_launch_layout(mission)
    fusion = Fusion(mission, frames)
    kit.feed(fusion, cones[:10])
    for graph in (frames, final):
        graph.place("a", 0, Transform(0.1, (1.0, 0.0, 0.0)))
    kit.feed(fusion, cones[10:])
    other = Fusion(mission, final)
    kit.feed(other, cones)
    assert kit.same_bits(kit.settle(fusion, kit.T0_NS + kit.END_NS), kit.settle(other, kit.T0_NS + kit.END_NS))


def test_a_frame_that_moves_from_some_time_on_moves_what_was_measured_since_alone(kit, mission, entries, in_order):
    """Drone b's localisation is 7 m off from 10 s on, which is learnt at 20 s: exactly undone, and only from there on."""
    jump_ns = kit.T0_NS + 10_000_000_000
    moved = [
        msgspec.structs.replace(e, apex_m=(e.apex_m[0] - 7.0, *e.apex_m[1:])) if e.drone == "b" and e.stamp_ns >= jump_ns else e
        for e in entries
        if e.sequence < 1000
    ]
    frames = FrameGraph.from_launch_layout(mission)
    fusion = Fusion(mission, frames)
    for entry in moved:
        if entry.stamp_ns > jump_ns + 10_000_000_000:
            frames.replace_from("b", 0, jump_ns, [(jump_ns, Transform(0.0, (7.0, 0.0, 0.0)))])
        kit.feed(fusion, [entry])
        fusion.advance(entry.stamp_ns)
    reference = fusion_of(mission)
    kit.feed(reference, [entry for entry in entries if entry.sequence < 1000])
    expected = kit.settle(reference, kit.T0_NS + kit.END_NS).position
    np.testing.assert_allclose(kit.settle(fusion, kit.T0_NS + kit.END_NS).position, expected, atol=1e-6)
    frames.replace_from("b", 0, jump_ns, [(jump_ns, None)])  # lost: later measurements wait again
    fewer = kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert fewer.cones == sum(not (e.drone == "b" and e.stamp_ns >= jump_ns) for e in moved if isinstance(e, Cone))
