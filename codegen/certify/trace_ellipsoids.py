"""Ellipsoids with weights chosen online: freeze, and the exact proof on the numbers of the C.

With Z = M X M' and S the shape of the noise, ``(1 + 1/a) Z + (1 + a) S`` holds ``M E(X) + E(S)`` for every a > 0, so
for the a that the firmware finds, whatever it is worth. Rounded, the two factors are short of these by a few units at
most; that, and the rounding of Z, is at most a small share of the weighted trace of X in every entry, and so below a
diagonal matrix times that trace: k (as in ``ellipsoids``). S has room for its own. A root is taken of no number below
``least``, which keeps the factors below ``1 + 1 / root(least)`` and every product above the subnormal numbers.

How large the sets can be. Let tau be the weighted trace tr(W X). If ``M_q' W M_q <= theta W`` then tau(Z) is at most
c tau(X), c = theta and what rounding adds, and the best a gives ``root(tau+) = root(tau(Z)) + root(tau(S))``. The a
that is found is worse by ``LOSS`` at most: with s = tau(Z) / tau(S) and e the share by which a exceeds root(s),

    within the tangents, 2^-12 <= s <= 2^36: the smallest tangent is off by 9/8 at most, three of Heron's steps
        e -> e^2 / 2 (1 + e) leave e < 1/1700, and (1 + 1/a) s + (1 + a) is e^2 root(s) above (1 + root(s))^2;
    below, a = 1/64 but for e, and 1 + s + 64 s + 1/64 is (8 root(s) - 1/8)^2 above (1 + root(s))^2: at most 1/64;
    above, the last tangent is s / 2^17 + 2^15 and three steps leave a <= 7/8 root(s) + s / 2^20 + 2^12, s / a is at
        most root(s), so the sum exceeds the best by less than 2^-19 s.

So root(tau) shrinks onto ``root(1 + LOSS) root(tau(S)) / (1 - root((1 + LOSS) c))`` under any switching, and no state's
half width exceeds root(tau / W_i). Where no W of the form that is emitted shrinks in every mode, nothing is claimed;
the firmware's own check of the limits is left, as for the other sets.
"""

from __future__ import annotations

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .ellipsoids import ROOM, EllipsoidDemands, check_range, reaches
from .exact import Q, leading_failure, product, rational, up
from .freeze import nearest
from .rounding import TINY, UNIT
from .set_freeze import _check_reach, raised

Array = np.ndarray
#: Where the tangents touch the root.
POINTS = tuple(16.0**j for j in range(-1, 5))
LEAST = 2.0**-12
#: What the trace may lose by the root that is found, rounding included.
LOSS = fmpq(1, 60)
#: Over a root's square: half widths of the bounds, from a root that is 1/1700 too large.
LONG = fmpq(1001, 1000)
#: Names of noise, its shape, one over its trace, matrix and rounding.
FORMS = (("F", "H", "r", "M", "k"), ("Fb", "Hb", "rb", "A", "kb"), ("V", "V", "rv", "C", "kr"))


def rounding(demands: EllipsoidDemands, A: Array, weight: Array) -> Array:
    """Smallest k of rows A (r, n): those of fixed weights of one, and six units for the factors."""
    n = A.shape[1]
    return demands.rounding(A, weight, fmpq(2 * n + 16, 2 * n + 8))


def small(demands: EllipsoidDemands, A: Array) -> fmpq:
    """What flushed products can take from a diagonal entry, times the largest factor."""
    return demands.small(A, fmpq(2) / Q(np.sqrt(LEAST)))


def powers(sizes: Array) -> Array:
    """Weights, powers of four, that make these sizes about 1."""
    return 4.0 ** -np.round(np.log2(np.maximum(sizes, 1e-30)))


def freeze(shape_class, modes, t, weight: Array, weight_y: Array, directions: Array):
    """Build the tables for an estimate.

    Parameters
    ----------
    shape_class : type
        ``TraceTables``.
    modes : sequence
    t : object
        Estimate of ``set_freeze.freeze_estimate``, as attributes.
    weight : ndarray (n_x,), weight_y : ndarray (n_y,)
        Powers of four.
    directions : ndarray (m, n_y)

    Returns
    -------
    TraceTables
    """
    real, demands = t.real, EllipsoidDemands(modes, t)
    out = {"weight": weight.astype(real), "weight_y": weight_y.astype(real),
           "directions": nearest(directions, real).reshape(-1, t.C.shape[1])}
    for noise, S, inverse, matrix, k in FORMS:
        A = getattr(demands.of, matrix)
        own = weight_y if noise == "V" else weight
        out[k] = np.stack([raised(rounding(demands, a, out["weight"]), real) for a in A])
        out[S] = np.stack([np.stack([nearest(_bumped(demands, noise, q, o, a), real)
                                     for o in range(len(demands.of.gain))]) for q, a in enumerate(A)])
        trace = np.einsum("i,qoii->qo", own, out[S].astype(float))
        out[inverse] = np.minimum(1 / np.maximum(trace, 1e-30), 2.0**60).astype(real)
    points = np.array(POINTS)
    out |= {"a": (0.5 / points).astype(real), "b": (points / 2).astype(real), "least": np.array(LEAST, real)}
    out |= {name: np.array([up(x, real) for x in _scale(w, real)], real)
            for name, w in (("scale", out["weight"]), ("scale_y", out["weight_y"]))}
    out["spread"] = raised(_spread(demands), real)
    out["slack"] = np.array(up(64 * t.C.shape[1] * UNIT[real], real), dtype=real)
    out["floor"] = np.array(up(4096 * t.C.shape[1] ** 3 * TINY[real], real), dtype=real)
    return shape_class(**out)


