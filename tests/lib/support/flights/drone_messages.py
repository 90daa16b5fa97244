"""Messages of one drone by the second, to be changed by lying members."""

from radron.protocol.entries import Cone, ConeOrder, Counts, Exposure, PoseSample, Sighting
from radron.protocol.messages import Plan, Pose

SECOND = 1_000_000_000
BORN = {"mission": "a" * 16, "boot": "b" * 16}
UNIT = (1.0, 0.0, 0.0, 0.0)


def at(kind, second):
    """A message of d1 as of a second, at x = that many metres."""
    stamp, place = {"stamp_ns": second * SECOND, "drone": "d1", "epoch": 0}, (float(second), 0.0, 3.0)
    sigmas = {"position_sigma_m": 0.1, "yaw_sigma_rad": 0.1}
    match kind:
        case "pose":
            facts = {"silences_ns": {"d2": 0}, "home_m": (0.0, 0.0, 0.0)}
            where = {"position_m": place, "velocity_mps": (1.0, 0.0, 0.0), "quaternion": UNIT}
            return Pose(**stamp, **sigmas, **where, **facts)
        case "plan":
            return Plan(**stamp, step_ns=SECOND // 10, positions_m=(place, (second + 0.1, 0.0, 3.0)))
        case "exposure":
            return Exposure(
                **stamp, **BORN, **sigmas, sequence=second, end_ns=(second + 1) * SECOND, live_time_s=1.0,
                counts=Counts(10 + second, 5, 3), poses=(PoseSample(0, place, UNIT),),
            )  # fmt: skip
        case "cone":
            order = ConeOrder((1.0, 0.0, 0.0), 0.5, 0.1, 0.5)
            return Cone(
                **stamp, **BORN, sequence=second, apex_m=place, apex_sigma_m=0.1, yaw_sigma_rad=0.1, orders=(order, order),
                energies_kev=(200.0, 400.0), energy_sigmas_kev=(5.0, 5.0), separation_mm=1.0,
            )  # fmt: skip
    return Sighting(
        **stamp, **BORN, sequence=second, target="d2", position_m=place, direction=(1.0, 0.0, 0.0), direction_sigma_rad=0.1,
        range_m=10.0, range_sigma_m=0.3,
    )  # fmt: skip
