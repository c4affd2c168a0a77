r"""Exact error of a polytopic descriptor observer, from the constants that the firmware holds.

Standard form, in continuous time; in discrete time the next sample in place of the derivative:

    x_hat = z + T2 y,   r = y - C x_hat,   z' = sum_j h_j(x_hat) (F_j x_hat + G_j u - K_j r),

where F_j, G_j are T1 A_j, T1 B_j but for rounding, and C of the observer is rounded too. T1 E + T2 C = I fails by
rounding as well: let T2* be the nearest matrix with (I - T2* C) k = 0 for every k of the kernel of E, T1 with
T1 E = I - T2* C, and s = T2* - T2. With eb = T1 E x - z then, for the plant at vertex i and the observer at j,

    x_hat = (I - s C) x - eb + T2 Dd d,      r = (C - C_j (I - s C)) x + C_j eb + (I - C_j T2) Dd d,
    eb' = T1 (A_i x + B_i u + Bd_i d) - F_j x_hat - G_j u + K_j r:

linear in x, eb, u, d; what rounding leaves of T1 E + T2 C = I couples x to the error by about 1e-7, exactly.

Descriptor form: E x_hat' = sum_j h_j (A_j x_hat + B_j u + L_j (y - C x_hat)) with held A_j, B_j, C, L_j, e = x_hat - x.

The plant's numbers are its float64 ones. ``period``: the plant by one Euler step, E x+ = (E + period A_i) x + ..
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from flint import fmpq

from ..algebra.admissibility import left_kernel
from ..errors import CertificateError
from .exact import Q, eye, inverse, product, rational, zeros

Array = np.ndarray
Pair = tuple[int, int]


@dataclass(frozen=True)
class ErrorModel:
    """diag(Ee, E) [e; x]' = A [e; x] + B [u; d] per pair (next sample in discrete time), z = C [e; x] + D [u; d].

    Parameters
    ----------
    Ee, E : object array (n, n)
    S : object array (n, n - r)
        E' S = 0: S' (A_i x + B_i u + Bd_i d) = 0 always.
    pairs : dict
        (i, j) -> A (2n, 2n), B (2n, m + q).
    C : object array (k, 2n), D : object array (k, m + q)
    residual : object array (p, 2n + m + q) or None
        r of the standard form.
    T1 : tuple of object array (n, n)
        Of the standard form: one for all vertices of the observer, or one for each.
    ties : dict
        (i, j) -> object array (a, 2n + m + q): rows that are zero on (e, x, u, d), of an e whose Ee is singular.
    """

    Ee: Array
    E: Array
    S: Array
    pairs: dict[Pair, tuple[Array, Array]]
    C: Array
    D: Array
    residual: Array | None = None
    T1: tuple[Array, ...] = ()
    ties: dict[Pair, Array] = field(default_factory=dict)


def _plant(problem, period) -> dict[str, Array]:
    """The plant's matrices, exactly, for u and d in their units; by an Euler step where a period is given."""
    out = {key: rational(getattr(problem, key)) for key in ("E", "A", "B", "Bd", "C", "Dd", "H", "J")}
    u, d = rational(problem.u_unit), rational(problem.d_unit)
    out |= {"B": out["B"] * u, "Bd": out["Bd"] * d, "Dd": out["Dd"] * d, "J": out["J"] * d}
    if period is not None:
        t = Q(period)
        out |= {"A": t * out["A"] + out["E"], "B": t * out["B"], "Bd": t * out["Bd"]}
    return out


def standard_errors(problem, gains, T1: Array, period: float | None = None) -> ErrorModel:
    """Error of an observer in standard form.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant.
    gains : StandardGains
        T2, F, G, K, C as held.
    T1 : ndarray (n, n) or (h, n, n)
        Near the T1 that is meant, one for all vertices of the observer or one for each: its part on the algebraic rows
        is free.
    period : float, optional
        Continuous plant, discrete observer: the plant by Euler steps.

    Returns
    -------
    ErrorModel

    Raises
    ------
    CertificateError
        No T1 exists for T2, or T1 differs between vertices that are tied.
    """
    p = _plant(problem, period)
    held = {key: rational(getattr(gains, key)) for key in ("T2", "F", "G", "K", "C")}
    held["G"] = held["G"] * rational(problem.u_unit)
    n, m = len(p["E"]), p["B"].shape[2]
    S = _columns(left_kernel(problem.E), n)
    if np.ndim(T1) == 3 and len(problem.pairs) < len(T1) ** 2:
        # S' (A_i x + ..) = 0 holds for the weights of the plant as a whole, not for those of one known bit.
        raise CertificateError(f"certificate: T1 for every vertex with {len(problem.pairs)} pairs of vertices (found), "
                               f"expected all {len(T1) ** 2}.")
    own = [factors(p["E"], p["C"], S, rational(M), held["T2"]) for M in np.reshape(T1, (-1, n, n))]
    fixed = own[0][1]
    # x_hat and r over (eb, x, u, d).
    seen = eye(n) - product(fixed - held["T2"], p["C"])
    none = zeros(n, m)
    estimate = np.concatenate([-eye(n), seen, none, product(held["T2"], p["Dd"])], axis=1)
    output = np.concatenate([zeros(len(p["C"]), n), p["C"], zeros(len(p["C"]), m), p["Dd"]], axis=1)
    residual = output - product(held["C"], estimate)
    pairs = {}
    for i, j in problem.pairs:
        flow = np.concatenate([zeros(n, n), p["A"][i], p["B"][i], p["Bd"][i]], axis=1)
        step = product(held["F"][j], estimate) - product(held["K"][j], residual)
        step[:, 2 * n:2 * n + m] += held["G"][j]
        both = np.concatenate([product(own[j % len(own)][0], flow) - step, flow], axis=0)
        pairs[i, j] = both[:, :2 * n], both[:, 2 * n:]
    state = np.concatenate([zeros(n, n), eye(n), zeros(n, m), zeros(n, p["Bd"].shape[2])], axis=1)
    z = product(p["H"], state - estimate)
    z[:, 2 * n + m:] += p["J"]
    return ErrorModel(eye(n), p["E"], S, pairs, z[:, :2 * n], z[:, 2 * n:], residual, tuple(T for T, _ in own))


