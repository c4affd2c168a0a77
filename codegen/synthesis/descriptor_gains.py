"""Constants of a polytopic descriptor observer as the firmware holds them: rounded, in the plant's units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .descriptor_lmi import DescriptorDesign
from .descriptor_problem import DescriptorProblem, Scaling

Array = np.ndarray


@dataclass(frozen=True)
class StandardGains:
    """x_hat = z + T2 y, r = y - C x_hat, z' = sum_j h_j (F_j x_hat + G_j u - K_j r); z+ in discrete time.

    Parameters
    ----------
    T2 : ndarray (n, p), C : ndarray (p, n)
    F : ndarray (h, n, n), G : ndarray (h, n, m), K : ndarray (h, n, p)
    """

    T2: Array
    F: Array
    G: Array
    K: Array
    C: Array


@dataclass(frozen=True)
class DirectGains:
    """E x_hat' = sum_j h_j (A_j x_hat + B_j u + L_j (y - C x_hat)).

    Parameters
    ----------
    A : ndarray (h, n, n), B : ndarray (h, n, m), L : ndarray (h, n, p)
    C : ndarray (p, n)
    """

    A: Array
    B: Array
    L: Array
    C: Array


def rounded(M: Array, real: str) -> Array:
    """A matrix in float64, each number one of the type.

    Parameters
    ----------
    M : ndarray (any shape)
    real : {"float32", "float64"}
    """
    return np.asarray(M, dtype=float).astype(real).astype(float) + 0.0  # no negative zeros


def standard_gains(problem: DescriptorProblem, design: DescriptorDesign, s: Scaling, real: str) -> StandardGains:
    """Constants of an observer in standard form, for the derivative.

    Parameters
    ----------
    problem : DescriptorProblem
        In the plant's units.
    design : DescriptorDesign
        In those of the scaling.
    s : Scaling
    real : {"float32", "float64"}
    """
    T1, T2 = s.factor1(design.T1), s.factor2(design.T2)
    K = np.array([s.gain(k) for k in design.K])
    return StandardGains(*(rounded(M, real) for M in (T2, T1 @ problem.A, T1 @ problem.B, K, problem.C)))


def euler_gains(problem: DescriptorProblem, design: DescriptorDesign, s: Scaling, period: float,
                real: str) -> StandardGains:
    """Constants of the same observer stepped by Euler's rule: z+ = x_hat - T2 y + period z', written in r.

    With y = r + C x_hat this is T1 (E + period A_j) for F, period T1 B_j for G and T2 + period K_j for K: the firmware
    needs no other form for a sampled observer than for one designed in discrete time.

    Parameters
    ----------
    problem : DescriptorProblem
    design : DescriptorDesign
    s : Scaling
    period : float
    real : {"float32", "float64"}
    """
    T1, T2 = s.factor1(design.T1), s.factor2(design.T2)
    K = np.array([s.gain(k) for k in design.K])
    return StandardGains(*(rounded(M, real) for M in (
        T2, T1 @ (problem.E + period * problem.A), period * (T1 @ problem.B), T2 + period * K, problem.C)))


def direct_gains(problem: DescriptorProblem, design: DescriptorDesign, s: Scaling, real: str) -> DirectGains:
    """Constants of an observer in descriptor form.

    Parameters
    ----------
    problem : DescriptorProblem
    design : DescriptorDesign
    s : Scaling
    real : {"float32", "float64"}
    """
    L = np.array([s.injection(k) for k in design.K])
    return DirectGains(*(rounded(M, real) for M in (problem.A, problem.B, L, problem.C)))
