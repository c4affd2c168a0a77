r"""A polytopic plant with E = I at its sampling period: second-order vertices, and a bound of all that they miss.

    x' = sum_i h_i (A_i x + B_i u + Bw_i w),    u held, T the period,
    x(T) = sum_i h_i (P_i x + G_i u + T Bw_i wm) + e

with the weights h_i at the sample, P_i = I + T A_i + T^2/2 A_i^2, G_i = T B_i + T^2/2 A_i B_i, wm the mean of w over
the period (within its bounds as w is). With |x| <= X, |u| <= U, |w| <= W over the period, elementwise, let

    |A_i| <= a,  |A_i - Am| <= D,  |B_i - Bm| <= Db,  |Bw_i - Bwm| <= Dw,   v = a X + |B| U + |Bw| W >= |x'|,

Am, Bm, Bwm the middles. A premise z, affine in x, moves by |dz/dx| v at most, and sum_i |h_i(t) - h_i(0)| <= p t,
p = 2 sum_z |dz/dx| v / (hi - lo). Twice the integral equation of x then leaves

    |e| <= p T^2/2 (D X + Db U + Dw W)                                 the weights move
         + a (a v T^3/6 + p T^3/6 (D X + Db U) + T^2/2 |Bw| W)         third order; w within the second
         + T^2 D (D X + Db U)                                          sum_i h_i A_i^2 for (sum_i h_i A_i)^2
         + rounding of P_i, G_i and T Bw_i to float64.

The last line but one: sum h_i (A_i - Ah)(A_i - Ah) = sum h_i (A_i - Am)(A_i - Am) - (Ah - Am)(Ah - Am), and so for B.
All of it in rational numbers, rounded up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, eye, product, rational, up, zeros
from .polytope_rounding import sizes

Array = np.ndarray


@dataclass(frozen=True)
class SampledVertices:
    """x+ = sum_i h_i (A_i x + B_i u + Bw_i w) + e, |e| <= error.

    Parameters
    ----------
    A : ndarray (h, n, n), B : ndarray (h, n, m), Bw : ndarray (h, n, n_w)
    error : ndarray (n,)
    speed : ndarray (n,)
        Of |x'|.
    slope : ndarray (n_premises, n)
        |dz/dx| / (hi - lo) of each premise.
    """

    A: Array
    B: Array
    Bw: Array
    error: Array
    speed: Array
    slope: Array


def sampled_vertices(plant) -> SampledVertices:
    """Sample a plant.

    Parameters
    ----------
    plant : Plant
        Continuous, a sector model with E = I, premises affine in the states, all ranges finite, inputs held.

    Returns
    -------
    SampledVertices

    Raises
    ------
    CertificateError
        It is another one.
    """
    p = plant.polytope
    if (plant.kind != "continuous" or p is None or not p.premises or np.any(np.eye(len(p.E)) != p.E)
            or any(np.any(v.offset) for v in p.vertices) or any(s.rate for s in plant.u)):
        raise CertificateError("certificate: the plant is no continuous sector model with E = I and held inputs "
                               "(found), expected one: others are not sampled here.")
    T = Q(plant.sample_period)
    half = T * T / 2
    A, B, Bw = ([rational(getattr(v, key)) for v in p.vertices] for key in ("A", "B", "Bw"))
    X, U, W = (sizes(*plant.limits(v)) for v in "xuw")
    a, b, bw = (_largest([abs(M) for M in some]) for some in (A, B, Bw))
    D, Db, Dw = (_largest([abs(M - _middle(some)) for M in some]) for some in (A, B, Bw))
    v = _times(a, X) + _times(b, U) + _times(bw, W)
    slope = _slopes(plant)
    p_rate = 2 * sum(_times(slope, v), fmpq(0))
    drift = _times(D, X) + _times(Db, U)
    third = T * T * T / 6
    error = (half * p_rate * (drift + _times(Dw, W)) + T * T * _times(D, drift)
             + _times(a, third * _times(a, v) + third * p_rate * drift + half * _times(bw, W)))
    exact = {"A": [eye(len(M)) + T * M + half * product(M, M) for M in A],
             "B": [T * N + half * product(M, N) for M, N in zip(A, B)], "Bw": [T * M for M in Bw]}
    held, lost = {}, error
    for key, size in (("A", X), ("B", U), ("Bw", W)):
        held[key] = np.array([[[float(x) for x in row] for row in M] for M in exact[key]]).reshape(
            len(A), len(X), len(size))
        lost = lost + _times(_largest([abs(M - rational(N)) for M, N in zip(exact[key], held[key])]), size)
    return SampledVertices(**held, error=np.array([up(x) for x in lost]), speed=np.array([up(x) for x in v]),
                           slope=np.array([[up(x) for x in row] for row in slope]).reshape(len(p.premises), len(X)))


def _slopes(plant) -> Array:
    """|dz/dx| / (hi - lo) of every premise."""
    p = plant.polytope
    out = zeros(len(p.premises), plant.n_x)
    for i, z in enumerate(p.premises):
        for k, s in enumerate(p.symbols[:plant.n_x]):
            slope = z.term.diff(s)
            if not slope.is_number or z.term.free_symbols - set(p.symbols[:plant.n_x]):
                raise CertificateError(f'certificate: premise "{z.name}" (found) is not affine in the states, expected '
                                       "that: its rate is bounded by it.")
            # A decimal number of sympy is a binary fraction of 53 bits: its float is exact.
            value = fmpq(int(slope.p), int(slope.q)) if slope.is_Rational else Q(float(slope))
            out[i, k] = abs(value) / (Q(z.hi) - Q(z.lo))
    return out


def _times(M: Array, v: Array) -> Array:
    return product(M, v.reshape(-1, 1)).reshape(-1)


def _largest(some: list[Array]) -> Array:
    out = some[0]
    for M in some[1:]:
        out = np.where(out < M, M, out)
    return out


def _middle(some: list[Array]) -> Array:
    return sum(some[1:], some[0]) / len(some)
