r"""Surely detected faults where parameters and unknowns move the error recursion itself.

The adjoint of ``adjoint`` follows one recursion; here M(theta) may be another one at every sample. What matters is how
large the errors ``e_hi = x_hi - x`` and ``e_lo = x - x_lo`` to the true, *faulty* state can still be: both residual
bounds are sums of them with weights >= 0. With M split by sign (``M_neg`` takes the opposite bound) they obey

    e_hi+ = M_pos e_hi + M_neg e_lo + b_hi + g f,    e_lo+ = M_pos e_lo + M_neg e_hi + b_lo - g f,
    g     = L(theta) Df + N Df+ - T (Bf + [-1, 1] Bf_rad)

so only the closed loop carries a fault on, never the plant's own dynamics. No b is larger than its largest value
without a fault, the radii included: these are bounded over the declared ranges, in which state and framers stay. Errors
that obey the same recursion without f therefore keep to their ultimate box, and the faulty ones exceed those by at most

    s+ = M s + g f       at the worst corner of theta, per pair of modes; s = [s_hi; s_lo], from 0 before the onset.

Rows of s are upper bounds: s_hi = -s_lo as long as there is one mode and no parameter. With a change of coordinates s
is that of z (Z stands for T), and ``of_x`` makes that of x of it.

How much too large: at the first delay with a promise some run hides 0.9 of it or more on most of the gallery's plants,
0.65 to 0.7 of it where modes differ much; at later delays about half (tests/synthesis/test_robust.py).

Assumed is what the bounds always rest on: the state stays in its declared range, *the effect of the fault included*. A
cut to that range makes no error larger, with one exception: a framer beyond the far end, x_hi below the least or x_lo
above the largest declared value, is put back to it. A channel that acts on outputs only is promised for that case too
(zero joins s). A fault on the state (Bf) can hide in it, on a state at the very end of its range: it is promised while
x_hi stays above the least and x_lo below the largest declared value, as ``out`` shows; so they do wherever the state
keeps farther from the ends of its range than the fault has moved the bounds past it.
"""

from __future__ import annotations

import numpy as np

from ..algebra.interval import neg, pos, support

Array = np.ndarray


def fault_free(modes, t, tails) -> tuple[Array, Array]:
    """Largest r_hi and -r_lo of each output without a fault (n_modes, n_y); ``tails`` bounds both errors."""
    above, below = [], []
    for q, m in enumerate(modes):
        C, (z_hi, z_lo) = m.C, of_x_errors(t, tails)
        most, least = support(m.Dv, m.v_lo, m.v_hi), -support(-m.Dv, m.v_lo, m.v_hi)
        c_hi, c_lo = np.asarray(t.c_hi[q], float), np.asarray(t.c_lo[q], float)
        margin = np.maximum(c_hi - most, least - c_lo)
        above.append(pos(C) @ z_hi + neg(C) @ z_lo + c_hi - least + margin)
        below.append(pos(C) @ z_lo + neg(C) @ z_hi - c_lo + most + margin)
    return np.array(above), np.array(below)


def of_x(t, errors: Array) -> Array:
    """Bounds of [e_hi; e_lo] of x for those of the state of the recursion."""
    if t.change is None:
        return errors
    X, (hi, lo) = t.change.X.astype(float), np.split(errors, 2)
    return np.concatenate([pos(X) @ hi + neg(X) @ lo, pos(X) @ lo + neg(X) @ hi])


def of_x_errors(t, tails) -> tuple[Array, Array]:
    """Bounds on both errors of x for those of the state; the offsets b count twice, as they cover their rounding."""
    if t.change is None:
        return tails
    hi, lo = np.split(of_x(t, np.concatenate(tails)), 2)
    return hi + 2 * abs(t.change.b_hi.astype(float)), lo + 2 * abs(t.change.b_lo.astype(float))


