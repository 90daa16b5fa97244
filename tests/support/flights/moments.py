"""Moments of a flight of three drones, made by hand, to be judged by invariants."""

from types import SimpleNamespace

import numpy as np

from agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from protocol.messages import Stage
from sim.campaign.faults.draw import draw
from sim.scenario import parse_scenario
from sim.scoring.invariants.base import Setting
from sim.scoring.moment import Moment

PLACES = ((10.0, 10.0, 3.0), (20.0, 10.0, 3.0), (10.0, 20.0, 3.0))
HEAL_S, END_S = 50.0, 100.0


def setting(*faults, sightings=False):
    """Three drones in 40 x 40 m with a fence of 20 m; ``faults``: entries."""
    document = draw(1)
    document["mission"]["drones"] = [{"id": f"d{k}", "origin_m": [2.0 + 6.0 * k, 2.0, 0.0]} for k in (1, 2, 3)]
    document["mission"]["area"] = {"polygon_m": [[0, 0], [40, 0], [40, 40], [0, 40]], "fence_margin_m": 20.0}
    document.pop("localization", None)
    document.pop("sightings", None)
    document["fault"] = list(faults)
    if sightings:
        document["sightings"] = {}
    return Setting(parse_scenario(document, "test"), HEAL_S, END_S)


def hypothesis(x=30.0, y=30.0, sigma_m=0.5, stamp_ns=0):
    return SimpleNamespace(
        stamp_ns=stamp_ns,
        position=np.array([x, y, 0.0]),
        covariance=np.eye(3) * sigma_m**2,
        velocity=np.zeros(3),
    )


def pilot(
    stage=Stage.TRACK, believed=None, digest="0", pending=False, counters=(), suspects=(), own_place=None, problems=(), entries=()
):
    return SimpleNamespace(
        stage=stage,
        hypothesis=believed,
        digest=digest,
        counters=dict.fromkeys(counters, 1),
        pending=pending,
        fusion=SimpleNamespace(log=[SimpleNamespace(entry=SimpleNamespace(sequence=number)) for number in entries]),
        frames=SimpleNamespace(suspects=lambda: dict.fromkeys(suspects, "")),
        own_place=own_place,
        problems=problems,
    )


def autopilot(mode=FlightMode.OFFBOARD, armed=True, setpoint_age_s=0.05):
    return SimpleNamespace(mode=mode, armed=armed, setpoint_age_s=setpoint_age_s)


def command(x=10.0):
    return VehicleCommand(Request.OFFBOARD, Setpoint((x, 10.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0))


def moment(time_s, places=PLACES, **changes):
    """Three healthy drones that fly at ``places``, unless changed."""
    given = {
        "velocity_mps": np.zeros((3, 3)),
        "source": (30.0, 30.0),
        "pilots": [pilot() for _ in range(3)],
        "commands": [command() for _ in range(3)],
        "autopilots": [autopilot() for _ in range(3)],
        "sent": [3] * 3,
        "inboxes": [5] * 3,
        "batteries": [0.8] * 3,
    }
    return Moment(time_s=time_s, position_m=np.array(places, dtype=np.float64), **(given | changes))


def changed(drone, one, other):
    """``one`` at a drone's place, ``other`` at the others'."""
    return [one if k == drone else other() for k in range(3)]
