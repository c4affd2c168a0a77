r"""Exact certificate of a point observer's gains: H-infinity or L-infinity level, and stability under the switching.

For rounded gains L, N (any float32 or float64 numbers), M_q = T A_q - L C, T = I - N C, noise in units of its bounds,
``H_q = [T Bw, -L Dv, -N Dv+]``, ``Z_q = [0, Dv, 0]`` and d = [w; v; v+], one matrix says all:

    [ (1-lam) P_q - C'C      -C' Z        M_q' P_l ]
    [ *                   g I - Z'Z       H_q' P_l ]  > 0        (H-infinity; L-infinity without C and Z, g = mu)
    [ *                       *             P_l    ]

* lam = 0: all pairs of q and the mode l that follows: ``|r|_2 < sqrt(g) |d|_2`` from e = 0, any switching.
* lam > 0: l = q, and P_q <= rho P_l for a jump. With s the factor of ``certify.dwell`` an L-infinity level is
  ``|e|^2 <= s mu |d|^2`` ultimately, as P >= I. For H-infinity, V >= 0 and V_0 = 0 give for every K
  ``sum_k c_k |r_k|^2 <= g sum_k c_k |d_k|^2`` with c_k = rho^(switches in (k, K]) (1-lam)^(K-1-k); summed over K, c_k
  adds up to at least 1/lam and at most s, hence ``|r|_2^2 <= s lam g |d|_2^2``.
* Where the proof states units, e and r are measured in them: P >= diag(x_unit)^-2, C and Z are divided by y_unit.

Source: Zammali (2020), (6.19), (6.43), bounds corrected.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flint import fmpq

from ..algebra.cycles import growing_cycle
from ..errors import CertificateError
from .claims import floats, switching_words
from .dwell import factor
from .exact import Q, eye, leading_failure, product, rational, up, zeros

Array = np.ndarray
#: Shares added to the level that float arithmetic finds, until the exact check holds.
EXTRAS = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2)


class GainModel:
    """Exact error dynamics of all modes.

    Parameters
    ----------
    modes : sequence
        The plant's modes (``name A C Bw Dv w_lo w_hi v_lo v_hi``).
    L, N : ndarray (N, n_x, n_y)
        Gains as the firmware holds them.

    Raises
    ------
    CertificateError
        C differs between modes where N is not zero.
    """

    def __init__(self, modes, L: Array, N: Array):
        self.names = [m.name for m in modes]
        v_half = [max(h) for h in zip(*(_half(m.v_lo, m.v_hi) for m in modes))]
        noise = [rational(m.Dv) * np.array(v_half, dtype=object)[None, :] if v_half else rational(m.Dv) for m in modes]
        self.tnl = bool(np.any(N))
        for m in modes if self.tnl else ():
            if not np.array_equal(m.C, modes[0].C):
                raise CertificateError(f'certificate: C of mode "{m.name}" differs from that of "{modes[0].name}" '
                                       "(found), expected one C where N is not zero: N reads the next sample.")
        self.M, self.C, self.pushes = [], [], []
        for q, m in enumerate(modes):
            A, C, l, n = rational(m.A), rational(m.C), rational(L[q]), rational(N[q])
            T = eye(len(A)) - product(n, C)
            half = np.array(_half(m.w_lo, m.w_hi), dtype=object)
            Bw = rational(m.Bw) * half[None, :] if len(half) else rational(m.Bw)
            self.M.append(product(T, A) - product(l, C))
            self.C.append(C)
            here = [product(T, Bw), -product(l, noise[q])]
            direct = np.concatenate([zeros(len(C), Bw.shape[1]), noise[q]], axis=1)
            later = [D for i, D in enumerate(noise) if not any(np.array_equal(D, E) for E in noise[:i])]
            # N acts on the noise of the next sample, whose matrix is that of the next mode.
            self.pushes.append([(np.concatenate([*here, -product(n, D)], axis=1),
                                 np.concatenate([direct, zeros(*D.shape)], axis=1)) for D in later]
                               if self.tnl else [(np.concatenate(here, axis=1), direct)])

    @property
    def channels(self) -> int:
        """Entries of d: each is at most 1 in magnitude."""
        return self.pushes[0][0][0].shape[1]

    def outputs(self, q: int, Z: Array, cert: dict) -> tuple[Array, Array]:
        """C and Z of a mode in the units of the proof."""
        unit = np.array(_units(cert, "y_unit", len(Z)), dtype=object)[:, None]
        return self.C[q] / unit, Z / unit


def block(M: Array, H: Array, C: Array | None, Z: Array | None, P: Array, after: Array, lam: fmpq, g: fmpq) -> Array:
    """The matrix of the module's head as rational object array; without C and Z the L-infinity one.

    Parameters
    ----------
    M : ndarray (n, n), H : ndarray (n, k), C : ndarray (m, n) or None, Z : ndarray (m, k) or None
    P, after : ndarray (n, n)
        P of this mode and of the next.
    lam, g : fmpq
    """
    n, k = len(M), H.shape[1]
    S = zeros(2 * n + k, 2 * n + k)
    S[:n, :n], S[n + k:, n + k:] = (1 - lam) * P, after
    for i in range(k):
        S[n + i, n + i] = g
    if C is not None:
        S[:n, :n] = S[:n, :n] - product(C.T, C)
        S[:n, n:n + k] = -product(C.T, Z)
        S[n:n + k, n:n + k] = S[n:n + k, n:n + k] - product(Z.T, Z)
        S[n:n + k, :n] = S[:n, n:n + k].T
    S[n + k:, :n], S[n + k:, n:n + k] = product(after, M), product(after, H)
    S[:n, n + k:], S[n:n + k, n + k:] = S[n + k:, :n].T, S[n + k:, n:n + k].T
    return S


def prove(modes, L: Array, N: Array, proof: dict, resolve: Callable[[Array, Array], dict | None] | None = None) -> dict:
    """Complete the proof data of synthesis into a certificate of these gains.

    Parameters
    ----------
    modes : sequence
    L, N : ndarray (N, n_x, n_y)
        Rounded gains.
    proof : dict
        "kind" ("hinf" or "linf"), "P", "lam", "rho", "dwell_add", "dwell_drain", "chatter".
    resolve : callable, optional
        (L, N) -> proof with P found anew for these gains (``synthesis.refit``), asked when the proof at hand fails.

    Returns
    -------
    dict
        With "g" (the level of the matrix) and "level"; ``check`` accepts it.

    Raises
    ------
    CertificateError
        Naming mode, condition and amount.
    """
    model = GainModel(modes, L, N)
    try:
        return _completed(model, proof)
    except CertificateError as error:
        if resolve is None:
            raise
        again = resolve(np.asarray(L, float), np.asarray(N, float))
        if again is None:
            raise CertificateError(f"{error} No other P was found either.") from None
        return _completed(model, again)


def check(modes, L: Array, N: Array, cert: dict) -> list[str]:
    """Re-check a certificate in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming mode, condition and amount.
    """
    model = GainModel(modes, L, N)
    level2 = _level2(model, cert)
    if Q(cert["level"]) ** 2 < level2:
        raise CertificateError(f"certificate: level {cert['level']:.9g} claimed, only {float(level2) ** 0.5:.9g} is "
                               "proved.")
    if cert["kind"] == "hinf":
        units = ", r in units of the half ranges of y" if "y_unit" in cert else ""
        return [f"H-infinity: from an exact start |r| (2-norm over all samples) stays below {cert['level']:.6g} |d|, d "
                f"disturbance and noise in units of their bounds{units}, {switching_words(cert)}",
                f"the error of the estimate decays {switching_words(cert)}"]
    units = ", in units of the half ranges of x" if "x_unit" in cert else ""
    return [f"L-infinity: |x - x_hat| (2-norm{units}) stays ultimately below {cert['level']:.6g} "
            f"(mu = {cert['g']:.6g}, lambda = {cert['lam']:.6g}), {switching_words(cert)}"]


def _completed(model: GainModel, proof: dict) -> dict:
    """Sharpest level that float arithmetic finds and the exact check confirms."""
    cert = {k: v for k, v in proof.items() if k not in ("g", "level")}
    P = [np.array(p, dtype=float) for p in cert["P"]]
    x, g = np.array([float(u) for u in _units(cert, "x_unit", len(P[0]))]), 0.0
    for q, r in _pairs(P, Q(cert["lam"])):
        for H, Z in model.pushes[q]:
            M, H, C, Z = (floats(a) for a in (model.M[q], H, *model.outputs(q, Z, cert)))
            # In the units of the proof, which keep the entries within floating point's reach of each other.
            g = max(g, least_level(M / x[:, None] * x, H / x[:, None], C * x, Z, P[q] * x * x[:, None],
                                   P[r] * x * x[:, None], cert["lam"], cert["kind"] == "hinf"))
    failure = None
    for extra in EXTRAS if np.isfinite(g) else (0.0,):
        cert["g"] = float(g * (1 + extra)) if np.isfinite(g) else 1e300
        try:
            level2 = _level2(model, cert)
        except CertificateError as error:
            failure = error
            continue
        cert["level"] = _root_up(level2)
        return cert
    raise failure


def least_level(M: Array, H: Array, C: Array, Z: Array, P: Array, after: Array, lam: float, hinf: bool) -> float:
    """Float estimate of the least g for which ``block`` is positive definite; inf if none is."""
    R, S, X = (1 - lam) * P - M.T @ after @ M, H.T @ after @ H, M.T @ after @ H
    if hinf:
        R, S, X = R - C.T @ C, S + Z.T @ Z, X + C.T @ Z
    if np.min(np.linalg.eigvalsh(R)) <= 0:
        return np.inf
    if H.shape[1] == 0:
        return 0.0
    return max(float(np.max(np.linalg.eigvalsh(S + X.T @ np.linalg.solve(R, X)))), 0.0)


def _pairs(P: list, lam: fmpq) -> list[tuple[int, int]]:
    """(mode, mode after) to check: all with different P where V may not jump, else each mode alone."""
    if lam > 0:
        return [(q, q) for q in range(len(P))]
    different = [r for r in range(len(P)) if not any(np.array_equal(P[r], P[i]) for i in range(r))]
    return [(q, r) for q in range(len(P)) for r in different]


def _level2(model: GainModel, cert: dict) -> fmpq:
    """Check every condition; return the square of the level that they prove."""
    kind, lam, rho, g = cert["kind"], Q(cert["lam"]), Q(cert["rho"]), Q(cert["g"])
    if kind not in ("hinf", "linf"):
        raise CertificateError(f"certificate: kind {kind!r} (found), expected hinf or linf.")
    if not (0 <= lam < 1 and (lam > 0 or kind == "hinf")) or rho < 1 or g < 0:
        raise CertificateError(f"certificate: lam = {cert['lam']}, rho = {cert['rho']}, g = {cert['g']} (found), "
                               "expected 0 <= lam < 1 (0 < lam for linf), rho >= 1, g >= 0.")
    P = [rational(np.array(p)) for p in cert["P"]]
    if len(P) != len(model.M) or any(p.shape != M.shape for p, M in zip(P, model.M)):
        raise CertificateError(f"certificate: P has {len(P)} matrices (found), expected {len(model.M)} of the size of "
                               "the state.")
    least, n = zeros(*P[0].shape), len(P[0])
    for i, unit in enumerate(_units(cert, "x_unit", n) if kind == "linf" else ()):
        least[i, i] = 1 / unit**2
    for name, p in zip(model.names, P):
        if any(p[i, j] != p[j, i] for i in range(len(p)) for j in range(i)):
            raise CertificateError(f'certificate: P of mode "{name}" is not symmetric.')
        words = "P" if kind == "hinf" else "P - diag(x_unit)^-2" if "x_unit" in cert else "P - I"
        if leading_failure(p - least) is not None:
            raise CertificateError(f'certificate: {words} of mode "{name}" is not positive definite: smallest '
                                   f"eigenvalue {_smallest(p - least):.3g} (found), expected above 0.")
    for q, r in _pairs(P, lam):
        for H, Z in model.pushes[q]:
            outputs = model.outputs(q, Z, cert) if kind == "hinf" else (None, None)
            S = block(model.M[q], H, *outputs, P[q], P[r], lam, g)
            bad = leading_failure(S)
            if bad is not None:
                raise CertificateError(_failure_words(model, kind, q, r, lam, P, S, bad))
    if lam == 0:
        return g
    for q, name in enumerate(model.names):
        for r, other in enumerate(model.names):
            if not np.array_equal(P[q], P[r]) and leading_failure(rho * P[r] - P[q]) is not None:
                raise CertificateError(
                    f'certificate: jump from "{other}" to "{name}": P grows by more than the claimed {cert["rho"]:.6g} '
                    f"(rho P - P has the eigenvalue {_smallest(rho * P[r] - P[q]):.3g}, expected above 0).")
    s = factor(rho, lam, cert["dwell_add"], cert["dwell_drain"], cert["chatter"])
    if s is None:
        raise CertificateError(
            f"certificate: average dwell time {cert['dwell_add']}/{cert['dwell_drain']} samples is too short for jump "
            f"factor {cert['rho']:.6g} and decay {cert['lam']:.6g}. Try a longer dwell time.")
    return s * g * (lam if kind == "hinf" else model.channels)


def _failure_words(model: GainModel, kind: str, q: int, r: int, lam: fmpq, P: list, S: Array, bad: int) -> str:
    """Name mode, condition and amount."""
    n, M = len(P[q]), model.M[q]
    where = f'in mode "{model.names[q]}"' + (f' before mode "{model.names[r]}"' if r != q else "") + " on these gains"
    shrink = (1 - lam) * P[q] - product(product(M.T, P[r]), M)
    if _smallest(shrink) <= 0:
        what = "decrease" if lam == 0 else f"shrink by {float(lam):.6g}"
        cycle = growing_cycle(np.array([floats(m) for m in model.M]))
        words = "Try float64, or other gains."
        if cycle is not None:
            order = ", ".join(f'"{model.names[i]}"' for i in cycle[0])
            words = (f"Mode {order} again and again" if len(cycle[0]) == 1 else f"Modes {order} in turn") + (
                f" would multiply the error by {cycle[1]:.4g} per round: take other gains"
                + (", or a dwell time." if len(cycle[0]) > 1 else "."))
        return (f"certificate: e'Pe does not {what} {where}: smallest eigenvalue {_smallest(shrink):.3g} (found), "
                f"expected above 0. {words}")
    left = _smallest(S[:n, :n] - product(product(M.T, P[r]), M))
    if left <= 0:
        return (f"certificate: e'Pe does not decrease by |C e|^2 {where}: smallest eigenvalue {left:.3g} (found), "
                "expected above 0. Try a larger P.")
    name = "H-infinity" if kind == "hinf" else "L-infinity"
    return (f"certificate: the {name} inequality fails {where} (leading minor {bad + 1} of {len(S)}, smallest "
            f"eigenvalue {_smallest(S):.3g}, expected above 0). Try float64, or a larger level.")


def _smallest(S: Array) -> float:
    """Smallest eigenvalue, in floats, for messages."""
    return float(np.linalg.eigvalsh(floats(S))[0])


def _units(cert: dict, name: str, n: int) -> list[fmpq]:
    """Units that a proof states; 1 where it states none."""
    units = [Q(x) for x in cert.get(name, [1] * n)]
    if len(units) != n or any(x <= 0 for x in units):
        raise CertificateError(f"certificate: {name} is {cert[name]} (found), expected {n} positive numbers.")
    return units


def _half(lo, hi) -> list[fmpq]:
    return [(Q(b) - Q(a)) / 2 for a, b in zip(lo, hi)]


def _root_up(value: fmpq) -> float:
    """Smallest convenient float whose square is not below the rational."""
    guess = up(Q(float(value) ** 0.5))
    while Q(guess) ** 2 < value:
        guess = float(np.nextafter(guess, np.inf))
    return guess
