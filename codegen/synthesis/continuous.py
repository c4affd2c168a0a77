r"""Designs made in continuous time and brought to the sampling period (``[observer] design = "continuous"``).

With F = T A(theta) - L(theta) C the errors of both framers obey ``e' = F e + b`` where b holds the disturbance and the
noise that L lets in; F must be Metzler at every corner of theta (entries off the diagonal >= 0). Two criteria::

    width   diag(p) F + cap diag(p) >= 0,   1' diag(p) F <= -a p',   p' |T Bw| wbar + 1' |W Dv| vbar <= t,    min t
    linf    P F + cap P >= 0,   [P F + F' P + a P, P H; H' P, -mu I] <= 0,   H = [I, L],   P_q <= rho P_l,     min mu

with W = diag(p) L, P diagonal, P >= I. The first bounds ``p' (x_hi - x_lo)`` by 2 t / a, the second each error by
sqrt(mu / a) in units of its drive (with switching: ``certify.dwell``). ``cap`` limits how negative the diagonal may
become, hence the gains; without it gains grow beyond all bounds where noise is small.

A firmware that holds y over a period cannot run these observers as they stand (explicit Euler loses the state). The
exact solution for held y has the gain ``L_d = int_0^h e^{F s} ds L - N``; its values at the corners are fitted by an
affine function of theta, moved no further than the sign of the sampled T A_d - L_d C asks for, and certified like every
other design of the sampled plant.

Source: Zammali (2020), Theorems 6 to 8, and for "width" and the noise in H own. Differences from the print:

* Theorem 7 asks for feasibility only, (3/rho) P for a P: here the decay a is searched and mu minimised. Its gains
  depend on the solver (36, 19 or 13.5 at the same claim).
* (3.28) ``[W_l P_q; P_q P_q] >= 0`` with free W_l is vacuous; P_q <= rho P_l takes its place.
* gamma of Theorem 8 is blind to |L| v: at cap 60 and 1e5 it is 0.3554 both times, the true bounds are 1.73 and 33.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import cvxpy as cp
import numpy as np
from scipy.linalg import expm
from scipy.optimize import linprog

from ..errors import DesignError
from .linf import LinfProblem, candidate, jump_factors
from .problem import Candidate, Problem, slopes
from .width import WidthProblem

Array = np.ndarray
#: Caps on the diagonal of -F, in units of 1/h, and decay rates in units of the fastest that is possible.
CAPS = (0.05, 0.25, 1.0)
SHARES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)


class ContinuousWidth(WidthProblem):
    """The linear program in continuous time; ``solve(a)`` takes the decay in 1/s.

    Parameters
    ----------
    problem : Problem
        Of ``continuous_problem``.
    cap : float
        1/s.
    """

    def __init__(self, problem: Problem, cap: float):
        self.cap = cap
        super().__init__(problem)

    def _decay(self, M) -> list:
        return [M + self.cap * cp.diag(self.p) >= 0, cp.sum(M, axis=0) <= -self.keep * self.p]

    @staticmethod
    def kept(a: float) -> float:
        """The decay itself: -a p is what the derivative of p' e stays below."""
        return a


class ContinuousLinf(LinfProblem):
    """The matrix inequality in continuous time; ``solve(a, rho)`` takes the decay in 1/s.

    Parameters
    ----------
    problem : Problem
        Of ``continuous_problem``.
    multiple : bool
        One P per mode instead of a common one.
    cap : float
        1/s.
    blind : bool
        As printed, without the noise through L.
    """

    def __init__(self, problem: Problem, multiple: bool, cap: float, blind: bool = False):
        self.cap, self.blind = cap, blind
        super().__init__(problem, multiple)

    def _decay(self, P, PM, PH) -> list:
        PH = P if self.blind else PH
        n, k = P.shape[0], PH.shape[1]
        block = cp.bmat([[-(PM + PM.T) - self.shrink * P, -PH], [-PH.T, self.mu * np.eye(k)]])
        return [PM + self.cap * P >= 0, (block + block.T) / 2 >> 1e-7 * np.eye(n + k)]

    @staticmethod
    def kept(lam: float) -> float:
        """The decay itself."""
        return lam


