"""Who else could command the autopilot: it obeys everybody who reaches its MAVLink port."""

from __future__ import annotations

import ipaddress
import re

_NETWORK = re.compile(r"(?P<kind>udp|udpin|udpout|tcp|tcpin|tcpout)://(?P<host>\[[^\]]*\]|[^:/]*)")


def exposure(address: str) -> str | None:
    """What to tell the operator of a link that is neither a loopback nor a serial line; None of one that is."""
    match = _NETWORK.match(address)
    if match is None:
        return None
    host = match["host"].strip("[]")
    try:
        if host == "localhost" or ipaddress.ip_address(host).is_loopback:
            return None
    except ValueError:
        pass
    return f"vehicle.address {address} is neither loopback nor serial: whoever reaches this network can command the autopilot"
