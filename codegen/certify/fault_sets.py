r"""Thresholds of an observer of states and faults, checked exactly: an ellipsoid that its error keeps.

For the recursion of ``fault_bounds``, e+ = N_j e + W_j d with |d_i| <= 1, and every vertex j,

    [a P - N_j' P N_j,  -N_j' P W_j;  *,  D_j - W_j' P W_j]  positive definite,      P > 0, D_j diagonal and >= 0,

makes V = e' P e obey V+ <= a V + tau, tau the largest trace of the D_j, at every sample and for every weights: those
of a sample are a mean of vertices, and V is convex. A row c of the residual is then at most sqrt(V c' P^-1 c).

At a start the error is G xi with |xi_i| <= 1 (x in its box, z known or in its limits), and V at most the sum of
|G' P G|.

Columns of W that move little are put together, one for each row: that makes the set of d larger. The certificate says
which are not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from flint import fmpq

from ..errors import CertificateError
from .exact import Q, inverse, leading_failure, pivots, product, rational, up, zeros
from .fault_bounds import model
from .polytope_ranges import middle

Array = np.ndarray
#: A column is put together with others where all of it is below this share of what its rows are moved by.
SMALL = fmpq(1, 10)
GRID = 2**70


def columns_that_matter(W: Array) -> list[int]:
    """Those that are anywhere more than a share of what their row is moved by.

    Parameters
    ----------
    W : object array (n, q)
    """
    total = abs(W).sum(axis=1)
    return [k for k in range(W.shape[1]) if any(abs(w) > SMALL * t for w, t in zip(W[:, k], total))]


def condensed(W: Array, kept: list[int]) -> Array:
    """Some columns of W, as doubles, and a column per row for the rest.

    Parameters
    ----------
    W : object array (n, q)
    kept : list of int

    Raises
    ------
    CertificateError
        There are no such columns.
    """
    if sorted(set(kept)) != list(kept) or not set(kept) <= set(range(W.shape[1])):
        raise CertificateError(f"certificate: columns {kept} of {W.shape[1]} (found), expected some of them in order.")
    rest = [k for k in range(W.shape[1]) if k not in kept]
    near = rational(np.array([[float(w) for w in row] for row in W[:, kept]]).reshape(len(W), len(kept)))
    left, own = abs(W[:, rest]).sum(axis=1) + abs(W[:, kept] - near).sum(axis=1), zeros(len(W), len(W))
    for i, size in enumerate(left):
        own[i, i] = Q(up(size))
    return np.concatenate([near, own], axis=1)


def unit_bounds(found, P: Array) -> list[fmpq]:
    """Value c' P^-1 c of every row c of what is judged.

    Parameters
    ----------
    found : JointMode
    P : object array (n, n)
    """
    back = inverse(P)
    return [(c[None] @ back @ c[:, None])[0, 0] for c in found.O]


def starts(plant, t, T1E: Array) -> tuple[Array, Array]:
    """G of the error at a start from the initial box, and of one from anywhere; rational (n, k).

    Parameters
    ----------
    plant : Plant
        Its x holds states and faults.
    t : PolytopicTables
    T1E : object array (n, n)
    """
    found = []
    for x, z in (((plant.x0_lo, plant.x0_hi), (t.z0, t.z0)), (plant.limits("x"), (t.z_lo, t.z_hi))):
        (mid, half), (at, room) = middle(*x), middle(*z)
        found.append(np.concatenate([(T1E @ mid - at)[:, None], T1E * half, np.diag(room)], axis=1))
    return found[0], found[1]


def first_level(P: Array, G: Array) -> fmpq:
    """Largest V of G xi, |xi_i| <= 1, at most.

    Parameters
    ----------
    P : object array (n, n), G : object array (n, k)
    """
    return abs(product(G.T, product(P, G))).sum()


def levels(first: fmpq, share: fmpq, tau: fmpq, count: int) -> list[fmpq]:
    """V at most, from a start on; rounded up.

    Parameters
    ----------
    first, share, tau : fmpq
    count : int
    """
    out = [first]
    for _ in range(count):
        after = (share * out[-1] + tau) * GRID
        out.append(fmpq(-((-after.p) // after.q), GRID))
    return out


@dataclass(frozen=True)
class Condition:
    """One condition of a table: what it is about, where, what is left of it, and the words of its refusal.

    "kept" are pivots, "threshold" squares of what thresholds leave: the first must be positive, none may be negative.
    """

    what: str
    where: str
    left: fmpq
    words: str

    def require(self) -> None:
        """Refuse where it does not hold.

        Raises
        ------
        CertificateError
        """
        if self.left < 0 or (self.what == "kept" and self.left == 0):
            raise CertificateError(f"certificate: {self.words}")


def conditions(plant, problem, t, cert: dict, T1: Array, period: float | None, bend: Array) -> Iterator[Condition]:
    """All conditions of a table; each rests on those before it.

    Parameters
    ----------
    plant : Plant
        Its x holds states and faults.
    problem : DescriptorProblem
    t : PolytopicTables
    cert : dict
        "P" (n, n), "kept" columns of W (h, k), "D" (h, k + n), "share", "level".
    T1 : ndarray (n, n)
    period : float or None
    bend : ndarray (n_x,)

    Yields
    ------
    Condition
        "kept", "last", "start" or "threshold".

    Raises
    ------
    CertificateError
        The certificate is of another shape, or boxes are not within each other.
    """
    found, T1E = model(plant, problem, t, T1, period, bend)
    P, share, last = rational(np.array(cert["P"], dtype=float)), Q(cert["share"]), Q(cert["level"])
    if P.shape != (len(T1E), len(T1E)) or np.any(P != P.T) or leading_failure(P) is not None or not 0 <= share < 1:
        raise CertificateError("certificate: P is no symmetric, positive definite matrix, or its share is not in "
                               "[0, 1).")
    tau = fmpq(0)
    for name, m, kept, d in zip(problem.names, found, cert["kept"], cert["D"], strict=True):
        W, D = condensed(m.W, kept), rational(np.array(d, dtype=float))
        if len(D) != W.shape[1] or any(v < 0 for v in D):
            raise CertificateError(f'certificate: D of vertex "{name}" has {len(D)} entries (found), expected '
                                   f"{W.shape[1]} that are not negative.")
        both = np.concatenate([m.J, W], axis=1)
        S, n = -product(both.T, product(P, both)), len(P)
        S[:n, :n] += share * P
        S[n:, n:] += np.diag(D)
        yield Condition("kept", f'vertex "{name}"', min(pivots(S)), f'the ellipsoid of the error is not kept at vertex '
                        f'"{name}". Try float64, a faster decay or larger gains.')
        tau = max(tau, sum(D, fmpq(0)))
    yield Condition("last", "", last - share * last - tau, f"the last level {cert['level']:.6g} of the error is not "
                    "kept.")
    if not 0 <= t.shift < 16 or not 0 <= t.start <= t.last:
        raise CertificateError(f"certificate: the table of {t.last + 1} rows starts at {t.start}.")
    if not all(np.all(a <= z) and np.all(z <= c) for z in (t.z0, t.z_mid) for a, c in [(t.z_lo, t.z_hi)]):
        raise CertificateError("certificate: z does not start within its limits.")
    if any(Q(a) < Q(c) or Q(b) > Q(d) for a, b, c, d in zip(plant.x0_lo, plant.x0_hi, *plant.limits("x"))):
        raise CertificateError("certificate: the initial box is not within the declared range.")
    first, whole = (first_level(P, G) for G in starts(plant, t, T1E))
    sizes, count = unit_bounds(found[0], P), t.last << t.shift
    proved = levels(whole, share, tau, count)
    held = last if t.start == t.last else proved[t.start << t.shift]
    yield Condition("start", f"row {t.start}", held - first, f"the initial box is not within the level of row "
                    f"{t.start}.")
    for k, level in enumerate([*proved[:count], last]):
        for i, (size, room, h) in enumerate(zip(sizes, found[0].room, t.h[min(k >> t.shift, t.last)])):
            when, left = "in the end" if k == count else f"{k} samples after a start", Q(h) - room
            yield Condition("threshold", f"residual {i}, {when}", min(left, left * left - level * size),
                            f"residual {i} reaches {float(level * size) ** 0.5 + float(room):.6g} {when}, its "
                            f"threshold is {float(h):.6g}.")
    yield Condition("last", f"after {count} samples", last - proved[count],
                    f"after {count} samples the error is not within the last level.")


def check(plant, problem, t, cert: dict, T1: Array, period: float | None, bend: Array) -> None:
    """Check all thresholds of a table; arguments as `conditions`.

    Raises
    ------
    CertificateError
        Naming what fails.
    """
    for condition in conditions(plant, problem, t, cert, T1, period, bend):
        condition.require()
