"""The criterion that a design claims, checked exactly on the emitted constants.

Each function takes the exact error model and the proof data, and returns the proved level or raises
``CertificateError`` saying which condition fails, in which mode, by how much, and what to try.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .dwell import factor
from .exact import Q, eye, leading_failure, rational, zeros

Array = np.ndarray


def lyapunov_block(M, L, N, P, lam, mu) -> Array:
    """The matrix of (5.11)/(5.39) of Zammali (2020), one framer, sign reversed: positive definite when it holds.

    ``[[(1-lam) P, 0, (P M)'], [0, mu I, (P H)'], [P M, P H, P]]`` with H = [I, L, N] acting on
    [offset slack; Dv v; Dv v+] (classical: N left out). Rational object arrays throughout.
    """
    n = len(P)
    H = np.concatenate([eye(n), L] + ([N] if any(x != 0 for x in N.ravel()) else []), axis=1)
    PM, PH = P[:, None] * M, P[:, None] * H
    k = H.shape[1]
    S = zeros(2 * n + k, 2 * n + k)
    for i in range(n):
        S[i, i], S[n + k + i, n + k + i] = (1 - lam) * P[i], P[i]
    for i in range(k):
        S[n + i, n + i] = mu
    S[:n, n + k:], S[n + k:, :n] = PM.T, PM
    S[n:n + k, n + k:], S[n + k:, n:n + k] = PH.T, PH
    return S


def check_linf(model, t, proof: dict, names: list[str]) -> dict:
    """Theorems 14, 16 (one P) and 17, 18 (P per mode, average dwell time) on the emitted constants.

    Returns
    -------
    dict
        "error_bound2": proved bound on the squared norm of each framer's error, ultimately.
    """
    lam, mu, rho = Q(proof["lam"]), Q(proof["mu"]), Q(proof["rho"])
    if model.t.signed:
        raise CertificateError("certificate: the Lyapunov inequality follows each framer's error by itself, but "
                               'entries of T A - L C take the opposite bound. Use criterion = "width".')
    if not 0 < lam < 1:
        raise CertificateError(f"certificate: lambda is {proof['lam']} (found), expected 0 < lambda < 1.")
    # Equal halves are one problem: what is proved for one holds for the other.
    equal = t.shared and np.array_equal(proof["P_hi"], proof["P_lo"])
    for side in ("hi",) if equal else ("hi", "lo"):
        P = rational(np.array(proof["P_" + side]))
        if any(x < 1 for x in P.ravel()):
            raise CertificateError(f"certificate: P_{side} has an entry below 1; the bound is normalised to P >= I.")
        for k, q in enumerate(model.mode):
            name = names[q]
            S = lyapunov_block(model.M[side][k], model.L[side][k], rational(getattr(t, "N_" + side)[q]), P[q], lam, mu)
            bad = leading_failure(S)
            if bad is not None:
                raise CertificateError(
                    f'certificate: the Lyapunov inequality fails in mode "{name}" ({side} framer, leading minor '
                    f"{bad + 1} of {len(S)}) on the rounded constants. Try a smaller lambda or float64.")
        for q, name in enumerate(names):
            for r, other in enumerate(names):
                i = int(np.argmax([float(a / b) for a, b in zip(P[q], P[r])]))
                if any(P[q][i] > rho * P[r][i] for i in range(P.shape[1])):
                    raise CertificateError(
                        f'certificate: jump from "{other}" to "{name}": P grows by {float(P[q][i] / P[r][i]):.6g} '
                        f"at state {i}, claimed at most {proof['rho']:.6g}.")
    f = factor(rho, lam, proof["dwell_add"], proof["dwell_drain"], proof["chatter"])
    if f is None:
        raise CertificateError(
            f"certificate: average dwell time {proof['dwell_add']}/{proof['dwell_drain']} samples is too short for "
            f"jump factor {proof['rho']:.6g} and decay {proof['lam']:.6g}. Try a longer dwell time.")
    return {"error_bound2": f * mu * model.theta2}


def check_width(model, proof: dict, names: list[str]) -> dict:
    """Linear copositive function: p' M_q <= (1 - a) p' for all modes, so p' W shrinks to its push / a.

    Returns
    -------
    dict
        "width_bound": proved ultimate bound on p' (x_hi - x_lo).
    """
    p, a = rational(np.array(proof["p"])), Q(proof["a"])
    if not (0 < a < 1 and all(x > 0 for x in p)):
        raise CertificateError("certificate: the copositive function needs p > 0 and 0 < a < 1.")
    level = fmpq(0)
    for k, q in enumerate(model.mode):
        name = names[q]
        # With equal gains the width has a recursion of its own; else it is the sum of both errors.
        push = fmpq(0)
        for side in ("width",) if "width" in model.push else ("hi", "lo"):
            decay = p @ model.M[side][k]
            for j, x in enumerate(decay):
                if x > (1 - a) * p[j]:
                    raise CertificateError(
                        f'certificate: p\' M <= (1 - a) p\' fails in mode "{name}", state {j}, by '
                        f"{float(x - (1 - a) * p[j]):.3g} ({side}). Try a smaller a.")
            push += p @ model.push[side][k]
        level = max(level, push / a)
    return {"width_bound": level}


def check_box(model, proof: dict, names: list[str]) -> dict:
    """Box [0, z]: M_q z + push_q <= z for all modes, so errors (and width) that have entered it never leave.

    ``proof`` has one z per side: "hi", "lo", and with equal gains "width".
    """
    if model.t.signed and not np.array_equal(proof["hi"], proof["lo"]):
        raise CertificateError("certificate: the error boxes of both framers differ, expected equal ones where entries "
                               "of T A - L C take the opposite bound.")
    for side in model.push:
        z = rational(np.array(proof[side]))
        bad = model.box_violation(z, side)
        if bad is not None:
            q, i, excess = bad
            raise CertificateError(
                f'certificate: the error box is left in mode "{names[q]}" at state {i} by {float(excess):.3g} '
                f"({side}). Try a larger box.")
    return {}


def smallest_mu(M, L, N, P, lam) -> float:
    """Float estimate of the least mu for which ``lyapunov_block`` is positive definite; inf if none is."""
    M, P = np.asarray(M, float), np.diag(np.asarray(P, float))
    H = np.hstack([np.eye(len(P)), L] + ([N] if np.any(N) else []))
    R = (1 - lam) * P - M.T @ P @ M
    if np.min(np.linalg.eigvalsh(R)) <= 0:
        return np.inf
    X = M.T @ P @ H
    return float(np.max(np.linalg.eigvalsh(H.T @ P @ H + X.T @ np.linalg.solve(R, X))))