def _bumped(demands: EllipsoidDemands, noise: str, q: int, o: int, A: Array) -> Array:
    """The shape to be rounded: exact, and room on the diagonal."""
    exact = demands.noise(noise, q, o)
    for i in range(len(exact)):
        exact[i, i] = exact[i, i] * (1 + 2 * ROOM[demands.t.real]) + 2 * small(demands, A)
    return exact


def _scale(weight: Array, real: str) -> list[fmpq]:
    """One over the root of each weight, larger by the rounding of a root and its product."""
    return [(1 + 8 * UNIT[real]) * Q(1 / np.sqrt(float(w))) for w in weight]


def _spread(demands: EllipsoidDemands) -> Array:
    t, u = demands.t, demands.u
    return demands.of.carried() * (1 + 4 * u) + 4 * u * (rational(t.box) + 2 * rational(t.limit)) + 8 * demands.tiny


def prove(modes, t, proof: dict) -> dict:
    """Make the certificate; ``check`` accepts it.

    Parameters
    ----------
    modes : sequence
    t : PointTables
    proof : dict
        Of the gains; kept beside what is proved of the set.

    Returns
    -------
    dict

    Raises
    ------
    CertificateError
    """
    cert = {**proof, "set": "ellipsoid_trace", "steady_box": None, "shrink": None}
    theta = shrinkage(t)
    found = _steady_trace(t, theta) if theta.max() < 1 else None
    if found is not None:
        half = np.sqrt(found / t.shape.weight.astype(float)) * (1 + 1e-9)
        width = np.array([float(x) for x in _width(t, half)]) * (1 + 1e-9)
        cert |= {"shrink": theta.tolist(), "trace": found, "steady_box": {
            "half": half.tolist(), "hi": (width / 2).tolist(), "lo": (width / 2).tolist(), "width": width.tolist()}}
    check(modes, t, cert)
    return cert


def shrinkage(t) -> Array:
    """Smallest theta of each mode with M' W M <= theta W, a little more, (N,)."""
    s = np.sqrt(t.shape.weight.astype(float))
    return np.array([np.linalg.norm(s[:, None] * M / s, 2) ** 2 for M in t.M.astype(float)]) * (1 + 1e-6) + 1e-9


def _steady_trace(t, theta: Array) -> float | None:
    """Weighted trace that the set comes below in every mode."""
    least = 0.0
    for q, share in enumerate(theta):
        carried, added = (np.sqrt(float(x)) for x in _parts(t, q, share))
        if carried >= 1:
            return None
        least = max(least, added / (1 - carried))
    return float(least**2 * (1 + 1e-6))


def _parts(t, q: int, theta: float) -> tuple[fmpq, fmpq]:
    """What is carried of the trace, ``(1 + LOSS) c``, and added to it, ``(1 + LOSS) tau(S)``, rounding inside."""
    z, u = t.shape, UNIT[t.real]
    w, k = rational(z.weight), rational(z.k[q])
    most = 1 + LOSS + 16 * len(w) * u
    flushed = 2**20 * TINY[t.real] * sum(w)
    traces = [sum((w[i] * Q(S[i, i]) for i in range(len(w))), fmpq(0)) for S in z.H[q]]
    return most * (Q(theta) + 3 * sum(w * k)), most * max(traces) + flushed


