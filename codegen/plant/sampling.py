r"""A continuous plant at its sampling period, soundly: exact up to bounds that are part of the result.

Plant ``x' = A(theta(t)) x + B(theta(t)) u(t) + Bw w(t)`` in one mode; over a period h the input is held (or keeps
to its rate), w and theta move as they like within bounds and rates, the mode changes at sampling instants only.
With z = [x; u] and ``F = [[A, B], [0, 0]]`` the transition over one period is, by Peano and Baker,

    Phi = I + int F + int int F F + ... ,      F(s) = Fc + sum_j p_j F_j + D(s)

where Fc is the middle of the bounds, p_j what the firmware knows of theta_j (the mean of the measurements at both
ends, or the one at the start) and D what it does not know: how far theta moves from p_j, and the parameters that
nobody measures. Sorted by size, everything in [x; u]:

    Phi0      sum_k h^k Fc^k / k!                                   matrices of the discrete plant
    p_j       sum_k h^k/k! sum_{a+b=k-1} Fc^a F_j Fc^b              their slopes
    s_l       the first-order effect of D, int e^{Fc(h-s)} F_l e^{Fc s} ds, one unknown per parameter
    radius    the rest, bounded elementwise: powers of order k whose factors hold D once at least, or p_j twice
              at least, sum h^k/k! ([|Fc|+Tb+Db]^k - ...), and the tail of the series

With ``interpolation = "quadratic"`` the words with p_j p_k and any number of Fc are not bounded but computed: the
products theta_j theta_k become parameters of the discrete plant that firmware multiplies out itself. Where theta is
read at both ends of a period, its mean is off by less the closer it ran to its rate: ``h |mean - p_j| <= (rate h^2/4)
(1 - (change/(rate h))^2)`` (the path that stays within the rate and reaches both ends); ``paced`` says which unknown
shrinks by that factor.

``scheme`` is the order at which Phi0 and the slopes stop: "euler" (1; the Euler step with a truncation bound,
Chevet (2021)), "second-order" (2; our sound form of Zammali (2020), section 3) and "exponential" (the whole series
to float64). What the shorter ones leave out goes into the radius, so the exponential one is never wider; it may
have more entries that are not zero. Everything is computed in ball arithmetic (Arb) with outward rounding.

The disturbance: ``int Phi w ds = G wbar + rest`` with the mean wbar of w within its bounds and G = int e^{Ac s}
Bw ds; w enters the discrete plant as [wbar; rest] with the rest in a box.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
from flint import arb, ctx

from ..errors import DesignError
from .drive import disturbance, held_fault
from .model import Mode, Plant, Signal
from .period import TERMS, Period, balls, ceiling, middles, size, upper
from .uncertain import SCHEDULED, UncertainMode

Array = np.ndarray
ORDERS = {"euler": 1, "second-order": 2, "exponential": TERMS}


def sampled(plant: Plant) -> Plant:
    """The discrete plant of a continuous one at its sampling period.

    Parameters
    ----------
    plant : Plant
        ``options["sampling"]``: "euler", "second-order" or "exponential" (default).

    Returns
    -------
    Plant
        kind "discrete", modes ``UncertainMode``, w = [mean disturbance; rest of each state].

    Raises
    ------
    DesignError
        The sampling period is far too long for the plant.
    """
    scheme = plant.options.get("sampling", "exponential")
    if scheme not in ORDERS:
        raise DesignError(f"{plant.name}: observer.sampling is {scheme!r}, expected one of {', '.join(ORDERS)}.")
    before, ctx.prec = ctx.prec, 160
    try:
        modes = tuple(_mode(plant, mode, ORDERS[scheme]) for mode in plant.modes)
    except OverflowError:
        raise DesignError(f"{plant.name}: time.sample_period is {plant.sample_period:g} s, so long that the plant "
                          "moves by more than its own size between samples. Choose a shorter one.") from None
    finally:
        ctx.prec = before
    measured = tuple(s for s in plant.theta if s.measured)
    w = tuple(replace(s, name=f"mean_{s.name}") for s in plant.w) + tuple(Signal(f"rest_{s.name}") for s in plant.x)
    return replace(plant, kind="discrete", modes=modes, theta=measured, w=w)


def _mode(plant: Plant, mode: Mode, order: int) -> UncertainMode:
    n, n_u, h = plant.n_x, plant.n_u, arb(float(plant.sample_period))
    m = n + n_u
    lo, hi = plant.theta_box(mode)
    middle, radius = (balls(lo) + balls(hi)) / 2, (balls(hi) - balls(lo)) / 2
    J = len(plant.theta)
    F0, F = balls(np.zeros((m, m))), [balls(np.zeros((m, m))) for _ in range(J)]
    for name, columns in zip(SCHEDULED, (slice(0, n), slice(n, m))):
        F0[:n, columns] = balls(getattr(mode, name))
        for j, slope in enumerate(mode.theta_terms.get(name, [])):
            F[j][:n, columns] = balls(slope)
    Fc = sum((middle[j] * F[j] for j in range(J)), F0)
    known = [j for j, s in enumerate(plant.theta) if s.measured]
    errors = balls([plant.theta[j].error for j in known])
    excursion, average = _excursions(plant, known, radius, h)
    unknown = [radius[j] * F[j] for j in range(J) if j not in known]
    unknown += [e * F[j] for e, j in zip(errors, known) if e.upper() > 0]
    products = tuple(combinations_with_replacement(range(len(known)), 2)) if plant.multiplies_parameters else ()
    period = Period(Fc, [F[j] for j in known], [radius[j] + e for j, e in zip(known, errors)], average, excursion,
                    unknown, h, order, products)
    return _discrete(plant, mode, period, known, middle, lo, hi)


def _excursions(plant: Plant, known: list[int], radius: Array, h: arb) -> tuple[list, list]:
    """Largest |theta - p| and |mean of theta - p| times h, for parameters measured at both ends or at the start."""
    excursion, average = [], []
    both = plant.reads_both_ends
    for j in known:
        width = 2 * radius[j]
        rate = plant.theta[j].rate
        far = width if not np.isfinite(rate) else min(width, arb(float(rate)) * h / (2 if both else 1), key=upper)
        mean = width if not np.isfinite(rate) else min(width, arb(float(rate)) * h / (4 if both else 2), key=upper)
        excursion.append(far)
        average.append(mean * h)
    return excursion, average


def _discrete(plant, mode, period: Period, known, middle, lo, hi) -> UncertainMode:
    n = plant.n_x
    base, spread = middles(period.nominal()[:n])
    slopes, radius = [], period.radius()[:n] + balls(spread)
    shift = base * 0.0
    for j, (F, reach) in enumerate(zip(period.slopes, period.known)):
        slope, off = middles(period.derivative(F, period.order)[:n])
        slopes.append(slope)
        radius = radius + balls(off) * reach
        # The tables take theta itself, not its distance from the middle.
        shift = shift + float(middle[known[j]].mid()) * slope
    slopes = np.array(slopes).reshape(len(known), *base.shape)
    start = base - shift
    exact = balls(base) - sum((middle[known[j]] * balls(slopes[j]) for j in range(len(known))), 0 * balls(base))
    radius = radius + size(exact - balls(start))
    if period.products:
        start, slopes, rounded = _multiplied(period, [middle[j] for j in known], exact, slopes, lo[known], hi[known])
        radius = radius + rounded
    unknowns, of = [], []
    for j, F in period.unknowns():
        value, off = middles(F[:n])
        if np.any(value):
            unknowns.append(value)
            of.append(j)
            radius = radius + balls(off)
    # An unknown that moves with time inside the period reaches the end by e^{F(h-s)} F_l e^{F s}, not by F_l alone:
    # that is order two and in ``radius``.
    unknowns = np.array(unknowns).reshape(len(unknowns), *base.shape)
    bounded = ceiling(radius)
    error = np.array([plant.theta[j].error for j in known])
    reach = [period.h * float(plant.theta[j].rate) for j in known] if plant.multiplies_parameters else []
    # Less than the whole reach counts as unknown only where the change over the period is known without error.
    exact = plant.reads_both_ends & (error == 0)
    paced = [j if reach and j >= 0 and exact[j] and upper(reach[j] / 4) <= hi[known[j]] - lo[known[j]] else -1
             for j in of]
    Bw, w_lo, w_hi = disturbance(plant, mode, period)
    fault = dict(zip(("Bf", "Bf_rad"), held_fault(period, balls(mode.Bf))))
    keep = {k: getattr(mode, k) for k in ("name", "C", "D", "Dv", "Df", "v_lo", "v_hi")}
    return UncertainMode(
        **keep, **fault, A=start[:, :n], B=start[:, n:], Bw=Bw, w_lo=w_lo, w_hi=w_hi, A_theta=slopes[:, :, :n],
        B_theta=slopes[:, :, n:], A_unc=unknowns[:, :, :n], B_unc=unknowns[:, :, n:], A_rad=bounded[:, :n],
        B_rad=bounded[:, n:], theta_lo=(lo[known] - error), theta_hi=(hi[known] + error), products=period.products,
        paced=np.array(paced, dtype=int), reach=ceiling(np.array(reach, dtype=object)))


def _multiplied(period: Period, middle: list, exact: Array, slopes: Array, lo: Array, hi: Array):
    """Base and slopes in theta and its products, of a step that is quadratic in p = theta - middle.

    Parameters
    ----------
    middle : list of arb (J,)
    exact : object array (n, m)
        Base in theta of the linear part.
    slopes : ndarray (J, n, m)
        Of the linear part, in p and in theta alike.
    lo, hi : ndarray (J,)

    Returns
    -------
    base : ndarray (n, m)
    slopes : ndarray (J + products, n, m)
    radius : object array (n, m)
        What rounding of base and slopes may change.
    """
    n = len(exact)
    most = np.maximum(np.abs(lo), np.abs(hi)) + np.array([upper(k) for k in period.known])
    linear, quadratic, radius = [balls(S) for S in slopes], [], 0 * exact
    for j, k in period.products:
        value, off = middles(period.second(j, k)[:n])
        quadratic.append(value)
        radius = radius + balls(off) * period.known[j] * period.known[k]
        # p_j p_k = theta_j theta_k - c_j theta_k - c_k theta_j + c_j c_k
        exact = exact + middle[j] * middle[k] * balls(value)
        linear[j] = linear[j] - middle[k] * balls(value)
        linear[k] = linear[k] - middle[j] * balls(value)
    base, off = middles(exact)
    radius, rounded = radius + balls(off), []
    for S, reach in zip(linear, most):
        value, off = middles(S)
        rounded.append(value)
        radius = radius + balls(off) * arb(float(reach))
    return base, np.array([*rounded, *quadratic]), radius
