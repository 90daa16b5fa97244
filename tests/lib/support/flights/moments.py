"""Moments of a flight of three drones, made by hand, to be judged by invariants."""

from types import SimpleNamespace

import numpy as np
from msgspec.structs import replace
from shapely import box

from radron.agent.frames.transform import Transform
from radron.agent.localization.ownpose import Whereabouts
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.reckoning import Reckoning
from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from radron.protocol.messages import Stage
from radron.sim.campaign.faults.draw import draw
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.moment import Moment

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


class Log:
    """Numbers of the entries held of d2's first boot, and the ranges in the summary."""

    def __init__(self, entries=(), told=()):
        self.entries, self.told = entries, told

    def __iter__(self):
        return (SimpleNamespace(entry=SimpleNamespace(sequence=number), payload=str(number)) for number in self.entries)

    def __len__(self):
        return len(self.entries)

    def summary(self):
        return {("d2", "boot"): SimpleNamespace(ranges=self.told)} if self.told else {}

    def payloads(self):
        return map(str, self.entries)

    def numbers(self, publisher):
        return self.entries


def whereabouts(x=10.0, sigma_m=0.1, yaw_rad=0.0, yaw_sigma_rad=0.02):
    """Of the first drone, which is at x = 10 and points east."""
    return Whereabouts((x, 10.0, 3.0), sigma_m, yaw_rad, yaw_sigma_rad)


def reckoning(
    other=(20.0, 10.0, 3.0), sigma_m=0.0, room=20.0, name="d2", away=None, ends=(10.0, 10.0, 3.0), blind=False, stamp_ns=0,
    more=(), radius_m=np.inf,
):  # fmt: skip
    """Of the first drone, with another drone expected at a place, and d3 at ``more`` places; ``room``: margin around the area;
    ``ends``: its own plan.
    """
    plans = [PeerPlan(name, 0, 0.2, [other], sigma_m, away=away, blind=blind, radius_m=radius_m)]
    plans += [PeerPlan("d3", 0, 0.2, [place], sigma_m, blind=blind) for place in more]
    room = box(0.0, 0.0, 40.0, 40.0).buffer(room)
    return Reckoning(stamp_ns, (10.0, 10.0, 3.0), plans, room, Transform(), np.array([(10.0, 10.0, 3.0), ends]), 4.0)


SOMEWHERE = whereabouts()


def pilot(
    stage=Stage.TRACK, believed=None, digest="0", pending=False, counters=(), suspects=(), unknown=(), placed=None,
    problems=(), entries=(), told=(), reckons=None, memory=None, fused=None, backlog_s=0.0,
):  # fmt: skip
    return SimpleNamespace(
        stage=stage,
        hypothesis=believed,
        digest=digest,
        counters=dict.fromkeys(counters, 1),
        pending=pending,
        backlog_s=backlog_s,
        fusion=fused or SimpleNamespace(log=Log(entries, told)),
        frames=SimpleNamespace(
            contradicted=lambda: dict.fromkeys(suspects, ""), suspects=lambda: dict.fromkeys((*suspects, *unknown), "")
        ),
        whereabouts=placed,
        reckoning=reckons,
        memory=memory,
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
        "heading_rad": np.zeros(3),
        "source": (30.0, 30.0),
        "pilots": [pilot() for _ in range(3)],
        "commands": [command() for _ in range(3)],
        "autopilots": [autopilot() for _ in range(3)],
        "sent": [3] * 3,
        "inboxes": [5] * 3,
        "batteries": [0.8] * 3,
        "told_s": [time_s] * 3,
    }
    return Moment(time_s=time_s, position_m=np.array(places, dtype=np.float64), **(given | changes))


def changed(drone, one, other):
    """``one`` at a drone's place, ``other`` at the others'."""
    return [one if k == drone else other() for k in range(3)]


def with_estimated_frames(mission):
    """The mission with drones that localise themselves each in its own way."""
    return replace(mission, drones=[replace(drone, localization="gnss") for drone in mission.drones])
