"""From a fault estimation filter to its tables: rounding, thresholds that the set of plant and filter gives, proof."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np

from ..algebra.template_set import combinations, independent, largest, least_kept, walks
from ..certify import filter_bounds
from ..certify.exact import Q, down, up
from ..certify.filter_model import JointMode, boxes, joint, joint_mode, parts
from ..errors import CertificateError, DesignError
from ..observers import FilterTables
from ..plant.model import Plant

Array = np.ndarray
#: Most rows of the set; fewer where its thresholds are that close to what a run reaches. Rows added at a time.
ROWS, CLOSE, STEP = 64, 1.01, 4
#: The last bounds over the smallest ones; the smaller, the longer the table. Most samples of its two beginnings.
ABOVE, MOST = 1.002, 4000
#: Rows of a beginning at most; where it lasts longer a row holds for two, four, ... samples.
LENGTH = 20
#: Samples that runs are followed back.
LONG = 120
#: Unknown numbers of a mode that are taken at both ends where runs are looked for.
MOST_NUMBERS = 6
#: An initial box may raise the last thresholds by so much; else the firmware starts from anywhere.
RAISED = 1.02
#: Maps are raised by so much before bounds are solved for that they keep.
SOLVED = filter_bounds.RAISE * (1 + 1e-9)
#: Samples that runs of slow plants are followed back at most, and over 1 - the largest eigenvalue.
LONGEST, SLOW = 4000, 3.0


def floats(values: Array) -> Array:
    """Nearest doubles of rationals."""
    return np.array([float(x) for x in values.ravel()]).reshape(values.shape)


def plain_tables(plant: Plant, constants: dict[str, Array], real: str) -> dict:
    """Everything of ``FilterTables`` but thresholds and limit."""
    out = dict(constants) | {"real": real}
    for name, (lo, hi) in {"x": plant.limits("x"), "x0": (plant.x0_lo, plant.x0_hi)}.items():
        out[f"{name}_lo"] = np.array([down(Q(x), real) for x in lo], dtype=real)
        out[f"{name}_hi"] = np.array([up(Q(x), real) for x in hi], dtype=real)
    for name in ("u", "y"):
        out[f"{name}_lo"], out[f"{name}_hi"] = (np.asarray(side).astype(real) for side in plant.limits(name))
    return out


class Chooser:
    """Chooses the rows of the set and their combinations, in double precision.

    Parameters
    ----------
    model : tuple of JointMode
    graph : Graph
    n_s : int
        States of the filter.
    """

    def __init__(self, model: tuple[JointMode, ...], graph: filter_bounds.Graph, n_s: int):
        self.model, self.graph, self.n_s = model, graph, n_s
        self.J = [floats(m.J) for m in model]
        self.W = [floats(m.W) for m in model]
        self.O = [floats(m.O) for m in model]
        self.S = [floats(filter_bounds.seen(m)) for m in model]
        self.n = len(self.J[0])
        self.like = [next(k for k, first in enumerate(self.J) if np.array_equal(first, J)) for J in self.J]
        self.paths = backwards(graph, len(model), LONG)
        self.sizes = np.zeros(self.n + sum(map(len, self.S)))  # of the unit rows and of S, as far as runs reach

    def reached(self, rows: Array) -> Array:
        """What |r e| reaches along random sequences, the unknown numbers at their worst as well."""
        asked = np.concatenate([np.eye(self.n), *self.S])
        value = self.sizes
        for _ in range(8):
            pushes = self._pushes(value)
            new = largest(self.J, pushes, asked, self.paths[1:61]).max(axis=0)
            if np.all(new <= value * (1 + 1e-3)):
                break
            value = new
            if not np.max(value) < 1e12:
                break
        self.sizes = value
        return largest(self.J, self._pushes(value), rows, self.paths[1:]).max(axis=0)

    def _pushes(self, value: Array) -> list[Array]:
        """Columns of disturbance and of what is uncertain, for sizes of the unit rows and of S."""
        known, out = iter(value[self.n:]), []
        for m, W in zip(self.model, self.W):
            columns = [W]
            for p in m.pushes:
                size = float(p.room) + floats(p.weight) @ value[:self.n] + (next(known) if np.any(p.S != 0) else 0.0)
                columns.append(floats(p.h)[:, None] * size)
            out.append(np.concatenate(columns, axis=1))
        return out

    def seeds(self) -> Array:
        """The unit rows, what is estimated and what is uncertain."""
        unit = list(np.eye(self.n))
        return np.array(unit + independent(unit, np.concatenate([*self.O, *self.S])))

    def grown(self, most: int, low: Array) -> Array:
        """Rows of a set: from the seeds, where a combination loses most of what it is worth to the estimate.

        Parameters
        ----------
        most : int
        low : ndarray (k,)
            What the estimates reach; no set is below that.
        """
        rows, own = self.seeds(), [{} for _ in self.J]
        carry = [own[k] for k in self.like]  # modes that move e alike share the combinations
        while True:
            after = [rows @ J for J in self.J]
            both = self.reached(np.concatenate([rows, *after]))
            b, need = both[:len(rows)], both[len(rows):].reshape(len(self.J), len(rows))
            if not np.max(b) < 1e12:
                return rows
            for known, wanted in zip(carry, after):
                fresh = [i for i in range(len(rows)) if i not in known]
                if fresh:
                    known |= dict(zip(fresh, combinations(rows, np.maximum(b, 1e-9 * np.max(b)), wanted[fresh])))
            held = np.array([[np.abs(known[i]) @ b[:len(known[i])] for i in range(len(rows))] for known in carry])
            lost = held - need
            worth, highest = self._worth(rows, carry, b)
            if highest <= CLOSE * np.max(low) or len(rows) >= most:
                return rows
            order = np.argsort(-(lost * worth), axis=None)[:max(STEP, len(rows) // 6)]
            chosen = [(p, i) for p, i in zip(*np.unravel_index(order, lost.shape)) if lost[p, i] > 1e-6 * b[i]]
            fresh = independent(rows, np.array([after[p][i] for p, i in chosen]).reshape(-1, self.n))
            if not fresh:
                return rows
            rows = np.concatenate([rows, fresh])[:most]
            for p, i in chosen:
                carry[p].pop(i, None)

    def _worth(self, rows: Array, carry: list[dict], b: Array) -> tuple[Array, float]:
        """How much each combination counts in the estimate's bound along runs, (N, m), and that bound."""
        m = len(rows)
        G = np.zeros((len(carry), m, m))
        for g, known, J in zip(G, carry, self.J):
            for i, row in known.items():
                g[i, :len(row)] = np.abs(row)
                g[i, :self.n] += np.abs(rows[i] @ J - row @ rows[:len(row)])
        omega = [np.abs(rows @ W).sum(axis=1) for W in self._pushes(self.sizes)]
        outs = np.abs(combinations(rows, np.maximum(b, 1e-9 * np.max(b)), np.concatenate(self.O)))
        count, worth = min(20, self.paths.shape[1]), np.zeros((len(carry), m))
        for path in self.paths[1:61, :count].T:
            w = outs.max(axis=0)
            for q in path:
                worth[q] += w / count
                w = w @ G[q]
                if not np.max(w) < 1e6:
                    break
        bounds = np.tile(b, (len(self.graph.mode), 1))
        for _ in range(1000):
            after = bounds.copy()
            for a, p, to in self.graph.edges:
                after[to] = np.maximum(after[to], G[p] @ bounds[a] + omega[p])
            if np.all(after <= bounds * (1 + 1e-6)):
                return worth, float(np.max(bounds @ outs.T))
            bounds = after
            if not np.max(bounds) < 1e12:
                break
        return worth, np.inf

    def combined(self, rows: Array, b: Array) -> dict:
        """Combinations for bounds b (m,), as the certificate holds them."""
        b = np.maximum(b, 1e-9 * np.max(b))

        def sparse(wanted: Array) -> list:
            return [[np.flatnonzero(row).tolist(), row[np.flatnonzero(row)].tolist()]
                    for row in combinations(rows, b, wanted)]

        own = [sparse(rows @ J) if k == like else [] for k, (like, J) in enumerate(zip(self.like, self.J))]
        still = rows * (np.arange(self.n) < self.n - self.n_s)
        return {"rows": rows.tolist(), "carry": [own[k] for k in self.like], "sees": [sparse(S) for S in self.S],
                "out": [sparse(O) for O in self.O], "lost": sparse(still)}  # noqa: E741

    def settled(self, found: filter_bounds.Maps, b: Array) -> Array | None:
        """Bounds that are kept, from bounds b (nodes, m) upward; None where they grow without end."""
        top, first = 1e6 * np.max(b), b
        for _ in range(4000):
            after = found.after(self.graph, b)
            if np.all(after <= b):
                return b
            b = np.maximum(b, after * (1 + 1e-9))
            if not np.max(b) < top:
                return None
        # Slow plants take long: solve for them.
        return least_kept(found.G * SOLVED, found.omega * SOLVED, self.graph.edges, first)

    def kept(self, rows: Array) -> tuple[dict, filter_bounds.Maps, Array] | None:
        """A certificate's combinations, what follows from them, and the last bounds; None where there are none."""
        for factor in (1.0, 1.5, 1.0):
            b = self.reached(rows) * factor
            if not np.max(b) < 1e12:
                return None
            cert = self.combined(rows, b)
            found = filter_bounds.maps(self.model, cert, self.n_s)
            bounds = self.settled(found, np.tile(b / 1.01, (len(self.graph.mode), 1)))
            if bounds is not None:
                return cert, found, bounds
            if factor > 1:  # runs may have been too short to show how rows grow together
                self.follow_further()
        return None

    def follow_further(self) -> None:
        """Follow runs as far back as the slowest mode asks for."""
        radius = min(max(np.abs(np.linalg.eigvals(J)).max() for J in self.J), 1 - 1e-9)
        self.paths = backwards(self.graph, len(self.model), int(np.clip(SLOW / (1 - radius), LONG, LONGEST)))


