r"""What moves the error of an observer that solves the algebraic equations itself: what its thresholds rest on.

With e_m = x_m - z_m of ``descriptor_error``, the observer's weights h at vertex j and its weights g at vertex k,

    x_a - x_hat_a = P_k e_m + m,    |m| <= largest over i of |(P_i - P_k) x_m + (Q_i - Q_k) u + D_i d|,
    e_m+ = N_j (e_m; P_k e_m + m) + (what x, u, d do) + rounding,

N_j of ``descriptor_error.step``; one recursion for each pair (j, k), because g is made of the h by division; vertices k
with the same P and Q are one (`kinds`). The division has its room: the held d_j are above 0, the h_j at least 0 with a
sum near 1, so that its guard, half the least d_j, never acts. What the plant's own weights leave is bounded entry by
entry: those of the algebraic equations are the ones at the sample, those of the rest their means over the period, so
that no vertex is common to both. The noise alone is followed as itself.

Drift between samples and rounding: as in ``polytope_bounds``.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .descriptor_error import Solved, solved, step
from .exact import Q, eye, product, rational, zeros
from .filter_model import JointMode
from .polytope_drift import drift
from .polytope_ranges import Ranges, columns, largest, reach
from .polytope_rounding import Rounding, off_one, rounding, sizes
from .rounding import sum_error

Array = np.ndarray
#: The least pivot: products with weights are far from subnormal there.
LEAST = 2.0**-60


def solved_sums(t) -> list[tuple[list, tuple[fmpq, fmpq]]]:
    """(error, largest magnitude) of what every vertex says of an algebraic state, and of the state; one per state.

    Parameters
    ----------
    t : DescriptorTables
    """
    real, off, out = t.real, off_one(t), []
    operands = [*sizes(t.z_lo, t.z_hi), *sizes(t.u_lo, t.u_hi)]
    for row in range(len(t.algebraic)):
        own = [sum_error([(Q(c), b) for c, b in zip(np.where(t.common[row], 0, M[row]), operands)], real)
               for M in t.solved]
        terms = [(Q(c), b) for c, b in zip(np.where(t.common[row], t.solved[0, row], 0), operands)]
        out.append((own, sum_error([*terms, *((1 + off, m) for _, m in own)], real)))
    return out


def algebraic_rounding(t) -> list[tuple[fmpq, fmpq]]:
    """Rounding and magnitude of every entry of x_hat, that of solved ones with weights that do not add up to 1.

    Parameters
    ----------
    t : DescriptorTables
    """
    off, out = off_one(t), [sum_error([(fmpq(1), b)], t.real) for b in sizes(t.z_lo, t.z_hi)]
    for k, (own, (error, most)) in zip(t.algebraic, solved_sums(t)):
        out[k] = error + (1 + off) * max(e for e, _ in own) + off * max(m for _, m in own), most
    return out


def kinds(t) -> list[int]:
    """The first vertex of each that have one solution of the algebraic equations.

    Parameters
    ----------
    t : DescriptorTables
    """
    return sorted({M.tobytes(): k for k, M in reversed(list(enumerate(t.solved)))}.values())


def mismatch(problem, t, known: Solved, box: Ranges) -> list[Array]:
    """Bounds of |m| for every vertex of the observer, (a,) each.

    Parameters
    ----------
    problem : DescriptorProblem
    t : DescriptorTables
    known : Solved
    box : Ranges
    """
    x = tuple(side[known.moving] for side in box.x)
    unit, out = rational(problem.u_unit), []
    for P, G in zip(t.P, t.Q):
        P, G = rational(P)[:, known.moving], rational(G) * unit
        rows = [reach(p - P, x) + reach(g - G, box.u) + reach(d, box.d)
                for p, g, d in zip(known.P, known.Q, known.D)]
        out.append(largest(rows))
    return out


def model(plant, problem, t, period: float | None) -> tuple[tuple[JointMode, ...], Array]:
    """The recursion of e_m, one entry per pair of the observer's weights, and T1 E.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : DescriptorTables
    period : float or None
        Of a continuous plant.

    Returns
    -------
    model : tuple of JointMode
        What it estimates is M r.
    T1E : object array (r, n)

    Raises
    ------
    CertificateError
        A pivot is not positive, or the algebraic equations have no solution of this kind.
    """
    if not (off_one(t) < fmpq(1, 4) and all(d >= LEAST for d in t.pivot)):
        raise CertificateError(f"certificate: the least pivot of the algebraic equations is {float(min(t.pivot)):.3g} "
                               f"(found), expected at least {LEAST:.3g}: the C divides by a mean of them.")
    known, box = solved(problem), Ranges.of(plant, problem)
    slip: Rounding = rounding(t, x_hat=algebraic_rounding(t))
    (r, n), at, a, h = known.T1.shape, known.moving, known.algebraic, range(len(t.F))
    C, M, K = rational(t.C), rational(t.M), rational(t.K)[:, at]
    wrong = mismatch(problem, t, known, box)
    seen = product(M, C)
    noise = product(M, rational(problem.Dd) * rational(problem.d_unit))
    lost = [product(M, rational(problem.C) - C), np.concatenate([M * slip.y, M * slip.r, eye(len(M)) * slip.weighted],
                                                                axis=1)]
    moved = None if period is None else drift(plant, problem, box, period)
    extents, steps = [], []
    for j in h:
        each = [step(problem, t, known, i, j, period) for i in h]
        fed = product(K[j], rational(problem.Dd) * rational(problem.d_unit))
        left = largest([reach(s.x, box.x) + reach(s.u, box.u) + reach(s.d - fed, box.d) for s in each])
        if moved is not None:
            change = largest([moved.of(product(known.T1, rational(A))) for A in problem.A])
            left = left + Q(period) * change
        extents.append(columns([(fed, box.d)], [eye(r) * left, K[j] * slip.y, rational(t.G[j])[at] * slip.u,
                                               K[j] * slip.r, eye(r) * slip.z[at]]))
        steps.append(each[0].e)
    out = []
    for j in h:
        for k in kinds(t):
            through = zeros(n, r)
            through[at, np.arange(r)] = fmpq(1)
            through[a] = rational(t.P[k])[:, at]
            late = slip.x_hat.copy()
            late[a] = late[a] + wrong[k] + product(abs(rational(t.Q[k])), slip.u.reshape(-1, 1))[:, 0]
            W = np.concatenate([extents[j], steps[j] * late], axis=1)
            room = abs(np.concatenate([columns([(lost[0], box.x), (noise, box.d)]), lost[1], seen * late],
                                      axis=1)).sum(axis=1)
            out.append(JointMode(product(steps[j], through), W, (), product(seen, through), zeros(len(M), r), room))
    return tuple(out), product(known.T1, rational(problem.E))


def room(plant, problem, t, size: Array) -> Array:
    """How far x_hat can be from x where e_m is within bounds, (n,).

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : DescriptorTables
    size : ndarray (r,)
        Bounds of |e_m|.
    """
    known = solved(problem)
    out = np.zeros(len(problem.E))
    out[known.moving] = size
    wrong = mismatch(problem, t, known, Ranges.of(plant, problem))
    found = [np.abs(P.astype(float))[:, known.moving] @ size + [float(v) for v in w] for P, w in zip(t.P, wrong)]
    out[known.algebraic] = np.max(found, axis=0)
    return out
