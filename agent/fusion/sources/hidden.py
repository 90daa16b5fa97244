"""Unknown obstacles between sources and cameras: a view from a place may be hidden by a wall that is not on the map.

M are the expected counts in a clear view, and D the direct photons among them. A cell is either clear, or hidden with the
probability ``HIDDEN``. A cell is a row with at least ``_ALONE`` events. Rows with fewer, all within 6 m, form one cell, for only
their sum is significant. The total counts K of a hidden cell may be anything up to a clear cell's. K is log-uniform, and so
carries no information on the counts without the wall. Its spectrum is that of M_h = M - (1 - s) D, with s = ``_SHARE``. In groups
g of energy bins, w the mean of the rows' weights, the log likelihoods of the two are

    clear     w sum_g k_g log (M_g / M)    + w [K log (M / K) - M + K]
    hidden    w sum_g k_g log (M_hg / M_h) + log [sqrt(2 pi K / w) / (L (K + 1))] + log Phi((M - K) sqrt(w / M)),

each count of a row times its own weight where these differ, Phi the normal distribution, exp(L) the ratio of the greatest to the
least counts. (With a mean weight instead, hidden views would inform on the strength of a source after all, and without a limit.)
Within the groups, and from row to row, counts are those of a clear view. So a cell far below its expectation neither pulls
sources away nor makes them weaker. Its information is that of a clear cell times the probability of a clear view. The variance of
the gradient with respect to the rate of the direct photons is subtracted (Louis's formula).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from radron.agent.fusion.sources.data import Rows, summing
from radron.agent.geometry import Array
from radron.protocol.spectrum import BINS

HIDDEN = 0.056  # as in fusion.bayes.hidden
_SHARE = 0.1
_DECADES = np.log(1e3)  # L
# Squared sigmas of the direct photons' signal in a cell: below the first, hidden and clear cannot be distinguished; from the
# second on the prior holds in full.
_NOTICED = 1.0, 3.0
_GROUP = 4  # energy bins
_ALONE = 20  # events
_SIDE = 12  # voxels, of a cell of several rows
_LEAST_LEFT = 0.01  # share of a cell's information that is left at least
_TINY = 1e-300
_GROUPS: Array = np.repeat(np.eye(BINS // _GROUP), _GROUP, axis=0)  # (BINS, G): sums over a short axis are slow
_EACH_GROUP: Array = np.ones(BINS // _GROUP)


class Expected(NamedTuple):
    """Expected counts of a solution, (R, BINS) each. clear: M. direct: D. least: lower limit of M, however much is hidden."""

    clear: Array
    direct: Array
    least: Array


class Cells:
    """The rows by cells; the cells follow from the measurements alone."""

    def __init__(self, rows: Rows) -> None:
        alone = rows.counts.sum(axis=1) >= _ALONE
        _, self._cell = np.unique(
            np.column_stack((np.where(alone, 1 + np.arange(len(rows)), 0), rows.table[:, 1:4] // _SIDE)),
            axis=0,
            return_inverse=True,
        )
        self._cell = self._cell.ravel()
        self._sums = summing(self._cell, int(self._cell.max(initial=-1)) + 1)
        self._rows = self.sums(np.ones(len(rows)))

    def sums(self, by_row: Array) -> Array:
        """Return (N, ...) sums of (R, ...)."""
        result: Array = self._sums @ by_row
        return result

    def means(self, by_row: Array) -> Array:
        """Return (N,) means of (R,)."""
        return self.sums(by_row) / self._rows

    def each(self, by_cell: Array) -> Array:
        """Return (R, ...) values of the rows' cells, from (N, ...)."""
        result: Array = by_cell[self._cell]
        return result

    def views(self, counts: Array, weight: Array, expected: Expected) -> Views:
        """Return the views of counts (R, BINS) with weights (R,)."""
        return Views(self, counts, weight, expected)


