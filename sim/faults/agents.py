"""Faults of the agents: their processes, the links between them, members that say what is not so, and their disks."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from sim.faults.base import Delay, Drones, Family, Fault, Metres, Probability


class Kill(Fault, frozen=True, kw_only=True, tag="kill"):
    """The agent dies at once (kill -9). With ``for_s`` its service manager starts it again after that time."""

    family: ClassVar[Family] = "process"


class Freeze(Fault, frozen=True, kw_only=True, tag="freeze"):
    """The agent stands still (SIGSTOP). After a second its watchdog kills it; it is started again when the fault is over."""

    family: ClassVar[Family] = "process"


class Late(Fault, frozen=True, kw_only=True, tag="late"):
    """The agent is started only at ``at_s``, when the others fly, and the operator starts its drone then."""

    family: ClassVar[Family] = "process"

    def check(self) -> str | None:
        """``for_s`` has no meaning here."""
        return "for_s: an agent that is late stays; remove it" if self.for_s is not None else None


class SlowCpu(Fault, frozen=True, kw_only=True, tag="slow-cpu"):
    """Each step of the agent comes up to ``late_s`` late, uniformly."""

    family: ClassVar[Family] = "process"
    late_s: Annotated[float, Meta(gt=0.0, le=2.0)]


class Partition(Fault, frozen=True, kw_only=True, tag="partition"):
    """The groups do not hear each other. Drones in no group are alone. ``target`` is not used."""

    family: ClassVar[Family] = "network"
    groups: Annotated[tuple[tuple[str, ...], ...], Meta(min_length=1, max_length=64)]

    def names(self) -> tuple[str, ...]:
        """All drones in the groups."""
        return tuple(name for group in self.groups for name in group)

    def check(self) -> str | None:
        """Each drone is in one group."""
        names = self.names()
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            return f"groups: {', '.join(twice)} in more than one group; give each drone once"
        return None if self.target is None else "target: groups say who is cut off; remove it"


class LinkFault(Fault, frozen=True, kw_only=True):
    """Links of the targets with ``peers`` (all others if not given), in both directions, or what they send or receive only."""

    family: ClassVar[Family] = "network"
    peers: Drones | None = None
    direction: Literal["both", "send", "receive"] = "both"

    def names(self) -> tuple[str, ...]:
        """All drones named in it."""
        return (*Fault.names(self), *self.names_of_peers())

    def names_of_peers(self) -> tuple[str, ...]:
        """The drones named as peers; none where they are all others."""
        return () if self.peers is None else (self.peers,) if isinstance(self.peers, str) else self.peers


class Cut(LinkFault, frozen=True, kw_only=True, tag="cut"):
    """Nothing gets through, and nobody is told; one way with ``direction``."""


class Loss(LinkFault, frozen=True, kw_only=True, tag="loss"):
    """Messages are lost. ``resent``: log entries are repeated by their publisher until they arrive, unless its cache has
    overflowed. ``news``: only messages of this kind are lost; all kinds if it is not given.
    """

    probability: Probability
    resent: bool = True
    news: Literal["pose", "plan", "frame", "estimate", "status"] | None = None


class Lag(LinkFault, frozen=True, kw_only=True, tag="delay"):
    """Messages take ``delay_s`` longer, and up to ``jitter_s`` more, uniformly; with jitter they overtake each other."""

    delay_s: Delay = 0.0
    jitter_s: Delay = 0.0

    def check(self) -> str | None:
        """One of the two is needed."""
        return "delay_s, jitter_s: give at least one above 0" if self.delay_s + self.jitter_s == 0.0 else None


class Stall(LinkFault, frozen=True, kw_only=True, tag="stall"):
    """Links stand still: what is sent arrives when it is over, all at once, as where TCP repeats it; live flights only."""


class Throttle(LinkFault, frozen=True, kw_only=True, tag="throttle"):
    """Links carry ``rate_kilobytes_ps`` (kilobytes a second) at most; live flights only."""

    rate_kilobytes_ps: Annotated[float, Meta(gt=0.0, le=1e6)]


class Reorder(LinkFault, frozen=True, kw_only=True, tag="reorder"):
    """Messages are held back for ``held_s`` and so overtaken by later ones."""

    probability: Probability
    held_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.3


class Duplicate(LinkFault, frozen=True, kw_only=True, tag="duplicate"):
    """Messages arrive twice, the second one up to ``within_s`` later."""

    probability: Probability
    within_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 1.0


class Corrupt(LinkFault, frozen=True, kw_only=True, tag="corrupt"):
    """Messages arrive with changed, missing or additional bytes."""

    probability: Probability


class RadioRange(Fault, frozen=True, kw_only=True, tag="range"):
    """Drones that are further apart than ``range_m`` do not hear each other."""

    family: ClassVar[Family] = "network"
    range_m: Annotated[float, Meta(gt=0.0, le=1e5)]


class Flood(Fault, frozen=True, kw_only=True, tag="flood"):
    """The targets send many messages: ``rate_mbps`` (megabytes a second) of poses padded to ``message_bytes``.

    They are valid up to 4 kB; larger ones are refused by their size.
    """

    family: ClassVar[Family] = "network"
    rate_mbps: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    message_bytes: Annotated[int, Meta(ge=100, le=65_536)] = 200


class OldEntries(Fault, frozen=True, kw_only=True, tag="old-entries"):
    """Valid log entries of ``ago_s`` before, ``per_s`` a second, beside those of the targets and with their keys: after each one
    much has to be computed again.
    """

    family: ClassVar[Family] = "network"
    per_s: Annotated[float, Meta(gt=0.0, le=1e4)] = 3.0
    ago_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 60.0


class DenseEntries(Fault, frozen=True, kw_only=True, tag="dense-entries"):
    """More valid log entries than cameras measure, ``per_s`` a second, beside those of the targets and with their keys.

    ``what``: exposures without counts, cones that say nothing, or searched paths, the smallest of all entries.
    """

    family: ClassVar[Family] = "network"
    what: Literal["exposure", "cone", "coverage"] = "exposure"
    per_s: Annotated[float, Meta(gt=0.0, le=1e4)] = 900.0


class Forged(Fault, frozen=True, kw_only=True, tag="forged"):
    """The targets also send messages that every agent must refuse: nothing may follow from them.

    ``impossible``: numbers that contradict each other, such as a live time longer than its exposure. ``impersonated``:
    under their own keys, as if they were another drone, 15 m beside it. ``other-mission``: log entries of another mission,
    in which the source lay elsewhere. ``two-versions``: each log entry a second time under the same number with another
    content; neither of the two counts then, nor what follows.
    """

    family: ClassVar[Family] = "network"
    what: Literal["impossible", "impersonated", "other-mission", "two-versions"]


class CopiedKey(Fault, frozen=True, kw_only=True, tag="copied-key"):
    """A thief with copies of the targets' keys publishes under their ids too: poses, plans and statuses.

    ``place``: where it has them: ``beside_m`` to the east of where they are, or of where they were when it began (``frozen``), or
    on the ground below that (``ground``). ``epochs``: added to theirs. ``boot``: of its statuses. ``stage``: likewise; None:
    theirs. ``lead_s``: of its stamps before the time, ``period_s``: of its publications.
    """

    family: ClassVar[Family] = "liar"
    beside_m: Annotated[float, Meta(ge=0.0, le=1e4)] = 15.0
    place: Literal["beside", "frozen", "ground"] = "beside"
    epochs: Annotated[int, Meta(ge=0, le=1000)] = 0
    boot: Literal["other", "same"] = "other"
    stage: Literal["preflight", "takeoff", "track", "hold", "return", "landing", "landed"] | None = "landed"
    lead_s: Annotated[float, Meta(ge=-2.0, le=2.0)] = 0.01
    period_s: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.1


class OldCommand(Fault, frozen=True, kw_only=True, tag="old-command"):
    """The operator commands the targets to hold, and to resume 3 s later; 5 s after that a slow link delivers the hold again."""

    family: ClassVar[Family] = "network"

    def check(self) -> str | None:
        """It takes its time."""
        return "for_s: the commands come when they come; remove it" if self.for_s is not None else None


Said = Literal["pose", "plan", "cone", "counts", "sighting"]


class Lie(Fault, frozen=True, kw_only=True, tag="lie"):
    """The targets publish what is not so.

    ``what``: the messages. ``how``: ``false`` (positions shifted by ``shift_m``, cones turned, counts multiplied by ``factor``);
    ``replayed``: what was true ``ago_s`` before, under new stamps; ``mistimed``: what is true, with stamps wrong by ``ago_s``.
    """

    family: ClassVar[Family] = "liar"
    what: Said
    how: Literal["false", "replayed", "mistimed"] = "false"
    shift_m: Metres = 20.0
    factor: Annotated[float, Meta(ge=0.0, le=1000.0)] = 5.0
    ago_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 5.0


class Poisoned(Fault, frozen=True, kw_only=True, tag="poisoned"):
    """The targets publish exposures that mislead the estimator, signed, at a place on the ground that they know for certain.

    ``counts``: ``none`` or ``many``. ``place``: at the source estimate, or 15 m beside it. ``beside``: with each of their own
    exposures, ``burst`` more of ``lasts_s``, which overlap it and each other; else in the place of their own.
    """

    family: ClassVar[Family] = "liar"
    counts: Literal["none", "many"] = "none"
    place: Literal["estimate", "elsewhere"] = "estimate"
    beside: bool = True
    lasts_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 2.0
    burst: Annotated[int, Meta(ge=1, le=100)] = 1


class Equivocating(Fault, frozen=True, kw_only=True, tag="equivocating"):
    """The targets give ``peers`` other log entries than the rest under the same numbers: cones turned, counts multiplied,
    sightings of other places. ``peers``: if not given, every second of the other drones.

    All must find out, leave the same of it out, and agree on one log.
    """

    family: ClassVar[Family] = "liar"
    peers: Drones | None = None

    def names(self) -> tuple[str, ...]:
        """All drones named in it."""
        return (*Fault.names(self), *((self.peers,) if isinstance(self.peers, str) else self.peers or ()))


class Revoked(Fault, frozen=True, kw_only=True, tag="revoked"):
    """The operator revokes the targets: what they have measured counts up to then, and they are not heard any more, nor hear
    the others.
    """

    family: ClassVar[Family] = "process"

    def check(self) -> str | None:
        """There is no way back."""
        return "for_s: who is revoked stays so; remove it" if self.for_s is not None else None


class Disk(Fault, frozen=True, kw_only=True, tag="disk"):
    """The drone's disk: full, ``slow``, or its state file (``state``) or flight record (``record``) torn or with flipped bits."""

    family: ClassVar[Family] = "disk"
    how: Literal["full", "slow", "state-torn", "state-flipped", "record-torn", "record-removed"]
