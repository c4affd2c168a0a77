"""What order statistics say of thresholds that are the largest values of runs without fault.

Of N independent runs of one kind, each with m statistics, let every threshold be the k-th largest value of its
statistic. A further run of that kind exceeds any of them with a probability of at most p, except with a chance of

    P(Bin(N, p) < k m)        over the N runs; for k = m = 1 that is (1 - p)^N

whatever the distribution is: the thresholds are no lower than those of Tukey's blocks (the k runs largest in the first
statistic taken out, then of the rest the k largest in the second, ...), whose coverage is beta-distributed, and ties
only help. So a calibrated threshold is a statement about runs like those drawn, never about all that the bounds admit.

Source: S. S. Wilks, Determination of sample sizes for setting tolerance limits, Ann. Math. Stat. 12, 1941; J. W. Tukey,
Non-parametric estimation II, Ann. Math. Stat. 18, 1947.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

Array = np.ndarray


def confidence(runs: int, probability: float, blocks: int = 1) -> float:
    """Confidence that a further run exceeds the thresholds with at most a given probability.

    Parameters
    ----------
    runs : int
        N, independent.
    probability : float
        p, between 0 and 1.
    blocks : int
        k m: rank of the thresholds times their number.

    Returns
    -------
    float
        1 - P(Bin(N, p) < k m), summed exactly and rounded down.

    Raises
    ------
    ValueError
        A number is out of its range.
    """
    value = float(exact_confidence(runs, probability, blocks))
    return max(float(np.nextafter(value, 0.0)), 0.0)


def exact_confidence(runs: int, probability: float, blocks: int = 1) -> Fraction:
    """The same, as a fraction.

    Parameters
    ----------
    runs : int
    probability : float
    blocks : int

    Returns
    -------
    Fraction

    Raises
    ------
    ValueError
        A number is out of its range.
    """
    if not 0 < probability < 1 or runs < 0 or blocks < 1:
        raise ValueError(f"confidence: {runs} runs, probability {probability}, {blocks} blocks (found), expected "
                         "0 < probability < 1 and at least one block.")
    if runs < blocks:
        return Fraction(0)
    p, q = (Fraction(probability).numerator, Fraction(1 - Fraction(probability)).numerator)
    whole = Fraction(probability).denominator
    term, total = q**runs, 0  # C(N, i) p^i q^(N - i), all over whole^N
    for i in range(blocks):
        total += term
        term = term * (runs - i) * p // ((i + 1) * q)  # exact: q divides, as does i + 1
    return 1 - Fraction(total, whole**runs)


def runs_needed(probability: float, wanted: float, blocks: int = 1) -> int:
    """Fewest runs for a confidence.

    Parameters
    ----------
    probability : float
    wanted : float
        Confidence below 1.
    blocks : int

    Returns
    -------
    int

    Raises
    ------
    ValueError
        A number is out of its range.
    """
    if not 0 < wanted < 1:
        raise ValueError(f"runs_needed: a confidence of {wanted} (found), expected one between 0 and 1.")
    high = max(blocks, 1)
    while confidence(high, probability, blocks) < wanted:
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if confidence(middle, probability, blocks) >= wanted else (middle, high)
    return high


def largest_values(values: Array, rank: int = 1) -> Array:
    """The rank-th largest value of each statistic.

    Parameters
    ----------
    values : ndarray (N, ...)
        A row per run.
    rank : int
        k: 1 is the largest.

    Returns
    -------
    ndarray (...)

    Raises
    ------
    ValueError
        Fewer runs than that, or a value is NaN.
    """
    values = np.asarray(values)
    if not 1 <= rank <= len(values) or np.isnan(values).any():
        raise ValueError(f"largest_values: rank {rank} of {len(values)} runs, {int(np.isnan(values).sum())} values NaN "
                         "(found), expected 1 to the number of runs, and numbers.")
    return np.sort(values, axis=0)[len(values) - rank]


@dataclass(frozen=True)
class Calibration:
    """Thresholds of a campaign and what may be said of them.

    Parameters
    ----------
    thresholds : ndarray (...)
        One per statistic.
    runs : int
    steps : int
        Samples of a run.
    rank : int
    probability : float
        A further run exceeds any threshold with at most this probability, ...
    confidence : float
        ... with at least this confidence.
    seed : int
    conditions : tuple of str
        What the runs had in common: beyond it nothing is said.
    """

    thresholds: Array
    runs: int
    steps: int
    rank: int
    probability: float
    confidence: float
    seed: int = 0
    conditions: tuple[str, ...] = ()


def calibrate(values: Array, probability: float, steps: int = 1, rank: int = 1) -> Calibration:
    """Thresholds of given statistics.

    Parameters
    ----------
    values : ndarray (N, ...)
        The statistics of each of N independent runs, such as the largest residual of each channel.
    probability : float
    steps : int
    rank : int

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
    """
    values = np.asarray(values)
    level = confidence(len(values), probability, rank * max(int(np.prod(values.shape[1:])), 1))
    return Calibration(largest_values(values, rank), len(values), steps, rank, probability, level)