def continuous_problem(plant, tnl: bool) -> Problem:
    """The arrays of the continuous plant, parameters that nobody measures as unknowns.

    Raises
    ------
    DesignError
        The TNL structure with noise: N would let in its derivative.
    """
    problem = Problem.of(replace(plant, kind="discrete"), tnl)
    if tnl and problem.v_half.size and np.any(problem.Dv @ problem.v_half):
        raise DesignError(f'{plant.name}: design = "continuous" with gains N is for outputs without noise, found noise '
                          'in v. Use design = "sampled", or method "lpv-interval".')
    return problem


def fastest(solve: Callable[[float], dict | None], most: float) -> float:
    """Largest decay at which ``solve`` finds a design, to a few per cent; 0 where there is none."""
    lo, hi = 0.0, most
    for _ in range(30):
        trial = hi / 2 if lo == 0.0 else (lo + hi) / 2
        lo, hi = (trial, hi) if solve(trial) is not None else (lo, trial)
        if lo > 0 and hi - lo < 0.03 * hi:
            break
    return lo


def sampled_gains(ct: Problem, dt: Problem, solved: dict, h: float) -> dict | None:
    """Gains of the sampled observer from those in continuous time.

    Parameters
    ----------
    ct, dt : Problem
        Of the continuous plant, and of the sampled one.
    solved : dict
        "L", "L_theta", "N" in continuous time.
    h : float
        Sampling period, s.

    Returns
    -------
    dict or None
        "L", "L_theta", "N"; None where a row of the sampled T A - L C cannot be made nonnegative.
    """
    modes, n, p = dt.sizes
    L, steps = np.zeros((modes, n, p)), np.zeros((modes, dt.parameters, n, p))
    for q in range(modes):
        T = np.eye(n) - solved["N"][q] @ ct.C[q]
        wanted, at = [], []
        for corner, A in ct.at(q):
            gain = solved["L"][q] + np.tensordot(corner, solved["L_theta"][q], 1)
            F = T @ A - gain @ ct.C[q]
            both = expm(h * np.block([[F, np.eye(n)], [np.zeros((n, 2 * n))]]))
            wanted.append(both[:n, n:] @ gain - solved["N"][q])
            at.append(np.concatenate([[1.0], corner[:dt.parameters]]))
        for i in range(n):
            row = nearest_row(dt, q, i, T, np.array(at), np.array(wanted)[:, i])
            if row is None:
                return None
            L[q, i], steps[q, :, i] = row[0], row[1:]
    return {"L": L, "L_theta": steps, "N": solved["N"]}


def nearest_row(dt: Problem, q: int, i: int, T: Array, at: Array, wanted: Array) -> Array | None:
    """Row i of L_d and its slopes (1 + J, n_y): nearest to the wanted values with T A - L C >= 0 at every corner.

    Parameters
    ----------
    at : ndarray (corners, 1 + J)
        [1, theta] of the wanted values.
    wanted : ndarray (corners, n_y)
    """
    J, p, C = at.shape[1], wanted.shape[1], dt.C[q]
    rows, rhs = [], []
    for corner, A in dt.at(q):
        here = np.concatenate([[1.0], corner[:J - 1]])
        rows.append(np.hstack([np.kron(here, C.T), np.zeros((len(C.T), wanted.size))]))
        rhs.append((T @ A)[i])
    for k, (here, value) in enumerate(zip(at, wanted)):
        pick = np.zeros((p, wanted.size))
        pick[:, k * p:(k + 1) * p] = np.eye(p)
        for sign in (1.0, -1.0):
            rows.append(np.hstack([sign * np.kron(here, np.eye(p)), -pick]))
            rhs.append(sign * value)
    # Entries are of the size of h times the plant's: a solver with absolute tolerances wants them near one.
    scale = max(np.max(np.abs(wanted)), 1e-12)
    solved = linprog(np.concatenate([np.zeros(J * p), np.ones(wanted.size)]), A_ub=np.vstack(rows),
                     b_ub=np.concatenate(rhs) / scale, bounds=[(None, None)] * (J * p) + [(0, None)] * wanted.size)
    return solved.x[:J * p].reshape(J, p) * scale if solved.status == 0 else None


