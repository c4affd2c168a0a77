"""Thresholds of a polytopic observer's residual, checked exactly: a set of its error that every pair of vertices keeps.

The set is one of ``filter_bounds``, for the recursion of ``polytope_bounds``. A start from anywhere has x in its
declared range and z within its limits, the first one x in the initial box and z at its start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product as pairs_of

import numpy as np

from ..errors import CertificateError
from . import descriptor_bounds, filter_bounds, polytope_bounds, polytope_near
from .exact import Q, rational
from .filter_bounds import Demand, Graph
from .polytope_ranges import middle

Array = np.ndarray


def every_pair(problem):
    """The problem with all pairs of vertices: thresholds do not rest on weights that both compute alike.

    Parameters
    ----------
    problem : DescriptorProblem
    """
    return replace(problem, pairs=tuple(pairs_of(range(len(problem.A)), repeat=2)))


def graph_of(model) -> Graph:
    """Any pair of vertices may follow any other.

    Parameters
    ----------
    model : sequence of JointMode
    """
    return Graph((None,), tuple((0, p, 0) for p in range(len(model))))


def model_of(plant, problem, t, T1: Array, period: float | None, parts=None) -> tuple[tuple, Array]:
    """The recursion of the error and T1 E, for all pairs of vertices.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    T1 : ndarray (n, n) or (h, n, n)
        Not read where the observer solves the algebraic equations itself.
    period : float or None
    parts : Parts, optional
        Of ``polytope_bounds``, where they are at hand.
    """
    if hasattr(t, "algebraic"):
        return descriptor_bounds.model(plant, problem, t, period)
    return polytope_bounds.model(plant, every_pair(problem), t, T1, period, parts)


def starts(plant, t, T1E: Array) -> tuple[Array, Array]:
    """Bounds of |eb| at a start from the initial box, and at one from anywhere; rational (n,).

    Parameters
    ----------
    plant : Plant
    t : PolytopicTables
    T1E : object array (n, n)
    """
    found = []
    for x, z in (((plant.x0_lo, plant.x0_hi), (t.z0, t.z0)), (plant.limits("x"), (t.z_lo, t.z_hi))):
        (mid, half), (at, room) = middle(*x), middle(*z)
        found.append(abs(T1E @ mid - at[t.moving]) + abs(T1E) @ half + room[t.moving])
    return found[0], found[1]


def demands(plant, problem, t, cert: dict, T1: Array, period: float | None) -> Iterator[Demand]:
    """All conditions of a table; each rests on those before it.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    t : PolytopicTables
    cert : dict
        See ``filter_bounds.maps``; "bounds" (1, m); "near", see ``polytope_near.maps``: without it the weights of plant
        and observer are any.
    T1 : ndarray (n, n) or (h, n, n)
    period : float or None

    Yields
    ------
    Demand
        "kept", "start" or "threshold".

    Raises
    ------
    CertificateError
        The certificate is of another shape, boxes are not within each other, or bounds do not come down to the last.
    """
    every = every_pair(problem)
    parts = None if hasattr(t, "algebraic") else polytope_bounds.Parts.of(plant, every, t, T1, period)
    model, T1E = model_of(plant, problem, t, T1, period, parts)
    graph, rows, b = graph_of(model), np.array(cert["rows"], dtype=float), np.array(cert["bounds"], dtype=float)
    found = _maps(plant, every, t, parts, model, cert)
    if b.shape != (1, len(rows)) or not np.all(b >= 0):
        raise CertificateError(f"certificate: bounds of shape {b.shape} (found), expected one row of {len(rows)} that "
                               "are not negative.")
    yield Demand("kept", "a sample later", found.after(graph, b), b, lambda at, needed: (
        f"the set of the error is not kept: row {at[1]} exceeds its bound by {needed[at] - b[at]:.3g}."))
    if not 0 <= t.shift < 16 or t.start not in (0, t.last):
        raise CertificateError(f"certificate: the table of {t.last + 1} rows starts at {t.start}.")
    if not all(np.all(a <= z) and np.all(z <= c) for z in (t.z0, t.z_mid) for a, c in [(t.z_lo, t.z_hi)]):
        raise CertificateError("certificate: z does not start within its limits.")
    if any(Q(a) < Q(c) or Q(b) > Q(d) for a, b, c, d in zip(plant.x0_lo, plant.x0_hi, *plant.limits("x"))):
        raise CertificateError("certificate: the initial box is not within the declared range.")
    first, whole = (filter_bounds.raised(abs(rational(rows)) @ half)[None] for half in starts(plant, t, T1E))
    last = t.start == t.last
    yield Demand("start", f"initial box against the {'last bounds' if last else 'declared range'}", first,
                 b if last else whole, lambda at, needed: "the initial box is not within the last bounds." if last else
                 "the initial box is not within the declared range.")
    for k in range(t.last << t.shift):
        yield _threshold(found.estimate(graph, whole), t.h[k >> t.shift], f"{k} samples after a start")
        whole = found.after(graph, whole)
    if np.any(whole > b):
        raise CertificateError(f"certificate: after {t.last << t.shift} samples bounds of the error still exceed the "
                               "last.")
    yield _threshold(found.estimate(graph, b), t.h[t.last], "in the end")


def check(plant, problem, t, cert: dict, T1: Array, period: float | None) -> None:
    """Check all thresholds of a table; arguments as `demands`.

    Raises
    ------
    CertificateError
        Naming the row that fails.
    """
    for demand in demands(plant, problem, t, cert, T1, period):
        demand.require()


def _threshold(needed: Array, given: Array, when: str) -> Demand:
    return Demand("threshold", when, needed.max(axis=0), given.astype(float), lambda at, needed: (
        f"residual {at[0]} reaches {needed[at]:.6g} {when}, its threshold is {float(given[at]):.6g}."))


def weights_words(polytope, cert: dict) -> str:
    """What the thresholds take the weights of plant and observer to be.

    Parameters
    ----------
    polytope : Polytope
    cert : dict
    """
    if "near" not in cert:
        return "whatever the weights of plant and observer do"
    function = ", exp of the target's library being right to a part in 16384" if polytope.softmax else ""
    return f"with the weights that the model has at the state, and the C at its estimate{function}"


def _maps(plant, problem, t, parts, model, cert: dict):
    """Bounds a sample later: of every pair, or with weights that are near each other where the certificate says so."""
    if "near" not in cert:
        return filter_bounds.maps(model, cert, 0)
    found = None if parts is None else polytope_near.near(plant, problem, t, parts, model)
    if found is None:
        raise CertificateError("certificate: the weights have no slopes here (found), expected some: the thresholds "
                               "rest on them.")
    return polytope_near.maps(model, found, cert)
