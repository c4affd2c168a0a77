"""Ellipsoids of a point observer: freeze with fixed weights, and the exact proof on the numbers of the C.

For any a > 0, ``M E(X) + E(Q)`` lies in ``E((1 + a) M X M' + (1 + 1/a) Q)``; a is read off the emitted g = 1 + a. The
noise is a sum of segments f_j z_j, |z_j| <= 1, which lies in E(Q) with ``Q = sum(t) sum(f f' / t)`` for any t > 0; the
box e of rounding and left-over constants is one segment per state. What the C's own sums round off ``g M X M'`` is at
most a small share of the weighted trace of X in every entry, hence below a diagonal matrix times that trace (scaled
diagonal dominance): k. All positive definiteness is decided in rationals.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, leading_failure, product, rational, up
from .freeze import nearest
from .rounding import TINY, UNIT
from .set_freeze import _check_reach, raised
from .sets import SetDemands, column

Array = np.ndarray
#: Room of emitted shapes over the exact ones, relative: rounding of their entries and of the sums with them.
ROOM = {"float32": fmpq(1, 2**15), "float64": fmpq(1, 2**40)}


def segments(columns: Array, box: Array, scale: Array) -> Array:
    """Exact Q of a sum of segments and a box, weighted by their length in units of ``scale``.

    Parameters
    ----------
    columns : ndarray (n, c) of fmpq
    box : ndarray (n,) of fmpq
    scale : ndarray (n,) of float

    Returns
    -------
    ndarray (n, n) of fmpq
    """
    diagonal = np.zeros((len(box), len(box)), dtype=object)
    for i, b in enumerate(box):
        diagonal[i] = [b if i == j else fmpq(0) for j in range(len(box))]
    every = np.concatenate([columns, diagonal], axis=1)
    size = np.linalg.norm(np.array([[float(x) for x in row] for row in every]) / scale[:, None], axis=0)
    used = [j for j in range(every.shape[1]) if np.any(every[:, j] != 0)]
    least = 1e-12 * float(size.max()) or 1.0  # where squares are below the numbers of floats; any weight will do
    weight = [Q(max(float(size[j]), least)) for j in used]
    total = sum(weight, fmpq(0))
    out = diagonal * 0
    for j, w in zip(used, weight):
        out = out + total / w * (column(every[:, j]) * every[:, j][None, :])
    return out


class EllipsoidDemands:
    """Smallest noise shapes and rounding factors of the tables of an ellipsoid.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
        Its estimate is read.
    """

    def __init__(self, modes, t):
        self.of, self.t, self.u, self.tiny = SetDemands(modes, t), t, UNIT[t.real], TINY[t.real]
        self.columns = self.of.columns()
        self.scale = np.maximum(t.limit.astype(float), 1e-300)
        self.scale_y = np.maximum(np.maximum(np.abs(t.y_lo), np.abs(t.y_hi)).astype(float), 1e-300)
        self.rests = {m: [self.of.rest(q, m) for q in range(len(modes))] for m in (True, False)}
        self.outputs = [self.of.residual_rest(q) for q in range(len(modes))]

    def noise(self, name: str, q: int, o: int) -> Array:
        """Exact Q of what a step (F, Fb) or the residual (V) adds."""
        box = {"F": self.rests[True], "Fb": self.rests[False], "V": self.outputs}[name][q]
        return segments(self.columns[name][q, o], box, self.scale_y if name == "V" else self.scale)

    def rounding(self, A: Array, weight: Array, g: fmpq) -> Array:
        """Smallest k of rows A (r, n) for weights 1/s^2 of the trace."""
        n = A.shape[1]
        s = np.array([Q(1 / np.sqrt(float(w))) for w in weight], dtype=object)  # powers of two
        m = product(abs(A), column(s)).ravel()
        delta = (2 * n + 8) * self.u * g * fmpq(17, 16)
        return len(A) * delta * m * m

    def small(self, A: Array, g: fmpq) -> fmpq:
        """What flushed products can take from a diagonal entry."""
        n, most = A.shape[1], max([fmpq(1), *abs(A).ravel()])
        return 64 * n**3 * most * most * g * self.tiny


def freeze_ellipsoid(shape_class, modes, estimate: dict, alpha: Array, beta: Array, steady: dict, directions: Array):
    """Build the tables of an ellipsoid for an estimate.

    Parameters
    ----------
    shape_class : type
        ``EllipsoidTables``.
    modes : sequence
    estimate : dict
        Of ``set_freeze.freeze_estimate``.
    alpha : ndarray (2, N)
        Of measured and of blind steps.
    beta : ndarray (N,)
    steady : dict
        "x" (n_x,), "y" (n_y,): smallest half widths that the tangents should be good for; "x_most", "y_most": largest.
    directions : ndarray (m, n_y)

    Returns
    -------
    EllipsoidTables
    """
    real, t = estimate["real"], SimpleNamespace(**estimate)
    demands = EllipsoidDemands(modes, t)
    n_modes, origins = len(modes), len(demands.of.gain)
    weight = 2.0 ** (-2 * np.round(np.log2(np.maximum(steady["x"], 1e-30))))
    weight = weight / weight.max()
    out = {"weight": weight.astype(real), "directions": nearest(directions, real).reshape(-1, t.C.shape[1])}
    for name, noise, factor, matrix, k, share in (("H", "F", "g", demands.of.M, "k", alpha[0]),
                                                  ("Hb", "Fb", "gb", demands.of.A, "kb", alpha[1]),
                                                  ("V", "V", "gr", demands.of.C, "kr", beta)):
        out[factor] = (1.0 + share).astype(real)
        out[k] = np.stack([raised(demands.rounding(matrix[q], out["weight"], Q(out[factor][q])), real)
                           for q in range(n_modes)])
        shapes = [[_bumped(demands, noise, q, o, Q(out[factor][q]), matrix[q]) for o in range(origins)]
                  for q in range(n_modes)]
        out[name] = np.stack([np.stack([nearest(x, real) for x in row]) for row in shapes])
    for first, (a, b) in (("x", ("a", "b")), ("y", ("ay", "by"))):
        out[a], out[b] = tangents(steady[first], steady[first + "_most"], real)
    own = 4 * UNIT[real] * (rational(t.box) + 2 * rational(t.limit)) + 8 * TINY[real]
    out["spread"] = raised(demands.of.carried() * (1 + 4 * UNIT[real]) + own, real)
    out["slack"] = np.array(up(64 * t.C.shape[1] * UNIT[real], real), dtype=real)
    out["floor"] = np.array(up(4096 * t.C.shape[1] ** 3 * TINY[real], real), dtype=real)
    return shape_class(**out)


def _bumped(demands: EllipsoidDemands, noise: str, q: int, o: int, g: fmpq, A: Array) -> Array:
    """The shape to be rounded: exact, and room on the diagonal."""
    exact = g / (g - 1) * demands.noise(noise, q, o)
    for i in range(len(exact)):
        exact[i, i] = exact[i, i] * (1 + 2 * ROOM[demands.t.real]) + 2 * demands.small(A, g)
    return exact


def tangents(least: Array, most: Array, real: str) -> tuple[Array, Array]:
    """Slopes and offsets of tangents of the square root, each point twice the one before: (K, n) each."""
    count = int(np.ceil(np.log2(np.max(most / least)))) + 1 if np.all(least > 0) else 1
    points = least[None] * 2.0 ** np.arange(max(count, 1))[:, None]
    room = Q(1) + 8 * UNIT[real]
    slope = [[up(room / (2 * Q(c)), real) for c in row] for row in points]
    offset = [[up(room * Q(c) / 2 + 4 * TINY[real], real) for c in row] for row in points]
    return np.array(slope, dtype=real), np.array(offset, dtype=real)


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the tables of an ellipsoid in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition and the mode.
    """
    z, demands = t.shape, EllipsoidDemands(modes, t)
    room, names = ROOM[t.real], [m.name for m in modes]
    if np.any(np.log2(z.weight.astype(float)) % 2 != 0):
        raise CertificateError("certificate: a weight of the trace is no power of four.")
    for name, noise, factor, k, matrix in (("H", "F", z.g, z.k, demands.of.M), ("Hb", "Fb", z.gb, z.kb, demands.of.A),
                                           ("V", "V", z.gr, z.kr, demands.of.C)):
        for q, mode in enumerate(names):
            g = Q(factor[q])
            if not g > 1:
                raise CertificateError(f'certificate: weight {float(g):.6g} of {name} in mode "{mode}" (found), '
                                       "expected above 1.")
            if np.any(rational(k[q]) < demands.rounding(matrix[q], z.weight, g)):
                raise CertificateError(f'certificate: the rounding of {name} in mode "{mode}" is not covered.')
            for o in range(len(demands.of.gain)):
                S = rational(getattr(z, name)[q, o])
                lack = S - g / (g - 1) * demands.noise(noise, q, o)
                for i in range(len(S)):
                    lack[i, i] = lack[i, i] - room * S[i, i] - demands.small(matrix[q], g)
                if np.any(S != S.T) or leading_failure(lack) is not None:
                    raise CertificateError(f'certificate: {name} in mode "{mode}" does not hold its noise: the set '
                                           "could lose a residual without fault.")
    _check_bounds(t, demands)
    for q, Z in enumerate(reaches(t, z.weight, z.kr)):
        check_range(t, Q(z.gr[q]) * Z + np.max([np.diagonal(rational(V)) for V in z.V[q]], axis=0))
    _check_reach(t, np.sqrt(len(t.box)))
    return ["the residual lies in its ellipsoid at every sample while no fault acts, so there is no false alarm, for "
            f"any switching, rounding included ({t.real}, with or without fused multiply-add)",
            "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
            "the half widths of the error set stay below "
            f"[{', '.join(f'{x:.4g}' for x in t.limit)}]: a set that would grow beyond starts again from the declared "
            "ranges; the estimate stays in a box"]


