"""Thresholds of a fault estimate, proved on the numbers of the C: sets ``|r_i e| <= b_i`` that the recursion keeps.

With combinations ``r_i J = sum_j lambda_j r_j + rest`` and the bounds of ``filter_model``, from node a in mode p

    |r_i e+| <= sum_j |lambda_j| b_j + |rest| |e| + |r_i W| 1 + sum_l |r_i h_l| (bound of p_l)  =:  (G_p b + omega_p)_i,

where all bounds on the right are combinations of the b_j again; the first rows are the unit rows, so |e_k| <= b_k.
G and omega are exact rationals rounded up, and sums of nonnegative doubles are raised by more than they can have lost.
What is checked: the last bounds are kept along every edge of the switching graph, each row of the table follows from
the one before, and every threshold holds the estimate. What the combinations are does not matter for that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import CertificateError
from .exact import eye, product, rational, up, zeros
from .filter_model import JointMode, boxes, joint

Array = np.ndarray
#: Raises a sum of nonnegative doubles by more than its rounding.
RAISE = 1 + 1e-11


@dataclass(frozen=True)
class Graph:
    """Switching: mode of each node (None: any), edges (node, mode of the step, node)."""

    mode: tuple
    edges: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, automaton) -> Graph:
        """That of an ``Automaton``; where any mode may follow any other one node is enough."""
        count, nodes = len(automaton.mode), range(len(automaton.mode))
        if not automaton.dwell[0] and len(automaton.edges) == count**2:
            return cls((None,), tuple((0, p, 0) for p in nodes))
        return cls(tuple(automaton.mode), tuple((a, automaton.mode[a], b) for a, b in automaton.edges))

    def nodes(self, q: int) -> list[int]:
        """Nodes at which the mode may be q."""
        return [a for a, mode in enumerate(self.mode) if mode in (None, q)]


@dataclass(frozen=True)
class Maps:
    """Bounds as functions of the bounds before: per mode ``G b + omega`` of the rows and ``out b + room`` of f_hat.

    Parameters
    ----------
    G : ndarray (N, m, m), omega : ndarray (N, m)
    out : ndarray (N, n_f, m), room : ndarray (N, n_f)
    lost : ndarray (m, m)
        Bounds with xi = 0.
    """

    G: Array
    omega: Array
    out: Array
    room: Array
    lost: Array

    def after(self, graph: Graph, b: Array) -> Array:
        """Bounds a sample later, (nodes, m)."""
        new = np.zeros_like(b)
        for a, p, to in graph.edges:
            new[to] = np.maximum(new[to], (self.G[p] @ b[a] + self.omega[p]) * RAISE)
        return new

    def estimate(self, graph: Graph, b: Array) -> Array:
        """Bounds of |f_hat| per mode, (N, n_f)."""
        return np.array([np.max([(self.out[q] @ b[a] + self.room[q]) * RAISE for a in graph.nodes(q)], axis=0)
                         for q in range(len(self.out))])


class Combined:
    """Functionals as combinations of rows, and what the combination leaves over, exactly."""

    def __init__(self, rows: Array):
        self.rows, self.n = rational(rows), rows.shape[1]
        if len(rows) < self.n or np.any(self.rows[:self.n] != eye(self.n)):
            raise CertificateError("certificate: the first rows of the set are not the unit rows.")

    def sizes(self, wanted: Array, given: list) -> Array:
        """Nonnegative weights of the b_j: (k, m) rationals."""
        if len(given) != len(wanted):
            raise CertificateError(f"certificate: {len(given)} combinations (found), expected {len(wanted)}.")
        out = zeros(len(wanted), len(self.rows))
        for k, (row, (places, values)) in enumerate(zip(wanted, given)):
            values = rational(values)
            rest = row - sum((v * self.rows[j] for j, v in zip(places, values)), zeros(self.n))
            for j, v in zip(places, values):
                out[k, j] += abs(v)
            out[k, :self.n] += abs(rest)
        return out


def raised(values: Array) -> Array:
    """Doubles that are not below rationals."""
    out = np.zeros(values.shape)
    for index in np.ndindex(values.shape):
        if values[index] != 0:
            out[index] = up(values[index])
    return out


def seen(m: JointMode) -> Array:
    """The functionals S of the pushes of one mode that have one."""
    rows = [p.S for p in m.pushes if np.any(p.S != 0)]
    return np.array(rows, dtype=object).reshape(-1, m.J.shape[0])


def maps(model: tuple[JointMode, ...], cert: dict, n_s: int) -> Maps:
    """Bounds of rows and estimate as functions of the bounds before.

    Parameters
    ----------
    model : tuple of JointMode
    cert : dict
        "rows", "carry", "sees", "out", "lost".
    n_s : int

    Returns
    -------
    Maps

    Raises
    ------
    CertificateError
        The combinations do not belong to the rows.
    """
    c = Combined(np.array(cert["rows"], dtype=float))
    G, omega, out, room = [], [], [], []
    for m, carry, sees, estimate in zip(model, cert["carry"], cert["sees"], cert["out"], strict=True):
        g = c.sizes(product(c.rows, m.J), carry)
        o = abs(product(c.rows, m.W)).sum(axis=1)
        f, free = c.sizes(m.O, estimate), m.room.copy()
        known = iter(c.sizes(seen(m), sees))
        for p in m.pushes:
            bound = next(known) if np.any(p.S != 0) else zeros(len(c.rows))
            bound[:c.n] += p.weight
            for k in np.flatnonzero(p.seen != 0):
                f[k] += p.seen[k] * bound
                free[k] += p.seen[k] * p.room
            reach = abs(c.rows @ p.h)
            for i in np.flatnonzero(reach != 0):
                g[i] += reach[i] * bound
                o[i] += reach[i] * p.room
        f[:, :c.n] += m.weight
        for store, value in zip((G, omega, out, room), (g, o, f, free)):
            store.append(raised(value))
    still = c.rows.copy()
    still[:, c.n - n_s:] *= 0
    return Maps(np.array(G), np.array(omega), np.array(out), np.array(room), raised(c.sizes(still, cert["lost"])))


def supports(rows: Array, half: Array) -> Array:
    """Supports of a box about zero of x, with xi = 0, or of x and xi, per row."""
    exact = rational(rows)
    return raised(abs(exact[:, :len(half)]) @ half)


def anywhere(t, half: Array) -> Array:
    """Half widths of x and xi that hold at a start from anywhere; ``half`` are those of x."""
    return np.concatenate([half, rational(t.limit)])


def table(found: Maps, graph: Graph, b: Array, first: Array, most: int) -> list[Array]:
    """Bounds of |f_hat| from a start until the last bounds hold.

    Parameters
    ----------
    found : Maps
    graph : Graph
    b : ndarray (nodes, m)
        The last bounds.
    first : ndarray (nodes, m)
    most : int

    Returns
    -------
    rows : list of ndarray (N, n_f)

    Raises
    ------
    CertificateError
        They do not come down within ``most`` samples.
    """
    rows: list[Array] = []
    while np.any(first > b):
        if len(rows) == most:
            raise CertificateError(f"certificate: after {most} samples bounds of the estimate still exceed the last.")
        rows.append(found.estimate(graph, first))
        first = found.after(graph, first)
    return rows


@dataclass(frozen=True)
class Demand:
    """One condition of the table: ``needed`` is at most ``given`` (where ``strict`` less), entry by entry.

    ``says`` makes the refusal's sentence of an index and of what is needed there.
    """

    what: str
    when: str
    needed: Array
    given: Array
    says: Callable[[tuple, Array], str]
    strict: bool = False

    def require(self) -> None:
        """Refuse where it does not hold.

        Raises
        ------
        CertificateError
        """
        wrong = ~(self.needed < self.given) if self.strict else ~(self.needed <= self.given)
        if np.any(wrong):
            at = np.unravel_index(np.argmax(np.where(wrong, self.needed - self.given, -np.inf)), wrong.shape)
            raise CertificateError(f"certificate: {self.says(at, self.needed)}")


def demands(modes, t, graph: Graph, cert: dict, x0: tuple[Array, Array]) -> Iterator[Demand]:
    """All conditions of a table of thresholds; each rests on those before it.

    Parameters
    ----------
    modes : sequence
        Of the plant as the firmware sees it.
    t : FilterTables
    graph : Graph
    cert : dict
        See ``maps``; "bounds" (nodes, m).
    x0 : (ndarray (n_x,), ndarray (n_x,))
        The initial box.

    Yields
    ------
    Demand
        "kept", "start", "threshold" or "limit".

    Raises
    ------
    CertificateError
        The certificate is of another shape, or bounds do not come down to the last.
    """
    n_s, n_x = len(t.limit), len(t.x_lo)
    found, b, rows = maps(joint(modes, t), cert, n_s), np.array(cert["bounds"], dtype=float), np.array(cert["rows"])
    if b.shape != (len(graph.mode), len(rows)) or not np.all(b >= 0):
        raise CertificateError(f"certificate: bounds of shape {b.shape} (found), expected {len(graph.mode)} nodes of "
                               f"{len(rows)} bounds that are not negative.")
    yield Demand("kept", "a sample later", found.after(graph, b), b, lambda at, needed: (
        f"the set of plant and filter is not kept: row {at[1]} at node {at[0]} exceeds its bound by "
        f"{needed[at] - b[at]:.3g}."))
    initial, declared = boxes(t, *x0)
    first, whole = (np.tile(supports(rows, half), (len(b), 1)) for half in (initial, anywhere(t, declared)))
    last = t.h.shape[0] - 1
    if not 0 <= t.lost <= last or not 0 <= t.shift < 16 or t.start not in (0, t.lost, last):
        raise CertificateError(f"certificate: the table of {last + 1} rows starts at {t.start} and {t.lost}.")
    late = (b @ found.lost.T) * RAISE
    for begins, bounds, words in ((last, b, "last bounds"), (t.lost, late, "bounds after a lost sample"),
                                  (t.start, whole, "declared range")):
        if t.start == begins:  # the last of them whatever row init takes
            yield Demand("start", f"initial box against the {words}", first, bounds,
                         lambda at, needed, words=words: f"the initial box is not within the {words}.")
    for name, start, begin, end in (("anywhere", whole, 0, t.lost),
                                    ("a lost sample", late, t.lost, last)):
        proved = table(found, graph, b, start, (end - begin) << t.shift)
        for k in range((end - begin) << t.shift):
            held = proved[k] if k < len(proved) else found.estimate(graph, b)
            yield _threshold(held, t.h[begin + (k >> t.shift)], f"{k} samples after {name}")
    yield _threshold(found.estimate(graph, b), t.h[last], "in the end")
    most, limit = np.max(b[:, n_x:n_x + n_s], axis=0), t.limit.astype(float)
    yield Demand("limit", "without a fault", most, limit, lambda at, needed: (
        f"xi[{at[0]}] reaches {needed[at]:.4g} without a fault, beyond its limit {limit[at]:.4g}."), True)


def check(modes, t, graph: Graph, cert: dict, x0: tuple[Array, Array]) -> None:
    """Check all thresholds of a table; arguments as ``demands``.

    Raises
    ------
    CertificateError
        Naming the row and mode that fail.
    """
    for demand in demands(modes, t, graph, cert, x0):
        demand.require()


def _threshold(needed: Array, given: Array, when: str) -> Demand:
    return Demand("threshold", when, needed, given.astype(float), lambda at, needed: (
        f"the estimate of fault {at[1]} in mode {at[0]} reaches {needed[at]:.6g} {when}, its threshold is "
        f"{float(given[at]):.6g}."))


def check_monitor(supervision, cert: dict) -> None:
    """Check that the bucket of the firmware is the one along which the filter is proved.

    Parameters
    ----------
    supervision : Supervision
    cert : dict
        Of a filter.

    Raises
    ------
    CertificateError
        Another bucket.
    """
    for name in ("dwell_add", "dwell_drain", "dwell_limit"):
        if getattr(supervision, name) != cert[name]:
            raise CertificateError(f"certificate: {name} of the monitor is {getattr(supervision, name)} (found), "
                                   f"expected {cert[name]}.")
