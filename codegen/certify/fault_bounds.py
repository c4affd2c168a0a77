r"""What moves the error of an observer of states and faults at most, on the numbers of the C.

As ``polytope_bounds``, for a plant whose weights and known terms are functions of what is measured exactly: plant and
observer have the same but for rounding, so that only pairs (i, i) occur. What that rounding is worth comes from
``program_error``.

A continuous plant moves between samples, its weights and known terms with it. All of that is in the change of the
right side f of E x' = f: row i of E x is off an Euler step by at most period^2/2 max |d f_i/dt| (``bend``, of the
plant's equations); the algebraic rows hold at every sample.

The faults are part of x. Nothing of them drives the error but what rounding leaves of T1 E + T2 C = I, so the bounds
hold for every course of the faults within their ranges. The residual y - C x_hat is with the C of the plant alone: it
is Df f but for the error, and so its thresholds are bounds of the error of what it says of f, fault or not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from flint import fmpq

from .exact import Q, eye, product, rational, zeros
from .filter_model import JointMode
from .polytope_error import of_faults, standard_errors
from .polytope_ranges import Ranges, columns
from .polytope_rounding import rounding
from .program_error import program_errors
from .rounding import input_error

Array = np.ndarray


@dataclass(frozen=True)
class Slips:
    """Errors of the weights (h,) and known terms (g,), largest magnitudes of the latter; rational object arrays."""

    h: Array
    g: Array
    size: Array


def slips(t, premises=()) -> Slips:
    """Bound the rounding of weights and known terms over the ranges of inputs, outputs and parameters.

    Parameters
    ----------
    t : PolytopicTables
        Its weights read only estimates that are outputs.
    premises : sequence of Premise
        The reciprocals of their widths, constants of the weights alone, are made of rounded ends.
    """
    units = 4 + max(((abs(Q(p.lo)) + abs(Q(p.hi))) / (Q(p.hi) - Q(p.lo)) for p in premises), default=fmpq(0))
    inputs = []
    for i in t.outputs:
        inputs.append(_read(t.y_lo[i], t.y_hi[i], t.real) if i >= 0 else None)
    inputs += [_read(lo, hi, t.real) for side in ("u", "theta")
               for lo, hi in zip(getattr(t, f"{side}_lo"), getattr(t, f"{side}_hi"))]
    found = [*program_errors(t.weights, inputs, t.real, units)[:len(t.F)],
             *program_errors(t.weights, inputs, t.real)[len(t.F):]]
    errors = np.array([e for _, _, e in found], dtype=object)
    size = np.array([max(abs(lo), abs(hi)) + e for lo, hi, e in found], dtype=object)
    return Slips(errors[:len(t.F)], errors[len(t.F):], size[len(t.F):])


def _read(lo, hi, real: str) -> tuple[fmpq, fmpq, fmpq]:
    """A measured signal: its range, and how far the number that stands for it may be off."""
    lo, hi = Q(lo), Q(hi)
    return lo, hi, input_error(max(abs(lo), abs(hi)), real)


def model(plant, problem, t, T1: Array, period: float | None, bend: Array) -> tuple[tuple[JointMode, ...], Array]:
    """The recursion of eb, one entry per vertex, and T1 E.

    Parameters
    ----------
    plant : Plant
        Its x holds states and faults.
    problem : DescriptorProblem
        Of states and faults; inputs u and known terms, unknown ones w, v and f.
    t : PolytopicTables
    T1 : ndarray (n, n)
        Its columns of algebraic rows are free, those of f = f are zero.
    period : float or None
        Of a continuous plant.
    bend : ndarray (n_x,)
        Largest |d f_i/dt|; not read where period is None.

    Returns
    -------
    model : tuple of JointMode
        What it estimates is y - C x_hat without what the faults are in it. Columns of W, in their order: the middle of
        all ranges, half widths of x, f, u, g, w, v and f, then what y, u, g, x_hat, r and z are off, weights, Euler.
    T1E : object array (n, n)
    """
    n, p = len(problem.E), len(problem.C)
    held = SimpleNamespace(T2=t.T2, F=t.F, K=t.K, C=t.C,
                           G=np.concatenate([t.G, np.tile(t.known, (len(t.F), 1, 1))], axis=2))
    tied = replace(problem, pairs=tuple((i, i) for i in range(len(problem.A))))
    errors, off = standard_errors(tied, held, T1, period), slips(t, plant.polytope.premises)
    slip = rounding(t, off.size)
    F, K, C, T2, G, known = (rational(getattr(t, key)) for key in ("F", "K", "C", "T2", "G", "known"))
    box = Ranges.of(plant, problem)
    x, inputs, d = box.x, box.u, box.d
    width = problem.B.shape[2]
    passed = eye(p) - product(C, T2)
    seen = errors.residual.copy()
    seen[:, n:2 * n] -= of_faults(problem, t.faults)
    noise = [passed * slip.y, C * slip.x_hat, np.diag(slip.r) if p else zeros(0, 0)]
    room = abs(columns([(seen[:, n:2 * n], x), (seen[:, 2 * n:2 * n + width], inputs), (seen[:, 2 * n + width:], d)],
                       noise)).sum(axis=1)
    left = zeros(n)  # weights that are off, each with what its vertex says at most
    for j, most in enumerate(spoken(t)):
        left += off.h[j] * most
    out = []
    for j in range(len(F)):
        A, B = errors.pairs[j, j]
        own = [(product(F[j], T2) - product(K[j], passed)) * slip.y, G[j] * slip.u, known * off.g,
               (F[j] + product(K[j], C)) * slip.x_hat, K[j] * slip.r, eye(n) * slip.z, eye(n) * left]
        if period is not None:
            moved = Q(period) * Q(period) / 2 * rational(bend)
            own.append(errors.T1[0][:, :len(bend)] * moved)
        W = columns([(A[:n, n:], x), (B[:n, :width], inputs), (B[:n, width:], d)], own)
        out.append(JointMode(A[:n, :n], W, (), seen[:, :n], zeros(p, n), room))
    return tuple(out), product(errors.T1[0], rational(problem.E))


def spoken(t) -> list[Array]:
    """Largest magnitude of what each vertex adds to z+ (n,) over the ranges of the inputs and of z.

    Parameters
    ----------
    t : PolytopicTables
    """
    z, y, u = (np.array([max(abs(Q(a)), abs(Q(b))) for a, b in zip(getattr(t, f"{v}_lo"), getattr(t, f"{v}_hi"))],
                        dtype=object).reshape(-1) for v in ("z", "y", "u"))
    x_hat = z + product(abs(rational(t.T2)), y.reshape(-1, 1))[:, 0]
    r = y + product(abs(rational(t.C)), x_hat.reshape(-1, 1))[:, 0]
    values = np.concatenate([x_hat, u, r]).reshape(-1, 1)
    own = np.where(t.shared[:, :len(values)], 0, t.gains[:, :, :len(values)])
    return [product(abs(rational(M)), values)[:, 0] for M in own]