def thresholds(plant: Plant, given: dict, graph: filter_bounds.Graph, most: int | None = None) -> tuple[dict, dict]:
    """Choose a set, and with it the table of thresholds.

    Parameters
    ----------
    plant : Plant
    given : dict
        Of ``plain_tables``.
    graph : Graph
    most : int, optional
        Rows of the set; by default as many as it takes.

    Returns
    -------
    tables : dict
        "h", "lost", "start", "shift", "limit".
    cert : dict
        For ``certify.filter_bounds.check``.

    Raises
    ------
    DesignError
        No set is kept.
    """
    n_s = given["M"].shape[1]
    t = SimpleNamespace(**given, limit=np.zeros(n_s))
    model = joint(plant.observed.modes, t)
    chooser = Chooser(model, graph, n_s)
    low = chooser.reached(np.concatenate(chooser.O))
    kept = chooser.kept(chooser.grown(most or ROWS, low))
    if kept is None:
        raise DesignError(f"{plant.name}: no set of plant and filter is kept under this switching and uncertainty "
                          "(found none), so there is no threshold. State a dwell time or narrower bounds, or raise "
                          "observer.set_rows.")
    tables, cert = laid_out(plant, t, graph, *kept, chooser)
    return tables, cert | {"reached": reached(plant, t, graph).tolist()}


