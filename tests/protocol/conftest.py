"""Certificates of one swarm, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from radron.protocol.identity import Role
from radron.protocol.issuing import Issuer
from support.mesh.encrypted import DRONES
from support.mesh.identities import identity, new_issuer


@pytest.fixture(scope="session")
def issuer() -> Issuer:
    return new_issuer()


@pytest.fixture(scope="session")
def folder(issuer: Issuer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identities")
    for name in DRONES:
        identity(issuer, folder, name)
    for role in (Role.OPERATOR, Role.OBSERVER):
        identity(issuer, folder, str(role), role)
    return folder
