"""The faults of a simulated flight, for figures and reports."""

from __future__ import annotations

from collections.abc import Sequence

from radron.sim.faults.agents import Disk, Lie, LinkFault, Partition
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import kind_of
from radron.sim.result import FaultTrace


def told_faults(faults: Sequence[Fault], drones: Sequence[str], until_s: float) -> tuple[FaultTrace, ...]:
    """Return the faults that begin before the end of a flight, in order of their begin, for figures and reports."""
    begun = sorted((fault for fault in faults if fault.at_s <= until_s), key=lambda fault: fault.at_s)
    return tuple(
        FaultTrace(
            label=_label(fault, drones),
            drones=tuple(drones.index(name) for name in fault.strikes(drones)),
            begin_s=fault.at_s,
            end_s=min(fault.end_s, until_s),
        )
        for fault in begun
    )


def _label(fault: Fault, drones: Sequence[str]) -> str:
    """Return the kind and the struck drones, such as ``kill d2`` or ``partition d1 d2 | d3``."""
    if isinstance(fault, Partition):
        alone = [(name,) for name in drones if name not in fault.names()]
        return f"partition {' | '.join(' '.join(group) for group in (*fault.groups, *alone))}"
    what = (
        f"{fault.how} {fault.what}"
        if isinstance(fault, Lie)
        else f"disk {fault.how}"
        if isinstance(fault, Disk)
        else kind_of(fault)
    )
    whom = [] if fault.target is None else fault.strikes(drones)
    peers = ["with", *fault.names_of_peers()] if isinstance(fault, LinkFault) and fault.peers is not None else []
    return " ".join((what, *whom, *peers))
