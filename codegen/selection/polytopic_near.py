"""The set of a polytopic observer's error where the weights of plant and observer are near each other, chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..algebra.template_set import combinations
from ..certify import filter_bounds, polytope_near
from ..certify.filter_bounds import Graph
from ..certify.filter_model import JointMode, Push
from .filter_tables import ABOVE, Chooser

Array = np.ndarray
#: Samples that bounds are followed, and the share by which one of them has to fall in one.
SAMPLES, SLOW = 3000, 1e-6
#: Thresholds have to be lower by so much in some residual, or the certificate stays the plainer one.
GAIN = 0.95


def pushed(found: polytope_near.Near) -> tuple[JointMode, ...]:
    """The recursion with one push per column of the steepest slope of each functional: what rows are chosen by.

    Parameters
    ----------
    found : Near
    """
    n, flows, pushes = found.flows.shape[1], found.flows.astype(float), []
    for s, room in zip(found.weights.slopes, found.room):
        moved = np.einsum("ki,inc->knc", s.mid, flows)
        steepest = moved[np.argmax(np.abs(moved).sum(axis=(1, 2)))]
        for column in steepest.T[np.any(steepest != 0, axis=0)]:
            pushes.append(Push(filter_bounds.rational(column), s.state, 0 * s.state, room, filter_bounds.zeros(0)))
    return tuple(replace(m, pushes=tuple(pushes), O=m.O[:, :n]) for m in found.own)


class NearChooser:
    """Chooses rows by the recursion with near weights, and combinations for every pair.

    Parameters
    ----------
    every : Chooser
        Of every pair.
    model : tuple of JointMode
        Of every pair.
    found : Near
    """

    def __init__(self, every: Chooser, model: tuple[JointMode, ...], found: polytope_near.Near):
        self.every, self.model, self.found = every, model, found
        graph = Graph((None,), tuple((0, j, 0) for j in range(len(found.own))))
        self.own = Chooser(found.own, graph, 0)
        self.driven = Chooser(pushed(found), graph, 0)

    def reached(self) -> Array:
        """What |M r| reaches along runs whose weights are the same in plant and observer."""
        return self.own.reached(np.concatenate(self.own.O))

    def kept(self, most: int, low: Array, rows: Array, whole: Array) -> tuple[dict, polytope_near.NearMaps, Array]:
        """A certificate's combinations, what follows from them, and the last bounds.

        Parameters
        ----------
        most : int
            Rows at most.
        low : ndarray (k,)
            What the residuals reach.
        rows : ndarray (m, n)
            Those of every pair: taken where none are kept by the recursion with near weights.
        whole : object array (n,)
            Bounds of |eb| at a start from anywhere.
        """
        b = self.driven.reached(np.eye(self.driven.n))
        if np.max(b) < 1e12:
            rows = self.driven.grown(most, low)
            b = self.driven.reached(rows)
        if not np.max(b) < 1e12:
            b = self.every.reached(rows)
        cert, found = self._mapped(rows, b)
        first = filter_bounds.raised(abs(filter_bounds.rational(rows)) @ whole)[None]
        down = self._down(found, first)
        return cert, found, down

    def _mapped(self, rows: Array, b: Array) -> tuple[dict, polytope_near.NearMaps]:
        cert = self.every.combined(rows, b)
        wanted = self.found.functionals.astype(float)
        sees = combinations(rows, np.maximum(b, 1e-9 * np.max(b)), wanted)
        cert["near"] = {"sees": [[np.flatnonzero(row).tolist(), row[np.flatnonzero(row)].tolist()] for row in sees]}
        return cert, polytope_near.maps(self.model, self.found, cert)

    def _down(self, found: polytope_near.NearMaps, b: Array) -> Array:
        """The bounds that a start from anywhere comes down to, as far as it takes samples for a table."""
        for _ in range(SAMPLES):
            after = np.minimum(b, found.after(self.every.graph, b))
            if np.all(after >= b * (1 - SLOW)):
                break
            b = after
        return self.every.settled(found, b * ABOVE)


def lower(graph: Graph, plain: tuple, other: tuple) -> tuple:
    """Of two sets, as (cert, maps, bounds) and what residuals reach, the one whose thresholds are lower.

    Parameters
    ----------
    graph : Graph
    plain, other : tuple
        The second is taken where some threshold is a good deal lower and none is higher.
    """
    if other[0][2] is None:
        return plain
    own, near = (found.estimate(graph, b).max(axis=0) for (_, found, b), _ in (plain, other))
    return other if np.all(near <= own * 1.01) and np.any(near < GAIN * own) else plain
