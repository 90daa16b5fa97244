"""Who may publish what: the rules by which a session judges what its peers send, by the names in their certificates.

Whatever is not allowed is dropped where it arrives. Zenoh knows names, not roles, and no author of what a peer passes on: that
commands come from operators only, and that an entry in an answer is its author's, is checked by the agents, by signatures.
"""

from __future__ import annotations

from collections.abc import Collection

from protocol.keys import ROOT
from protocol.mesh.inbox import ENTRY_KINDS
from protocol.messages import STATION_KINDS
from protocol.units import STATION

_PREFIX = "radron/*"  # of every version of the protocol: others must be seen to be named
_VERSIONS = range(1, 10)  # whose liveliness tokens are taken: with a wildcard, a member could have its peers keep any number
_READ = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
LOG_QUERIES_PER_S = 20.0  # of a peer, 50 ms apart; an honest one asks every 0.2 s at most
MAX_CACHE_QUERIES_PER_S = 5.0  # of a peer and a kind of entries; a query that is dropped leaves its entries to the log query
COMMANDS_PER_S = 50.0  # of a peer and kind, under whatever names; an operator repeats one every second
_PUBLISH = ("put", "delete", "declare_queryable", "reply", "liveliness_token")


def access_control(
    swarm: str, drones: Collection[str] | None, revoked: Collection[str], others: Collection[str] | None = None
) -> dict[str, object]:
    """Zenoh's ``access_control`` settings of one session.

    Everybody in the swarm may subscribe, query logs as an operator, send what looks like a command or an upload, and query and
    answer the mission of a station, whose parts are known by their hashes. A drone besides publishes and queries logs under its
    own name, queries the caches of entries, and answers queries with entries of all. (A rule that denies would not help: of
    several subjects that fit a peer, Zenoh takes the one that allows. So nobody gets more than is listed here.)

    Args:
        swarm: its name.
        drones: names of its drones; None: unknown, and any member's news are taken (an operator's session).
        revoked: names that get no rights of a drone, and none at all where ``others`` are named (``link`` ends their links).
        others: names of everybody else; None: everybody with a certificate of the swarm.
    """
    own = f"{_PREFIX}/{swarm}"
    rules = [
        _rule("send", "egress", (*_READ, "query", *_PUBLISH), f"{own}/**"),
        _rule("read", "ingress", _READ, f"{own}/**"),
        _rule("command", "ingress", ("put",), *(f"{own}/{STATION}/*/{kind}" for kind in STATION_KINDS)),
        _rule("mission", "ingress", ("query", "reply", "declare_queryable"), f"{own}/{STATION}/*/mission"),
        _exactly("logs", ("query",), f"{own}/*/log/{STATION}"),
        _exactly("caches", ("query",), *(f"{own}/*/{kind}/@adv/**" for kind in ENTRY_KINDS)),
        _rule("answer", "ingress", ("reply",), *(f"{own}/*/{kind}" for kind in ENTRY_KINDS)),
        _rule("news", "ingress", _PUBLISH, f"{own}/**"),
    ]
    basic = ["send", "read", "command", "mission", "logs", *(["news"] if drones is None else [])]
    members = [name for name in drones or () if name not in revoked]
    for name in members:
        rules.append(_rule(f"{name} publishes", "ingress", ("put", "delete", "reply"), f"{own}/{name}/**"))
        tokens = [f"radron/{version}/{swarm}/{name}/alive" for version in _VERSIONS]
        rules.append(_exactly(f"{name} is there", ("liveliness_token",), *tokens))
        caches = [f"{ROOT}/{swarm}/{name}/{kind}/@adv/**" for kind in ENTRY_KINDS]
        rules.append(_exactly(f"{name} answers", ("declare_queryable",), f"{ROOT}/{swarm}/{name}/log/*", *caches))
        rules.append(_exactly(f"{name} asks", ("query",), f"{own}/*/log/{name}"))
    own_rights = ("publishes", "is there", "answers", "asks")
    grants = {name: [*basic, "answer", "caches", *(f"{name} {right}" for right in own_rights)] for name in members}
    if others is not None:
        grants |= {name: basic for name in others if name not in revoked and name not in grants}
    subjects: list[dict[str, object]] = [{"id": name, "cert_common_names": [name]} for name in grants]
    policies = [{"subjects": [name], "rules": granted} for name, granted in grants.items()]
    if others is None:
        subjects.append({"id": "anybody with a certificate"})
        policies.append({"subjects": ["anybody with a certificate"], "rules": basic})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def limits(swarm: str) -> list[dict[str, object]]:
    """Zenoh's ``downsampling`` settings of one session: how often each of its peers can command, and query logs and caches.

    What comes sooner is dropped in Zenoh's own threads: whatever gets further takes time of the agent's event loop, commands
    first, and a flood would keep it from its steps and from the news of the others. News and entries are the inbox's to bound:
    after a stall several come at once, and the newest counts.
    """
    commands = [{"key_expr": f"{_PREFIX}/{swarm}/{STATION}/*/{kind}", "freq": COMMANDS_PER_S} for kind in STATION_KINDS]
    queries = [{"key_expr": f"{_PREFIX}/{swarm}/*/log/*", "freq": LOG_QUERIES_PER_S}]
    queries += [{"key_expr": f"{_PREFIX}/{swarm}/*/{kind}/@adv/**", "freq": MAX_CACHE_QUERIES_PER_S} for kind in ENTRY_KINDS]
    return [
        {"id": "commands", "flows": ["ingress"], "messages": ["put", "delete"], "rules": commands},
        {"id": "queries", "flows": ["ingress"], "messages": ["query"], "rules": queries},
    ]


def _exactly(name: str, messages: Collection[str], *keys: str, flow: str = "ingress") -> dict[str, object]:
    """A rule that allows these messages under exactly these keys."""
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _rule(name: str, flow: str, messages: Collection[str], *keys: str) -> dict[str, object]:
    """What is allowed; the keys include those of the advanced publishers' channel, which ``**`` does not."""
    return _exactly(name, messages, *keys, *(f"{key.removesuffix('/**')}/**/@adv/**" for key in keys), flow=flow)
