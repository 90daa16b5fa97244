import msgspec

from radron.station.picture.frame import ConeCurve, DroneFrame, Frame
from radron.station.picture.history import CONES_MS, FRAME_MS, MAX_DRAWN_CONES, RASTER_MS, History


def frame(at_ms, x=0.0):
    return Frame(at_ms=at_ms, drones=(DroneFrame(id="d1", place=(x, 1.0, 2.0), rates_ps=(7.0, 1.0, 0.5)), DroneFrame(id="d2")))


def kept(history, at_ms, x=0.0):
    one = frame(at_ms, x)
    return history.add_frame(one, msgspec.json.encode(one))


def test_a_frame_a_second_is_kept_and_found_again():
    history = History(2)
    assert sum(kept(history, at_ms, x=at_ms) for at_ms in range(0, 3 * FRAME_MS, 100)) == 3
    assert history.last_ms == 2 * FRAME_MS
    assert msgspec.json.decode(history.frame(FRAME_MS + 999))["at_ms"] == FRAME_MS
    assert [one.at_ms for one in history.frames()] == [0, FRAME_MS, 2 * FRAME_MS]
    assert history.frame(-1) is None


def test_layers_come_where_they_are_others_than_before():
    history = History(2)
    assert history.wants_rasters(0)
    for at_ms in (0, RASTER_MS):
        history.add_layer("belief", at_ms, b"belief %d" % at_ms)
        history.add_layer("spectra", at_ms, b"spectra %d" % at_ms)
    assert not history.wants_rasters(2 * RASTER_MS - 1)
    assert history.layers(RASTER_MS, None) == {
        "belief": b"belief %d" % RASTER_MS,
        "dose": None,
        "spectra": b"spectra %d" % RASTER_MS,
    }
    assert history.layers(RASTER_MS + 500, RASTER_MS) == {}
    assert history.layers(RASTER_MS - 1, RASTER_MS) == {"belief": b"belief 0", "spectra": b"spectra 0"}
    assert history.layers(-1, 0) == {"belief": None, "spectra": None}


def test_the_cones_of_a_time_are_found_in_the_order_in_which_they_came_and_the_newest_where_they_are_too_many():
    history = History(2)
    for at_ms in range(0, 20_000, 25):
        history.add_cone(ConeCurve(at_ms=at_ms, drone="d1", curves=(((0.0, 0.0), (1.0, 1.0)),)), at_ms)

    def times(after_ms, until_ms):
        return [msgspec.json.decode(cone)["at_ms"] for cone in history.cones(after_ms, until_ms)]

    assert times(9_990, 10_060) == [10_000, 10_025, 10_050]
    assert times(19_900, 30_000) == [19_925, 19_950, 19_975]  # not packed yet
    assert times(10_000 - CONES_MS, 10_000) == list(range(10_000 - (MAX_DRAWN_CONES - 1) * 25, 10_001, 25))