def reaches(t, weight: Array, rounding: Array) -> list[Array]:
    """Largest diagonal of ``C X C'`` and its rounding, (n_y,) per mode, while half widths are within their limits."""
    limit = rational(t.limit)
    trace = sum(rational(weight) * limit**2)
    return [(product(abs(rational(C)), column(limit)).ravel() ** 2 + rational(k) * trace) * fmpq(17, 16)
            for C, k in zip(t.C, rounding)]


def check_range(t, squares: Array) -> None:
    """Check that the products of the membership test stay finite for residuals of these squares, (n_y,).

    Raises
    ------
    CertificateError
        An infinite product would be taken for a fault.
    """
    n_y, most = len(squares), max(squares)
    largest = most if n_y == 1 else n_y**2 * most**2
    if 64 * largest > 1 / (2 * TINY[t.real]):
        raise CertificateError(f"certificate: a square of a residual may be {float(most):.3g} (found), and products of "
                               f"such squares are not finite in {t.real}. Use float64, or larger units of x and y.")


def _check_bounds(t, demands: EllipsoidDemands) -> None:
    """Check tangents, spread and the room of the membership test."""
    z, u, tiny = t.shape, demands.u, demands.tiny
    for a, b in ((z.a, z.b), (z.ay, z.by)):
        # (1 + 4u) times the square root of s is below a s + b for every s where 4 a b >= (1 + 4u)^2.
        least = np.min(4 * rational(a) * (rational(b) - 4 * tiny))
        if least < (1 + 4 * u) ** 2:
            raise CertificateError("certificate: a tangent of the square root lies below it.")
    own = 4 * u * (rational(t.box) + 2 * rational(t.limit)) + 8 * tiny
    if np.any(rational(z.spread) < demands.of.carried() * (1 + 4 * u) + own):
        raise CertificateError("certificate: spread, the bounds of x, is too small: they could lose the state.")
    n_y = t.C.shape[1]
    if Q(z.slack) < 64 * n_y * u or Q(z.floor) < 4096 * n_y**3 * tiny:
        raise CertificateError("certificate: the room of the membership test is too small.")
