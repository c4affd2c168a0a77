"""From a polytopic observer to its tables: constants, weights, limits of its state, thresholds that a set gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..certify import descriptor_bounds, filter_bounds, polytope_bounds, polytope_near, polytope_thresholds
from ..certify.exact import Q, down, rational, up
from ..errors import CertificateError, DesignError, EmitError
from ..observers import DescriptorTables, PolytopicTables
from ..plant.model import Plant
from ..plant.weight_program import weight_program
from ..synthesis.descriptor_gains import StandardGains
from ..synthesis.descriptor_problem import Scaling
from .filter_tables import ABOVE, LENGTH, RAISED, Chooser, above, grouped
from .polytopic_near import NearChooser, lower

Array = np.ndarray
#: Rows of the set at most, without ``observer.set_rows``: more where so few keep none. Samples in which thresholds may
#: come down.
ROWS, MOST = (12, 32, 96), 4000
#: Limits of z beyond where it can be without a fault, in bounds of the error.
BEYOND = 1.5


def tables_of(plant: Plant, gains: StandardGains, M: Array, real: str) -> PolytopicTables:
    """The numbers that the C of an observer holds, but for thresholds and limits of z, which say nothing yet.

    Parameters
    ----------
    plant : Plant
        With a polytope, the one of the design.
    gains : StandardGains
        Of a recursion, rounded to this type.
    M : ndarray (n_y, n_y)
        Weight of the residual, rounded.
    real : {"float32", "float64"}

    Returns
    -------
    tables : PolytopicTables

    Raises
    ------
    EmitError
        The gains are of the other type, or the weights have a function without operation.
    """
    given = {k: getattr(gains, k).astype(real) for k in ("T2", "C", "F", "G", "K")} | {"M": M.astype(real)}
    if any(not np.array_equal(value, given[k]) for k, value in (*vars(gains).items(), ("M", M))):
        raise EmitError(f"{plant.name}: the observer's constants are no {real} (found). Design it for {real}.")
    try:
        inputs = plant.polytope.symbols[plant.n_x:plant.n_x + plant.n_u]
        weights = weight_program(plant.polytope, real, dict(zip(inputs, zip(*plant.limits("u")))))
    except TypeError as error:
        raise EmitError(f"{plant.name}: a weight cannot be printed: {error}. Write it with other functions.") from None
    # z starts at T1 E x0 = (I - T2 C) x0: then x_hat is x0 with its algebraic part from the first measurement.
    x, x0, most = plant.limits("x"), (plant.x0_lo, plant.x0_hi), float(np.finfo(real).max)
    for name, (lo, hi) in {"x": x, "x0": x0}.items():
        given[f"{name}_lo"] = np.array([down(Q(v), real) for v in lo], dtype=real)
        given[f"{name}_hi"] = np.array([up(Q(v), real) for v in hi], dtype=real)
    for name in ("u", "y"):
        lo, hi = (np.clip(side, -most, most) for side in plant.limits(name))
        given |= {f"{name}_lo": lo.astype(real), f"{name}_hi": hi.astype(real)}
    given |= read_parameters(plant, real)
    for z, y, (lo, hi) in (("z0", "y0", x0), ("z_mid", "y_mid", x)):
        at = (np.asarray(lo) + np.asarray(hi)) / 2
        given |= {z: (at - gains.T2 @ (gains.C @ at)).astype(real) + 0, y: (gains.C @ at).astype(real) + 0}
        given[y] = np.clip(given[y], given["y_lo"], given["y_hi"])
    n, p = gains.T2.shape
    given["known"] = np.zeros((n, 0), real)
    return PolytopicTables(real=real, h=np.zeros((1, p), real), start=0, shift=0, z_lo=np.zeros(n, real),
                           z_hi=np.zeros(n, real), weights=weights, **given)


def read_parameters(plant: Plant, real: str) -> dict:
    """Columns of theta that are measured, and what the check accepts of them: their bounds, error included.

    Parameters
    ----------
    plant : Plant
    real : {"float32", "float64"}

    Returns
    -------
    dict
        "columns", "theta_lo", "theta_hi" of the tables, rounded outward.
    """
    read = [(j, s) for j, s in enumerate(plant.theta) if s.measured]
    return {"columns": tuple(j for j, _ in read),
            "theta_lo": np.array([down(Q(s.lo) - Q(s.error), real) for _, s in read], dtype=real),
            "theta_hi": np.array([up(Q(s.hi) + Q(s.error), real) for _, s in read], dtype=real)}


def without_dust(gains: StandardGains, s: Scaling, u_unit: Array, real: str) -> StandardGains:
    """Gains without entries that do less, in the units of the design, than the type rounds: they cost operations.

    Parameters
    ----------
    gains : StandardGains
    s : Scaling
    u_unit : ndarray (m,)
    real : {"float32", "float64"}
    """
    units = {"T2": s.outputs, "F": s.columns, "G": u_unit, "K": s.outputs}
    moved = {k: np.abs(getattr(gains, k)) * units[k] / s.columns[:, None] for k in units}
    most = max(np.max(moved[k], initial=0.0) for k in "FGK")
    least = {"T2": np.max(moved["T2"], initial=0.0)} | dict.fromkeys("FGK", most)
    return replace(gains, **{k: np.where(moved[k] < np.finfo(real).eps / 4 * least[k], 0.0, getattr(gains, k))
                             for k in units})


def limited(plant: Plant, t: PolytopicTables, T1E: Array, room: Array) -> PolytopicTables:
    """Tables with limits of z: where T1 E x can be, and so much beyond.

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    T1E : ndarray (n, n)
    room : ndarray (n,)
    """
    lo, hi = plant.limits("x")
    mid, half = T1E @ (lo + hi) / 2, np.abs(T1E) @ (hi - lo) / 2 * (1 + 1e-6) + room + 1e-30
    ends = np.minimum(mid - half, np.minimum(t.z0, t.z_mid)), np.maximum(mid + half, np.maximum(t.z0, t.z_mid))
    return replace(t, z_lo=-above(-ends[0], t.real), z_hi=above(ends[1], t.real))


def frozen(plant: Plant, problem, t: PolytopicTables, T1: Array, period: float | None,
           most: int | None = None, near: bool = True) -> tuple[PolytopicTables, dict]:
    """Tables with thresholds and their proof, checked.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
        Of `tables_of`.
    T1 : ndarray (n, n) or (h, n, n)
    period : float or None
        Of a continuous plant.
    most : int, optional
        Rows of the set.
    near : bool
        Whether it may rest on weights that are no further apart than the error allows.

    Returns
    -------
    tables : PolytopicTables
    cert : dict
        For ``certify.polytope_thresholds.check``.

    Raises
    ------
    DesignError
        No set is kept, or no bound is to be had.
    CertificateError
        The exact check refuses the thresholds.
    """
    moving = [s.name for s in plant.u if s.rate] if plant.kind == "continuous" else []
    if moving:
        raise DesignError(f"{plant.name}: the input {moving[0]} moves between samples (found), expected inputs that "
                          "are held: what it does there has no bound here. Remove its rate.")
    every = polytope_thresholds.every_pair(problem)
    n, far, rows, solves = len(problem.E), np.zeros(len(problem.E)), None, isinstance(t, DescriptorTables)
    first = np.eye(n) if solves else np.reshape(T1, (-1, n, n))[0] @ problem.E
    for _ in range(2):  # the limits of z tell the rounding, which tells the set, which tells the limits
        t = limited(plant, t, first, BEYOND * far)
        parts = None if solves else polytope_bounds.Parts.of(plant, every, t, T1, period)
        model, T1E = polytope_thresholds.model_of(plant, problem, t, T1, period, parts)
        chooser = Chooser(model, polytope_thresholds.graph_of(model), 0)
        low = chooser.reached(np.concatenate(chooser.O))
        for count in ROWS if most is None else (most,):
            rows = chooser.grown(count, low) if rows is None else rows
            if (kept := chooser.kept(rows)) is not None:
                break
            rows = None
        else:
            raise DesignError(f"{plant.name}: no set of the error is kept for all weights (found none), so there is no "
                              "threshold. Ask for a faster decay or other gains, or raise observer.set_rows.")
        start = polytope_thresholds.starts(plant, t, T1E)
        if near and not solves and (found := polytope_near.near(plant, every, t, parts, model)) is not None:
            own = NearChooser(chooser, model, found)
            kept, low = lower(chooser.graph, (kept, low), (own.kept(len(rows), own.reached(), rows, start[1]),
                                                           own.reached()))
        size = kept[2][0, :len(T1E)]
        far = descriptor_bounds.room(plant, problem, t, size) if solves else size
    t, cert = _laid_out(plant, t, chooser, *kept, start)
    if period is not None:
        cert["between"] = "joint"  # how ``polytope_drift`` bounds the plant between samples
    cert["reached"] = low.reshape(-1, len(t.M)).max(axis=0).tolist()
    polytope_thresholds.check(plant, problem, t, cert, T1, period)
    return t, cert


def _laid_out(plant: Plant, t: PolytopicTables, chooser: Chooser, cert: dict, found, b: Array, starts):
    """The table of thresholds of a set."""
    graph, rows = chooser.graph, np.abs(rational(cert["rows"]))
    initial, anywhere = (filter_bounds.raised(rows @ half)[None] for half in starts)
    settled = found.estimate(graph, b)
    with_box = chooser.settled(found, np.maximum(b, initial))
    begins = with_box is not None and bool(np.all(found.estimate(graph, with_box) <= RAISED * settled))
    b = chooser.settled(found, (with_box if begins else b) * ABOVE)
    if b is None:
        raise DesignError(f"{plant.name}: the set of the error is not kept. Raise observer.set_rows.")
    try:
        first = filter_bounds.table(found, graph, b, anywhere, MOST)
    except CertificateError:
        raise DesignError(f"{plant.name}: the thresholds take more than {MOST} samples to come down from the declared "
                          "range of x (found), expected fewer. Ask for a faster decay, or narrow that range.") from None
    first, final = [row.max(axis=0) for row in first], found.estimate(graph, b).max(axis=0)
    shift = 0
    while len(first) > LENGTH << shift:
        shift += 1
    h = above(np.array([*grouped(first, final, 1 << shift), final]), t.real)
    return replace(t, h=h, start=len(h) - 1 if begins else 0, shift=shift), cert | {"bounds": b.tolist()}
