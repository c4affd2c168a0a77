"""Which order, key and coordinates a zonotope is reduced with: proved bounded, else seen to settle, else refused.

Coordinates with a box certificate (``reduction``) come first; among them the ones with the smallest sets along mode
sequences that the dwell time admits. Without any, larger orders are tried by simulation alone: a set that settles along
all of them is called "simulated", not proved. Boxing in modal coordinates helps where the modes' bases are well
conditioned, and harms where eigenvalues nearly coincide; hence the trial.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra import zonotope
from ..algebra.bases import bases
from ..algebra.dwell import patterns
from ..algebra.error_set import ErrorRecursion
from ..errors import CertificateError
from .reduction import BoxCertificate, box_certificate, every_sample

Array = np.ndarray

#: Mode sequences that a choice is tried on.
MOST_PATHS = 30


@dataclass(frozen=True)
class Reduction:
    """How a zonotope is to be reduced.

    Parameters
    ----------
    order : int
    key : {"squared", "girard"}
    name : str
        Of the coordinates.
    coordinates : ndarray (Q, n, n) or None
        None: those of x.
    certificate : BoxCertificate or None
        None: settled in simulation only.
    ratio : float
        Mean half width of the residual over the exact one along the sequences tried.
    """

    order: int
    key: str
    name: str
    coordinates: Array | None
    certificate: BoxCertificate | None
    ratio: float

    @property
    def proved(self) -> bool:
        """Whether the set is bounded for every admissible sequence."""
        return self.certificate is not None


def choose(m: ErrorRecursion, order: int, dwell: int, H0: Array, most: int | None = None, limit: float = 3.0,
           steps: int = 150) -> Reduction:
    """Choose coordinates, key and order so that the reduced set stays bounded.

    Parameters
    ----------
    m : ErrorRecursion
        With the constants that the firmware holds.
    order : int
        Wanted.
    dwell : int
        Samples a mode lasts at least.
    H0 : ndarray (n, g)
        Generators of the first error.
    most : int or None
        Largest order; None: four times the wanted one.
    limit : float
        An order that is not proved is taken only below this mean ratio to the exact set.
    steps : int
        Length of the sequences simulated.

    Returns
    -------
    choice : Reduction

    Raises
    ------
    CertificateError
        Nothing settles; names the mode and the spectral radius of |Ac_q|.
    """
    every = patterns(m.modes, dwell, steps)
    paths = np.array(every[::-(-len(every) // MOST_PATHS)])
    exact = _widths(m, paths, H0, None, "", None)
    found = []
    for name, T in bases(m.A):
        certificate = box_certificate(m.A, every_sample(m.modes, dwell), T)
        if certificate is not None:
            for key in zonotope.KEYS:
                ratio, _ = _trial(m, paths, exact, H0, order, key, T)
                found.append(Reduction(order, key, name, T, certificate, ratio))
    if found:
        return min(found, key=lambda r: r.ratio * (1.0 if r.name == "x" else 1.02))  # other coordinates have to pay
    for larger in range(order, (most or 4 * order) + 1, max(1, order // 2)):
        for key in zonotope.KEYS:
            ratio, settled = _trial(m, paths, exact, H0, larger, key, None)
            if settled and ratio < limit:
                found.append(Reduction(larger, key, "x", None, None, ratio))
        if found:
            return min(found, key=lambda r: r.ratio)
    radii = [max(abs(np.linalg.eigvals(np.abs(A)))) for A in m.A]
    worst = int(np.argmax(radii))
    raise CertificateError(f"mode {worst}: the reduced set of order {order} grows without bound: spectral radius of "
                           f"|Ac| {radii[worst]:.4g} (found), expected below 1, and no other coordinates or order up "
                           f"to {most or 4 * order} settles for a dwell time of {dwell} samples. Use tables = "
                           '"arbitrary" (reduction once per block), a longer dwell time, or a faster decay.')


def _trial(m: ErrorRecursion, paths: Array, exact: Array, H0: Array, order: int, key: str,
           T: Array | None) -> tuple[float, bool]:
    """Mean ratio to the exact half widths, and whether the last third is no larger than the middle one."""
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = zonotope.ratio(_widths(m, paths, H0, order, key, T), exact)
    third = len(ratio) // 3
    middle, last = ratio[third:2 * third].max(axis=0), ratio[2 * third:].max(axis=0)
    return float(ratio[third:].mean()), bool(np.all(last <= 1.02 * middle))


def _widths(m: ErrorRecursion, paths: Array, H0: Array, order: int | None, key: str, T: Array | None) -> Array:
    """Half widths (K, S, m) of the residual sets of S paths (S, K), as ``residual_sets.zonotopes`` has them."""
    H = np.broadcast_to(np.asarray(H0, dtype=float), (len(paths), *np.shape(H0)))
    before, out = np.full(len(paths), m.start), []
    back = None if T is None else np.linalg.inv(T)
    for q in paths.T:
        out.append(np.abs(m.C[q] @ H).sum(axis=2) + np.abs(m.V[before, q]).sum(axis=2))
        if order is not None and H.shape[2] > order:
            H = _reduced(H, order, key) if T is None else T[q] @ _reduced(back[q] @ H, order, key)
        H = np.concatenate([m.A[q] @ H, m.W[before, q]], axis=2)
        before = q
    return np.array(out)


def _reduced(H: Array, order: int, key: str) -> Array:
    """``zonotope.reduce`` of many sets at once (which of several equal columns is kept may differ)."""
    size = np.abs(H)
    value = (H * H).sum(axis=1) if key == "squared" else size.sum(axis=1) - size.max(axis=1)
    H = np.take_along_axis(H, np.argsort(-value, axis=1)[:, None], axis=2)
    kept = order - H.shape[1]
    box = np.abs(H[:, :, kept:]).sum(axis=2)
    return np.concatenate([H[:, :, :kept], box[:, :, None] * np.eye(H.shape[1])], axis=2)
