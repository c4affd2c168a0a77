r"""One sample of a polytopic observer, operation by operation as the C does it.

The weights may be wrong by whatever rounding does: the certificate covers every weight in [0, 1] with sum 1. Only the
weights need functions of the libm. The reference calls those of this machine, one number at a time, so that it equals
the C that runs on it; on a target with another libm last bits of the weights differ.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from functools import cache

import numpy as np

from ..algebra.program import LIBM, TRUTHS, Program
from .polytopic_tables import PolytopicTables

Array = np.ndarray


def step(t: PolytopicTables, z: Array, u: Array, y: Array, theta: Array, measured: Array) -> tuple[Array, ...]:
    """One sample of S runs: x_hat, r, inside and the z after it, before it is cut.

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
        return x_hat, r, inside, moved(t, x_hat, u, r, h)


def moved(t: PolytopicTables, x_hat: Array, u: Array, r: Array, h: Array) -> Array:
    """The z after a sample of S runs, before it is cut.

    Parameters
    ----------
    t : PolytopicTables
    x_hat : ndarray (S, n), u : ndarray (S, m), r : ndarray (S, p)
    h : ndarray (S, h + g)
        Weights, then known terms.
    """
    values = np.concatenate([x_hat, u, r, h[:, len(t.F):]], axis=1)
    after = summed(np.where(t.shared, t.gains[0], 0), values)
    for j, M in enumerate(t.gains):
        own = np.where(t.shared, 0, M)
        some = np.any(own != 0, axis=1)
        after = np.where(some, after + h[:, [j]] * summed(own, values), after)
    return after


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
