r"""What the outputs see of a descriptor system E x' = A x, y = C x, told by three tests that share nothing.

==============  ==========================================  =============================  ============================
                by_rank                                     by_weierstrass                 by_svd
==============  ==========================================  =============================  ============================
regular         defect of T_(n+1) at most n                 gE - A nonsingular for some g  index reduction ends
finite part     n1 = n - defect of T_(n+1); QZ              A1                             consistent states
impulse-free    rank [E 0; A E] = n + rank E                N = 0                          A22 nonsingular
R-observable    rank [sE - A; C] = n, s finite              (A1, C1) observable            no invariant zero
C-observable    and rank [E; C] = n                         and rank [N; C2] = n2          and rank [A22; Cb] = n - r
                                                                                           and ker of (E; C) is 0
I-observable    rank [E A; 0 E; 0 C] = n + rank E           rank [C2 N; C2 N^2 ...] =      rank [A22; Cb] = n - r
                                                            rank N
hidden          eigenvalues that lose the rank              of A1 on the unobservable      invariant zeros
                                                            subspace
==============  ==========================================  =============================  ============================

T_k is the k by k block matrix with E on its diagonal and A below it: its defect is the sum of min(k, size) over the
blocks at infinity of a regular pencil, and grows without end for a singular one. "Detectable" asks the hidden
eigenvalues to decay. Controllability is the same of (E', A', B').

A property of all vertices need not be one of their convex hull: see ``tests/unit/test_properties.py`` for regular,
impulse-free, stable and observable vertices with a middle that is none of it.

References: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, sections 2.4 and A.7 to A.9, equations
(2.37), (2.38); the conditions with Laurent coefficients, a fourth way, are in ``by_laurent``. L. Dai, 1989.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigvals

from . import pencil
from .balance import balanced
from .pencil import laurent, svd_form, weierstrass

Array = np.ndarray
#: Eigenvalues closer than this (times the scale) to the limit of stability count as not decaying.
MARGIN = 1e-7
#: An eigenvalue that is double is computed to half the digits only.
NEAR = 1e-6


@dataclass(frozen=True)
class Visibility:
    """What one test found; where the pencil is singular nothing else is true.

    Parameters
    ----------
    regular, impulse_free : bool
    index : int
        0 where E is nonsingular, -1 for a singular pencil.
    finite : ndarray (n1,) complex
        Finite eigenvalues, sorted.
    r_observable, c_observable, i_observable : bool
        The reachable states, all states, the impulses can be told from the outputs.
    hidden : tuple of complex
        Finite eigenvalues that no output sees.
    scale : float
        Size of the pencil's eigenvalues.
    """

    regular: bool
    impulse_free: bool = False
    index: int = -1
    finite: Array = None
    r_observable: bool = False
    c_observable: bool = False
    i_observable: bool = False
    hidden: tuple[complex, ...] = ()
    scale: float = 1.0

    def decays(self, values, kind: str = "continuous") -> bool:
        """Whether all of these eigenvalues lie clearly within the stable region of continuous or discrete time."""
        values = np.asarray(values, dtype=complex)
        if kind == "discrete":
            return bool(np.all(np.abs(values) < 1 - MARGIN))
        return bool(np.all(values.real < -MARGIN * self.scale))

    def stable(self, kind: str = "continuous") -> bool:
        """Whether all finite eigenvalues decay."""
        return self.regular and self.decays(self.finite, kind)

    def admissible(self, kind: str = "continuous") -> bool:
        """Regular, impulse-free (causal in discrete time) and stable."""
        return self.impulse_free and self.stable(kind)

    def detectable(self, kind: str = "continuous") -> bool:
        """Whether all that no output sees decays."""
        return self.regular and self.decays(self.hidden, kind)


def by_rank(E: Array, A: Array, C: Array) -> Visibility:
    """Judge by ranks of the given matrices alone.

    Parameters
    ----------
    E, A : ndarray (n, n)
    C : ndarray (n_y, n)
    """
    n, scale, E, A, C = _scaled(E, A, C)
    defects = [k * n - rank(_toeplitz(E, A, k)) for k in range(1, n + 2)]
    if defects[-1] > n:
        return Visibility(False)
    index = next((k for k, (a, b) in enumerate(zip([0, *defects], defects)) if a == b), n)
    # The infinite eigenvalues come out as large ones: the n1 smallest are the finite ones.
    finite = eigvals(A, E, homogeneous_eigvals=True)
    order = np.argsort(np.abs(finite[0]) / np.maximum(np.abs(finite[1]), 1e-300))[:n - defects[-1]]
    finite = finite[0][order] / finite[1][order]
    zero = np.zeros_like(E)
    hidden = tuple(s * scale for s in finite
                   if np.linalg.svd(np.vstack([s * E - A, C]), compute_uv=False)[n - 1] < NEAR * max(1.0, abs(s)))
    return Visibility(
        True, rank(np.block([[E, zero], [A, E]])) == n + rank(E), index, _sorted(finite * scale), not hidden,
        not hidden and rank(np.vstack([E, C])) == n,
        rank(np.block([[E, A], [zero, E], [np.zeros_like(C), C]])) == n + rank(E), hidden, scale)


def by_weierstrass(E: Array, A: Array, C: Array) -> Visibility:
    """Judge by the slow and the fast part of the form of Kronecker and Weierstrass.

    Parameters
    ----------
    E, A : ndarray (n, n)
    C : ndarray (n_y, n)
    """
    n, scale, E, A, C = _scaled(E, A, C)
    try:
        form = weierstrass(E, A)
    except ValueError:
        return Visibility(False)
    slow, fast = form.outputs(C)
    unseen = kernel(_kalman(form.A1, slow))
    hidden = np.linalg.eigvals(unseen.T @ form.A1 @ unseen) * scale if unseen.size else ()
    size = max(form.index, 1)
    impulses = np.vstack([fast @ np.linalg.matrix_power(form.N, k) for k in range(1, size + 1)])
    return Visibility(
        True, form.index <= 1, form.index, _sorted(np.linalg.eigvals(form.A1) * scale), not unseen.size,
        not unseen.size and rank(np.vstack([form.N, fast])) == len(form.N), rank(impulses) == rank(form.N),
        tuple(map(complex, hidden)), scale)


def by_svd(E: Array, A: Array, C: Array) -> Visibility:
    """Judge in the coordinates where E = diag(I, 0), by eliminating the algebraic part.

    Parameters
    ----------
    E, A : ndarray (n, n)
    C : ndarray (n_y, n)
    """
    n, scale, E, A, C = _scaled(E, A, C)
    index = _reductions(E, A)
    if index is None:
        return Visibility(False)
    form = svd_form(E, A)
    seen_x, seen_z = np.hsplit(C @ form.Q, [form.r])
    finite = _zeros(form.A11, form.A12, form.A21, form.A22)
    below, right = np.vstack([form.A21, seen_x]), np.vstack([form.A22, seen_z])
    hidden = _zeros(form.A11, form.A12, below, right)
    static = rank(right) == n - form.r
    return Visibility(True, rank(form.A22) == n - form.r, index, _sorted(finite * scale), not hidden.size,
                      not hidden.size and rank(seen_z) == n - form.r, static, tuple(hidden * scale), scale)


def by_laurent(E: Array, A: Array, C: Array) -> tuple[bool, bool, bool]:
    """Judge R-, C- and I-observability of a regular pencil by its Laurent coefficients.

    Parameters
    ----------
    E, A : ndarray (n, n)
    C : ndarray (n_y, n)

    Returns
    -------
    r_observable, c_observable, i_observable : bool

    Raises
    ------
    ValueError
        The pencil is not regular.
    """
    n, _, E, A, C = _scaled(E, A, C)
    phi = laurent(E, A, -n - 1, n - 1)
    seen = {k: C @ p for k, p in phi.items()}
    return (rank(np.vstack([seen[k] for k in range(n)])) == rank(phi[0]),
            rank(np.vstack([seen[k] for k in range(-n, n)])) == n,
            rank(np.vstack([seen[k] for k in range(-n, -1)] or [seen[-2]])) == rank(phi[-2]))


def _scaled(E: Array, A: Array, C: Array) -> tuple[int, float, Array, Array, Array]:
    """The size, the scale of the eigenvalues, and the matrices balanced; the rows of C at norm 1."""
    scale = balanced(E, A)
    C = C * scale.columns
    size = np.linalg.norm(C, axis=1, keepdims=True)
    return len(E), scale.time, *scale.apply(E, A), C / np.where(size > 0, size, 1.0)


def rank(M: Array) -> int:
    """Rank of a matrix computed from balanced ones."""
    return pencil.rank(M, 1.0)


def kernel(M: Array) -> Array:
    """Kernel of a matrix computed from balanced ones."""
    return pencil.kernel(M, 1.0)


def _sorted(values: Array) -> Array:
    return np.sort_complex(np.asarray(values, dtype=complex))


def _toeplitz(E: Array, A: Array, k: int) -> Array:
    return np.kron(np.eye(k), E) + np.kron(np.eye(k, k=-1), A)


def _kalman(A: Array, C: Array) -> Array:
    """[C; C A; C A^2 ...]; A is scaled, so that no power runs away."""
    A = A / max(1.0, np.linalg.norm(A, 2)) if A.size else A
    rows = [C]
    for _ in range(len(A) - 1):
        rows.append(rows[-1] @ A)
    return np.vstack(rows)


def _reductions(E: Array, A: Array) -> int | None:
    """How often the algebraic rows must be differentiated until E is nonsingular (the shuffle algorithm)."""
    for k in range(len(E) + 1):
        r = rank(E)
        if r == len(E):
            return k
        U = np.linalg.svd(E)[0].T
        E, A = np.vstack([(U @ E)[:r], (U @ A)[r:]]), np.vstack([(U @ A)[:r], 0 * A[r:]])
    return None


def _zeros(A: Array, B: Array, C: Array, D: Array) -> Array:
    """Where [sI - A, -B; C, D] loses its full column rank: the eigenvalues on the weakly unobservable subspace.

    That is the largest V with A V in V + B U and C V + D U = 0 for some U. As the pencil is regular, U is unique.
    """
    V = np.eye(len(A))
    while V.shape[1]:
        # Those V a for which some V b and U give  A V a = V b - B U,  C V a = -D U.
        rows = np.block([[A @ V, -V, B], [C @ V, np.zeros((len(C), V.shape[1])), D]])
        parts = kernel(rows)[:V.shape[1]]
        U, sizes, _ = np.linalg.svd(parts, full_matrices=False)
        left = U[:, sizes > pencil.TOLERANCE]
        if left.shape[1] == V.shape[1]:
            break
        V = V @ left
    if not V.shape[1]:
        return np.zeros(0, dtype=complex)
    # A V = V W - B U, C V = -D U: solved for W and U together.
    known = np.vstack([A @ V, C @ V])
    unknown = np.block([[V, -B], [np.zeros((len(C), V.shape[1])), -D]])
    W = np.linalg.lstsq(unknown, known, rcond=None)[0][:V.shape[1]]
    return np.linalg.eigvals(W).astype(complex)
