"""Synthetic flights for the Bayesian estimator, with cones and counts from an independent model."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from msgspec.structs import replace

from radron.agent.fusion.registry import estimator_named
from radron.protocol.entries import Cone, ConeOrder, Counts
from support.flights import fusions

# Events of one cluster with less than a photon's energy and with all of it, and of two clusters.
BACKGROUND_PS = np.array([1.45, 0.03, 0.01, 0.0])
SOURCE = np.array([35.0, 62.0])
AREAS_MM2 = np.array([14.0, 2.0, 1.1, 0.9])


def fusion_of(mission):
    return fusions.fusion_of(mission, estimator_named("bayes", mission))


def entries_of(kit, mission, rng, seconds, source_at, activity_bq, background=1.0, around=None):
    """Exposures and cones of drones that close in on the source on circles; ``source_at`` None: background only.

    A source at None of ``source_at(time_s)`` has gone. background: how strong it is against the configured one. around: centre
    of the circles; None: the source.
    """
    entries = []
    ids = [drone.id for drone in mission.drones]
    for number in range(int(seconds / 0.5)):
        time_s = number * 0.5
        for index, drone in enumerate(ids):
            phase = time_s * 0.25 + 2.0 * math.pi * index / len(ids)
            source = None if source_at is None else source_at(time_s)
            centre = source if around is None else around
            middle = (50.0, 50.0) if centre is None else centre
            radius = max(12.0, 45.0 - time_s)
            place = np.array([middle[0] + radius * math.cos(phase), middle[1] + radius * math.sin(phase), 3.0])
            flux, cones = 0.0, 0
            if source is not None:
                distance = float(np.linalg.norm(np.array([*source, 0.0]) - place))
                flux = activity_bq * 0.851 / (4e6 * math.pi * distance**2) * math.exp(-0.0093 * distance)
                cones = int(rng.poisson(0.55 * flux * 0.5))
            expected = (AREAS_MM2 * flux + background * BACKGROUND_PS) * 0.5
            partial, full, partial_pair, full_pair = rng.poisson(expected).tolist()
            pairs = partial_pair + full_pair
            counts = Counts(hits=partial + full + 2 * pairs, photopeak=full + full_pair, coincidences=pairs)
            exposure = kit.exposure_entry(mission, time_s, place, drone=drone, sequence=10 * number, duration_s=0.5)
            entries.append(msgspec.structs.replace(exposure, counts=counts))
            for k in range(cones):
                entries.append(_cone(kit, mission, rng, time_s, place, (*source, 0.0), drone, 10 * number + 1 + k))
    return entries


def _cone(kit, mission, rng, time_s, place, target, drone, sequence):
    """A cone: one in eight points anywhere, and three in ten have mixed-up orders."""
    if rng.random() < 0.12:
        target = place + rng.normal(size=3)
    axis, theta = kit.cone_towards(rng, place, target, 0.1)
    cone = kit.cone_entry(mission, time_s + 0.2, place, axis, theta, drone=drone, sequence=sequence, probability=0.7)
    if rng.random() < 0.3:
        right, wrong = cone.orders
        cone = msgspec.structs.replace(
            cone, orders=(ConeOrder(wrong.axis, wrong.theta_rad, 0.1, 0.7), ConeOrder(right.axis, right.theta_rad, 0.1, 0.3))
        )
    return cone


def misplaced(entry, sigma_m, off_m=(0.0, 0.0)):
    """As measured at a place that is wrong by ``off_m``, and stated with that sigma."""
    if isinstance(entry, Cone):
        x, y, z = entry.apex_m
        return replace(entry, apex_m=(x + off_m[0], y + off_m[1], z), apex_sigma_m=sigma_m)
    moved = [
        replace(pose, position_m=(pose.position_m[0] + off_m[0], pose.position_m[1] + off_m[1], pose.position_m[2]))
        for pose in entry.poses
    ]
    return replace(entry, poses=tuple(moved), position_sigma_m=sigma_m)


def flown(kit, mission, *, of, since_s, until_s, sigma_m, off_m=(0.0, 0.0), seconds=70.0, activity_bq=3e9):
    """Entries of a flight in which some drones are off by ``off_m`` for a while, and state that sigma of their places."""
    entries = entries_of(kit, mission, np.random.default_rng(3), seconds, lambda _: SOURCE, activity_bq)
    times = [(entry.stamp_ns - kit.T0_NS) * 1e-9 for entry in entries]
    return [
        misplaced(entry, sigma_m, off_m) if entry.drone in of and since_s <= time_s < until_s else entry
        for entry, time_s in zip(entries, times, strict=True)
    ]


def hypotheses(kit, mission, entries, seconds):
    """Times and hypotheses twice a second, entries coming in as they are measured."""
    fusion = fusion_of(mission)
    waiting = sorted(entries, key=lambda entry: entry.entry_id)
    found = []
    for number in range(1, int(seconds * 2)):
        now_ns = kit.T0_NS + number * 500_000_000
        while waiting and waiting[0].stamp_ns < now_ns - 500_000_000:
            kit.feed(fusion, [waiting.pop(0)])
        fusion.advance(now_ns, 10**6)
        if fusion.hypothesis is not None:
            found.append((number * 0.5, fusion.hypothesis))
    return found


def errors_of(found, source_at):
    return np.array([hypothesis.position[:2] - source_at(time_s) for time_s, hypothesis in found])