def backwards(graph: filter_bounds.Graph, n_modes: int, length: int, runs: int = 60) -> Array:
    """Mode sequences that the switching admits, the last sample first, (length + 1, runs)."""
    if graph.mode == (None,):
        every = list(range(n_modes))
        return walks(every, [every] * n_modes, length, runs)
    return walks(graph.mode, [[a for a, _, b in graph.edges if b == to] for to in range(len(graph.mode))], length, runs)


def corners(m) -> list:
    """A mode at the ends of its unknown numbers, what is bounded elementwise in the middle."""
    if getattr(m, "A_unc", None) is None:
        return [m]
    A, B, effects, _ = parts(m)
    plain = {f: getattr(m, f)[:0] for f in ("A_unc", "B_unc", "A_theta", "B_theta", "theta_lo", "theta_hi")}
    out = []
    for signs in product((-1, 1), repeat=min(len(effects), MOST_NUMBERS)):
        both = np.concatenate([A, B], axis=1) + sum(s * e for s, e in zip(signs, effects))
        AB = floats(np.asarray(both, dtype=object))
        plain |= {"A": AB[:, :A.shape[1]], "B": AB[:, A.shape[1]:], "A_rad": 0 * m.A_rad, "B_rad": 0 * m.B_rad,
                  "more": {}, **{name: getattr(m, name) + np.tensordot(signs[:len(unc)], unc, 1)
                                 for name, unc in m.more.items()}}
        out.append(replace(m, **plain))
    return out


