"""Rules for what each peer may publish in the network, by the names in the peers' certificates.

A message without a right is dropped by its receiver. Zenoh knows neither the roles of names nor the authors of relayed messages.
Agents check by signatures that a command comes from an operator, and that an entry in an answer comes from its author.
"""

from __future__ import annotations

from collections.abc import Collection

from radron.protocol.keys import ROOT
from radron.protocol.mesh.inbox import ENTRY_KINDS
from radron.protocol.messages import STATION_KINDS
from radron.protocol.units import STATION

_PREFIX = "radron/*"  # of every version of the protocol: only a visible drone of another version can be reported
_VERSIONS = range(1, 10)  # of accepted liveliness tokens: with a wildcard, a member could make its peers keep any number of them
_READ = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
LOG_QUERIES_PER_S = 20.0  # of a peer, 50 ms apart; an honest peer queries every 0.2 s at most
MAX_CACHE_QUERIES_PER_S = 5.0  # of a peer and a kind of entries; a dropped query leaves its entries to the log query
COMMANDS_PER_S = 50.0  # of a peer and kind, under all names together; an operator repeats a command every second
_PUBLISH = ("put", "delete", "declare_queryable", "reply", "liveliness_token")


def access_control(
    swarm: str, drones: Collection[str] | None, revoked: Collection[str], others: Collection[str] | None = None
) -> dict[str, object]:
    """Return Zenoh's ``access_control`` settings of one session: what each peer may send to this member.

    - Every member may subscribe, query logs as an operator, send messages under the keys of commands and uploads, and query and
      answer the mission of a station (hashes identify its parts).
    - A drone besides publishes and queries logs under its own name, queries the caches of entries, and answers queries with
      entries of all drones.

    Rules only allow. A denying rule would not help: of several subjects that fit a peer, Zenoh takes an allowing subject.

    Args:
        swarm: name of the swarm.
        drones: names of its drones; None: unknown, and messages of any member are accepted (an operator's session).
        revoked: names without a drone's rights, and without any rights if ``others`` are named (``link`` closes their links).
        others: names of all further members; None: every holder of a certificate of the swarm.
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
    """Return Zenoh's ``downsampling`` settings of one session: the maximum rates at which a peer may send commands and queries.

    Zenoh's own threads drop messages beyond these rates. If the agent dropped them, a flood of commands would take time of its
    event loop and delay its control steps and the messages of other peers. Rates of measurements and of regular messages are
    limited in the inbox instead: after a stall several messages arrive at once, and the newest counts.
    """
    commands = [{"key_expr": f"{_PREFIX}/{swarm}/{STATION}/*/{kind}", "freq": COMMANDS_PER_S} for kind in STATION_KINDS]
    queries = [{"key_expr": f"{_PREFIX}/{swarm}/*/log/*", "freq": LOG_QUERIES_PER_S}]
    queries += [{"key_expr": f"{_PREFIX}/{swarm}/*/{kind}/@adv/**", "freq": MAX_CACHE_QUERIES_PER_S} for kind in ENTRY_KINDS]
    return [
        {"id": "commands", "flows": ["ingress"], "messages": ["put", "delete"], "rules": commands},
        {"id": "queries", "flows": ["ingress"], "messages": ["query"], "rules": queries},
    ]


def _exactly(name: str, messages: Collection[str], *keys: str, flow: str = "ingress") -> dict[str, object]:
    """Return a rule that allows these messages under exactly these keys."""
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _rule(name: str, flow: str, messages: Collection[str], *keys: str) -> dict[str, object]:
    """Return a rule for the keys and for their advanced publishers' channel, which ``**`` does not match."""
    return _exactly(name, messages, *keys, *(f"{key.removesuffix('/**')}/**/@adv/**" for key in keys), flow=flow)
