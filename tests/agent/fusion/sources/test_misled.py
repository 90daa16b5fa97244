"""The stated errors where the model is wrong by a share that neighbouring measurements have in common."""

import numpy as np
import pytest

from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import ConeObservation, observe
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.misled import _COMMON_ERROR, misled
from radron.agent.fusion.sources.solution import Solution

SOURCES = [("Cs-137", 12.0, 20.0, 3e9), ("Ir-192", 30.0, 15.0, 5e8)]


@pytest.fixture(scope="module")
def flight(among):
    mission = among.mission_of()
    entries = among.entries_of(mission, np.random.default_rng(1), 30.0, SOURCES)
    seen = [observe(entry, Transform()) for entry in sorted(entries, key=lambda entry: entry.entry_id)]
    rows = Rows.none().plus([one for one in seen if not isinstance(one, ConeObservation)], {"a": 0, "b": 1})
    return among.problem_of(mission, entries), rows


@pytest.fixture(scope="module")
def fitted(flight):
    places, activities = np.array([(12.0, 20.0), (30.0, 15.0)]), np.log([3.0, 0.5])
    return flight[0].fitted(Solution((0, 2), places, activities, 0.0, np.zeros((2, 3))), 12)


def test_the_solution_stays_and_its_errors_grow(flight, fitted):
    told = misled(fitted, *flight)
    assert told.solution is fitted.solution
    assert told.evidence == fitted.evidence
    more = np.linalg.eigvalsh(told.covariance - fitted.covariance)
    assert more.min() > -1e-12
    assert 1.0 < told.sigma_of(0)[0] / fitted.sigma_of(0)[0] < 3.0


def test_nothing_fitted_has_no_more_errors(flight):
    nothing = flight[0].fitted(Solution.nothing(2), 3)
    assert misled(nothing, *flight) is nothing


def test_the_errors_are_those_that_wrong_counts_would_make(flight, fitted):
    """To first order: the gradient's change when counts of a patch, or in a bin, rise by a small share of a source's
    contribution.
    """
    problem, rows = flight
    counts, share = problem.counts, 1e-4
    before, _ = problem._scored(fitted.solution)[1]()
    patches, index = np.unique(np.column_stack((rows.drone, rows.table[:, 1:4] // 12)), axis=0, return_inverse=True)
    groups = [(index.ravel() == patch)[:, None] for patch in range(len(patches))] + [one[None] for one in np.eye(32)]
    measured, added = counts.counts, np.zeros_like(fitted.covariance)
    for k in range(2):
        for group in groups:
            counts.counts = measured + share * group * counts.of_source(fitted.solution, k)
            after, _ = problem._scored(fitted.solution)[1]()
            moved = fitted.covariance @ (after - before) / share
            added += _COMMON_ERROR**2 * np.outer(moved, moved)
    counts.counts = measured
    told = misled(fitted, problem, rows).covariance - fitted.covariance
    assert told == pytest.approx(added, rel=0.1, abs=0.02 * added.max())