def reached(plant: Plant, t, graph: filter_bounds.Graph) -> Array:
    """What |f_hat| reaches in each mode on some run without fault, (N, n_f): no threshold can be below that."""
    ends = [[joint_mode(c, t, q) for c in corners(m)] for q, m in enumerate(plant.observed.modes)]
    first = np.cumsum([0, *map(len, ends)])
    vertices, rows = [v for group in ends for v in group], [joint_mode(m, t, q) for q, m in
                                                            enumerate(plant.observed.modes)]
    paths, rng = backwards(graph, len(rows), LONG, 200), np.random.default_rng(0)
    pick = rng.random((len(paths), 200)) if len(vertices) > len(rows) else np.zeros((len(paths), 200))
    pick[:, ::2] = pick[:1, ::2]  # a number that stays, or changes at each sample
    steps = first[paths] + (pick * np.array([len(g) for g in ends])[paths]).astype(int)
    low = largest([floats(v.J) for v in vertices], [floats(v.W) for v in vertices],
                  np.concatenate([floats(m.O) for m in rows]), steps[1:])
    n_f, out = len(rows[0].room), []
    for q, m in enumerate(rows):
        out.append(np.max(low[paths[0] == q, q * n_f:(q + 1) * n_f], axis=0) + [float(x) for x in m.room])
    return np.array(out)


def laid_out(plant: Plant, t, graph, cert: dict, found, b: Array, chooser: Chooser) -> tuple[dict, dict]:
    """The table of thresholds of a set, and the limits of xi."""
    rows, n_x, n_s = np.array(cert["rows"]), len(t.x_lo), t.M.shape[1]
    reach = [np.concatenate([t.L[q] * np.maximum(abs(t.y_lo), abs(t.y_hi)), t.G[q] * np.maximum(abs(t.u_lo),
             abs(t.u_hi))], axis=1).astype(float) for q in range(len(t.M))]
    driven = largest([M.astype(float) for M in t.M], reach, np.eye(n_s), chooser.paths).max(axis=0)
    t.limit = above(1.5 * np.maximum(driven, np.max(b, axis=0)[n_x:n_x + n_s]) + 1e-30, t.real)
    initial, declared = boxes(t, plant.x0_lo, plant.x0_hi)
    initial, anywhere = (np.tile(filter_bounds.supports(rows, half), (len(b), 1))
                         for half in (initial, filter_bounds.anywhere(t, declared)))
    plain = found.estimate(graph, b)
    with_box = chooser.settled(found, np.maximum(b, initial))
    starts = with_box is not None and bool(np.all(found.estimate(graph, with_box) <= RAISED * plain))
    b = chooser.settled(found, (with_box if starts else b) * ABOVE)
    if b is None:
        raise DesignError(f"{plant.name}: the set of plant and filter is not kept. Raise observer.set_rows.")
    late = (b @ found.lost.T) * filter_bounds.RAISE
    try:
        first, after = (filter_bounds.table(found, graph, b, start, MOST) for start in (anywhere, late))
    except CertificateError:
        raise DesignError(f"{plant.name}: the thresholds take more than {MOST} samples to come down from the declared "
                          "range of x (found), expected fewer. Narrow that range, or slow the sampling down.") from None
    shift, final = 0, found.estimate(graph, b)
    while max(len(first), len(after)) > LENGTH << shift:
        shift += 1
    groups = [grouped(part, final, 1 << shift) for part in (first, after)]
    h = above(np.array([*groups[0], *groups[1], final]), t.real)
    begins = len(groups[0]) if np.all(initial <= late) else 0
    return ({"h": h, "lost": len(groups[0]), "start": len(h) - 1 if starts else begins, "shift": shift,
             "limit": t.limit}, cert | {"bounds": b.tolist()})


def grouped(rows: list[Array], final: Array, stride: int) -> list[Array]:
    """The largest of so many rows at a time; after the last of them the final one holds."""
    full = [*rows, *[final] * (-len(rows) % stride)]
    return [np.max(full[k:k + stride], axis=0) for k in range(0, len(full), stride)]


def above(x: Array, real: str) -> Array:
    """Round doubles up."""
    y = x.astype(real)
    return np.where(y.astype(np.float64) < x, np.nextafter(y, np.array(np.inf, real)), y).astype(real)


def frozen(plant: Plant, constants: dict[str, Array], graph: filter_bounds.Graph, real: str,
           most: int | None = None) -> tuple[FilterTables, dict]:
    """Tables of a filter and the proof of their thresholds, checked.

    Parameters
    ----------
    plant : Plant
    constants : dict
        M, L, G, K, Dy, Du, rounded.
    graph : Graph
    real : {"float32", "float64"}
    most : int, optional
        Rows of the set.

    Returns
    -------
    tables : FilterTables
    cert : dict

    Raises
    ------
    DesignError
        No set is kept.
    CertificateError
        The exact check refuses the thresholds.
    """
    given = plain_tables(plant, constants, real)
    more, cert = thresholds(plant, given, graph, most)
    t = FilterTables(**given, **more)
    filter_bounds.check(plant.observed.modes, t, graph, cert, (plant.x0_lo, plant.x0_hi))
    return t, cert
