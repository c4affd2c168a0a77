r"""The matrix pencil s E - A of a descriptor system E x' = A x: its forms and its expansion.

Regular: det(sE - A) is not zero for every s. Then there are n1 finite eigenvalues (of the slow part) and n2 = n - n1
infinite ones (of the fast part), and nonsingular P, Q take the pencil to the form of Kronecker and Weierstrass,

    P E Q = diag(I, N),    P A Q = diag(A1, I),    N^index = 0.

Index 1 (or 0, where E is nonsingular) means that the system answers no step with an impulse. The form is computed
without a Jordan form, from the resolvent Eh = (gE - A)^-1 E at one real g: the ranges of its powers shrink to the
slow part and their kernels grow to the fast one.

Numerical ranks count singular values above `TOLERANCE` times the largest; matrices are balanced to about norm 1 before.

References: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, sections 2.4.1, A.5 and A.6 (corrected: P
and Q of (A.57) to (A.60) change places, the powers of (A.47) and (A.52) are those of `laurent`); L. Dai, Singular
Control Systems, 1989.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .balance import balanced

Array = np.ndarray
TOLERANCE = 1e-9


def rank(M: Array, size: float = 0.0) -> int:
    """Return the number of singular values above `TOLERANCE` times the largest, or times ``size`` if that is more.

    Parameters
    ----------
    M : ndarray (m, n)
    size : float
        Size of what M was computed from: without it the rank of a rounding error would count.
    """
    values = np.linalg.svd(M, compute_uv=False) if M.size else np.zeros(1)
    return int(np.sum(values > TOLERANCE * max(values[0], size)))


def kernel(M: Array, size: float = 0.0) -> Array:
    """Return an orthonormal basis of the kernel.

    Parameters
    ----------
    M : ndarray (m, n)
    size : float
        As for `rank`.

    Returns
    -------
    basis : ndarray (n, n - rank)
    """
    if not M.size:
        return np.eye(M.shape[1])
    return np.linalg.svd(M)[2][rank(M, size):].T


def regular_shift(E: Array, A: Array) -> float | None:
    """Return a real g at which gE - A is far from singular; None where it is singular for every g.

    det(gE - A) is a polynomial of degree n at most, so n + 1 distinct values of g decide (Theorem A.2.5, with n in
    place of its unknown degree); more are tried, for the best condition.

    Parameters
    ----------
    E, A : ndarray (n, n)
    """
    scale = balanced(E, A)
    E, A = scale.apply(E, A)
    # No round numbers: an eigenvalue sits on those more often than not.
    sizes = np.geomspace(0.057, 9.3, len(E) + 3)
    best, found = TOLERANCE, None
    for g in np.concatenate([sizes, -1.03 * sizes]):
        values = np.linalg.svd(g * E - A, compute_uv=False)
        if values[-1] > best * values[0]:
            best, found = values[-1] / values[0], float(g * scale.time)
    return found


def is_regular(E: Array, A: Array) -> bool:
    """Whether det(sE - A) is not zero for every s.

    Parameters
    ----------
    E, A : ndarray (n, n)
    """
    return regular_shift(E, A) is not None


@dataclass(frozen=True)
class Weierstrass:
    """P E Q = diag(I, N) and P A Q = diag(A1, I).

    Parameters
    ----------
    P, Q : ndarray (n, n)
    A1 : ndarray (n1, n1)
        Its eigenvalues are the finite ones of the pencil.
    N : ndarray (n2, n2)
        Nilpotent.
    index : int
        The first power of N that is zero: 0 where there is no fast part, 1 where the system is impulse-free.
    """

    P: Array
    Q: Array
    A1: Array
    N: Array
    index: int

    def outputs(self, C: Array) -> tuple[Array, Array]:
        """Return what C reads of the slow and of the fast part: C Q = [C1 C2].

        Parameters
        ----------
        C : ndarray (n_y, n)
        """
        return tuple(np.hsplit(C @ self.Q, [len(self.A1)]))


def weierstrass(E: Array, A: Array) -> Weierstrass:
    """Return the form of Kronecker and Weierstrass of a regular pencil.

    Parameters
    ----------
    E, A : ndarray (n, n)

    Returns
    -------
    form : Weierstrass

    Raises
    ------
    ValueError
        The pencil is not regular.
    """
    shift, scale = regular_shift(E, A), balanced(E, A)
    if shift is None:
        raise ValueError("the pencil sE - A is singular for every s")
    E, A = scale.apply(E, A)
    g = shift / scale.time
    resolvent = np.linalg.inv(g * E - A)
    Eh = resolvent @ E
    slow, index = _last_range(Eh)
    other, _ = _last_range(Eh.T)
    Q = np.hstack([slow, kernel(other.T, 1.0)])
    blocks = np.linalg.solve(Q, Eh @ Q)
    n1 = slow.shape[1]
    slow_part, fast_part = np.linalg.inv(blocks[:n1, :n1]), np.linalg.inv(g * blocks[n1:, n1:] - np.eye(len(E) - n1))
    left = np.zeros_like(Q)
    left[:n1, :n1], left[n1:, n1:] = scale.time * slow_part, fast_part
    P = left @ np.linalg.solve(Q, resolvent) * scale.rows
    N = fast_part @ blocks[n1:, n1:] / scale.time if index > 1 else np.zeros_like(fast_part)
    return Weierstrass(P, scale.columns[:, None] * Q, scale.time * (g * np.eye(n1) - slow_part), N, index)


def _last_range(M: Array) -> tuple[Array, int]:
    """Orthonormal basis of the range of M^k for k so large that it does not shrink any more, and that k."""
    size, basis, k = np.linalg.norm(M, 2), np.eye(len(M)), 0
    while basis.shape[1]:
        U, values, _ = np.linalg.svd(M @ basis, full_matrices=False)
        left = int(np.sum(values > TOLERANCE * size))
        if left == basis.shape[1]:
            break
        basis, k = U[:, :left], k + 1
    return basis, k


@dataclass(frozen=True)
class SvdForm:
    """P E Q = diag(I, 0) with r ones, and P A Q = [[A11, A12], [A21, A22]]: differential and algebraic rows.

    Parameters
    ----------
    P, Q : ndarray (n, n)
        Q is orthogonal.
    r : int
        Rank of E.
    A11 : ndarray (r, r), A12 : ndarray (r, n - r)
    A21 : ndarray (n - r, r), A22 : ndarray (n - r, n - r)
        The system is regular and impulse-free where A22 is nonsingular.
    """

    P: Array
    Q: Array
    r: int
    A11: Array
    A12: Array
    A21: Array
    A22: Array


def svd_form(E: Array, A: Array) -> SvdForm:
    """Return the coordinates in which E is the identity on its rank and zero elsewhere.

    Parameters
    ----------
    E, A : ndarray (n, n)
    """
    U, values, Vt = np.linalg.svd(E)
    r, Q = rank(E), Vt.T
    P = U.T / np.concatenate([values[:r], np.ones(len(E) - r)])[:, None]
    top, bottom = np.vsplit(P @ A @ Q, [r])
    return SvdForm(P, Q, r, *np.hsplit(top, [r]), *np.hsplit(bottom, [r]))


def finite_eigenvalues(E: Array, A: Array) -> Array:
    """Return the finite eigenvalues of a regular pencil.

    Parameters
    ----------
    E, A : ndarray (n, n)

    Returns
    -------
    eigenvalues : ndarray (n1,) complex

    Raises
    ------
    ValueError
        The pencil is not regular.
    """
    return np.linalg.eigvals(weierstrass(E, A).A1).astype(complex)


def laurent(E: Array, A: Array, first: int, last: int) -> dict[int, Array]:
    """Return the coefficients Phi_k of (sE - A)^-1 = sum_k Phi_k s^(-k-1), for large |s|.

    Phi_k = Q diag(A1^k, 0) P for k >= 0, and Q diag(0, -N^(-k-1)) P for k < 0, zero below minus the index.

    Parameters
    ----------
    E, A : ndarray (n, n)
    first, last : int
        Smallest and largest k.

    Returns
    -------
    coefficients : dict
        k -> ndarray (n, n).

    Raises
    ------
    ValueError
        The pencil is not regular.
    """
    form = weierstrass(E, A)
    n1 = len(form.A1)
    out = {}
    for k in range(first, last + 1):
        middle = np.zeros_like(form.P)
        if k >= 0:
            middle[:n1, :n1] = np.linalg.matrix_power(form.A1, k)
        else:
            middle[n1:, n1:] = -np.linalg.matrix_power(form.N, -k - 1)
        out[k] = form.Q @ middle @ form.P
    return out
