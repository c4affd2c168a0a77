r"""Sensitivity of a polytopic detection observer to faults, and its level, checked exactly.

The level of M r from (u, d) is that of ``polytope_gain``. For the faults, with V = eb' P1 eb + x' E' P2 x,

    |M r|^2 - b |f|^2 - V' > 0 over (eb, x, f), for every pair of vertices, P = Y E + S X, Y > 0,

says that from rest, without inputs and disturbance, the energy of M r is at least b times that of f, however the
weights move. Where no fault moves the state (Bf = 0), x stays zero and is left out, and the plant's vertex with it.

Criterion "slow": the same for e = eb - T2 Df f, which obeys it while f stands still. Settled with weights that stand
still V' is zero, and |M r|^2 >= b |f|^2 at every such moment.

Sampled, by Euler steps of a period: the level is that in discrete time. Of the criteria "slow" remains, with the
increments (eb+ - eb)/period and E (x+ - x)/period for the derivatives: they too are zero once everything is settled.
So it is of a discrete plant, with increments per sample.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, (4.25), corrected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import CertificateError
from .exact import Q, eye, product, rational, zeros
from .polytope_error import ErrorModel, standard_errors
from .polytope_gain import continuous, discrete, refuse, storage

Array = np.ndarray


@dataclass(frozen=True)
class FaultModel:
    """e' = A [e; x] + B f per pair, r = C [e; x] + D f, exactly.

    Parameters
    ----------
    pairs : dict
        (i, j) -> A (2n, 2n), B (2n, n_f).
    C : object array (p, 2n), D : object array (p, n_f)
    E, S : object array (n, n), (n, n - r)
    moved : bool
        Whether a fault moves x.
    """

    pairs: dict
    C: Array
    D: Array
    E: Array
    S: Array
    moved: bool


def level_model(problem, gains, M: Array, T1: Array, period: float | None = None) -> ErrorModel:
    """The error model with z = M r.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant.
    gains : StandardGains
    M : ndarray (k, p)
        As the firmware holds it.
    T1 : ndarray (h, n, n)
    period : float, optional
        The observer is stepped, the plant by Euler steps.
    """
    model = standard_errors(problem, gains, T1, period)
    z = product(rational(M), model.residual)
    n = len(model.E)
    return replace(model, C=z[:, :2 * n], D=z[:, 2 * n:])


def fault_model(problem, faults, gains, T1: Array, criterion: str, period: float | None = None) -> FaultModel:
    """What faults do, for one of the criteria.

    Parameters
    ----------
    problem : DescriptorProblem
    faults : Faults
        In the units of the plant.
    gains : StandardGains
    T1 : ndarray (h, n, n)
    criterion : {"all", "slow", "band"}
        The last is "all", which steps may have too.
    period : float, optional
        Of Euler steps.

    Raises
    ------
    CertificateError
        Another criterion.
    """
    steps = takes_steps(problem, period)
    if criterion not in ("all", "slow", "band") or (steps and criterion == "all"):
        raise CertificateError(f"certificate: criterion {criterion!r} (found), expected all or slow; slow where "
                               "steps are taken.")
    n, m, n_f = len(problem.E), problem.B.shape[2], faults.Df.shape[1]
    as_input = replace(problem, Bd=faults.Bf, Dd=faults.Df, J=np.zeros((len(problem.H), n_f)), d_unit=np.ones(n_f))
    model = standard_errors(as_input, gains, T1, period)
    C, D = model.residual[:, :2 * n], model.residual[:, 2 * n + m:]
    pairs = {pair: (A, B[:, m:]) for pair, (A, B) in model.pairs.items()}
    if steps:
        now = np.concatenate([np.concatenate([eye(n), zeros(n, n)], axis=1),
                              np.concatenate([zeros(n, n), model.E], axis=1)])
        each = Q(1 if period is None else period)
        pairs = {pair: ((A - now) / each, B / each) for pair, (A, B) in pairs.items()}
    if criterion == "slow":
        shift = np.concatenate([product(rational(gains.T2), rational(faults.Df)), zeros(n, n_f)])
        pairs = {pair: (A, B + product(A, shift)) for pair, (A, B) in pairs.items()}
        D = D + product(C, shift)
    return FaultModel(pairs, C, D, model.E, model.S, bool(np.any(faults.Bf)))


def takes_steps(problem, period: float | None) -> bool:
    """Whether plant and observer take steps: those of a discrete plant, or Euler's.

    Parameters
    ----------
    problem : DescriptorProblem
    period : float or None
        Of Euler steps.

    Raises
    ------
    CertificateError
        Euler steps of a discrete plant.
    """
    if problem.kind == "discrete" and period is not None:
        raise CertificateError(f"certificate: Euler steps of {period:.6g} s of a discrete plant (found), expected its "
                               "own steps.")
    return problem.kind == "discrete" or period is not None


def check(problem, faults, gains, M: Array, proof: dict) -> list[str]:
    """Check level and sensitivity on the constants of the firmware; return what is proved, one sentence per claim.

    Parameters
    ----------
    problem : DescriptorProblem
    faults : Faults
    gains : StandardGains
    M : ndarray (k, p)
    proof : dict
        "T1", "criterion", "level": proof of `polytope_gain.continuous` with "level2", "gamma"; "fault": "level2",
        "beta", "Y1", and "Y2", "X2" where a fault moves x; where steps are taken the level is by
        `polytope_gain.discrete`; "period" of Euler steps.

    Returns
    -------
    claims : list of str

    Raises
    ------
    CertificateError
        Naming pair and condition.
    """
    level, fault, T1 = proof["level"], proof["fault"], np.array(proof["T1"])
    gamma, beta = Q(level["gamma"]), Q(fault["beta"])
    if gamma < 0 or gamma * gamma < Q(level["level2"]) or beta < 0 or beta * beta > Q(fault["level2"]):
        raise CertificateError(f"certificate: gamma {level['gamma']:.9g}, beta {fault['beta']:.9g} (found), expected "
                               "no more than the levels that are proved.")
    period = proof.get("period")
    judge = discrete if takes_steps(problem, period) else continuous
    claims = judge(problem.names, level_model(problem, gains, M, T1, period),
                   level | {"form": "standard", "period": period}, Q(level["level2"]))
    model = fault_model(problem, faults, gains, T1, proof["criterion"], period)
    weight, n = rational(M), len(model.E)
    _, P1 = storage(eye(n), zeros(n, 0), fault, "1")
    P2 = storage(model.E, model.S, fault, "2")[1] if model.moved else None
    seen, done = product(weight, np.concatenate([model.C, model.D], axis=1)), set()
    for (i, j), (A, B) in model.pairs.items():
        flow = np.concatenate([A, B], axis=1)
        V = np.concatenate([product(P1.T, flow[:n]), product(P2.T, flow[n:]) if model.moved else 0 * flow[n:],
                            zeros(B.shape[1], flow.shape[1])])
        S = V + V.T - product(seen.T, seen)
        for k in range(2 * n, len(S)):
            S[k, k] += Q(fault["level2"])
        if not model.moved:
            if j in done:
                continue
            done.add(j)
            kept = [*range(n), *range(2 * n, len(S))]
            S = S[np.ix_(kept, kept)]
        refuse(S, problem.names, i if model.moved else None, j, f"the sensitivity {fault['beta']:.6g} fails")
    size, big = f"{fault['beta']:.6g}", f"{level['gamma']:.6g}"
    return [f"H-infinity: from rest and without faults the energy of M r stays below {big}^2 times that of inputs and "
            "disturbances, for all weights of plant and observer, however they move",
            f"H-: from rest without inputs and disturbances the energy of M r is at least {size}^2 times that of the "
            "faults, however the weights move" if proof["criterion"] == "all" else
            f"H-: constant faults f, with weights that stand still, settle to |M r| of at least {size} |f| without "
            "inputs and disturbances", *claims]
