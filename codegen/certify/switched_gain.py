"""Energy gain of a switched system, checked exactly: one inequality per edge of the switching graph.

With V_a(x) = x' P_a x at node a, for every edge a -> b and every [x; d; p] other than zero

    g |d|^2 - |z|^2 + V_a(x) - V_b(x+) > sum over uncertainties of (s' T s - p' T p + 2 s' G p),

T >= 0, G skew. An uncertainty p = Delta s makes its term nonnegative (p = delta s with T, G; |p| <= |s| with
T = tau I), so that sum |z|^2 <= g sum |d|^2 + V(x_0), for every path of the graph and every Delta that may change at
each sample.
The inequality is a positive definite matrix; its numbers are those that the C holds.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, eye, leading_failure, product, rational, zeros

Array = np.ndarray


def closed_loop(m, gains) -> tuple[Array, Array]:
    """[x; s]+ and z of [x; s; d; p], exactly.

    Parameters
    ----------
    m : FilterMode
        Matrices A, E, C, F, Cz, Fz and blocks with H.
    gains : (A, B, C, D) of the filter, as the C holds them; floats, or rationals in other units

    Returns
    -------
    move, out : object arrays
    """
    A, B, C, D = (rational(np.asarray(g)) for g in gains)
    plant = {k: rational(getattr(m, k)) for k in ("A", "E", "C", "F", "Cz", "Fz")}
    n, s = len(plant["A"]), len(A)
    H = [rational(b.H) for b in m.blocks]
    H = np.concatenate(H, axis=1) if H else zeros(n + len(plant["C"]), 0)
    y = np.concatenate([plant["C"], zeros(len(plant["C"]), s), plant["F"], H[n:]], axis=1)
    state = np.concatenate([zeros(s, n), eye(s), zeros(s, y.shape[1] - n - s)], axis=1)
    above = np.concatenate([plant["A"], zeros(n, s), plant["E"], H[:n]], axis=1)
    n_f = len(plant["Cz"])
    target = np.concatenate([plant["Cz"], zeros(n_f, s), plant["Fz"], zeros(n_f, H.shape[1])], axis=1)
    move = np.concatenate([above, product(A, state) + product(B, y)], axis=0)
    return move, product(C, state) + product(D, y) + target


def multiplier(m, proof: list[dict], states: int, name: str) -> Array:
    """The right side of the inequality as a matrix over [x; s; d; p].

    Parameters
    ----------
    m : FilterMode
    proof : list of dict
        Per block "tau", or "T" and "skew" for a repeated number.
    states : int
        Of the filter.
    name : str
        Of the mode, for messages.

    Returns
    -------
    object array

    Raises
    ------
    CertificateError
        A multiplier is not of the form that its uncertainty allows.
    """
    n, n_d = len(m.A), m.E.shape[1]
    size = n + states + n_d
    total = size + sum(b.H.shape[1] for b in m.blocks)
    out, at = zeros(total, total), size
    if len(proof) != len(m.blocks):
        raise CertificateError(f'certificate: mode "{name}" has {len(m.blocks)} uncertainties, {len(proof)} '
                               "multipliers (found).")
    for i, (block, given) in enumerate(zip(m.blocks, proof)):
        k = block.H.shape[1]
        S = rational(block.S)
        S = np.concatenate([S[:, :n], zeros(len(S), states), S[:, n:]], axis=1)
        T, T_p, skew = _forms(block, given, k, len(S), f'certificate: uncertainty {i} of mode "{name}"')
        inside = slice(at, at + k)
        out[:size, :size] += S.T @ T @ S
        out[:size, inside] += S.T @ skew
        out[inside, :size] += (S.T @ skew).T
        out[inside, inside] -= T_p
        at += k
    return out


def _forms(block, given: dict, k: int, rows: int, place: str) -> tuple[Array, Array, Array]:
    """T on s, T on p, and the skew matrix; each checked."""
    if "tau" in given:
        tau = Q(given["tau"])
        if tau < 0:
            raise CertificateError(f"{place}: tau is {given['tau']:.3g} (found), expected at least 0.")
        return tau * eye(rows), tau * eye(k), zeros(rows, k)
    if not block.repeated or rows != k:
        raise CertificateError(f"{place}: it is a full block (found a matrix multiplier), expected tau.")
    T, skew = rational(np.array(given["T"])), rational(np.array(given["skew"]))
    if np.any(T != T.T) or leading_failure(T) is not None:
        raise CertificateError(f"{place}: T is not symmetric and positive definite.")
    if np.any(skew != -skew.T):
        raise CertificateError(f"{place}: the second multiplier is not skew.")
    return T, T, skew


def inequalities(modes, names, switching, gains, proof: dict) -> Iterator[tuple[str, str, Array]]:
    """Every matrix that must be positive definite: first those of Lyapunov, then one per edge.

    Parameters
    ----------
    modes : sequence of FilterMode
    names : sequence of str
    switching : Automaton
        Every mode sequence that is covered is a path of it.
    gains : sequence of (A, B, C, D), one per mode
    proof : dict
        "level2" = gamma^2, "P" per node, "multipliers" per mode.

    Yields
    ------
    kind : {"Lyapunov matrix", "edge"}
    where : str
    S : object array

    Raises
    ------
    CertificateError
        Something is missing, or not of the form that it must have.
    """
    level = Q(proof["level2"])
    nodes = switching.mode
    if len(proof["P"]) != len(nodes):
        raise CertificateError(f"certificate: {len(proof['P'])} Lyapunov matrices (found), expected {len(nodes)}.")
    P = [rational(np.array(p)) for p in proof["P"]]
    for a, p in enumerate(P):
        where = f'of mode "{names[nodes[a]]}" (node {a})'
        if np.any(p != p.T):
            raise CertificateError(f"certificate: the Lyapunov matrix {where} is not symmetric.")
        yield "Lyapunov matrix", where, p
    parts = {}
    for q, m in enumerate(modes):
        move, out = closed_loop(m, gains[q])
        states = len(gains[q][0])
        fixed = -product(out.T, out) - multiplier(m, proof["multipliers"][q], states, names[q])
        for i in range(len(m.A) + states, len(m.A) + states + m.E.shape[1]):
            fixed[i, i] += level
        parts[q] = move, fixed
    for a, b in switching.edges:
        move, fixed = parts[nodes[a]]
        S = fixed - move.T @ P[b] @ move
        k = len(P[a])
        S[:k, :k] += P[a]
        yield "edge", f'from mode "{names[nodes[a]]}" to "{names[nodes[b]]}"', S


def check_gain(modes, names, switching, gains, proof: dict) -> fmpq:
    """Check the level of a filter on the numbers that the C holds; arguments as ``inequalities``.

    Returns
    -------
    fmpq
        The proved gamma^2.

    Raises
    ------
    CertificateError
        Which edge fails.
    """
    level = Q(proof["level2"])
    for kind, where, S in inequalities(modes, names, switching, gains, proof):
        bad = leading_failure(S)
        if bad is not None and kind == "Lyapunov matrix":
            raise CertificateError(f"certificate: the Lyapunov matrix {where} is not positive definite.")
        if bad is not None:
            raise CertificateError(f"certificate: the level {float(level) ** 0.5:.6g} fails {where} (leading minor "
                                   f"{bad + 1} of {len(S)}) on the rounded constants. Try a larger level or float64.")
    return level
