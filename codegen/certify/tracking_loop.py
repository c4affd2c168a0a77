r"""The closed loop of a sampled plant, its polytopic observer and the tracking law, exactly, from the held constants.

    x+ = sum_i h_i (A_i x + B_i u + Bd_i d),  y = C x + Dd d        the plant at its period (``sampled_vertices``)
    x_hat, r, z+                                                    the observer (``polytope_error``), eb = T1 x - z
    u = sum_j g_j (K_j x_hat + L_j s),    s+ = s + T (ref - Y y)    the law; Y picks what follows the reference

h are the plant's weights, g those of observer and law. The vertices of the product of all three decide, as the step is
affine in each of them: every (i, j, l) is one matrix. So what is proved holds for every weights, also for those that a
faulty sensor makes. With xi = [eb; x; s]

    decay    M' P M < f^2 P                                   from any start, without disturbance
    level    M' P M - P + e'e - g d'd < 0                     e = Y C x over its size: from rest, reference 0

for each. Bounds of every |xi|, |u|, |r| for all disturbances, references and starts come from ``peaks``; from them
follows that no state leaves its declared range and no input saturates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product as every

import numpy as np

from ..errors import CertificateError
from .exact import Q, leading_failure, pivots, product, rational, zeros
from .polytope_error import ErrorModel, standard_errors
from .polytope_gain import squared_level

Array = np.ndarray
Vertices = tuple[int, int, int]


@dataclass(frozen=True)
class Loop:
    """xi+ = A xi + B [d; ref] per vertices of plant, observer and law; d and ref in units of their sizes.

    Parameters
    ----------
    error : ErrorModel
        Of the observer alone.
    vertices : dict
        (i, j, l) -> A (N, N), B (N, q + k).
    inputs : dict
        l -> rows of u over xi (m, N), over [d; ref] (m, q + k).
    estimate : (ndarray, ndarray)
        Rows of x - x_hat.
    residual : (ndarray, ndarray)
        Rows of r.
    """

    error: ErrorModel
    vertices: dict[tuple[int, int, int], tuple[Array, Array]]
    inputs: dict[int, tuple[Array, Array]]
    estimate: tuple[Array, Array]
    residual: tuple[Array, Array]


def loop(problem, gains, T1: Array, law) -> Loop:
    """The exact closed loop.

    Parameters
    ----------
    problem : DescriptorProblem
        Of the sampled plant: E = I, H = I, J = 0, all pairs.
    gains : StandardGains
        Of the observer, as held.
    T1 : ndarray (n, n)
    law : FeedbackLaw
        Kx, Ki, rows, period as held; reference: size of ref.

    Returns
    -------
    Loop
    """
    model = standard_errors(problem, gains, T1)
    n, m, q = len(model.E), problem.B.shape[2], problem.Bd.shape[2]
    k, T = len(law.rows), Q(law.period)
    N = 2 * n + k
    seen, noise = model.C, model.D[:, m:]  # x - x_hat over [eb; x] and d; u does not show in it
    if any(x != 0 for x in model.D[:, :m].ravel()):
        raise CertificateError("certificate: an input shows in the estimate at once (found), expected none.")
    state = np.concatenate([zeros(n, n), _eye(n)], axis=1)
    hat = np.concatenate([state - seen, zeros(n, k)], axis=1), np.concatenate([-noise, zeros(n, k)], axis=1)
    last = np.concatenate([zeros(k, 2 * n), _eye(k)], axis=1)
    size = rational(law.reference)
    inputs = {}
    for l, (Kx, Ki) in enumerate(zip(law.Kx, law.Ki)):  # noqa: E741
        inputs[l] = (product(rational(Kx), hat[0]) + product(rational(Ki), last), product(rational(Kx), hat[1]))
    rows = list(law.rows)
    C, Dd = rational(problem.C)[rows], (rational(problem.Dd) * rational(problem.d_unit))[rows]
    s_row = np.concatenate([zeros(k, n), -T * C, _eye(k)], axis=1)
    s_in = np.concatenate([-T * Dd, T * np.diag(size) + zeros(k, k)], axis=1)
    vertices = {}
    for ((i, j), (A, B)), (l, (u_xi, u_in)) in every(model.pairs.items(), inputs.items()):  # noqa: E741
        wide = np.concatenate([A, zeros(2 * n, k)], axis=1) + product(B[:, :m], u_xi)
        into = np.concatenate([B[:, m:], zeros(2 * n, k)], axis=1) + product(B[:, :m], u_in)
        vertices[i, j, l] = np.concatenate([wide, s_row]), np.concatenate([into, s_in])
    r, none = model.residual, zeros(len(problem.C), k)
    residual = np.concatenate([r[:, :2 * n], none], axis=1), np.concatenate([r[:, 2 * n + m:], none], axis=1)
    estimate = np.concatenate([seen, zeros(n, k)], axis=1), np.concatenate([noise, zeros(n, k)], axis=1)
    assert all(A.shape == (N, N) and B.shape == (N, q + k) for A, B in vertices.values())
    return Loop(model, vertices, inputs, estimate, residual)


def decays(found: Loop, proof: dict) -> Iterator[tuple[Vertices, Array]]:
    """What must be positive definite for a decay: f^2 P - M' P M of every vertex.

    Parameters
    ----------
    found : Loop
    proof : dict
        "P", "factor".

    Raises
    ------
    CertificateError
        P is not positive definite, or the factor not between 0 and 1.
    """
    P, factor = positive(proof["P"], len(next(iter(found.vertices.values()))[0])), Q(proof["factor"])
    if not 0 < factor < 1:
        raise CertificateError(f"certificate: the factor of the closed loop is {proof['factor']} (found), expected one "
                               "between 0 and 1.")
    for where, (A, _) in found.vertices.items():
        yield where, factor * factor * P - product(product(A.T, P), A)


def levels(found: Loop, out: Array, proof: dict) -> Iterator[tuple[Vertices, Array]]:
    """What must be positive definite for an energy gain from disturbances and noises to the tracking error.

    Parameters
    ----------
    found : Loop
    out : object array (k, N)
        The tracking error over xi, in units of the reference.
    proof : dict
        "P", "level2", "gamma", "inputs": how many of [d; ref] count.

    Raises
    ------
    CertificateError
        P is not positive definite, or gamma less than what is proved.
    """
    level, count = squared_level(proof), int(proof["inputs"])
    P = positive(proof["P"], out.shape[1])
    for where, (A, B) in found.vertices.items():
        flow = np.concatenate([A, B[:, :count]], axis=1)
        S = -product(product(flow.T, P), flow)
        S[:len(A), :len(A)] = S[:len(A), :len(A)] + P - product(out.T, out)
        for d in range(len(A), len(S)):
            S[d, d] = S[d, d] + level
        yield where, S


def check_decay(found: Loop, names, proof: dict) -> None:
    """Check that every sample shrinks xi by a factor, in a common norm; see `decays`.

    Parameters
    ----------
    found : Loop
    names : sequence of str
    proof : dict

    Raises
    ------
    CertificateError
    """
    for where, S in decays(found, proof):
        _refuse(S, names, where, f"the decay by {proof['factor']:.6g} per sample")


def check_level(found: Loop, names, out: Array, proof: dict) -> None:
    """Check the energy gain; see `levels`.

    Parameters
    ----------
    found : Loop
    names : sequence of str
    out : object array (k, N)
    proof : dict

    Raises
    ------
    CertificateError
    """
    for where, S in levels(found, out, proof):
        _refuse(S, names, where, f"the level {proof['gamma']:.6g}")


def positive(values, n: int) -> Array:
    """A symmetric, positive definite matrix of a proof.

    Parameters
    ----------
    values : nested lists
    n : int

    Raises
    ------
    CertificateError
    """
    P = rational(np.array(values, dtype=float))
    if P.shape != (n, n) or np.any(P != P.T) or leading_failure(P) is not None:
        raise CertificateError(f"certificate: P (found) is no symmetric, positive definite {n}x{n} matrix (expected).")
    return P


def _refuse(S: Array, names, where: tuple[int, int, int], words: str) -> None:
    if pivots(S)[-1] <= 0:
        i, j, l = (names[k] for k in where)  # noqa: E741
        raise CertificateError(f'certificate: {words} fails with the plant at "{i}", the observer at "{j}", the law at '
                               f'"{l}" on the rounded constants. Ask for a slower decay, or sample faster.')


def _eye(n: int) -> Array:
    return rational(np.eye(n)) if n else zeros(0, 0)