def steps_of(t) -> list[tuple[int, Array, Array, Array]]:
    """(mode, closed loop of [e_hi; e_lo], L, N) for every mode and corner of theta, float64."""
    out, vary = [], t.vary
    for q in range(len(t.M_hi)):
        M, L, N = (np.asarray(getattr(t, f"{k}_hi")[q], float) for k in "MLN")
        for corner in vary.corners(q):
            M_at, L_at = (base + np.tensordot(corner[:len(slopes[q])], slopes[q].astype(float), 1)
                          for base, slopes in ((M, vary.M), (L, vary.L)))
            same, opposite = np.where(t.flipped[q], 0.0, M_at), np.where(t.flipped[q], -M_at, 0.0)
            out.append((q, np.block([[same, opposite], [opposite, same]]), L_at, N))
    return out


def both(push: Array, radius: Array) -> Array:
    """What a push moves [e_hi; e_lo] by, at most."""
    return np.concatenate([radius + push, radius - push])


def thresholds(modes, t, tails, channel: int, within: int) -> tuple[float, ...]:
    """Smallest surely detected step of one channel for delays 0..within; inf where there is none.

    Parameters
    ----------
    modes : sequence of UncertainMode
        Of the plant as the firmware sees it.
    t : FramerTables
    tails : (ndarray (n_x,), ndarray (n_x,))
        Ultimate bounds of both errors.
    channel : int
    within : int

    Returns
    -------
    tuple of float
        Worse of the two signs of the fault; never increasing.
    """
    # The recursion runs in double precision; a part in a million covers its own rounding generously.
    sizes = np.maximum(*(needed(modes, t, tails, channel, within, sign) for sign in (1.0, -1.0))) * (1 + 1e-6)
    return tuple(float(x) for x in sizes)


def needed(modes, t, tails, channel: int, within: int, sign: float) -> Array:
    """``thresholds`` for a fault of one sign."""
    rooms = fault_free(modes, t, tails)
    if t.vary.late:  # the mode that is told may be another one
        rooms = [np.broadcast_to(room.max(axis=0), room.shape) for room in rooms]
    Bf, rad, Df = ([f[:, channel] for f in fs] for fs in (
        [sign * m.Bf for m in modes], [m.Bf_rad for m in modes], [sign * m.Df for m in modes]))
    hides = not np.any(Bf)
    steps = steps_of(t)
    shift = np.array([np.max([both(N @ d, 0 * (N @ d)) for _, _, _, N in steps], axis=0) for d in Df])
    found, out = np.full(len(modes), np.inf), []
    for _ in range(within + 1):
        shift = np.maximum(shift, 0.0) if hides else shift
        found = np.minimum(found.max(), [smallest(m, of_x(t, s), d, up, down)
                                         for m, s, d, up, down in zip(modes, shift, Df, *rooms)])
        out.append(found.max())
        moved = []
        for p, M, L, N in steps:
            T = (np.eye(len(L)) if t.change is None else t.change.Z.astype(float)) - N @ modes[p].C
            # A mode that is told late: its sample may have been taken with the tables of any other.
            for r in range(len(modes)) if t.vary.late else (p,):
                apart = np.abs(T) @ rad[r]
                moved.append([M @ shift[r] + both(L @ Df[r] + N @ d - T @ Bf[r], apart) for d in Df])
        shift = np.max(moved, axis=0)
    return np.array(out)


def smallest(m, shift: Array, Df: Array, above: Array, below: Array) -> float:
    """Size of a fault from which some residual bound is out; a unit of it moves the errors by ``shift`` at most."""
    n = m.C.shape[1]
    hi, lo = shift[:n], shift[n:]
    fall = np.concatenate([Df - pos(m.C) @ hi - neg(m.C) @ lo, -Df - pos(m.C) @ lo - neg(m.C) @ hi])
    room = np.concatenate([above, below])
    return float(np.min(np.divide(room, fall, out=np.full(len(room), np.inf), where=fall > 1e-12 * room)))