def of_faults(problem, faults: int) -> Array:
    """What the faults among the states do to y: C with their columns alone, rational.

    Parameters
    ----------
    problem : DescriptorProblem
        Its last states are the faults.
    faults : int
    """
    C, plain = rational(problem.C), problem.C.shape[1] - faults
    C[:, :plain] = fmpq(0)
    return C


def direct_errors(problem, gains) -> ErrorModel:
    """Error of an observer in descriptor form.

    Parameters
    ----------
    problem : DescriptorProblem
    gains : DirectGains
        A, B, C, L as held.

    Returns
    -------
    ErrorModel
    """
    p = _plant(problem, None)
    held = {key: rational(getattr(gains, key)) for key in ("A", "B", "C", "L")}
    held["B"] = held["B"] * rational(problem.u_unit)
    n, pairs = len(p["E"]), {}
    for i, j in problem.pairs:
        L = held["L"][j]
        own = held["A"][j] - product(L, held["C"])
        e_row = np.concatenate([own, own + product(L, p["C"]) - p["A"][i]], axis=1)
        x_row = np.concatenate([zeros(n, n), p["A"][i]], axis=1)
        e_in = np.concatenate([held["B"][j] - p["B"][i], product(L, p["Dd"]) - p["Bd"][i]], axis=1)
        x_in = np.concatenate([p["B"][i], p["Bd"][i]], axis=1)
        pairs[i, j] = np.concatenate([e_row, x_row]), np.concatenate([e_in, x_in])
    C = np.concatenate([-p["H"], zeros(*p["H"].shape)], axis=1)
    D = np.concatenate([zeros(len(C), p["B"].shape[2]), p["J"]], axis=1)
    return ErrorModel(p["E"], p["E"], _columns(left_kernel(problem.E), n), pairs, C, D)


def factors(E: Array, C: Array, S: Array, T1: Array, T2: Array) -> tuple[Array, Array]:
    """Exact T1 and T2 with T1 E + T2 C = I next to given ones.

    Parameters
    ----------
    E : object array (n, n), C : object array (p, n)
    S : object array (n, n - r)
        E' S = 0.
    T1 : object array (n, n), T2 : object array (n, p)

    Raises
    ------
    CertificateError
        rank [E; C] < n.
    """
    n = len(E)
    kernel = _columns(left_kernel(np.array([[float(x) for x in row] for row in E.T])), n)
    if kernel.shape[1]:
        seen = product(C, kernel)
        try:
            back = product(inverse(product(seen.T, seen)), seen.T)
        except CertificateError:
            raise CertificateError("certificate: rank [E; C] is less than the number of states (found), expected T1, "
                                   "T2 with T1 E + T2 C = I.") from None
        T2 = T2 + product(kernel - product(T2, seen), back)
    base = product(eye(n) - product(T2, C), pseudo_inverse(E))
    if S.shape[1]:
        onto = product(product(S, inverse(product(S.T, S))), S.T)
        base = base + product(T1 - base, onto)
    return base, T2


def pseudo_inverse(E: Array) -> Array:
    """A matrix G with E G E = E, exactly: of least norm.

    Parameters
    ----------
    E : object array (n, n)
    """
    columns = _independent(E)
    if not columns:
        return zeros(*E.T.shape)
    F = E[:, columns]
    left = product(inverse(product(F.T, F)), F.T)
    G = product(left, E)
    return product(product(G.T, inverse(product(G, G.T))), left)


def _independent(E: Array) -> list[int]:
    """Columns of E that span the others, by elimination."""
    rows, found, top = E.copy(), [], 0
    for c in range(E.shape[1]):
        pivot = next((r for r in range(top, len(rows)) if rows[r, c] != 0), None)
        if pivot is None:
            continue
        rows[[top, pivot]] = rows[[pivot, top]]
        for r in range(top + 1, len(rows)):
            rows[r] = rows[r] - rows[top] * (rows[r, c] / rows[top, c])
        found.append(c)
        top += 1
    return found


def _columns(rows, n: int) -> Array:
    """A matrix of fractions as object array (n, k)."""
    out = zeros(n, len(rows[0]) if rows else 0)
    for i, row in enumerate(rows):
        for k, value in enumerate(row):
            out[i, k] = fmpq(value.numerator, value.denominator)
    return out