class Views:
    """The counts of R rows against their expectation. Terms needed only for derivatives are computed on demand.

    log_likelihood: of all rows. hidden: (R,) probability of a hidden view.
    """

    def __init__(self, cells: Cells, counts: Array, weight: Array, expected: Expected) -> None:
        self._cells, self._counts, self._weight, self._clear = cells, counts, weight, expected.clear
        w = cells.means(weight)
        parts = np.stack([_grouped(part) for part in (counts, *expected)], axis=1)
        sums = cells.sums((weight[:, None, None] * parts).reshape(len(weight), -1)).reshape(-1, 4, BINS // _GROUP)
        k, m, d, floor = np.ascontiguousarray(sums.swapaxes(0, 1))  # (N, G) each, times their weights
        h = np.maximum(m - (1.0 - _SHARE) * d, floor)
        events, whole, rest = k @ _EACH_GROUP, m @ _EACH_GROUP, h @ _EACH_GROUP
        some = np.maximum(events, w)
        above = (whole - events) / np.sqrt(whole)
        log_below = log_ndtr(above)
        spectrum = (k * np.log(h / m)) @ _EACH_GROUP + events * np.log(whole / rest)  # log likelihoods, hidden less clear
        total = 0.5 * np.log(2.0 * np.pi * some / w**2) - np.log(_DECADES * (events / w + 1.0)) + log_below
        more = spectrum + total - (events * np.log(whole / some) - whole + events)
        shown = (d * d / m) @ _EACH_GROUP
        noticed = (shown - _NOTICED[0]) / (_NOTICED[1] - _NOTICED[0])
        prior = HIDDEN * np.clip(noticed, 0.0, 1.0)
        more = np.where(prior > 0.0, more, 0.0)
        top = np.maximum(more, 0.0)
        both = (1.0 - prior) * np.exp(-top) + prior * np.exp(more - top)
        self._hidden = prior * np.exp(more - top) / both
        rises = HIDDEN / (_NOTICED[1] - _NOTICED[0]) * ((noticed > 0.0) & (noticed < 1.0))
        self._by_shown = rises * (np.exp(more - top) - np.exp(-top)) / both  # through the prior
        self._of_cells = k, m, d, h, events, whole, rest, some, above, log_below, shown
        self.log_likelihood = float((weight @ (counts * np.log(self._clear) - self._clear)).sum() + (top + np.log(both)).sum())

    @property
    def hidden(self) -> Array:
        """(R,) probability of a hidden view."""
        return self._cells.each(self._hidden)

    @property
    def mean(self) -> Array:
        """(R, BINS) expected counts, mean of both views."""
        _, m, _, h, _, whole, rest, some, *_ = self._of_cells
        counted = h / m * (np.minimum(some, whole) / rest)[:, None]  # share of a clear view's counts
        shares = self._cells.each(1.0 - self._hidden[:, None] * (1.0 - counted))
        result: Array = self._clear * np.repeat(shares, _GROUP, axis=1)
        return result

    @property
    def information(self) -> Array:
        """(R,) weights of the rows in the Fisher information."""
        _, _, d, *_, shown = self._of_cells
        off, shape, limit = self._slopes
        pull, other = (off * d) @ _EACH_GROUP, _SHARE * ((shape * d) @ _EACH_GROUP) + limit * (d @ _EACH_GROUP)
        spread = self._hidden * (1.0 - self._hidden) * (pull - other) ** 2 / np.maximum(shown, _TINY)
        left = np.clip(1.0 - self._hidden - spread, _LEAST_LEFT, 1.0)
        result: Array = self._weight * self._cells.each(left)
        return result

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array]:
        """Derivatives of the cells' log likelihoods: by M (N, G) in a clear view; in a hidden one by M_h (N, G), by M (N,)."""
        k, m, _, h, events, whole, rest, _, above, log_below, _ = self._of_cells
        density = np.exp(-0.5 * above * above - log_below) / np.sqrt(2.0 * np.pi)
        return k / m - 1.0, k / h - (events / rest)[:, None], density / np.sqrt(whole) * (whole + events) / (2.0 * whole)

    def along(self, shapes: Array, direct: Array) -> Array:
        """Return (R, Q) derivatives of the log likelihood by strengths of the spectra ``shapes`` (Q, BINS) in each row.

        ``direct``: (Q, BINS) the direct photons in them.
        """
        changed, blocked = self._by_group
        by_cell = changed @ _grouped(shapes).T - blocked @ _grouped(direct).T
        excess = (self._counts / self._clear - 1.0) @ shapes.T
        result: Array = self._weight[:, None] * (excess + self._cells.each(by_cell))
        return result

    def along_fields(self, fields: Array, direct: Array) -> Array:
        """Return (F, R) derivatives of the log likelihood by strengths of spectra that differ from row to row: ``fields`` (F, R,
        BINS).

        ``direct``: (F, R, BINS) the direct photons in them.
        """
        changed, blocked = (self._cells.each(part) for part in self._by_group)
        excess = (fields * (self._counts / self._clear - 1.0)).sum(axis=2)
        result: Array = self._weight * (excess + ((fields @ _GROUPS) * changed - (direct @ _GROUPS) * blocked).sum(axis=2))
        return result

    @cached_property
    def _by_group(self) -> tuple[Array, Array]:
        """Derivatives (N, G) of the cells' log likelihoods beside a clear view's, by M and by -D, alike in a group's bins."""
        _, m, d, *_ = self._of_cells
        off, shape, limit = self._slopes
        hidden, by_shown, share = self._hidden[:, None], self._by_shown[:, None], d / m
        changed = hidden * (shape + limit[:, None] - off) - by_shown * share**2
        return changed, hidden * (1.0 - _SHARE) * shape - 2.0 * by_shown * share


def _grouped(by_bin: Array) -> Array:
    """Return (R, G) sums over groups of bins, from (R, BINS)."""
    result: Array = by_bin @ _GROUPS
    return result
