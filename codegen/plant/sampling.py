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
from .model import Mode, Plant, Signal
from .uncertain import SCHEDULED, UncertainMode

Array = np.ndarray
#: Terms of the series; what is beyond is bounded by its tail.
TERMS = 14
ORDERS = {"euler": 1, "second-order": 2, "exponential": TERMS}


def balls(array) -> Array:
    """Object array of exact balls."""
    array = np.asarray(array, dtype=float)
    out = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        out[index] = arb(float(array[index]))
    return out


def mul(A: Array, B: Array) -> Array:
    """Matrix product of balls; an empty inner dimension gives zeros."""
    return balls(np.zeros((A.shape[0], B.shape[1]))) if A.shape[1] == 0 else A @ B


def size(A: Array) -> Array:
    """Elementwise magnitude."""
    return np.array([abs(a) for a in A.ravel()], dtype=object).reshape(A.shape)


def ceiling(A: Array) -> Array:
    """Upper ends of the balls, as float64 rounded up."""
    out = np.array([float(a.upper()) for a in A.ravel()]).reshape(A.shape)
    return np.where(out > 0, np.nextafter(out, np.inf), 0.0)


def middles(A: Array) -> tuple[Array, Array]:
    """Float64 near the middle of each ball, and a bound on its distance from all of the ball."""
    near = np.array([float(a.mid()) for a in A.ravel()]).reshape(A.shape)
    return near, ceiling(size(A - balls(near)))


class Period:
    """The transition of [x; u] over one period in one mode.

    Parameters
    ----------
    Fc, slopes : object arrays (m, m), (J, m, m)
        Middle, and effect of the known parameters.
    known, average, excursion : object arrays (J,)
        Largest |p_j|, and of theta_j - p_j the largest mean and magnitude over the period.
    unknown : object array (S, m, m)
        Effect of what is not known at all, scaled to |s_l| <= 1.
    h : arb
    order : int
    products : tuple of (int, int)
        Pairs of known parameters whose product is computed; empty: bounded.
    """

    def __init__(self, Fc, slopes, known, average, excursion, unknown, h, order, products=()):
        self.Fc, self.slopes, self.h, self.order, self.products = Fc, slopes, h, order, products
        self.average, self.unknown, self.known = average, unknown, known
        m = Fc.shape[0]
        zero = balls(np.zeros((m, m)))
        self.Fb = size(Fc)
        self.Tb = sum((k * size(F) for k, F in zip(known, slopes)), zero)
        self.Db = sum((e * size(F) for e, F in zip(excursion, slopes)), zero) + sum(map(size, unknown), zero)
        self.powers = [balls(np.eye(m))]
        for _ in range(TERMS):
            self.powers.append(mul(self.powers[-1], Fc))
        self.weight = [arb(1)]
        for k in range(1, 2 * TERMS):
            self.weight.append(self.weight[-1] * h / k)

    def series(self, terms) -> Array:
        """Sum of weight[k] * terms[k]."""
        return sum((self.weight[k] * term for k, term in terms), 0 * self.Fc)

    def nominal(self) -> Array:
        """Phi0, with the middle of the squares p_j^2 of the second order."""
        out = self.series((k, self.powers[k]) for k in range(self.order + 1))
        if self.order >= 2 and not self.products:
            for k, F in zip(self.known, self.slopes):
                out = out + self.weight[2] * k * k / 2 * mul(F, F)
        return out

    def derivative(self, F: Array, order: int) -> Array:
        """Derivative of the truncated exponential in the direction F: sum_k h^k/k! sum_{a+b=k-1} Fc^a F Fc^b."""
        return self.series((k, sum((mul(mul(self.powers[a], F), self.powers[k - 1 - a]) for a in range(k)),
                                   0 * self.Fc)) for k in range(1, order + 1))

    def second(self, j: int, k: int) -> Array:
        """Coefficient of p_j p_k: all words with these two and any number of Fc, up to the order."""
        F = self.slopes
        out, plain, with_j, with_k, both = 0 * self.Fc, self.powers[0], 0 * self.Fc, 0 * self.Fc, 0 * self.Fc
        for n in range(1, self.order + 1):
            both = mul(both, self.Fc) + mul(with_j, F[k]) + (mul(with_k, F[j]) if j != k else 0 * self.Fc)
            with_j, with_k = (mul(w, self.Fc) + mul(plain, F[i]) for w, i in ((with_j, j), (with_k, k)))
            plain = self.powers[n]
            out = out + self.weight[n] * both
        return out

    def unknowns(self) -> list[tuple[int, Array]]:
        """First-order effect of each unknown, |s_l| <= 1; time weighted evenly, the rest is in the radius.

        Beside it the known parameter whose mean over the period it is; -1: none.
        """
        first = [(-1, self.weight[1] * F) for F in self.unknown]
        first += [(j, a * F) for j, (a, F) in enumerate(zip(self.average, self.slopes)) if a.upper() > 0]
        if self.order >= 2 and not self.products:  # p_j^2 is in [0, known^2]: half the range is a radius
            first += [(-1, self.weight[2] * k * k / 2 * mul(F, F)) for k, F in zip(self.known, self.slopes)]
        return first

    def radius(self) -> Array:
        """Everything else, elementwise."""
        Fb, Tb, Db, order = self.Fb, self.Tb, self.Db, self.order
        whole, plain, middle = Fb + Tb + Db, Fb, Fb + Tb
        powers = {name: [balls(np.eye(len(Fb)))] for name in ("whole", "plain", "middle")}
        for _ in range(TERMS):
            for name, base in (("whole", whole), ("plain", plain), ("middle", middle)):
                powers[name].append(mul(powers[name][-1], base))
        out, degree = 0 * Fb, [powers["plain"][1], Tb, 0 * Fb]
        for k in range(2, TERMS + 1):
            degree = [mul(x, Fb) + y for x, y in zip(degree, (0 * Fb, *(mul(x, Tb) for x in degree)))]
            # Unknown at least once, from the second order on.
            term = powers["whole"][k] - powers["middle"][k]
            if k <= order:
                # Known parameters twice or more; of the second order the squares p_j^2 are treated apart.
                term = term + powers["middle"][k] - degree[0] - degree[1] - (degree[2] if self.products else 0 * Fb)
                if k == 2 and not self.products:
                    for kj, Fj in zip(self.known, self.slopes):
                        term = term - kj * kj * mul(size(Fj), size(Fj))
            else:
                term = term + powers["middle"][k]
            out = out + self.weight[k] * term
        return out + self.tail(whole, TERMS)

    def tail(self, base: Array, terms: int) -> Array:
        """Bound on sum_{k > terms} h^k/k! base^k, elementwise: a geometric series of the largest row sum."""
        row = max(float((sum(r, arb(0))).upper()) for r in base) if base.size else 0.0
        step = arb(row) * self.h
        ratio = step / (terms + 2)
        if not ratio.upper() < 0.5:
            raise OverflowError
        rest = step ** (terms + 1) / arb.fac_ui(terms + 1) / (1 - ratio)
        return np.full(base.shape, arb(rest.upper()), dtype=object)


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


