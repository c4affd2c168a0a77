"""Plant and filter as one recursion on the numbers of the C: what moves e = [x; xi], and by how much at most.

In mode p, with the filter's constants as emitted and the plant's matrices as exact rationals,

    e+ = J e + W d + sum_l h_l p_l,    |d_i| <= 1,    |p_l| <= |S_l e| + weight_l |e| + room_l,
    f_hat = O e + V d + ...,           J = [A 0; L C M],  O = [Dy C  K].

The p_l are what is uncertain in [A B], one number per row and parameter; the elementwise rest; and what the C rounds of
xi (in proportion to the terms of its sums). d holds disturbance and noise at their bounds, the inputs at their ranges
(a filter that cancels them exactly lets nothing of that through), and the rounding of y and u on their way in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import fmpq

from .exact import eye, product, rational, zeros
from .rounding import TINY, UNIT, input_error

Array = np.ndarray


@dataclass(frozen=True)
class Push:
    """One unknown: its column h, and S, weight, room of its bound; all rational object arrays.

    ``seen`` (n_f,) is how much of it f_hat holds at once, in magnitude.
    """

    h: Array
    S: Array
    weight: Array
    room: fmpq
    seen: Array


@dataclass(frozen=True)
class JointMode:
    """One mode; n = n_x + n_s.

    Parameters
    ----------
    J : object array (n, n), W : object array (n, g)
    pushes : tuple of Push
    O : object array (n_f, n)
    weight : object array (n_f, n), room : object array (n_f,)
        ``|f_hat| <= |O e| + weight |e| + room``.
    """

    J: Array
    W: Array
    pushes: tuple[Push, ...]
    O: Array  # noqa: E741
    weight: Array
    room: Array


def joint(modes, t) -> tuple[JointMode, ...]:
    """The recursion of every mode.

    Parameters
    ----------
    modes : sequence
        Of the plant as the firmware sees it (``Mode`` or ``UncertainMode``).
    t : FilterTables

    Returns
    -------
    tuple of JointMode
    """
    return tuple(joint_mode(m, t, q) for q, m in enumerate(modes))


def sizes(lo: Array, hi: Array) -> Array:
    """Largest magnitudes, exactly."""
    lo, hi = rational(lo), rational(hi)
    return np.array([max(abs(a), abs(b)) for a, b in zip(lo, hi)] or zeros(0), dtype=object)


def _column(values: Array) -> Array:
    return values.reshape(-1, 1)


def joint_mode(m, t, q: int) -> JointMode:
    """The recursion of mode ``m`` of the plant with the filter's constants of mode q."""
    n_x, n_s = m.A.shape[0], len(t.limit)
    A, B, effects, rest = parts(m)
    C, D, Dv = (rational(getattr(m, k)) for k in ("C", "D", "Dv"))
    Bw, Dw = rational(m.Bw), rational(_feedthrough(m))
    M, G, L, K, Du, Dy = (rational(getattr(t, k)[q]) for k in ("M", "G", "L", "K", "Du", "Dy"))
    u, y = sizes(t.u_lo, t.u_hi), sizes(t.y_lo, t.y_hi)
    w, v = sizes(m.w_lo, m.w_hi), sizes(m.v_lo, m.v_hi)
    slip = [np.array([input_error(x, t.real) for x in z] or zeros(0), dtype=object) for z in (u, y)]
    J = np.concatenate([np.concatenate([A, zeros(n_x, n_s)], axis=1),
                        np.concatenate([product(L, C), M], axis=1)], axis=0)
    # Columns of disturbance, noise, input as read, and of what it and y differ by from it in the plant.
    inputs = ((Bw * w, Dw * w, None, None), (zeros(n_x, len(v)), Dv * v, None, None),
              (B * u, D * u, G * u, Du * u), (B * slip[0], D * slip[0], None, None),
              (zeros(n_x, len(y)), np.diag(slip[1]) if len(y) else zeros(0, 0), None, None))
    W, direct = [], []
    for to_x, to_y, to_xi, to_f in inputs:
        own = product(L, to_y) if to_y is not None else zeros(n_s, to_x.shape[1])
        seen = product(Dy, to_y) if to_y is not None else zeros(len(Dy), to_x.shape[1])
        W.append(np.concatenate([to_x, own if to_xi is None else own + to_xi], axis=0))
        direct.append(seen if to_f is None else seen + to_f)
    nothing, true = zeros(len(K)), u + slip[0]
    pushes = []
    for effect in others(m, effects):
        for i, row in enumerate(effect):
            if any(row != 0):
                h = _unit(i, n_x + n_s) if i < n_x else np.concatenate([zeros(n_x), L[:, i - n_x]])
                room = _size(row[n_x:], np.concatenate([w, v, true]))
                pushes.append(Push(h, _padded(row[:n_x], n_s), zeros(n_x + n_s), room,
                                   nothing if i < n_x else abs(Dy[:, i - n_x])))
    pushes += [Push(_unit(i, n_x + n_s), zeros(n_x + n_s), _padded(row[:n_x], n_s), _size(row[n_x:], true), nothing)
               for i, row in enumerate(rest) if any(row != 0)]
    rate, tiny = _rate(t, n_s)
    for i in range(n_s):
        size = _size(G[i], u) + _size(L[i], y)
        weight = np.concatenate([zeros(n_x), rate * abs(M[i])])
        pushes.append(Push(_unit(n_x + i, n_x + n_s), zeros(n_x + n_s), weight, rate * size + tiny, nothing))
    weight = np.concatenate([zeros(len(K), n_x), rate * abs(K)], axis=1)
    fixed = abs(np.concatenate(direct, axis=1)).sum(axis=1)
    room = np.array([a + rate * (_size(d, u) + _size(e, y)) + tiny for a, d, e in zip(fixed, Du, Dy)], dtype=object)
    return JointMode(J, np.concatenate(W, axis=1), tuple(pushes), np.concatenate([product(Dy, C), K], axis=1), weight,
                     room)


