r"""Bounds of a polytopic observer's error where the weights of plant and observer are no further apart than it allows.

With the weights g of the observer and h of the plant, and the flow q_i of the plant at vertex i (``polytope_bounds``),

    eb+ = sum_j g_j (N_j eb + W_jj ..) + sum_i (h_i - g_i) q_i,      h - g = (h(x) - h(x_hat)) + (rounding of g),

so that for a row r of the set, with the slopes D_l of ``weight_slopes``, |S_l (x - x_hat)| <= |S_l eb| + room_l,

    |r eb+| <= max_j (..) + min(spread, sum_l |r sum_i D_li q_i| (|S_l eb| + room_l) + off spread),

the largest |r (q_i - q_k)| of any two vertices being the spread, however far apart the weights are. Beside it stands
the bound of every pair of vertices: the smaller of both holds, for each row at each sample.

A continuous plant moves between samples, its weights with it: the mean distance of x from that at the sample is
``polytope_drift``, which |S_l| takes into room_l. T1 may differ between the observer's vertices: the plant's
whole flow is taken alike by all of them, so that their mean may stand for each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import filter_bounds
from .exact import eye, product, rational
from .filter_bounds import RAISE, Combined, Graph, Maps, raised
from .filter_model import JointMode
from .polytope_bounds import Parts
from .polytope_ranges import columns, reach
from .weight_slopes import Weights, steepness, weights

Array = np.ndarray


@dataclass(frozen=True)
class Near:
    """The recursion with weights that are near each other.

    Parameters
    ----------
    own : tuple of JointMode
        Plant and observer at vertex j.
    flows : object array (h, n, c)
        Columns of q_i, less those of their mean: a middle, then half widths.
    weights : Weights
    room : object array (L,)
    """

    own: tuple[JointMode, ...]
    flows: Array
    weights: Weights
    room: Array

    @property
    def functionals(self) -> Array:
        """The S_l, one per row (L, n)."""
        return np.array([s.state for s in self.weights.slopes], dtype=object).reshape(-1, self.flows.shape[1])


@dataclass(frozen=True)
class NearMaps:
    """Bounds a sample later: the smaller of those of every pair and of those with near weights.

    Parameters
    ----------
    apart : Maps
        Of every pair of vertices.
    G : ndarray (h, m, m), omega : ndarray (h, m)
        Of plant and observer at one vertex.
    sees : ndarray (L, m), room : ndarray (L,)
        |S_l (x - x_hat)| <= sees b + room.
    steep : ndarray (L, m)
        How much of that is in each row.
    spread : ndarray (m,)
    off : float
    """

    apart: Maps
    G: Array
    omega: Array
    sees: Array
    room: Array
    steep: Array
    spread: Array
    off: float

    def after(self, graph: Graph, b: Array) -> Array:
        """Bounds a sample later, (1, m)."""
        far = (self.sees @ b[0] + self.room) * RAISE
        mixed = np.minimum(self.spread, (far @ self.steep + self.off * self.spread) * RAISE)
        own = np.max(self.G @ b[0] + self.omega, axis=0)
        return np.minimum(self.apart.after(graph, b), ((own + mixed) * RAISE)[None])

    def estimate(self, graph: Graph, b: Array) -> Array:
        """Bounds of |M r|."""
        return self.apart.estimate(graph, b)


def near(plant, problem, t, parts: Parts, model: tuple[JointMode, ...]) -> Near | None:
    """The recursion of an observer with near weights; None where these have no slopes.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
        With every pair.
    t : PolytopicTables
    parts : Parts
    model : tuple of JointMode
        Of every pair.
    """
    errors, box, slip = parts.errors, parts.box, parts.slip
    n, m, h = len(problem.E), problem.B.shape[2], len(problem.A)
    T2, E, C = rational(t.T2), rational(problem.E), rational(problem.C)
    found = weights(plant.polytope, t, union(plant, t, slip.x_hat), slip.u)
    if found is None:
        return None
    mean = sum(errors.T1[1:], errors.T1[0]) / len(errors.T1)
    own, flows = [], []
    for j in range(h):
        A, B = errors.pairs[j, j]
        less = mean - errors.T1[j % len(errors.T1)]
        step = A[:n, n:] + product(less, A[n:, n:]), B[:n] + product(less, B[n:])
        first = model[list(errors.pairs).index((j, j))]
        own.append(JointMode(first.J, parts.driven(problem, t, j, mean, *step), (), first.O, first.weight, first.room))
        flow = product(mean, A[n:, n:]), product(mean, B[n:])
        flows.append(columns([(flow[0], box.x), (flow[1][:, :m], box.u), (flow[1][:, m:], box.d)]))
    flows = np.array(flows, dtype=object)
    lost = eye(n) - product(mean, E) - product(T2, C)
    Dd = product(T2, rational(problem.Dd) * rational(problem.d_unit))
    S = np.array([s.state for s in found.slopes], dtype=object).reshape(-1, n)
    still = slip.x_hat if parts.moved is None else slip.x_hat + parts.moved.moved
    room = reach(product(S, lost), box.x) + reach(product(S, Dd), box.d)
    room = room + product(abs(product(S, T2)), slip.y[:, None])[:, 0] + product(abs(S), still[:, None])[:, 0]
    room = room + np.array([s.room for s in found.slopes], dtype=object)
    return Near(tuple(own), flows - sum(flows[1:], flows[0]) / h, found, room)


def union(plant, t, slip: Array) -> list:
    """Ranges of every state, that of the plant and of the estimate together, and of every input; rational.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    slip : object array (n,)
        Rounding of the estimate.
    """
    y_lo, y_hi, T2 = (rational(v) for v in (t.y_lo, t.y_hi, t.T2))
    mid, half = T2 @ ((y_lo + y_hi) / 2), abs(T2) @ ((y_hi - y_lo) / 2)
    lo, hi = rational(t.z_lo) + mid - half - slip, rational(t.z_hi) + mid + half + slip
    x_lo, x_hi = (rational(v) for v in plant.limits("x"))
    u_lo, u_hi = (rational(v) for v in plant.limits("u"))
    t_lo, t_hi = rational(t.u_lo), rational(t.u_hi)
    return [*((min(a, b), max(c, d)) for a, b, c, d in zip(lo, x_lo, hi, x_hi)),
            *((min(a, b), max(c, d)) for a, b, c, d in zip(u_lo, t_lo, u_hi, t_hi))]


def maps(model: tuple[JointMode, ...], found: Near, cert: dict) -> NearMaps:
    """Bounds of rows and residual as functions of the bounds before.

    Parameters
    ----------
    model : tuple of JointMode
        Of every pair.
    found : Near
    cert : dict
        As for ``filter_bounds.maps``; "near": {"sees"}, combinations of the functionals of the slopes.

    Raises
    ------
    CertificateError
        The combinations do not belong to the rows.
    """
    h, c = len(found.own), Combined(np.array(cert["rows"], dtype=float))
    carry = [cert["carry"][j * h + j] for j in range(h)]
    own = filter_bounds.maps(found.own, cert | {
        "carry": carry, "sees": [[] for _ in range(h)], "out": [cert["out"][j * h + j] for j in range(h)]}, 0)
    steep, spread = steepness(found.weights.slopes, np.array([product(c.rows, q) for q in found.flows], dtype=object))
    sees = raised(c.sizes(found.functionals, cert["near"]["sees"]))
    return NearMaps(filter_bounds.maps(model, cert, 0), own.G, own.omega, sees, raised(found.room), steep, spread,
                    float(raised(np.array([found.weights.off], dtype=object))[0]))
