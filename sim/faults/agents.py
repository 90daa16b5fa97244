"""Faults of the agents: their processes, the links between them, false messages, and their disks."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from radron.sim.faults.base import Delay, Drones, Family, Fault, Metres, Probability


class Kill(Fault, frozen=True, kw_only=True, tag="kill"):
    """The agent (onboard software) of a drone dies at once (kill -9).

    With ``for_s`` its service manager restarts it after that time.
    """

    family: ClassVar[Family] = "process"


class Freeze(Fault, frozen=True, kw_only=True, tag="freeze"):
    """The agent (onboard software) of a drone stands still (SIGSTOP).

    Its watchdog kills it after a second; the agent is restarted at the end of the fault.
    """

    family: ClassVar[Family] = "process"


class Late(Fault, frozen=True, kw_only=True, tag="late"):
    """The agent of a drone is started only at ``at_s``, when other drones are in flight; the operator then starts its drone."""

    family: ClassVar[Family] = "process"

    def check(self) -> str | None:
        """Reject ``for_s``, as a late start has no end."""
        return "for_s: an agent that is late stays; remove it" if self.for_s is not None else None


class SlowCpu(Fault, frozen=True, kw_only=True, tag="slow-cpu"):
    """Each step of the agent is late by a random time of up to ``late_s``, uniformly distributed."""

    family: ClassVar[Family] = "process"
    late_s: Annotated[float, Meta(gt=0.0, le=2.0)]


class Partition(Fault, frozen=True, kw_only=True, tag="partition"):
    """The network falls apart into groups of drones, with no messages between the groups.

    Drones in no group are alone. ``target`` is not used.
    """

    family: ClassVar[Family] = "network"
    groups: Annotated[tuple[tuple[str, ...], ...], Meta(min_length=1, max_length=64)]

    def names(self) -> tuple[str, ...]:
        """Return the ids of all drones in the groups."""
        return tuple(name for group in self.groups for name in group)

    def check(self) -> str | None:
        """Check that each drone is in one group only; return an error text, or None."""
        names = self.names()
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            return f"groups: {', '.join(twice)} in more than one group; give each drone once"
        return None if self.target is None else "target: groups say who is cut off; remove it"


class LinkFault(Fault, frozen=True, kw_only=True):
    """Base of the faults of the links between the affected drones (``target``) and ``peers`` (default: all other drones).

    ``direction``: both directions, or only messages that the affected drones send or receive.
    """

    family: ClassVar[Family] = "network"
    peers: Drones | None = None
    direction: Literal["both", "send", "receive"] = "both"

    def names(self) -> tuple[str, ...]:
        """Return the ids of all drones named in the fault."""
        return (*Fault.names(self), *self.names_of_peers())

    def names_of_peers(self) -> tuple[str, ...]:
        """Return the ids of the drones named as peers; empty for the default, all other drones."""
        return () if self.peers is None else (self.peers,) if isinstance(self.peers, str) else self.peers


class Cut(LinkFault, frozen=True, kw_only=True, tag="cut"):
    """Messages on the links are dropped without a notice to either end; one way only with ``direction``."""


class Loss(LinkFault, frozen=True, kw_only=True, tag="loss"):
    """Messages on the links are lost at random.

    ``resent``: publishers repeat log entries until they arrive, unless their cache has overflowed. ``news``: the kind of message
    that is lost; default: all kinds.
    """

    probability: Probability
    resent: bool = True
    news: Literal["pose", "plan", "frame", "estimate", "status"] | None = None


class Lag(LinkFault, frozen=True, kw_only=True, tag="delay"):
    """Messages on the links take ``delay_s`` longer, plus a random time up to ``jitter_s``.

    With jitter the messages overtake each other.
    """

    delay_s: Delay = 0.0
    jitter_s: Delay = 0.0

    def check(self) -> str | None:
        """Check that ``delay_s`` or ``jitter_s`` is given; return an error text, or None."""
        return "delay_s, jitter_s: give at least one above 0" if self.delay_s + self.jitter_s == 0.0 else None


class Stall(LinkFault, frozen=True, kw_only=True, tag="stall"):
    """The links stall: all messages sent meanwhile arrive at once at the end, as with TCP retransmission; live flights only."""


class Throttle(LinkFault, frozen=True, kw_only=True, tag="throttle"):
    """The links carry at most ``rate_kilobytes_ps`` (kilobytes a second); live flights only."""

    rate_kilobytes_ps: Annotated[float, Meta(gt=0.0, le=1e6)]


class Reorder(LinkFault, frozen=True, kw_only=True, tag="reorder"):
    """Messages on the links are held back at random for ``held_s``, so that later messages overtake them."""

    probability: Probability
    held_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.3


class Duplicate(LinkFault, frozen=True, kw_only=True, tag="duplicate"):
    """Messages on the links arrive twice at random, the copy up to ``within_s`` later."""

    probability: Probability
    within_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 1.0


class Corrupt(LinkFault, frozen=True, kw_only=True, tag="corrupt"):
    """Messages on the links arrive at random with changed, missing or additional bytes."""

    probability: Probability


class RadioRange(Fault, frozen=True, kw_only=True, tag="range"):
    """Drones that are further apart than ``range_m`` have no link."""

    family: ClassVar[Family] = "network"
    range_m: Annotated[float, Meta(gt=0.0, le=1e5)]


class Flood(Fault, frozen=True, kw_only=True, tag="flood"):
    """The affected drones flood the network with messages.

    The messages are poses padded to ``message_bytes``, ``rate_mbps`` (megabytes a second) in total. Messages up to 4 kB are
    valid; the decoder refuses larger messages by their size.
    """

    family: ClassVar[Family] = "network"
    rate_mbps: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    message_bytes: Annotated[int, Meta(ge=100, le=65_536)] = 200


class OldEntries(Fault, frozen=True, kw_only=True, tag="old-entries"):
    """An attacker with the keys of the affected drones publishes valid log entries with old time stamps.

    Such entries make the agents compute much again. They are ``ago_s`` old, come ``per_s`` times a second, and stand beside the
    drones' own entries.
    """

    family: ClassVar[Family] = "network"
    per_s: Annotated[float, Meta(gt=0.0, le=1e4)] = 3.0
    ago_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 60.0


class DenseEntries(Fault, frozen=True, kw_only=True, tag="dense-entries"):
    """An attacker with the keys of the affected drones publishes more valid log entries than cameras measure, ``per_s`` a second.

    They stand beside the drones' own entries. ``what``: exposures (counting intervals) without counts, cones without information,
    or searched paths, the smallest of all entries.
    """

    family: ClassVar[Family] = "network"
    what: Literal["exposure", "cone", "coverage"] = "exposure"
    per_s: Annotated[float, Meta(gt=0.0, le=1e4)] = 900.0


class Forged(Fault, frozen=True, kw_only=True, tag="forged"):
    """The affected drones also send forged messages, which every agent must refuse without any consequence.

    ``impossible``: contradictory numbers, such as a live time longer than its counting interval. ``impersonated``: messages in
    the name of another drone, 15 m beside it, under the sender's keys. ``other-mission``: log entries of another mission with the
    source elsewhere. ``two-versions``: each log entry a second time under its number with another content; neither version counts
    then, nor any later entry of the sender.
    """

    family: ClassVar[Family] = "network"
    what: Literal["impossible", "impersonated", "other-mission", "two-versions"]


class CopiedKey(Fault, frozen=True, kw_only=True, tag="copied-key"):
    """A thief with copies of the keys of the affected drones publishes poses, plans and statuses under their ids.

    The drones publish, too. ``place``: the published place: ``beside_m`` to the east of the drone's present place, or of its
    place at the beginning (``frozen``), or on the ground below that (``ground``). ``epochs``: added to the drone's epochs.
    ``boot``: boot id in the statuses (random identity of a run of the agent). ``stage``: stage in the statuses; None: the drone's
    own. ``lead_s``: stamps are ahead of the time by this much. ``period_s``: interval between publications.
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
    """The operator commands a hold, and a resume 3 s later; 5 s after that a slow link delivers the hold a second time."""

    family: ClassVar[Family] = "network"

    def check(self) -> str | None:
        """Reject ``for_s``, as the times of the commands are fixed."""
        return "for_s: the commands come when they come; remove it" if self.for_s is not None else None


