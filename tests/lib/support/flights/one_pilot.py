"""The pilot of d1 alone, in a mission of two: its inputs, and how to bring it into the air."""

from collections import Counter

import numpy as np
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.drift import Drift
from radron.agent.localization.clocks import Clocks
from radron.agent.localization.ownpose import OwnPose
from radron.agent.mission.orders import Orders
from radron.agent.owntime import Utc
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Cone, ConeOrder
from radron.protocol.keys import command_key, key_of
from radron.protocol.messages import Action, Command, Pose, Stage, Status

SECOND = 1_000_000_000
START_NS = 1_800_000_000 * SECOND
AREA = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0)))
MISSION = MissionConfig(  # the paper's estimator: ten cones that fit are enough for it
    name="test",
    fusion=FusionConfig(estimator="paper"),
    area=AREA,
    drones=(DroneInMission(id="d1", origin_m=(5.0, 5.0, 0.0), yaw_deg=30.0), DroneInMission(id="d2")),
)
TICK_NS = SECOND // 20


def pilot(drone="d1", mission=MISSION, memory=None, boot=None):
    boot = boot or boot_of(drone)
    return Pilot(mission, DroneConfig(id=drone), boot=boot, memory=memory, nonce_key=nonce_key_of(boot))


def own_pose(drone, graph, member=None, epoch_offset=0):
    """The own pose of a drone of the mission, or of another member with its frame in this graph."""
    member = member or next(one for one in MISSION.drones if one.id == drone)
    drift = Drift(replace(MISSION, drones=(member,)))
    return OwnPose(member, graph, Clocks(drone, []), Counter(), MISSION.limits.speed_mps, drift, epoch_offset)


def state(now_ns, mode=FlightMode.HOLD, position=(0.0, 0.0, 3.0), **values):
    return replace(
        VehicleState(
            stamp_ns=now_ns,
            epoch=0,
            position_m=position,
            velocity_mps=(0.0, 0.0, 0.0),
            quaternion=(1.0, 0.0, 0.0, 0.0),
            height_m=position[2],
            position_sigma_m=0.1,
            yaw_sigma_rad=0.01,
            mode=mode,
            armed=True,
            in_air=True,
            healthy=True,
        ),
        **values,
    )


def fly(one, since_ns, seconds, mode, **vehicle):
    """Steps at 20 Hz; the requests."""
    requests = []
    for tick in range(1, round(seconds * SECOND / TICK_NS) + 1):
        now_ns = since_ns + tick * TICK_NS
        one.observe_vehicle(state(now_ns, mode, **vehicle))
        requests.append(one.step(now_ns).command.request)
    return requests


def boot_of(drone):
    return "0" * 15 + drone[-1]


def nonce_key_of(boot):
    """Of the tests' pilots, so that commands to them can be written without them."""
    return boot.encode()


def command(action=Action.START, mission=MISSION, stamp_ns=START_NS, drones=("d1", "d2"), boot=None):
    """A command at its stamp; the later it is, the higher its number."""
    orders = {name: Orders(name, mission.mission_id, nonce_key_of(boot or boot_of(name)), None, Utc()) for name in drones}
    to = {name: replace(one.ticket(stamp_ns), number=stamp_ns // 10**7) for name, one in orders.items()}
    message = Command(stamp_ns=stamp_ns, station="tester", mission=mission.mission_id, action=action, to=to)
    return command_key(mission.swarm, "tester"), encode(message)


def messages(step, kind):
    """The published messages of a kind; every text of a status has a code."""
    found = [decode_from(key, payload) for key, payload in step.publications]
    texts = [message.texts for message in found if isinstance(message, Status)]
    assert all(
        text.code for problems, finding, notices in texts for text in (*problems, *([finding] if finding else []), *notices)
    )
    return [message for message in found if isinstance(message, kind)]


def started():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY  # the vehicle is in the air and holds already
    return one


def cone_of(drone, sequence, stamp_ns, boot="2" * 16):
    """A cone of the source at (20, 20) in d2's frame, which is the mission's, from a circle around it."""
    angle = 0.6 * sequence
    apex = (20.0 + 10.0 * np.cos(angle), 20.0 + 10.0 * np.sin(angle), 3.0)
    towards = np.array([-np.cos(angle), -np.sin(angle), -0.3]) / np.hypot(1.0, 0.3)
    axis = np.cross(towards, [0.0, 0.0, 1.0])
    axis = np.cos(0.8) * towards + np.sin(0.8) * axis / np.linalg.norm(axis)
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    order = ConeOrder(axis=(x, y, z), theta_rad=0.8, sigma_rad=0.1, probability=0.7)
    other = ConeOrder(axis=(-x, -y, -z), theta_rad=1.5, sigma_rad=0.1, probability=0.3)
    return Cone(
        stamp_ns=stamp_ns,
        drone=drone,
        mission=MISSION.mission_id,
        boot=boot,
        sequence=sequence,
        epoch=0,
        apex_m=tuple(float(value) for value in apex),
        apex_sigma_m=0.1,
        yaw_sigma_rad=0.01,
        orders=(order, other),
        energies_kev=(200.0, 460.0),
        energy_sigmas_kev=(5.0, 9.0),
        separation_mm=1.5,
    )


def partner(now_ns):
    """Pose and status of a partner on the circle, so that what else it sends matters."""
    yield Pose(
        stamp_ns=now_ns,
        drone="d2",
        epoch=0,
        position_m=(30.0, 20.0, 3.0),
        velocity_mps=(0.0, 3.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )
    yield Status(stamp_ns=now_ns, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK)


def tracking():
    """Four seconds on, with a hypothesis from twenty cones."""
    one = started()
    for sequence in range(20):
        cone = cone_of("d2", sequence, START_NS + sequence * SECOND // 5)
        one.receive(key_of("radron", cone), encode(cone), cone.stamp_ns)
    now_ns = START_NS + 5 * SECOND
    one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
    one.step(now_ns)
    assert one.stage is Stage.TRACK
    return one
