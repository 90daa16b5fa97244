"""Exclusion limits of a search for several sources, by nuclide and place; and the places of possible further sources."""

import random

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.buildings import BuildingConfig, BuildingsConfig
from radron.agent.config.survey import SurveyConfig
from support.flights.fusions import fusion_of

LEAST_BQ = 5e7
STRONG = ("Cs-137", 8.0, 20.0, 5e9)


def outlook_of(kit, among, entries_of, seconds, least_bq=LEAST_BQ, shuffled=False, mission=None):
    """``mission``: more of its keys."""
    mission = replace(among.mission_of(), survey=SurveyConfig(least_activity_bq=least_bq), **(mission or {}))
    fusion = fusion_of(mission)
    entries = entries_of(mission)
    kit.feed(fusion, random.Random(1).sample(entries, len(entries)) if shuffled else entries)
    kit.settle(fusion, kit.T0_NS + round(seconds * 1e9))
    return fusion.outlook


def measured(among, seconds, sources, seed=3):
    return lambda mission: among.entries_of(mission, np.random.default_rng(seed), seconds, sources, cones=False)


def at(outlook, x, y):
    """The cell at a place."""
    return int(np.hypot(*(outlook.places - (x, y)).T).argmin())


def test_where_nobody_has_flown_yet_anything_may_hide(kit, among):
    """Two drones, each on the western lane of its half, for half of its length."""
    outlook = outlook_of(kit, among, measured(among, 7.0, []), 12.0)
    exclusion = outlook.exclusion
    assert outlook.excluded_bq is None
    assert set(exclusion.limits_bq) == set(among.NUCLIDES)
    assert exclusion.known_bq == {}
    assert exclusion.left[at(outlook, 20.0, 38.0)]
    assert not exclusion.left[at(outlook, 5.0, 10.0)]
    assert not exclusion.glare.any()
    assert outlook.weight.sum() == pytest.approx(1.0 - outlook.none)


def test_an_empty_area_is_excluded_down_to_an_activity_of_each_nuclide(kit, among):
    outlook = outlook_of(kit, among, measured(among, 60.0, []), 65.0)
    assert not outlook.exclusion.left.any()
    limits = outlook.exclusion.known_bq
    assert set(limits) == set(among.NUCLIDES)
    assert min(limits.values()) > 1e6
    assert max(limits.values()) == outlook.excluded_bq < 1.5 * LEAST_BQ
    assert outlook.none > 0.9


def test_what_is_there_is_not_excluded(kit, among):
    """A source too weak to be published: the limits of its nuclide are above its activity, as often as is stated.

    ``EXCLUDED`` is 5 % of the odds; of 20 flights one or two may be wrong, and four in fewer than 2 % of all such tests.
    """
    wrong = 0
    for seed in range(20):
        outlook = outlook_of(kit, among, measured(among, 20.0, [("Cs-137", 20.0, 17.0, 2e7)], seed), 25.0)
        limit_bq = outlook.exclusion.limits_bq["Cs-137"]
        wrong += limit_bq is not None and limit_bq < 2e7
    assert wrong <= 3


def test_behind_a_known_wall_less_is_excluded(kit, among):
    """A courtyard around (20, 20), between two lanes of the drones: they see into it through its walls alone."""
    outside = ((15.0, 15.0), (25.0, 15.0), (25.0, 25.0), (15.0, 25.0))
    inside = ((16.0, 16.0), (24.0, 16.0), (24.0, 24.0), (16.0, 24.0))
    walls = [
        BuildingConfig(footprint_m=(outside[k], outside[k - 3], inside[k - 3], inside[k]), height_m=20.0, attenuation_per_m=5.0)
        for k in range(4)
    ]
    entries = measured(among, 60.0, [])
    clear = outlook_of(kit, among, entries, 65.0)
    mission = {"buildings": BuildingsConfig(known=tuple(walls))}
    walled = outlook_of(kit, among, entries, 65.0, mission=mission)
    here, elsewhere = at(clear, 20.0, 20.0), at(clear, 5.0, 35.0)
    assert walled.weight[here] > 10.0 * clear.weight[here]
    assert walled.exclusion.left[here]
    assert not clear.exclusion.left[here]
    assert not walled.exclusion.left[elsewhere]


def test_beside_a_strong_source_less_is_excluded_and_in_its_glare_nothing(kit, among):
    alone = outlook_of(kit, among, measured(among, 60.0, []), 65.0)
    beside = outlook_of(kit, among, measured(among, 60.0, [STRONG]), 65.0)
    assert beside.exclusion.glare[at(beside, *STRONG[1:3])]
    assert not beside.exclusion.glare[at(beside, 35.0, 20.0)]
    assert not beside.exclusion.left[beside.exclusion.glare].all()
    assert beside.exclusion.limits_bq["Cs-137"] > 1.5 * alone.exclusion.limits_bq["Cs-137"]
    assert beside.exclusion.limits_bq["Co-60"] < beside.exclusion.limits_bq["Cs-137"]  # its lines are above those of Cs-137


def test_it_follows_from_the_log_alone(kit, among):
    entries = measured(among, 20.0, [STRONG])
    one, other = (outlook_of(kit, among, entries, 25.0, shuffled=shuffled) for shuffled in (False, True))
    assert one.weight.tobytes() == other.weight.tobytes()
    assert one.exclusion.limits_bq == other.exclusion.limits_bq
    assert one.exclusion.left.tobytes() == other.exclusion.left.tobytes()


def test_without_a_least_activity_nothing_is_told(kit, among):
    assert outlook_of(kit, among, measured(among, 10.0, []), 15.0, least_bq=None) is None
