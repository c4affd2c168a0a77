r"""How far a tracked plant gets: bounds of states, inputs and integrals for all disturbances, references and starts.

The closed loop, no fault, references in their range, starts in the initial box, whatever weights the firmware takes: by
``peaks`` on the exact matrices, with the rounding of every sum of the firmware. x and, between samples, x + T |x'| must
stay within the declared range, which the sampling rests on; u within its range, so that nothing saturates; s within the
limit at which the firmware stops it.

Rounding: a sum of N terms, in any order, with or without fused multiply-add, is off by less than (N + 1) eps times the
sum of its magnitudes; weights add up to 1 within 4 h eps; measurements and references are rounded when they come in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import CertificateError
from .exact import rational
from .peaks import Sums
from .tracking_loop import Loop

Array = np.ndarray


@dataclass(frozen=True)
class Sizes:
    """Largest magnitudes: of states, inputs, measurements, references, s; of a start around its middle; eps.

    Parameters
    ----------
    x : ndarray (n,), u : ndarray (m,), y : ndarray (p,), ref : ndarray (k,), s : ndarray (k,)
    start : ndarray (n,)
        Half widths of the initial box, its middle's size added: |x(0)|.
    eb : ndarray (n,)
        |T1 x(0) - z(0)|.
    eps : float
        Of the number type.
    """

    x: Array
    u: Array
    y: Array
    ref: Array
    s: Array
    start: Array
    eb: Array
    eps: float


@dataclass(frozen=True)
class Rounding:
    """Bounds of what rounding adds to x_hat, r, u, z+ and s+.

    Parameters
    ----------
    x_hat : ndarray (n,), r : ndarray (p,), u : ndarray (m,), z : ndarray (n,), s : ndarray (k,)
    """

    x_hat: Array
    r: Array
    u: Array
    z: Array
    s: Array

    @classmethod
    def of(cls, gains, law, sizes: Sizes) -> Rounding:
        """Count it.

        Parameters
        ----------
        gains : StandardGains
        law : FeedbackLaw
        sizes : Sizes
        """
        h, n, m = gains.G.shape
        unit = (n + m + len(sizes.y) + len(sizes.s) + 5 * h + 8) * sizes.eps * 1.01
        T2, C, F, G, K = (np.abs(M) for M in (gains.T2, gains.C, gains.F, gains.G, gains.K))
        Kx, Ki = np.abs(law.Kx).max(axis=0), np.abs(law.Ki).max(axis=0)
        F, G, K = F.max(axis=0), G.max(axis=0), K.max(axis=0)
        hat = 2 * sizes.x  # |x| and |x - x_hat|, which `envelope` checks
        x_hat = unit * (hat + 2 * T2 @ sizes.y)
        r_size = sizes.y + C @ hat
        r = unit * r_size + C @ x_hat
        u = unit * (Kx @ hat + Ki @ sizes.s) + Kx @ x_hat
        z = unit * (F @ hat + G @ sizes.u + K @ r_size) + F @ x_hat + K @ r
        s = unit * (sizes.s + law.period * (sizes.ref + sizes.y[list(law.rows)]))
        return cls(x_hat, r, u, z, s)


def envelope(found: Loop, gains, law, sizes: Sizes) -> dict[str, Array]:
    """Bounds of the closed loop without fault.

    Parameters
    ----------
    found : Loop
    gains : StandardGains
    law : FeedbackLaw
    sizes : Sizes

    Returns
    -------
    dict
        "eb", "x", "s", "u", "estimate" (of x - x_hat).

    Raises
    ------
    CertificateError
        There are none.
    """
    n, m, k = len(found.error.E), len(sizes.u), len(sizes.s)
    off = Rounding.of(gains, law, sizes)
    matrices = [A for A, _ in found.vertices.values()]
    middle = _middle(matrices)
    rows = [u for u, _ in found.inputs.values()]
    out = np.concatenate([_middle(rows), found.estimate[0]])
    into = _most([_floats(B) for _, B in found.vertices.values()])
    push = _most([_floats(B)[:, :m] for _, B in found.error.pairs.values()])  # what u moves
    e = into.sum(axis=1) + np.concatenate([push @ off.u + np.concatenate([off.z, np.zeros(n)]), off.s])
    D = _most([_floats(A - middle) for A in matrices])
    reached = Sums.of(middle, out).reached(_raised(e), _raised(D), np.concatenate([sizes.eb, sizes.start, np.zeros(k)]))
    xi, u, estimate = np.split(reached, [2 * n + k, 2 * n + k + m])
    apart = _most([_floats(row - out[:m]) for row in rows])
    u = u + apart @ xi + _most([_floats(B) for _, B in found.inputs.values()]).sum(axis=1) + off.u
    estimate = estimate + np.abs(_floats(found.estimate[1])).sum(axis=1) + off.x_hat
    return {"eb": xi[:n], "x": xi[n:2 * n], "s": xi[2 * n:], "u": _raised(u), "estimate": _raised(estimate)}


def limits(bounds: dict[str, Array], sizes: Sizes, inner: dict[str, Array], speed: Array, period: float,
           names: dict) -> Iterator[tuple[str, str, float, float]]:
    """Yield what no number may leave: its name, the limit in words, how far the number gets, and the limit.

    Parameters
    ----------
    bounds : dict
        From `envelope`.
    sizes : Sizes
    inner : dict
        "x", "u" -> how far 0 is from the nearer end of each range: bounds are of magnitudes.
    speed : ndarray (n,)
        Of |x'|.
    period : float
    names : dict
        "x", "u", "s" -> names.
    """
    between = bounds["x"] + period * speed * (1 + 1e-12)
    for vector, reached, most, words in (
            ("x", between, inner["x"], "its declared range"),
            ("u", bounds["u"], inner["u"], "its range: it would saturate"),
            ("s", bounds["s"], sizes.s, "the limit of its integral"),
            ("x", bounds["estimate"], sizes.x, "the size of its range with the error of its estimate")):
        for name, value, limit in zip(names[vector], reached, most):
            yield name, words, float(value), float(limit)


def check_envelope(*given) -> None:
    """Refuse bounds that leave a range; arguments as `limits`.

    Raises
    ------
    CertificateError
        Naming what may leave its range, and by how much.
    """
    for name, words, value, limit in limits(*given):
        if not value <= limit:
            raise CertificateError(
                f'certificate: "{name}" may reach {value:.6g} (found), beyond {words} ({limit:.6g}). Narrow the range '
                "of the reference or the bounds of the disturbances, or widen the range where that is true.")


def start_error(T1: Array, x_lo: Array, x_hi: Array, z0: Array) -> Array:
    """Bound of |T1 x(0) - z(0)| over the initial box.

    Parameters
    ----------
    T1 : object array (n, n)
        Exact.
    x_lo, x_hi : ndarray (n,), z0 : ndarray (n,)
    """
    lo, hi = rational(x_lo), rational(x_hi)
    off = T1 @ ((lo + hi) / 2) - rational(z0)
    return _raised(np.abs(_floats(off)) + np.abs(_floats(T1)) @ _floats((hi - lo) / 2))


def _floats(M) -> Array:
    return np.array([float(x) for x in np.ravel(M)]).reshape(np.shape(M))


def _most(some: list[Array]) -> Array:
    return np.max(np.abs(some), axis=0)


def _middle(some: list[Array]) -> Array:
    return sum(some[1:], some[0]) / len(some)


def _raised(values: Array) -> Array:
    """Upper bounds for what float64 rounded on the way, numbers of magnitudes alone."""
    return np.asarray(values, dtype=float) * (1 + 1e-10)

