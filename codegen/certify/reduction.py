"""Proof that a zonotope recursion with order reduction stays bounded, whatever the order and the mode sequence.

Boxing some columns leaves the row sums b of |T^-1 H| as they are, so a step in mode q, reduced in the coordinates T_q,
obeys ``b+ <= |T_l^-1 Ac_q T_q| b + const`` with l the mode that follows. The recursion is therefore bounded for *every*
order if weights c > 0 exist with

    |T_l^-1 Ac_q T_q| c_s <= theta c_t,    theta < 1,    for every step s -> t that the dwell time admits

where a state s is a mode and how long it has lasted. (One c for all is the linear program of the dossier; with a dwell
time c may follow the stay.) The weights are found in floating point and checked in exact rationals on the constants
given. Stability of Ac_q alone is not enough: spectral radii of |Ac_q| above 1 let a small order explode.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_mat
from scipy.sparse import csc_matrix, identity
from scipy.sparse.linalg import spsolve

from ..errors import CertificateError
from .exact import Q, product, rational, up

Array = np.ndarray

#: Contraction factors tried, smallest first; the weights grow like 1/(theta - least).
FACTORS = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999, 0.9999)


@dataclass(frozen=True)
class Steps:
    """All steps from one reduction to the next: state ``source`` to ``target`` by a map of the error.

    Parameters
    ----------
    states : tuple of (int, int)
        Mode, and samples that it has lasted (capped where it no longer matters).
    source, target : tuple of int
        Indices into ``states``, per step.
    powers : tuple of int
        The step is ``Ac_q^power`` of the source's mode q.
    """

    states: tuple[tuple[int, int], ...]
    source: tuple[int, ...]
    target: tuple[int, ...]
    powers: tuple[int, ...]


@dataclass(frozen=True)
class BoxCertificate:
    """Weights and factor that prove a reduced recursion bounded.

    Parameters
    ----------
    steps : Steps
    c : ndarray (S, n)
        Per state, in the coordinates of its mode.
    theta : float
        Below 1.
    """

    steps: Steps
    c: Array
    theta: float


def every_sample(modes: int, dwell: int = 1) -> Steps:
    """List the steps of a recursion that may be reduced at every sample.

    Parameters
    ----------
    modes : int
    dwell : int
        Samples a mode lasts at least.

    Returns
    -------
    steps : Steps
    """
    return every_block(modes, 1, dwell)


def every_block(modes: int, longest: int, dwell: int = 1) -> Steps:
    """List the steps of a recursion that is reduced at a switch and after ``longest`` samples.

    Parameters
    ----------
    modes : int
    longest : int
        J of ``analysis.set_blocks``.
    dwell : int
        Samples a mode lasts at least.

    Returns
    -------
    steps : Steps
    """
    lasted = sorted({min(k * longest, dwell) for k in range(-(-dwell // longest) + 1)})
    states = [(q, s) for q in range(modes) for s in lasted]
    index = {state: i for i, state in enumerate(states)}
    found = []
    for q, s in states:
        found.append((index[q, s], index[q, min(s + longest, dwell)], longest))
        for j in range(max(1, dwell - s), longest + 1):
            found += [(index[q, s], index[other, 0], j) for other in range(modes) if other != q]
    source, target, powers = zip(*found)
    return Steps(tuple(states), source, target, powers)


def box_certificate(Ac: Array, steps: Steps, coordinates: Array | None = None) -> BoxCertificate | None:
    """Find weights that prove the reduced recursion bounded, and check them exactly.

    Parameters
    ----------
    Ac : ndarray (Q, n, n)
        As the firmware holds it.
    steps : Steps
        Of ``every_sample`` or ``every_block``.
    coordinates : ndarray (n, n) or (Q, n, n) or None
        T_q in which the reduction boxes before the next step of mode q.

    Returns
    -------
    certificate : BoxCertificate or None
        None: no weights found, or they do not hold exactly.
    """
    Ac = np.asarray(Ac, dtype=float)
    T = np.eye(Ac.shape[1]) if coordinates is None else np.asarray(coordinates, dtype=float)
    T = np.broadcast_to(T, Ac.shape)
    back = np.linalg.inv(T)
    mode = [q for q, _ in steps.states]
    maps = np.abs([back[mode[t]] @ np.linalg.matrix_power(Ac[mode[s]], p) @ T[mode[s]]
                   for s, t, p in zip(steps.source, steps.target, steps.powers)])
    for factor in FACTORS:
        c = _weights(maps, steps, factor)
        if c is not None:
            found = BoxCertificate(steps, c, factor)
            return found if holds(Ac, found, coordinates) else None
    return None


def _weights(maps: Array, steps: Steps, factor: float) -> Array | None:
    """Least fixed point of ``c_t = 1 + max over steps of map c_s / factor``, by policy iteration.

    For each entry of c_t the step that it comes from is chosen, the linear equations are solved, and steps that ask for
    more are chosen instead; the values grow until nothing does, or the equations have no positive solution.
    """
    source, target = np.array(steps.source), np.array(steps.target)
    count, n = len(steps.states), maps.shape[1]
    maps = np.concatenate([maps, np.zeros((1, n, n))])  # for a state that is only started from
    source = np.append(source, 0)
    into = [np.append(np.flatnonzero(target == t), len(target)) for t in range(count)]
    c = np.ones((count, n))
    for _ in range(200):
        asked = np.einsum("eij,ej->ei", maps, c[source]) / factor
        chosen = np.array([edges[np.argmax(asked[edges], axis=0)] for edges in into])  # (count, n)
        if _ and np.all(1.0 + np.take_along_axis(asked, chosen, axis=0) <= c * (1.0 + 1e-9)):
            return c
        rows = np.repeat(np.arange(count * n), n)
        columns = (source[chosen][:, :, None] * n + np.arange(n)).ravel()
        values = maps[chosen, np.arange(n)].ravel() / factor
        system = identity(count * n, format="csc") - csc_matrix((values, (rows, columns)), shape=(count * n,) * 2)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # singular: no solution is an answer
            c = spsolve(system, np.ones(count * n)).reshape(count, n)
        if not np.all((c >= 1.0 - 1e-6) & (c < 1e7)):
            return None
    return None


def holds(Ac: Array, certificate: BoxCertificate, coordinates: Array | None = None) -> bool:
    """Check a certificate in exact rationals on the constants given.

    Parameters
    ----------
    Ac : ndarray (Q, n, n)
    certificate : BoxCertificate
    coordinates : ndarray (n, n) or (Q, n, n) or None

    Returns
    -------
    proved : bool
    """
    steps, theta = certificate.steps, Q(certificate.theta)
    c = rational(certificate.c)
    if not 0 <= theta < 1 or not np.all(c > 0):
        return False
    exact = _ExactMaps(Ac, coordinates)
    every = zip(steps.source, steps.target, steps.powers)
    return all(np.all(exact.size(steps.states[s][0], steps.states[t][0], p) @ c[s] <= theta * c[t])
               for s, t, p in every)


def largest_hull(Ac: Array, certificate: BoxCertificate, pushed: Array, start: Array,
                 coordinates: Array | None = None, extra: Array | None = None) -> Array:
    """Bound the row sums of |T_q^-1 H| that the recursion can ever have, in exact rationals rounded up.

    With b_s <= kappa c_s before a step, b_t <= theta kappa c_t + |T_t^-1 G| 1 after it: kappa is kept where it is at
    least every row sum of what is pushed over (1 - theta) c_t, and of the start over c_s.

    Parameters
    ----------
    Ac : ndarray (Q, n, n)
    certificate : BoxCertificate
        Of samples (``every_sample``) or of blocks (``every_block``).
    pushed : ndarray (B, Q, n, g)
        Generators that a sample of mode q adds after each mode before; B is 1 or Q + 1.
    start : ndarray (n, g0)
        Generators of the first error; it may start in every mode.
    coordinates : ndarray (n, n) or (Q, n, n) or None
    extra : ndarray (n,) or None
        Half widths of one more box that every step (or block) adds: rounding.

    Returns
    -------
    largest : ndarray (Q, n)
        Where a step (or block) of mode q begins, in its coordinates.

    Raises
    ------
    CertificateError
        The certificate does not hold.
    """
    if not holds(Ac, certificate, coordinates):
        raise CertificateError("reduction: the weights of the box certificate do not hold exactly (found), expected "
                               "|T^-1 Ac T| c <= theta c. Compute them again for these constants.")
    exact, steps = _ExactMaps(Ac, coordinates), certificate.steps
    c, theta = rational(certificate.c), Q(certificate.theta)
    begin, more = rational(start), rational(np.zeros((len(start), 0)) if extra is None else np.diag(extra))
    added = _Added(rational(Ac), rational(pushed))
    kappa = fmpq(0)
    for s, (q, _) in enumerate(steps.states):
        kappa = max(kappa, *(abs(exact.inward(q, begin)).sum(axis=1) / c[s]))
    for s, t, p in zip(steps.source, steps.target, steps.powers):
        for before in range(len(pushed)):
            G = np.concatenate([added.after(before, steps.states[s][0], p), more], axis=1)
            kappa = max(kappa, *(abs(exact.inward(steps.states[t][0], G)).sum(axis=1) / c[t] / (1 - theta)))
    out = np.zeros((len(Ac), c.shape[1]))
    for s, (q, _) in enumerate(steps.states):
        out[q] = np.maximum(out[q], [up(kappa * x) for x in c[s]])
    return out


class _Added:
    """What some samples of a mode add, after each mode before, in rationals; each computed once."""

    def __init__(self, A: Array, W: Array):
        self.A, self.W, self.known = A, W, {}

    def after(self, before: int, q: int, samples: int) -> Array:
        if samples == 1:
            return self.W[before, q]
        if (before, q, samples) not in self.known:
            own = self.W[q if len(self.W) > 1 else 0, q]
            moved = product(self.A[q], self.after(before, q, samples - 1))
            self.known[before, q, samples] = np.concatenate([moved, own], axis=1)
        return self.known[before, q, samples]


class _ExactMaps:
    """T_l^-1 Ac_q^p T_q in rationals, each computed once."""

    def __init__(self, Ac: Array, coordinates: Array | None):
        n = np.shape(Ac)[1]
        T = np.broadcast_to(np.eye(n) if coordinates is None else coordinates, np.shape(Ac))
        self.A, self.T = [_matrix(A) for A in Ac], [_matrix(X) for X in T]
        self.back = [X.inv() for X in self.T]
        self.known: dict = {}

    def size(self, q: int, following: int, power: int) -> Array:
        """Magnitudes of a map."""
        if (q, following, power) not in self.known:
            self.known[q, following, power] = abs(_array(self.back[following] * self.A[q] ** power * self.T[q]))
        return self.known[q, following, power]

    def inward(self, q: int, G: Array) -> Array:
        """T_q^-1 G of rationals."""
        return product(_array(self.back[q]), G)


def _matrix(array: Array) -> fmpq_mat:
    return fmpq_mat([[Q(x) for x in row] for row in np.asarray(array, dtype=float)])


def _array(matrix: fmpq_mat) -> Array:
    out = np.empty((matrix.nrows(), matrix.ncols()), dtype=object)
    out[:] = matrix.tolist()
    return out
