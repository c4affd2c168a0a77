r"""Energy gain and decay of a polytopic descriptor observer, checked exactly: one inequality per pair of vertices.

The plant is at vertex i with weight h_i(x), the observer at vertex j with weight h_j(x_hat); the error model of
``polytope_error`` is affine in both, so that the vertices decide. With V = e' Ee' P1 e + x' E' P2 x, continuous time:

    V' + |z|^2 - g |(u, d)|^2 < 0 for every pair,      Ee' P1, E' P2 symmetric and >= 0 by P = Y E + S X, Y > 0.

Discrete time: P1 > 0, P2 = Y2 > 0, V = e' P1 e + x' E' P2 E x, and for every pair

    V+ - V + |z|^2 - g |(u, d)|^2 + 2 c' R S' (A_i x + B_i u + Bd_i d) < 0,    c = [e; x; u; d],

with any R: what it multiplies is zero. Where the observer solves its own algebraic equations it is e' Ee' P1 Ee e, and
2 c' Re (rows that are zero, ``descriptor_error``) stands beside the term of R. Each is a negative definite matrix of
rational numbers. Then, from e = 0 and x = 0, the energy of z is at most g times that of (u, d), however the weights
move, in continuous or discrete time.

Decay, of the error alone (x, u, d zero): P' N_j + N_j' P + 2 decay Ee' Y Ee < 0, or N_j' P1 N_j < contraction^2 P1.
``euler``: (I + period N_j)' P1 (I + period N_j) < P1.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, Theorems 3.2.1, 3.3.1 and C.2.1, corrected.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .descriptor_error import descriptor_errors
from .exact import Q, eye, leading_failure, product, rational, zeros
from .polytope_error import ErrorModel, direct_errors, standard_errors

Array = np.ndarray


def squared_level(proof: dict) -> fmpq:
    """The square of the level that a proof is about, not above that of the level which is claimed.

    Parameters
    ----------
    proof : dict
        "level2", "gamma".

    Raises
    ------
    CertificateError
    """
    level = Q(proof["level2"])
    if level < 0 or Q(proof["gamma"]) ** 2 < level or Q(proof["gamma"]) < 0:
        raise CertificateError(f"certificate: gamma {proof['gamma']:.9g} is claimed, its square is {float(level):.9g} "
                               "(found), expected gamma^2 at least that.")
    return level


def errors_of(problem, gains, proof: dict) -> ErrorModel:
    """The exact error model that a proof is about.

    Parameters
    ----------
    problem : DescriptorProblem
    gains : StandardGains or DirectGains
    proof : dict
        "form" ("standard", "direct" or "descriptor"), "T1" of the standard form, "period" of a sampled continuous
        plant or None, "M" where z is M r.
    """
    if proof["form"] == "direct":
        return direct_errors(problem, gains)
    if proof["form"] == "descriptor":
        return descriptor_errors(problem, gains, proof.get("period"))
    model = standard_errors(problem, gains, np.array(proof["T1"]), proof.get("period"))
    if "M" not in proof:
        return model
    z, n = product(rational(np.array(proof["M"])), model.residual), len(model.E)
    return replace(model, C=z[:, :2 * n], D=z[:, 2 * n:])


def check(problem, gains, proof: dict, about: str = "inputs and disturbances") -> list[str]:
    """Check level and decay on the constants of the firmware; return what is proved, one sentence per claim.

    Parameters
    ----------
    problem : DescriptorProblem
        In the units of the plant; n, p, .. of it only, its numbers are exact.
    gains : StandardGains or DirectGains
    proof : dict
        "form", "time" ("continuous" or "discrete"), "gamma", "level2", and "Y1", "X1", "Y2", "X2" (continuous) or
        "P1", "P2", "R" (discrete; of "descriptor" "Re" and "Rc" too); "decay" or "contraction", "euler" or None.
    about : str
        What u and d are, in words.

    Returns
    -------
    claims : list of str

    Raises
    ------
    CertificateError
        Naming pair and condition.
    """
    model, level = errors_of(problem, gains, proof), squared_level(proof)
    if proof["time"] not in ("continuous", "discrete"):
        raise CertificateError(f"certificate: time {proof['time']!r} (found), expected continuous or discrete.")
    judge = continuous if proof["time"] == "continuous" else discrete
    claims = judge(problem.names, model, proof, level)
    tied = len(problem.pairs) < len(problem.names) ** 2
    return [f"H-infinity: from rest the energy of z stays below {proof['gamma']:.6g}^2 times that of {about}, for all "
            "weights of plant and observer, however they move"
            + (", the same in both for what is known exactly" if tied else ""), *claims]


def continuous(names, model: ErrorModel, proof: dict, level: fmpq) -> list[str]:
    """Check a level and a decay in continuous time; return what is said of the decay.

    Parameters
    ----------
    names : sequence of str
    model : ErrorModel
    proof : dict
    level : fmpq

    Raises
    ------
    CertificateError
    """
    Y1, P1 = storage(model.Ee, model.S if proof["form"] == "direct" else zeros(len(model.E), 0), proof, "1")
    _, P2 = storage(model.E, model.S, proof, "2")
    n = len(model.E)
    for (i, j), (A, B) in model.pairs.items():
        flow = np.concatenate([A, B], axis=1)
        M = np.concatenate([product(P1.T, flow[:n]), product(P2.T, flow[n:]), zeros(B.shape[1], flow.shape[1])])
        refuse(_inequality(M + M.T, model, level), names, i, j, f"the level {float(level) ** 0.5:.6g} fails")
    decay = Q(proof["decay"])
    claims = [f"the error of the estimate decays at least like exp(-{proof['decay']:.6g} t) where nothing drives it"]
    for j, N in _own(model).items():
        M = product(P1.T, N)
        own = M + M.T + 2 * decay * product(product(model.Ee.T, Y1), model.Ee)
        refuse(own, names, None, j, f"the decay {proof['decay']:.6g} fails")
    if proof.get("euler") is not None:
        for j, N in _own(model).items():
            step = eye(n) + Q(proof["euler"]) * N
            refuse(product(product(step.T, P1), step) - P1, names, None, j,
                    f"an Euler step of {proof['euler']:.6g} s does not contract")
        claims.append(f"Euler steps of {proof['euler']:.6g} s contract the error")
    return claims


def discrete(names, model: ErrorModel, proof: dict, level: fmpq) -> list[str]:
    """Check a level and a contraction in discrete time; return what is said of the contraction.

    Parameters
    ----------
    names : sequence of str
    model : ErrorModel
    proof : dict
    level : fmpq

    Raises
    ------
    CertificateError
    """
    words = {"level": f"the level {float(level) ** 0.5:.6g} fails",
             "contraction": f"the contraction {proof['contraction']:.6g} fails"}
    for kind, i, j, S in discrete_inequalities(model, proof, level):
        refuse(S, names, i, j, words[kind])
    steps = "" if proof.get("period") is None else f"; the plant by Euler steps of {proof['period']:.6g} s"
    return [f"the error of the estimate shrinks to at most {proof['contraction']:.6g} of what it was per sample where "
            f"nothing drives it{steps}"]


def discrete_inequalities(model: ErrorModel, proof: dict, level: fmpq) -> Iterator[tuple[str, int | None, int, Array]]:
    """Yield what must be negative definite in discrete time: "level" or "contraction", both vertices, the matrix.

    Parameters
    ----------
    model : ErrorModel
    proof : dict
    level : fmpq

    Raises
    ------
    CertificateError
        P1, P2, R or the contraction are none.
    """
    P1, P2 = (_positive(proof[key], key, len(model.E)) for key in ("P1", "P2"))
    n, R = len(model.E), rational(np.array(proof["R"], dtype=float).reshape(len(proof["R"]), model.S.shape[1]))
    before, own = (product(product(E.T, P), E) for E, P in ((model.E, P2), (model.Ee, P1)))
    free = {key: rational(np.array(proof[key], dtype=float)) for key in ("Re", "Rc") if model.ties}
    for (i, j), (A, B) in model.pairs.items():
        flow = np.concatenate([A, B], axis=1)
        e, x = flow[:n], flow[n:]
        M = product(product(e.T, P1), e) + product(product(x.T, P2), x)
        M[:n, :n] -= own
        M[n:2 * n, n:2 * n] -= before
        if model.S.shape[1]:
            if R.shape[0] != flow.shape[1]:
                raise CertificateError(f"certificate: R has {R.shape[0]} rows (found), expected {flow.shape[1]}.")
            zero = product(R, product(model.S.T, x))
            M = M + zero + zero.T
        if model.ties:
            zero = _tied(free["Re"], model.ties[i, j])
            M = M + zero + zero.T
        yield "level", i, j, _inequality(M, model, level)
    factor = Q(proof["contraction"])
    if factor < 0:
        raise CertificateError(f"certificate: contraction {proof['contraction']} (found), expected at least 0.")
    ties = {j: tie[:, :n] for (_, j), tie in model.ties.items()}
    for j, N in _own(model).items():
        M = product(product(N.T, P1), N) - factor * factor * own
        if ties:
            zero = _tied(free["Rc"], ties[j])
            M = M + zero + zero.T
        yield "contraction", None, j, M


def _tied(R: Array, tie: Array) -> Array:
    """R times rows that are zero."""
    if R.shape != tie.T.shape:
        raise CertificateError(f"certificate: a factor of the algebraic equations is {R.shape} (found), expected "
                               f"{tie.T.shape}.")
    return product(R, tie)


def _own(model: ErrorModel) -> dict[int, Array]:
    """N_j of e' = N_j e + ..: the same for every vertex of the plant."""
    n = len(model.E)
    return {j: A[:n, :n] for (_, j), (A, _) in model.pairs.items()}


