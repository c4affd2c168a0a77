r"""Sensitivity of a polytopic detection observer to faults of low frequency, checked exactly on its constants.

The error of the observer, from rest and without inputs and disturbance, in continuous time or by steps of a period T
(d e the derivative, or (e+ - e)/T), exactly, the channel of the fault included (``polytope_error``):

    d e = N_j e + B_j f,      r = C e + D f.

With symmetric P, Q > 0, a common Y and w the end of the band let, for every vertex j, over (d, e, f),

    |M r|^2 - b |f|^2 + d'Q d - w^2 e'Q e - 2 e'P d - T d'P d + 2 (Y (d, e, f))' (d - N_j e - B_j f) > 0.

The last term is zero along a trajectory, whatever the weights do, and linear in them, so that the vertices decide. The
terms of P are a difference: their sum is zero from rest to rest. So the energy of M r is at least b times that of f
wherever sum |Q^(1/2) d e|^2 <= w^2 sum |Q^(1/2) e|^2: where the error moves no faster than the band. With weights that
stand still it does wherever the fault has no frequency above w: |exp(j a) - 1| <= a.

This is the lemma of Kalman, Yakubovich and Popov for a low band, in the direction that a proof needs, with Y for
weights that move. Faults that move the state are not looked at here: the plant would be part of d e.

Source: T. Iwasaki, S. Hara, Generalized KYP lemma, IEEE Trans. Autom. Control 50, 2005; rederived.
"""

from __future__ import annotations

import numpy as np

from ..errors import CertificateError
from .exact import Q, eye, leading_failure, product, rational, zeros
from .polytope_detection import fault_model

Array = np.ndarray


def errors_of(problem, faults, gains, T1: Array, period: float | None) -> tuple[dict, Array, Array]:
    """N_j and B_j of every vertex of the observer, C and D, exactly.

    Parameters
    ----------
    problem : DescriptorProblem
    faults : Faults
    gains : StandardGains
    T1 : ndarray (n, n) or (h, n, n)
    period : float or None

    Raises
    ------
    CertificateError
        A fault moves the state.
    """
    if np.any(faults.Bf):
        raise CertificateError("certificate: a fault moves the state (found), expected faults of sensors: others have "
                               "no bound over a band here.")
    model, n = fault_model(problem, faults, gains, T1, "band", period), len(problem.E)
    return {j: (A[:n, :n], B[:n]) for (_, j), (A, B) in model.pairs.items()}, model.C[:, :n], model.D


def check(problem, faults, gains, M: Array, proof: dict) -> list[str]:
    """Check a sensitivity over a band; return what is proved.

    Parameters
    ----------
    problem : DescriptorProblem
    faults : Faults
        In units of their ranges.
    gains : StandardGains
    M : ndarray (k, p)
    proof : dict
        "T1", "period", "band" (rad per unit of time), "beta", "level2", "P", "Q", "Y" (2 n + n_f, n).

    Returns
    -------
    claims : list of str

    Raises
    ------
    CertificateError
        Naming what fails.
    """
    for j, S in inequalities(problem, faults, gains, M, proof):
        bad = leading_failure(S)
        if bad is not None:
            raise CertificateError(f'certificate: the sensitivity {proof["beta"]:.6g} up to {proof["band"]:.6g} '
                                   f'rad/s fails with the observer at "{problem.names[j]}" (leading minor {bad + 1}). '
                                   "Ask for a narrower band.")
    steps = "" if proof["period"] is None else f", by steps of {proof['period']:.6g} s"
    return [f"H- up to {proof['band']:.6g} rad/s{steps}: from rest without inputs and disturbances the energy of M "
            f"r is at least {proof['beta']:.6g}^2 times that of the faults, in units of their ranges, where these have "
            "no frequency above and the weights stand still; where weights move, as long as the error moves no faster"]


def inequalities(problem, faults, gains, M: Array, proof: dict) -> list[tuple[int, Array]]:
    """What must be positive definite at every vertex of the observer, exactly; arguments as `check`.

    Raises
    ------
    CertificateError
        P, Q or Y is none, or the claim is more than the level.
    """
    own, C, D = errors_of(problem, faults, gains, np.array(proof["T1"]), proof["period"])
    n, n_f, out_of = len(C.T), D.shape[1], []
    P, q, Y = (rational(np.array(proof[key], dtype=float)) for key in ("P", "Q", "Y"))
    if P.shape != (n, n) or np.any(P != P.T) or Y.shape != (2 * n + n_f, n):
        raise CertificateError(f"certificate: P is {P.shape}, Y is {Y.shape} (found), expected symmetric {(n, n)} and "
                               f"{(2 * n + n_f, n)}.")
    if q.shape != (n, n) or np.any(q != q.T) or leading_failure(q) is not None:
        raise CertificateError("certificate: Q is no symmetric, positive definite matrix.")
    band, level, T = Q(proof["band"]), Q(proof["level2"]), Q(proof["period"] or 0.0)
    if band <= 0 or Q(proof["beta"]) < 0 or Q(proof["beta"]) ** 2 > level:
        raise CertificateError(f"certificate: beta {proof['beta']:.6g} up to {proof['band']:.6g} rad/s (found), "
                               "expected no more than the level that is proved, and a band.")
    out = product(rational(M), np.concatenate([zeros(len(C), n), C, D], axis=1))
    base = product(out.T, out)
    base[:n, :n] += q - T * P
    base[:n, n:2 * n] -= P
    base[n:2 * n, :n] -= P
    base[n:2 * n, n:2 * n] -= band * band * q
    for k in range(2 * n, 2 * n + n_f):
        base[k, k] -= level
    for j, (N, B) in own.items():
        flow = np.concatenate([eye(n), -N, -B], axis=1)
        mixed = product(Y, flow)
        out_of.append((j, base + mixed + mixed.T))
    return out_of
