from radron.station.picture.events import Events
from radron.station.picture.frame import DroneFrame, Frame, SourceFrame

SOURCE = SourceFrame(
    place=(1.0, 2.0, 0.0),
    covariance_m2=(0.5, 0.0, 0.0, 0.5, 0.0, 0.0),
    rms_m=1.0,
    region=(2.0, 1.0, 0.0),
    velocity_mps=(0.0, 0.0),
    cones=9,
    nuclide="Cs-137",
)


def frame(at_ms=0, source=None, finding="", **drone):
    return Frame(at_ms=at_ms, drones=(DroneFrame(id="d1", **drone),), source=source, finding=finding)


def told(events, given):
    return [(event.text, *event.values.values()) for event in events.since(given)]


def test_each_change_is_told_once():
    events = Events(["d1"])
    assert told(events, frame()) == []
    heard = {"stage": "takeoff", "stale": False, "age_s": 0.1}
    assert told(events, frame(1, **heard)) == [("stage", "d1", "takeoff"), ("heard", "d1")]
    assert told(events, frame(2, **heard)) == []
    assert told(events, frame(3, **heard, problems=("no camera",), problem_codes=("camera-missing",))) == [
        ("problem", "d1", "no camera", "camera-missing")
    ]
    assert told(events, frame(4, **heard, problems=("no camera",), problem_codes=("camera-missing",), source=SOURCE)) == [
        ("source found",)
    ]
    assert told(events, frame(5, **heard)) == [("problem over", "d1", "no camera", "camera-missing"), ("source given up",)]
    assert told(events, frame(6, **heard | {"stale": True}, finding="nothing")) == [("silent", "d1"), ("finding", "nothing")]


def test_what_needs_attention_is_a_warning():
    events = Events(["d1"])
    events.since(frame(stage="track", stale=False, age_s=0.0))
    levels = {event.text: event.level for event in events.since(frame(1, stage="return", age_s=2.0, problems=("fire",)))}
    assert levels == {"stage": "info", "silent": "warning", "problem": "warning"}
