r"""Polytopic observers: constants blended by weights that are evaluated at the estimate, as the C does it.

    x_hat = z + T2 y,   r = y - C x_hat,   h = h(x_hat, u, theta),   z+ = sum_j h_j (F_j x_hat + G_j u - K_j r)

The residual costs nothing: the gains act on it. Entries that all vertices share are added once, outside the sum of
the weights: an entry of every row is either shared or varies.

The estimate needs no start value for what is algebraic: z starts at T1 E x0, and T2 y adds the rest from the first
measurement, so that an x0 that contradicts the algebraic equations does no harm. Without a measurement x_hat is
continued with the last y and r = 0.

The weights may be wrong by whatever rounding does: the certificate covers every weight in [0, 1] with sum 1. Only the
weights need functions of the libm. The reference calls those of this machine, one number at a time, so that it equals
the C that runs on it; on a target with another libm last bits of the weights differ.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..algebra.program import LIBM, TRUTHS, Program

Array = np.ndarray
#: Answers of a call; their numbers are those of all generated observers.
OK, BAD_INPUT, BAD_OUTPUT, BAD_PARAMETER = 0, 2, 3, 4


@dataclass(frozen=True)
class PolytopicTables:
    """The numbers that the C holds; h vertices on the first axis.

    Parameters
    ----------
    real : {"float32", "float64"}
    T2 : ndarray (n, p), C : ndarray (p, n)
    F : ndarray (h, n, n), G : ndarray (h, n, m), K : ndarray (h, n, p)
    z0 : ndarray (n,), y0 : ndarray (p,)
        Start of z, and the measurement that stands for a first one that is missing.
    u_lo, u_hi : ndarray (m,), y_lo, y_hi : ndarray (p,), theta_lo, theta_hi : ndarray (n_theta,)
        What the input check accepts.
    weights : Program
        h weights and whether they are in force, of x_hat, u, theta.
    """

    real: str
    T2: Array
    C: Array
    F: Array
    G: Array
    K: Array
    z0: Array
    y0: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    theta_lo: Array
    theta_hi: Array
    weights: Program

    @property
    def gains(self) -> Array:
        """F, G and -K side by side (h, n, n + m + p): factors of (x_hat, u, r)."""
        return np.concatenate([self.F, self.G, -self.K], axis=2)

    @property
    def shared(self) -> Array:
        """Entries of `gains` that are the same at all vertices (n, n + m + p)."""
        return np.all(self.gains == self.gains[0], axis=0)


@dataclass(frozen=True)
class PolytopicTrace:
    """Answers, (S, K) in front: x_hat, r, h, inside and status; z is the state after the last sample."""

    x_hat: Array
    r: Array
    h: Array
    inside: Array
    status: Array
    z: Array


class PolytopicObserver:
    """A polytopic observer as the firmware runs it, on S independent runs at once.

    Parameters
    ----------
    tables : PolytopicTables
    """

    def __init__(self, tables: PolytopicTables):
        self.tables = tables

    def run_many(self, u: Array, y: Array, theta: Array | None = None) -> PolytopicTrace:
        """Run over K samples.

        Parameters
        ----------
        u : ndarray (S, K, m), y : ndarray (S, K, p)
            A row of y with a NaN in it is a missing measurement.
        theta : ndarray (S, K, n_theta), optional

        Returns
        -------
        trace : PolytopicTrace
        """
        t, dtype = self.tables, np.dtype(self.tables.real)
        u, y = np.asarray(u, dtype), np.asarray(y, dtype)
        S, steps = y.shape[:2]
        theta = np.zeros((S, steps, 0), dtype) if theta is None else np.asarray(theta, dtype)
        out = PolytopicTrace(*(np.zeros((S, steps, k), dtype) for k in (len(t.C[0]), len(t.C), len(t.F))),
                             np.zeros((S, steps), bool), np.zeros((S, steps), int), np.tile(t.z0.astype(dtype), (S, 1)))
        z, last = out.z, np.tile(t.y0.astype(dtype), (S, 1))
        for k in range(steps):
            measured = ~np.isnan(y[:, k]).any(axis=1)
            status = np.where(~within(u[:, k], t.u_lo, t.u_hi), BAD_INPUT, OK)
            status = np.where((status == OK) & ~within(theta[:, k], t.theta_lo, t.theta_hi), BAD_PARAMETER, status)
            beyond = measured & ~within(y[:, k], t.y_lo, t.y_hi)
            status = np.where((status == OK) & beyond, BAD_OUTPUT, status)
            on = status == OK
            now = np.where(measured[:, None], y[:, k], last)
            x_hat, r, h, inside, after = step(t, z, u[:, k], now, theta[:, k], measured)
            out.status[:, k], out.x_hat[on, k], out.r[on, k] = status, x_hat[on], r[on]
            out.h[on, k], out.inside[on, k], z[on], last[on] = h[on], inside[on], after[on], now[on]
        return out


def step(t: PolytopicTables, z: Array, u: Array, y: Array, theta: Array, measured: Array) -> tuple[Array, ...]:
    """One sample of S runs: x_hat, r, h, inside and the z after it.

    Parameters
    ----------
    t : PolytopicTables
    z : ndarray (S, n), u : ndarray (S, m), y : ndarray (S, p), theta : ndarray (S, n_theta)
    measured : ndarray (S,) bool
    """
    with np.errstate(all="ignore"):
        x_hat = summed(t.T2, y, z)
        r = np.where(measured[:, None], summed(-t.C, x_hat, y), np.zeros_like(y))
        *h, inside = evaluate(t.weights, [*x_hat.T, *u.T, *theta.T], x_hat.dtype)
        h = np.stack([np.broadcast_to(w, inside.shape) for w in h], axis=1).astype(x_hat.dtype)
        values = np.concatenate([x_hat, u, r], axis=1)
        after = summed(np.where(t.shared, t.gains[0], 0), values)
        for j, M in enumerate(t.gains):
            own = np.where(t.shared, 0, M)
            some = np.any(own != 0, axis=1)
            after = np.where(some, after + h[:, [j]] * summed(own, values), after)
    return x_hat, r, h, inside, after


def summed(M: Array, values: Array, start: Array | None = None) -> Array:
    """Return start + M values, term after term; entries that are zero are left out.

    Parameters
    ----------
    M : ndarray (k, n), values : ndarray (S, n)
    start : ndarray (S, k), optional
    """
    out = np.zeros((len(values), len(M)), values.dtype) if start is None else start.copy()
    M = M.astype(values.dtype)
    for i, row in enumerate(M):
        terms = [c * values[:, k] for k, c in enumerate(row) if c != 0]
        if start is None and terms:
            out[:, i] = terms.pop(0)
        for term in terms:
            out[:, i] = out[:, i] + term
    return out


def within(values: Array, lo: Array, hi: Array) -> Array:
    """Whether all numbers of a row are in their ranges; NaN is not.

    Parameters
    ----------
    values : ndarray (S, k), lo, hi : ndarray (k,)
    """
    return ((values >= lo.astype(values.dtype)) & (values <= hi.astype(values.dtype))).all(axis=1)


def evaluate(program: Program, inputs: list[Array], dtype) -> list[Array]:
    """Results of a program, operation by operation.

    Parameters
    ----------
    program : Program
    inputs : list of ndarray (S,)
    dtype : numpy type
    """
    kind = np.dtype(dtype).type
    shape = inputs[0].shape
    values = [np.asarray(v, dtype) for v in inputs] + [np.full(shape, kind(c)) for c in program.constants]
    for op in program.operations:
        args = [values[k] for k in op.args]
        values.append(_libm(op.name, args) if op.name in LIBM else _plain(op.name, args, kind))
    return [values[k] for k in program.results]


def _plain(name: str, args: list[Array], kind) -> Array:
    a, b = (*args, None)[:2]
    if name == "select":
        return np.where(a, b, args[2])
    if name == "div":
        some = (b > 0) | (b < 0)  # NaN is neither
        return np.where(some, a / np.where(some, b, kind(1)), np.finfo(kind).max)
    done = {"add": lambda: a + b, "sub": lambda: a - b, "mul": lambda: a * b, "neg": lambda: -a,
            "abs": lambda: np.where(a < 0, -a, a), "min": lambda: np.where(a < b, a, b),
            "max": lambda: np.where(a > b, a, b), "sqrt": lambda: np.sqrt(a), "ge": lambda: a >= b,
            "le": lambda: a <= b, "gt": lambda: a > b, "and": lambda: a & b}[name]()
    return done if name in TRUTHS else done.astype(kind)


def _libm(name: str, args: list[Array]) -> Array:
    function = _function(name, len(args), args[0].dtype.name)
    return np.array([function(*map(float, row)) for row in zip(*args)], dtype=args[0].dtype)


@cache
def _function(name: str, arguments: int, real: str):
    """The function of this machine's libm, in the precision of the C."""
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    function = getattr(library, name + ("f" if real == "float32" else ""))
    kind = ctypes.c_float if real == "float32" else ctypes.c_double
    function.restype, function.argtypes = kind, [kind] * arguments
    return function