def candidates(plant, tnl: bool, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Continuous designs at the sampling period; the caller certifies them and keeps the best.

    Parameters
    ----------
    plant : Plant
        Continuous.
    tnl : bool
    options : dict
        ``criterion`` "width" | "linf", ``lyapunov``, ``decay`` and ``metzler`` (1/s) fix what else is searched.
    progress : callable

    Raises
    ------
    DesignError
    """
    ct, dt, h = continuous_problem(plant, tnl), Problem.of(plant, tnl), plant.sample_period
    caps = (float(options["metzler"]),) if "metzler" in options else tuple(c / h for c in CAPS)
    wanted = [options["criterion"]] if "criterion" in options else ["width", "linf"]
    kinds = [options["lyapunov"]] if "lyapunov" in options else ["common"] + ["multiple"] * (ct.tau is not None)
    for number, cap in enumerate(caps, 1):
        progress(f"continuous design, {number} of {len(caps)}: diagonal of T A - L C at most {cap:.4g} 1/s below zero")
        if "width" in wanted:
            yield from _widths(ct, dt, h, ContinuousWidth(ct, cap), options)
        for kind in kinds if "linf" in wanted else ():
            yield from _levels(ct, dt, h, ContinuousLinf(ct, kind == "multiple", cap), kind, options)


def _rates(lmi, options: dict, **fixed) -> tuple[float, ...]:
    """Decay rates to try: what the options ask for, else shares of the fastest."""
    if "decay" in options:
        return (float(options["decay"]),)
    most = fastest(lambda a: lmi.solve(a, **fixed), 2 * lmi.cap)
    return tuple(most * share for share in SHARES) if most > 0 else ()


def _widths(ct: Problem, dt: Problem, h: float, lp: ContinuousWidth, options: dict) -> Iterator[Candidate]:
    for a in _rates(lp, options):
        solved = lp.solve(a)
        gains = None if solved is None else sampled_gains(ct, dt, solved, h)
        if gains is not None:
            kept = max(float(np.max(solved["p"] @ M / solved["p"])) for _, M in closed_loops(dt, gains))
            if 0 < kept < 1:
                proof = {"kind": "width", "p": solved["p"].tolist(), "a": (1 - kept) * (1 - 1e-4)}
                yield Candidate(f"continuous width, decay {a:.4g}/s, cap {lp.cap:.4g}/s", gains["L"], gains["N"], proof,
                                slopes(dt, gains))


def _levels(ct, dt, h: float, lmi: ContinuousLinf, kind: str, options: dict) -> Iterator[Candidate]:
    for a in _rates(lmi, options, **({"rho": 1.01} if lmi.multiple else {})):
        sampled = -np.expm1(-a * h)
        for rho, dwell in jump_factors(ct, sampled) if lmi.multiple else [(1.0, (1, 1))]:
            solved = lmi.solve(a, rho)
            gains = None if solved is None else sampled_gains(ct, dt, solved, h)
            if gains is None:
                continue
            root = np.sqrt(solved["P"])
            kept = max(float(np.linalg.norm(root[q][:, None] * M / root[q][None], 2)) ** 2
                       for q, M in closed_loops(dt, gains))
            if 0 < kept < 1:
                found = solved | gains
                made = candidate(dt, kind, (1 - kept) * 0.9, found, dwell)
                yield replace(made, label=f"continuous linf, {kind} Lyapunov, decay {a:.4g}/s, cap {lmi.cap:.4g}/s")


def closed_loops(dt: Problem, gains: dict) -> Iterator[tuple[int, Array]]:
    """Yield (mode, T A - L C of the sampled plant) at every corner."""
    for q in range(len(dt.names)):
        T = np.eye(dt.A.shape[1]) - gains["N"][q] @ dt.C[q]
        for corner, A in dt.at(q):
            yield q, T @ A - (gains["L"][q] + np.tensordot(corner[:dt.parameters], gains["L_theta"][q], 1)) @ dt.C[q]