def upper(x: arb) -> float:
    """Upper end of a ball."""
    return float(x.upper())


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
    paced = [j if reach and plant.reads_both_ends and not error[j] and upper(reach[j] / 4) <= hi[known[j]] - lo[known[j]]
             else -1 for j in of] if reach else [-1] * len(of)
    Bw, w_lo, w_hi = _disturbance(plant, mode, period)
    fault = dict(zip(("Bf", "Bf_rad"), _held_fault(period, balls(mode.Bf))))
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


def _integral(period: Period, n: int) -> Array:
    """int_0^h e^{Ac s} ds, a ball matrix."""
    return sum((period.weight[k + 1] * period.powers[k][:n, :n] for k in range(period.order + 1)),
               0 * period.Fc[:n, :n])


def _held_fault(period: Period, Bf: Array) -> tuple[Array, Array]:
    """Effect of a fault that is held over the period, ``int Phi ds Bf``: float64 matrix, bound on the rest."""
    n = len(Bf)
    whole, plain, Bb = (period.Fb + period.Tb + period.Db)[:n, :n], period.Fb[:n, :n], size(Bf)
    middle, spread = middles(mul(_integral(period, n), Bf))
    rest = balls(spread) + period.h * mul(period.tail(period.Fb + period.Tb + period.Db, TERMS - 1)[:n, :n], Bb)
    p_whole, p_plain = Bb, Bb
    for k in range(1, TERMS + 1):
        p_whole, p_plain = mul(whole, p_whole), mul(plain, p_plain)
        rest = rest + period.weight[k + 1] * (p_whole - (p_plain if k <= period.order else 0 * p_plain))
    return middle, ceiling(rest)


def _disturbance(plant, mode, period: Period) -> tuple[Array, Array, Array]:
    """[mean; rest] of the disturbance: its matrix and bounds."""
    n, h, weight = plant.n_x, period.h, period.weight
    w_lo, w_hi = balls(mode.w_lo), balls(mode.w_hi)
    half, most = (w_hi - w_lo) / 2, np.array([max(abs(a), abs(b), key=upper) for a, b in zip(w_lo, w_hi)], dtype=object)
    Bw, Ab = balls(mode.Bw), period.Fb[:n, :n]
    whole = (period.Fb + period.Tb + period.Db)[:n, :n]
    gain, spread = middles(mul(_integral(period, n), Bw))
    Bb = size(Bw)

    def apply(A: Array, x: Array) -> Array:
        return mul(A, x.reshape(-1, 1)).ravel() if len(x) else np.array([arb(0)] * n, dtype=object)

    rest = apply(balls(spread), most)
    # The mean weighs every instant alike, e^{Ac s} does not: |f - mean f| integrated, f' <= |Ac| e^{|Ac| h} |Bw|.
    term, growth = mul(Ab, Bb), mul(Ab, Bb)
    for k in range(1, TERMS):
        term = mul(Ab, term) * h / k
        growth = growth + term
    tail = period.tail(period.Fb + period.Tb + period.Db, TERMS - 1)[:n, :n]
    growth = growth + mul(tail, mul(Ab, Bb))
    rest = rest + h * h / 4 * apply(growth, half)
    # Parameters away from the middle, and what the truncated integral leaves out.
    p_whole, p_plain, beyond = Bb, Bb, 0 * Bb
    for k in range(1, TERMS + 1):
        p_whole, p_plain = mul(whole, p_whole), mul(Ab, p_plain)
        beyond = beyond + weight[k + 1] * (p_whole - p_plain)
        if k > period.order:
            beyond = beyond + weight[k + 1] * p_plain
    rest = rest + apply(beyond, most) + apply(mul(tail, Bb) * h, most)
    # Inputs that move between samples.
    rates = np.array([arb(float(s.rate)) for s in plant.u], dtype=object)
    if len(rates):
        B_most = (period.Fb + period.Tb + period.Db)[:n, n:]
        term, moved = B_most, 0 * B_most
        for k in range(TERMS):
            moved = moved + weight[k + 2] * term
            term = mul(whole, term)
        moved = moved + mul(tail, B_most) * h * h
        rest = rest + apply(moved, rates)
    box = ceiling(rest)
    Bw_d = np.hstack([gain, np.eye(n)])
    return Bw_d, np.concatenate([mode.w_lo, -box]), np.concatenate([mode.w_hi, box])