Said = Literal["pose", "plan", "cone", "counts", "sighting", "stage", "contacts", "home", "alternative"]


class Lie(Fault, frozen=True, kw_only=True, tag="lie"):
    """The affected drones publish false messages of one kind under valid signatures.

    ``what``: the kind of message, or a field of the poses. ``how``: ``false`` (positions shifted by ``shift_m``, cones turned,
    counts multiplied by ``factor``, every stage ``landing``, lost links two-way and the others lost); ``replayed``: true
    messages of ``ago_s`` before, under new stamps; ``mistimed``: true messages with stamps wrong by ``ago_s``.
    """

    family: ClassVar[Family] = "liar"
    what: Said
    how: Literal["false", "replayed", "mistimed"] = "false"
    shift_m: Metres = 20.0
    factor: Annotated[float, Meta(ge=0.0, le=1000.0)] = 5.0
    ago_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 5.0


class Poisoned(Fault, frozen=True, kw_only=True, tag="poisoned"):
    """The affected drones publish signed false photon counts that mislead the estimator.

    The counts are stated for a place on the ground without position uncertainty. ``counts``: ``none`` or ``many``. ``place``: at
    the source estimate, or 15 m beside it. ``beside``: in addition to each true exposure (counting interval), ``burst`` false
    exposures of ``lasts_s``, which overlap it and each other; otherwise instead of the true exposure.
    """

    family: ClassVar[Family] = "liar"
    counts: Literal["none", "many"] = "none"
    place: Literal["estimate", "elsewhere"] = "estimate"
    beside: bool = True
    lasts_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 2.0
    burst: Annotated[int, Meta(ge=1, le=100)] = 1


class Equivocating(Fault, frozen=True, kw_only=True, tag="equivocating"):
    """The affected drones give some drones (``peers``) other log entries than the rest, under equal sequence numbers.

    Cones are turned, counts multiplied, and sightings (measurements of other drones) moved. ``peers``: by default every second of
    the other drones. All drones must detect this, leave out the same entries, and agree on one log.
    """

    family: ClassVar[Family] = "liar"
    peers: Drones | None = None

    def names(self) -> tuple[str, ...]:
        """Return the ids of all drones named in the fault."""
        return (*Fault.names(self), *((self.peers,) if isinstance(self.peers, str) else self.peers or ()))


class Revoked(Fault, frozen=True, kw_only=True, tag="revoked"):
    """The operator revokes the affected drones (withdraws their rights).

    Their earlier measurements count; their links to the other drones end in both directions.
    """

    family: ClassVar[Family] = "process"

    def check(self) -> str | None:
        """Reject ``for_s``, as a revocation is permanent."""
        return "for_s: who is revoked stays so; remove it" if self.for_s is not None else None


class Disk(Fault, frozen=True, kw_only=True, tag="disk"):
    """The disk of a drone fails: it is full or ``slow``, or a file on it is damaged.

    The damaged file is the agent's state (``state``) or the flight record (``record``), torn or with flipped bits.
    """

    family: ClassVar[Family] = "disk"
    how: Literal["full", "slow", "state-torn", "state-flipped", "record-torn", "record-removed"]
