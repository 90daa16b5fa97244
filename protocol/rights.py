"""Who may publish what: the rules by which a session judges what its peers send, by the names in their certificates.

Whatever is not allowed is dropped where it arrives. Zenoh knows names, not roles, and no author of what a peer passes on: that
commands come from operators only, and that an entry in an answer is its author's, is checked by the agents, by signatures.
"""

from __future__ import annotations

from collections.abc import Collection

from protocol.inbox import ENTRY_KINDS
from protocol.units import STATION

_PREFIX = "radron/*"  # of every version of the protocol: others must be seen to be named
_READ = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query", "query")
_PUBLISH = ("put", "delete", "declare_queryable", "reply", "liveliness_token")


def access_control(
    swarm: str, drones: Collection[str] | None, revoked: Collection[str], others: Collection[str] | None = None
) -> dict[str, object]:
    """Zenoh's ``access_control`` settings of one session.

    Everybody in the swarm may subscribe, query, and send what looks like a command. A drone besides publishes under its own name,
    and answers queries with entries of all. (A rule that denies would not help: of several subjects that fit a peer, Zenoh takes
    the one that allows. So nobody gets more than is listed here.)

    Args:
        swarm: its name.
        drones: names of its drones; None: unknown, and any member's news are taken (an operator's session).
        revoked: names that get no rights of a drone, and none at all where ``others`` are named.
        others: names of everybody else; None: everybody with a certificate of the swarm.
    """
    own = f"{_PREFIX}/{swarm}"
    rules = [
        _rule("send", "egress", (*_READ, *_PUBLISH), f"{own}/**"),
        _rule("read", "ingress", _READ, f"{own}/**"),
        _rule("command", "ingress", ("put",), f"{own}/{STATION}/*/command"),
        _rule("answer", "ingress", ("reply",), *(f"{own}/*/{kind}" for kind in ENTRY_KINDS)),
        _rule("news", "ingress", _PUBLISH, f"{own}/**"),
    ]
    basic = ["send", "read", "command", *(["news"] if drones is None else [])]
    members = [name for name in drones or () if name not in revoked]
    for name in members:
        rules.append(_rule(f"{name} publishes", "ingress", ("put", "delete", "reply"), f"{own}/{name}/**"))
        rules.append(_rule(f"{name} is there", "ingress", ("liveliness_token", "declare_queryable"), *_presence(f"{own}/{name}")))
    grants = {name: [*basic, "answer", f"{name} publishes", f"{name} is there"] for name in members}
    if others is not None:
        grants |= {name: basic for name in others if name not in revoked and name not in grants}
    subjects: list[dict[str, object]] = [{"id": name, "cert_common_names": [name]} for name in grants]
    policies = [{"subjects": [name], "rules": granted} for name, granted in grants.items()]
    if others is None:
        subjects.append({"id": "anybody with a certificate"})
        policies.append({"subjects": ["anybody with a certificate"], "rules": basic})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _presence(own: str) -> tuple[str, ...]:
    """What a drone declares: without these limits it could have its peers keep any number of other tokens."""
    return (f"{own}/alive", f"{own}/log", *(f"{own}/{kind}" for kind in ENTRY_KINDS))


def _rule(name: str, flow: str, messages: Collection[str], *keys: str) -> dict[str, object]:
    """What is allowed; the keys include those of the advanced publishers' channel, which ``**`` does not."""
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": [*keys, *(f"{key.removesuffix('/**')}/**/@adv/**" for key in keys)],
    }