def _inequality(M: Array, model: ErrorModel, level: fmpq) -> Array:
    """M of V' or of V+ - V, with |z|^2 - g |(u, d)|^2 added."""
    out = np.concatenate([model.C, model.D], axis=1)
    S = M + product(out.T, out)
    for k in range(2 * len(model.E), len(S)):
        S[k, k] = S[k, k] - level
    return S


def storage(E: Array, S: Array, proof: dict, which: str) -> tuple[Array, Array]:
    """Y, positive definite, and P = Y E + S X.

    Parameters
    ----------
    E : object array (n, n), S : object array (n, n - r)
    proof : dict
        "Y" and "X" with the suffix ``which``.
    which : str

    Raises
    ------
    CertificateError
        Y is not positive definite.
    """
    Y = _positive(proof["Y" + which], "Y" + which, len(E))
    P = product(Y, E)
    if S.shape[1]:
        X = rational(np.array(proof["X" + which], dtype=float))
        if X.shape != (S.shape[1], len(E)):
            raise CertificateError(f"certificate: X{which} is {X.shape} (found), expected {(S.shape[1], len(E))}.")
        P = P + product(S, X)
    return Y, P


def _positive(values, name: str, n: int) -> Array:
    P = rational(np.array(values, dtype=float))
    if P.shape != (n, n) or np.any(P != P.T) or leading_failure(P) is not None:
        raise CertificateError(f"certificate: {name} is not a symmetric, positive definite {n}x{n} matrix.")
    return P


def refuse(S: Array, names, i: int | None, j: int, words: str) -> None:
    """Raise unless -S is positive definite.

    Parameters
    ----------
    S : object array (k, k)
    names : sequence of str
    i, j : int
        Vertices of plant (None: any) and observer.
    words : str
        What fails.

    Raises
    ------
    CertificateError
    """
    bad = leading_failure(-S)
    if bad is None:
        return
    where = f'with the observer at "{names[j]}"' + ("" if i is None else f' and the plant at "{names[i]}"')
    largest = np.linalg.eigvalsh(np.array([[float(x) for x in row] for row in S]))[-1]
    raise CertificateError(f"certificate: {words} {where} (leading minor {bad + 1} of {len(S)}, largest eigenvalue "
                           f"{largest:.3g}, expected below 0) on the rounded constants. Try closer bounds of what "
                           "varies, units in which the matrices are about 1 (time too), a slower decay or float64.")
