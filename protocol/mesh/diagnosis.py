"""Diagnosis of links that certificates prevent: Zenoh dials again and again without a report.

A TLS handshake like Zenoh's shows the refusing side, the refused certificate and the reason.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Iterable
from functools import partial

from radron.protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, Identity, utc
from radron.protocol.mesh.link import in_thread

WITHIN_S = 1.5
_REFUSAL_S = 0.5  # with TLS 1.3 the other side's refusal follows our end of the handshake
_TIMES = (9, 10)  # of OpenSSL's verification: X509_V_ERR_CERT_NOT_YET_VALID, X509_V_ERR_CERT_HAS_EXPIRED
_OF_ANOTHER = "it is of another authority than its own"
_ALERTS = {  # of the other side (RFC 8446, 6.2), as rustls sends them for certificates
    "CERTIFICATE_EXPIRED": "it is not valid now by its clock",  # or not valid yet
    "UNKNOWN_CA": _OF_ANOTHER,
    "DECRYPT_ERROR": _OF_ANOTHER,  # another authority of the same name
    "UNSUPPORTED_CERTIFICATE": "it is not for links",
}
_PLAIN = ("WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING")


async def refusals(identity: Identity | None, endpoints: Iterable[str], now_ns: int) -> dict[str, str]:
    """Find out why the network reaches no peer at these addresses, as far as certificates are the reason.

    Args:
        identity: own certificate; without one the result is empty, as unencrypted links have no certificates.
        endpoints: addresses of peers (``tls/HOST:PORT``).
        now_ns: this computer's time for the text, nanoseconds UTC.

    Returns:
        By address, one line with the reason and the remedy. An address without a listener, or with a working link, has no line.
    """
    if identity is None:
        return {}
    asked = list(endpoints)
    found = await asyncio.gather(*(in_thread(partial(_refusal, identity, one, now_ns)) for one in asked))
    return {one: text for one, text in zip(asked, found, strict=True) if text}


def _refusal(identity: Identity, endpoint: str, now_ns: int) -> str:
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    own, now = identity.folder / CERTIFICATE_FILE, f"{utc(now_ns):%Y-%m-%d %H:%M} UTC"
    renew = f"`radron-deploy pki issue {identity.own.name} --role {identity.own.role}`"
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False  # the name in its certificate identifies a member, at any address
        context.load_verify_locations(identity.folder / AUTHORITY_FILE)
        context.load_cert_chain(own, identity.folder / KEY_FILE)
        with socket.create_connection((host.strip("[]"), int(port)), WITHIN_S) as plain, context.wrap_socket(plain) as link:
            link.settimeout(_REFUSAL_S)
            link.recv(1)
    except ssl.SSLCertVerificationError as error:
        if error.verify_code in _TIMES:
            clock = f"({error.verify_message}; this computer's clock shows {now}): set the clocks, or renew it there"
            return f"{endpoint}: its certificate is not valid now {clock}, with `radron-deploy pki issue NAME --role drone`"
        mend = f"take a folder of the same authority, from {renew} there"
        return f"{endpoint}: its certificate is not of the authority in {identity.folder / AUTHORITY_FILE}: {mend}"
    except ssl.SSLError as error:
        reason = error.reason or ""
        if reason in _PLAIN:
            return f"{endpoint}: does not encrypt its links: give --insecure, or remove mesh.insecure there"
        if "ALERT" not in reason:
            return ""
        alert = reason.partition("ALERT_")[2]
        what = _ALERTS.get(alert, alert.replace("_", " ").lower())
        mend = f"set the clocks (this computer's shows {now}), or run {renew}" if "EXPIRED" in alert else f"run {renew}"
        return f"{endpoint} refuses {own}: {what}: {mend} where the authority of all is"
    except (OSError, ValueError):
        return ""  # no listener, or no refusal: an accepted link is silent until Zenoh's first message
    return ""
