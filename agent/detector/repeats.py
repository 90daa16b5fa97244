"""Readouts that come again: a camera that has hung delivers an old measurement as if it were new."""

from __future__ import annotations

from collections import OrderedDict
from hashlib import blake2b

from msgspec.structs import replace

from radron.agent.detector.readout import PixelHits, Readout
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

KEPT_READOUTS = 64  # readouts that the present one is compared with: 13 s of them
MIN_COMPARED_PIXELS = 3  # of a readout that is compared
MAX_COMPARED_HITS = 512  # the first ones of a readout, by which it is compared: 0.3 ms at most


class Repeats:
    """Drops the readouts of a camera that has hung and delivers an old measurement again and again, as if it were new.

    Pixels, times over threshold and the times between the hits, to 1.6 ns, are as random as decay and noise, and never come
    again. Two clusters of three pixels agree in all of this once in 1e11 times or more rarely, two events in one readout once in
    1e16. One or two pixels alone may well be noisy pixels with always the same pulse, which ``NoiseMask`` leaves out. A camera
    that repeats so little is mute after that.

    After a repeated readout nothing is used until a readout with enough hits is new: empty readouts in between may be repeated,
    too.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[bytes, None] = OrderedDict()  # digests of the last readouts
        self._hangs = False
        self.readouts = 0  # left out so far

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator while the camera repeats readouts (pixel hits of one interval); empty otherwise."""
        text = "camera: it delivers the same hits again and again; they are not used"
        return (CodedText(Code.CAMERA_REPEATS, text),) if self._hangs else ()

    def without(self, readout: Readout) -> Readout:
        """Return the readout if it is new. A repeated readout is returned without hits and with live time 0: nothing was measured
        in it.
        """
        hits = readout.hits
        if len(hits) >= MIN_COMPARED_PIXELS and len(set(hits.index[:MAX_COMPARED_HITS].tolist())) >= MIN_COMPARED_PIXELS:
            digest = _digest(hits)
            self._hangs = digest in self._kept
            self._kept[digest] = None
            self._kept.move_to_end(digest)
            if len(self._kept) > KEPT_READOUTS:
                self._kept.popitem(last=False)
        if not self._hangs:
            return readout
        self.readouts += 1
        return replace(readout, live_time_s=0.0, hits=PixelHits.none(), lost_hits=0)


def _digest(hits: PixelHits) -> bytes:
    first = hits.take(slice(MAX_COMPARED_HITS))
    ticks = first.tick - first.tick[0]
    return blake2b(ticks.tobytes() + first.index.tobytes() + first.tot.tobytes(), digest_size=16).digest()
