r"""The L-infinity design of Chevet (2021) for parameters that nobody measures, with its conditions repaired.

With T, N given and F = T A - L C Metzler, both errors obey ``e' = F e + Phi(x, e) + drive`` where Phi holds what the
unknown part dA does; |Phi|^2 <= 3 (l_lo^2 + l_hi^2) |e|^2 + beta for both framers together::

    P F + eta P >= 0,   [PF + F'P + alpha P + delta Q, P, P; P, -delta I, 0; P, 0, -alpha gamma I] <= 0,
    [P, Co'; Co, mu I] >= 0,   mu >= gamma,   minimise mu,         Q = 3 (l_lo^2 + l_hi^2) I

with l_hi = |pos [TdA]_hi| + |pos [TdA]_lo|, l_lo alike of the negative parts (2-norms), Co the interval product with C.
Then |R|^2 <= mu V(0) e^{-alpha t} + mu gamma |drive|^2 + mu (delta / alpha) beta. Both framers have the same Q, so one
half is solved. The level is true and useless as a width: beta holds the whole range of x. What bounds the width is the
positive comparison system, which the certificate of the sampled tables checks; the gains are one more candidate there.

Source: Chevet (2021), Theorem 3.2, (15), (16). Differences from the print:

* gamma becomes alpha gamma: integrating V' <= -alpha V + gamma |eps|^2 gives gamma / alpha. With the printed form
  x' = -0.1 x + w is a counterexample to (16) (tests/synthesis/test_chevet.py).
* The constant gamma beta is dropped there with the implication the wrong way round; delta is its own multiplier here.
* Lemma 2.2 gives the lower function the constants of the upper one; they change places, so Q is the same for both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cvxpy as cp
import numpy as np

from ..algebra.interval import neg, pos
from .continuous import ContinuousWidth, continuous_problem, fastest, sampled_gains
from .problem import Candidate, Problem, slopes

Array = np.ndarray
#: alpha in units of the fastest decay of the linear program, eta in units of 1/h.
ALPHAS = (0.05, 0.15, 0.3, 0.6)
ETAS = (0.1, 0.5, 1.0)


def lipschitz2(T: Array, unknowns, radius: Array) -> float:
    """l_lo^2 + l_hi^2 of T dA, where dA is within +-(sum |A_unc| + A_rad) of zero.

    Parameters
    ----------
    T : ndarray (n_x, n_x)
    unknowns : sequence of ndarray (n_x, n_x)
    radius : ndarray (n_x, n_x)
    """
    most = np.abs(T) @ radius + sum((np.abs(T @ F) for F in unknowns), np.zeros_like(radius))
    return float(2 * np.linalg.norm(most, 2) ** 2)  # an interval about zero: both constants are the norm of its end


def solve(TA: list[Array], C: Array, l2: list[float], alpha: float, eta: float) -> dict | None:
    """Minimise mu for T A of every mode (one P for all).

    Parameters
    ----------
    TA : list of ndarray (n_x, n_x)
    C : ndarray (n_y, n_x)
    l2 : list of float
        ``lipschitz2`` of every mode.
    alpha, eta : float
        Decay, and the cap on how negative the diagonal of F may become, 1/s.

    Returns
    -------
    dict or None
        "L" (N, n_x, n_y), "P" (n_x,), "mu", "gamma", "delta"; None where the solver found nothing.
    """
    n, p = TA[0].shape[0], C.shape[0]
    P, mu, gamma, delta = cp.Variable(n), cp.Variable(), cp.Variable(), cp.Variable()
    Y = [cp.Variable((n, p)) for _ in TA]
    D, one, none = cp.diag(P), np.eye(n), np.zeros((n, n))
    outer = np.block([[pos(C), -neg(C)], [-neg(C), pos(C)]])
    both = cp.bmat([[D, none], [none, D]])
    size = cp.bmat([[both, outer.T], [outer, mu * np.eye(2 * p)]])
    constraints = [mu >= gamma, delta >= 0, (size + size.T) / 2 >> 0]
    for A, gains, l in zip(TA, Y, l2):
        S = D @ A - gains @ C
        block = cp.bmat([[S + S.T + alpha * D + 3 * l * delta * one, D, D], [D, -delta * one, none],
                         [D, none, -alpha * gamma * one]])
        constraints += [S + eta * D >= 0, (block + block.T) / 2 << 0]
    problem = cp.Problem(cp.Minimize(mu), constraints)
    try:
        problem.solve(solver=cp.CLARABEL)
    except (cp.error.SolverError, ArithmeticError):
        return None
    if mu.value is None or problem.status not in ("optimal", "optimal_inaccurate"):
        return None
    return {"L": np.array([g.value / P.value[:, None] for g in Y]), "P": P.value, "mu": float(mu.value),
            "gamma": float(gamma.value), "delta": float(delta.value)}


def candidates(plant, options: dict, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Designs for the N of the narrowest linear program, brought to the sampling period.

    Parameters
    ----------
    plant : Plant
        Continuous, no measured parameters.
    options : dict
        ``decay`` (alpha) and ``metzler`` (eta), 1/s, fix what else is searched.
    progress : callable
    """
    ct, dt, h = continuous_problem(plant, tnl=True), Problem.of(plant, tnl=True), plant.sample_period
    etas = (float(options["metzler"]),) if "metzler" in options else tuple(e / h for e in ETAS)
    for number, eta in enumerate(etas, 1):
        progress(f"Lipschitz design, {number} of {len(etas)}: eta {eta:.4g} 1/s")
        lp = ContinuousWidth(ct, eta)
        most = fastest(lp.solve, 2 * eta)
        narrow = lp.solve(most / 2) if most > 0 else None
        if narrow is None:
            continue
        T = [np.eye(len(ct.A[0])) - N @ C for N, C in zip(narrow["N"], ct.C)]
        l2 = [lipschitz2(t, F, R) for t, F, R in zip(T, ct.A_unc, ct.A_rad)]
        for alpha in (float(options["decay"]),) if "decay" in options else tuple(most * share for share in ALPHAS):
            solved = solve([t @ A for t, A in zip(T, ct.A)], ct.C[0], l2, alpha, eta)
            none = np.zeros((len(T), 0, *narrow["N"].shape[1:]))
            gains = None if solved is None else sampled_gains(
                ct, dt, {"L": solved["L"], "L_theta": none, "N": narrow["N"]}, h)
            if gains is not None:
                yield Candidate(f"continuous Lipschitz, alpha {alpha:.4g}/s, eta {eta:.4g}/s", gains["L"], gains["N"],
                                {"kind": "box"}, slopes(dt, gains))