def _width(t, half: Array) -> Array:
    """Ultimate width of the bounds of x for half widths of the set: roots are up to ``LONG`` too large."""
    room = 4 * UNIT[t.real] * (rational(t.box) + rational(t.limit)) + 8 * TINY[t.real]
    least = np.array([Q(np.sqrt(LEAST) / np.sqrt(float(w))) for w in t.shape.weight], dtype=object)
    return 2 * (LONG * np.maximum(rational(half), least) + np.max(rational(t.shape.spread), axis=0)) + room


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the tables in exact arithmetic; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming the condition and the mode.
    """
    z, demands, room = t.shape, EllipsoidDemands(modes, t), ROOM[t.real]
    if any(np.log2(w) % 2 != 0 for w in (*z.weight.astype(float), *z.weight_y.astype(float))):
        raise CertificateError("certificate: a weight of the trace is no power of four.")
    for noise, name, _, matrix, k in FORMS:
        A = getattr(demands.of, matrix)
        for q, mode in enumerate(modes):
            if np.any(rational(getattr(z, k)[q]) < rounding(demands, A[q], z.weight)):
                raise CertificateError(f'certificate: the rounding of {name} in mode "{mode.name}" is not covered.')
            for o in range(len(demands.of.gain)):
                S = rational(getattr(z, name)[q, o])
                lack = S - demands.noise(noise, q, o)
                for i in range(len(S)):
                    lack[i, i] = lack[i, i] - room * S[i, i] - small(demands, A[q])
                if np.any(S != S.T) or leading_failure(lack) is not None:
                    raise CertificateError(f'certificate: {name} in mode "{mode.name}" does not hold its noise: the '
                                           "set could lose a residual without fault.")
    _check_roots(t, demands)
    _check_range(t)
    _check_reach(t, np.sqrt(len(t.box)))
    claims = ["the residual lies in its ellipsoid at every sample while no fault acts, so there is no false alarm, for "
              f"any switching, rounding included ({t.real}, with or without fused multiply-add)",
              "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
              "the half widths of the error set stay below "
              f"[{', '.join(f'{x:.4g}' for x in t.limit)}]: a set that would grow beyond starts again from the "
              "declared ranges; the estimate stays in a box"]
    if cert.get("steady_box"):
        _check_steady(t, cert, [m.name for m in modes])
        width = cert["steady_box"]["width"]
        claims.append(f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], for arbitrary "
                      "switching: the ellipsoid's weighted trace shrinks in every mode")
    return claims


def _check_roots(t, demands: EllipsoidDemands) -> None:
    """Check what a root starts from, the scales, spread and the room of the membership test."""
    z, u, tiny, n_y = t.shape, demands.u, demands.tiny, t.C.shape[1]
    if float(z.least) != LEAST or not (np.array_equal(z.b, np.array(POINTS) / 2)
                                       and np.array_equal(z.a, 0.5 / np.array(POINTS))):
        raise CertificateError("certificate: the tangents that a root starts from are not those of the proof.")
    w = rational(z.weight)
    for shape, value in zip(z.H.reshape(-1, len(w), len(w)), z.r.ravel()):
        if abs(Q(value) * sum(w * np.diagonal(rational(shape))) - 1) > 16 * len(w) * u:
            raise CertificateError("certificate: r is not one over the weighted trace of H.")
    for scale, weight in ((z.scale, z.weight), (z.scale_y, z.weight_y)):
        if np.any(rational(scale) < np.array(_scale(weight, t.real), dtype=object)):
            raise CertificateError("certificate: a scale is too small: a root could lie below that of its number.")
    if np.any(rational(z.spread) < _spread(demands)):
        raise CertificateError("certificate: spread, the bounds of x, is too small: they could lose the state.")
    if Q(z.slack) < 64 * n_y * u or Q(z.floor) < 4096 * n_y**3 * tiny:
        raise CertificateError("certificate: the room of the membership test is too small.")
    if len(t.box) * 4 * u > ROOM[t.real]:
        raise CertificateError(f"certificate: {len(t.box)} states (found) for the room of the noise.")


def _check_range(t) -> None:
    """Check that no residual's square overflows in the membership test: factors are below 130, a V below Z and V."""
    z = t.shape
    wy, reach = rational(z.weight_y), reaches(t, z.weight, z.kr)
    for q, Z in enumerate(reach):
        noise = max(sum(w * Q(x) for w, x in zip(wy, np.diagonal(V))) for V in z.V[q])
        check_range(t, (132 * sum(wy * Z) + 4 * noise) * np.maximum(1 / wy, 1))


def _check_steady(t, cert: dict, names: list[str]) -> None:
    """Check that the weighted trace comes below the certificate's, and the widths that follow."""
    w = rational(t.shape.weight)
    W = np.array([[w[i] if i == j else fmpq(0) for j in range(len(w))] for i in range(len(w))], dtype=object)
    trace, half = Q(cert["trace"]), np.array(cert["steady_box"]["half"])
    if trace > 2**36:
        raise CertificateError("certificate: the weighted trace is beyond what the roots are good for.")
    for q, (name, theta) in enumerate(zip(names, cert["shrink"])):
        M = rational(t.M[q])
        if leading_failure(Q(theta) * W - product(M.T, product(W, M))) is not None:
            raise CertificateError(f'certificate: the weighted trace does not shrink by {theta:.6g} in mode "{name}".')
        parts = _parts(t, q, theta)
        carried, added = (Q(np.sqrt(float(x)) * (1 + 1e-12)) for x in parts)
        # (root(carried trace) + root(added))^2 <= trace, by roots that are checked to be upper bounds
        whole = Q(np.sqrt(float(trace)) * (1 - 1e-12))
        if carried**2 < parts[0] or added**2 < parts[1] or whole**2 > trace or carried >= 1:
            raise CertificateError(f'certificate: the weighted trace grows in mode "{name}".')
        if carried * whole * (1 + fmpq(1, 10**11)) + added > whole:
            raise CertificateError(f'certificate: the weighted trace exceeds {float(trace):.6g} in mode "{name}".')
    if np.any(w * rational(half) ** 2 < trace) or np.any(rational(cert["steady_box"]["width"]) < _width(t, half)):
        raise CertificateError("certificate: the steady half widths are too small for the weighted trace.")