def rounding_of(t, which: str, q: int) -> list[fmpq]:
    """What the model holds for the rounding of each sum of a filter whose state is within its limits.

    Parameters
    ----------
    t : FilterTables
    which : {"estimate", "forward"}
    q : int

    Returns
    -------
    list of fmpq
    """
    rate, tiny = _rate(t, len(t.limit))
    own = ("K", "Du", "Dy") if which == "estimate" else ("M", "G", "L")
    state, of_u, of_y = (rational(getattr(t, name)[q]) for name in own)
    u, y, limit = sizes(t.u_lo, t.u_hi), sizes(t.y_lo, t.y_hi), rational(t.limit)
    return [rate * (_size(a, limit) + _size(b, u) + _size(c, y)) + tiny for a, b, c in zip(state, of_u, of_y)]


def _feedthrough(m) -> Array:
    found = getattr(m, "Dw", None)
    return np.zeros((len(m.C), m.Bw.shape[1])) if found is None else found


def _unit(i: int, n: int) -> Array:
    return eye(n)[i]


def _padded(row: Array, more: int) -> Array:
    return np.concatenate([row, zeros(more)])


def _size(row: Array, bound: Array) -> fmpq:
    return sum((abs(a) * b for a, b in zip(row, bound)), fmpq(0))


def _rate(t, n_s: int) -> tuple[fmpq, fmpq]:
    """What a sum in the C can be off by, relative to the sizes of its terms, and in addition."""
    terms = n_s + t.L.shape[2] + t.G.shape[2]
    return (terms + 2) * UNIT[t.real] * fmpq(101, 100), 4 * (terms + 1) * TINY[t.real]


def others(m, effects: list[Array]) -> list[Array]:
    """Effects on [x+; y] over [x; w; v; u], from those on x+ over [x; u] and what the other matrices hold."""
    n_x, n_y, n_w, n_v, n_u = len(m.A), len(m.C), m.Bw.shape[1], m.Dv.shape[1], m.B.shape[1]
    more, out = getattr(m, "more", {}), []
    at = {"C": (n_x, 0), "Bw": (0, n_x), "Dw": (n_x, n_x), "Dv": (n_x, n_x + n_w), "D": (n_x, n_x + n_w + n_v)}
    for k, effect in enumerate(effects):
        whole = zeros(n_x + n_y, n_x + n_w + n_v + n_u)
        whole[:n_x, :n_x], whole[:n_x, n_x + n_w + n_v:] = effect[:, :n_x], effect[:, n_x:]
        for name in set(more) & set(at) if k < len(m.A_unc) else ():
            value, (i, j) = rational(more[name][k]), at[name]
            whole[i:i + value.shape[0], j:j + value.shape[1]] = value
        out.append(whole)
    return out


def parts(m) -> tuple[Array, Array, list[Array], Array]:
    """Middle of A and B, effects of numbers in [-1, 1] on [A B], and elementwise bounds of the rest; exact.

    Measured parameters count as unknown: the filter does not read them.
    """
    A, B = rational(m.A), rational(m.B)
    n_x, n_u = A.shape[0], B.shape[1]
    if getattr(m, "A_unc", None) is None:
        return A, B, [], zeros(n_x, n_x + n_u)
    effects = [np.concatenate([rational(a), rational(b)], axis=1) for a, b in zip(m.A_unc, m.B_unc)]
    for a, b, lo, hi in zip(m.A_theta, m.B_theta, rational(m.theta_lo), rational(m.theta_hi)):
        a, b = rational(a), rational(b)
        A, B = A + (lo + hi) / 2 * a, B + (lo + hi) / 2 * b
        effects.append((hi - lo) / 2 * np.concatenate([a, b], axis=1))
    return A, B, effects, np.concatenate([rational(m.A_rad), rational(m.B_rad)], axis=1)


def boxes(t, x0_lo: Array, x0_hi: Array) -> tuple[Array, Array]:
    """Half widths about zero of x in the initial box and in the declared range, exactly."""
    return sizes(x0_lo, x0_hi), sizes(t.x_lo, t.x_hi)
