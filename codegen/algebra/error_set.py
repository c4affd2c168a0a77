"""The error of a point observer as a recursion of sets: one for Luenberger and TNL, its noise kept together.

With e the error of the observer and q the mode of sample k (and of the transition k -> k+1)::

    e+ = Ac_q e + W z,    r = C_q e + V z',    every |z_i|, |z'_i| <= 1

A TNL observer reads v_k twice: in x_k through N of the mode before, and in r_k. ``tnl`` propagates
``e_k + N_{q-} Dv v_k`` instead, in which v_k has not acted yet::

    W = [T_q Bw w, -(Ac_q N_{q-} + L_q) Dv v],    V = (I - C N_{q-}) Dv v,    N_{q-} = 0 at k = 0

so that the unreduced set is exact at every sample. (Zammali (2020), Theorem 22, takes the two copies, and v_k and
v_k+1, for independent; with ``together=False`` so does ``tnl``, for comparison.) W and V are indexed [mode before,
mode]; the last "mode before" is none: sample 0. Nothing here depends on what is measured. The sets along a mode
sequence are in ``residual_sets``.

Bounds that are not symmetric: ``centre`` gives the known input and output that the observer has to be told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class ErrorRecursion:
    """The recursion of the error and the residual, Q modes.

    Parameters
    ----------
    A : ndarray (Q, n, n)
        Ac_q = T_q A_q - L_q C.
    C : ndarray (Q, m, n)
    W : ndarray (Q + 1, Q, n, g)
        Generators that the transition of mode q adds after mode i: W[i, q]; i = Q at sample 0.
    V : ndarray (Q + 1, Q, m, s)
        Generators of the residual itself.
    groups : tuple of int
        Columns of W that are images of one box each, in order (disturbance, noise, slack).
    """

    A: Array
    C: Array
    W: Array
    V: Array
    groups: tuple[int, ...]

    @property
    def modes(self) -> int:
        """Number of modes."""
        return len(self.A)

    @property
    def start(self) -> int:
        """Index of "no mode before"."""
        return len(self.A)

    @property
    def pairwise(self) -> bool:
        """Whether the mode before matters."""
        return bool(np.any(np.ptp(self.W, axis=0)) or np.any(np.ptp(self.V, axis=0)))

    def others(self, q: int) -> list[int]:
        """Modes from which q can be entered by a switch."""
        return [i for i in range(self.modes) if i != q]


def stack(value, modes: int, dims: int) -> Array:
    """Return an array with the modes first; what is common to all modes is repeated.

    Parameters
    ----------
    value : array
        With ``dims`` dimensions (common) or one more.
    modes, dims : int

    Returns
    -------
    stacked : ndarray (modes, ...)
    """
    value = np.asarray(value, dtype=float)
    return value if value.ndim == dims + 1 else np.broadcast_to(value, (modes, *value.shape))


def centre(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Split bounds into what the observer is told and what the set holds.

    Parameters
    ----------
    lo, hi : ndarray (..., n)

    Returns
    -------
    middle, half : ndarray (..., n)
        Of w: add ``Bw middle`` to ``B u``. Of v: subtract ``Dv middle`` from y. Of x_0: start there.
    """
    lo, hi = np.asarray(lo, dtype=float), np.asarray(hi, dtype=float)
    return (hi + lo) / 2.0, (hi - lo) / 2.0


def luenberger(A, C, L, Bw, Dv, w, v, slack_x=None, slack_r=None) -> ErrorRecursion:
    """Recursion of ``x^+ = A x^ + B u + L (y - C x^)``.

    Parameters
    ----------
    A : ndarray (Q, n, n)
    C : ndarray (m, n) or (Q, m, n)
    L : ndarray (Q, n, m)
    Bw : ndarray (n, p) or (Q, n, p)
    Dv : ndarray (m, s) or (Q, m, s)
    w : ndarray (p,) or (Q, p)
        Half widths of the disturbance.
    v : ndarray (s,) or (Q, s)
        Half widths of the noise.
    slack_x : ndarray (n,) or (Q, n) or None
        Half widths of one more box per step (rounding of the firmware).
    slack_r : ndarray (m,) or (Q, m) or None

    Returns
    -------
    recursion : ErrorRecursion
    """
    A = np.asarray(A, dtype=float)
    return tnl(A, C, L, np.zeros((len(A), A.shape[1], np.shape(L)[-1])), Bw, Dv, w, v, slack_x=slack_x,
               slack_r=slack_r)


def tnl(A, C, L, N, Bw, Dv, w, v, together: bool = True, slack_x=None, slack_r=None) -> ErrorRecursion:
    """Recursion of ``x^+ = T A x^ + T B u + L (y - C x^) + N y+`` with T = I - N C, q the mode of the transition.

    Parameters
    ----------
    A : ndarray (Q, n, n)
    C : ndarray (m, n) or (Q, m, n)
        The same in all modes where N is not zero.
    L, N : ndarray (Q, n, m)
    Bw : ndarray (n, p) or (Q, n, p)
    Dv : ndarray (m, s) or (Q, m, s)
    w : ndarray (p,) or (Q, p)
        Half widths of the disturbance.
    v : ndarray (s,) or (Q, s)
        Half widths of the noise.
    together : bool
        Keep the two copies of v_k together. False: as Theorem 22, larger.
    slack_x : ndarray (n,) or (Q, n) or None
        Half widths of one more box per step (rounding of the firmware).
    slack_r : ndarray (m,) or (Q, m) or None

    Returns
    -------
    recursion : ErrorRecursion

    Raises
    ------
    ValueError
        C (or Dv and v, where the copies are apart) differs between modes although N is not zero.
    """
    A, L, N = (np.asarray(X, dtype=float) for X in (A, L, N))
    Q, n = len(A), A.shape[1]
    C, Bw, Dv = stack(C, Q, 2), stack(Bw, Q, 2), stack(Dv, Q, 2)
    w, v = stack(w, Q, 1), stack(v, Q, 1)
    noise = Dv * v[:, None, :]
    if np.any(N) and (np.any(np.ptp(C, axis=0)) or not together and np.any(np.ptp(noise, axis=0))):
        raise ValueError("tnl: C or Dv differs between modes (found), expected the same in all where N is not zero.")
    T = np.eye(n) - N @ C
    Ac = T @ A - L @ C
    gust = (T @ Bw) * w[:, None, :]
    after = np.concatenate([N, np.zeros((1, *N.shape[1:]))])  # N of the mode before; none at sample 0
    if together:
        entering = -(Ac[None] @ after[:, None] + L[None]) @ noise[None]
        V = (np.eye(C.shape[1]) - C[None] @ after[:, None]) @ noise[None]
        parts = [np.broadcast_to(gust, (Q + 1, *gust.shape)), entering]
    else:
        copies = [gust, -L @ noise] + ([-N @ noise] if np.any(N) else [])
        parts = [np.broadcast_to(X, (Q + 1, *X.shape)) for X in copies]
        V = np.broadcast_to(noise, (Q + 1, *noise.shape))
    if slack_x is not None:
        parts.append(np.broadcast_to(_diagonal(stack(slack_x, Q, 1)), (Q + 1, Q, n, n)))
    if slack_r is not None:
        extra = _diagonal(stack(slack_r, Q, 1))
        V = np.concatenate([V, np.broadcast_to(extra, (Q + 1, *extra.shape))], axis=-1)
    groups = tuple(X.shape[-1] for X in parts)
    return ErrorRecursion(Ac, C, np.concatenate(parts, axis=-1), np.array(V), groups)


def of_tables(A, C, F, V, e=None, rho=None) -> ErrorRecursion:
    """Recursion of a firmware's tables, the boxes that cover its rounding included.

    Parameters
    ----------
    A : ndarray (Q, n, n)
    C : ndarray (Q, m, n)
    F : ndarray (Q, O, n, g)
        Columns that a step of mode q adds; O is 1, or Q + 1 with the mode before (none last).
    V : ndarray (Q, O, m, s)
    e : ndarray (n,) or (Q, n) or None
        Half widths of the box that each step adds beside F.
    rho : ndarray (m,) or (Q, m) or None
        The same beside V.

    Returns
    -------
    recursion : ErrorRecursion
    """
    A, C, F, V = (np.asarray(X, dtype=float) for X in (A, C, F, V))
    Q = len(A)
    W, V = (np.broadcast_to(np.swapaxes(X, 0, 1), (Q + 1, Q, *X.shape[2:])) for X in (F, V))
    groups: tuple[int, ...] = (W.shape[-1],)
    if e is not None:
        box = _diagonal(stack(e, Q, 1))
        W, groups = np.concatenate([W, np.broadcast_to(box, (Q + 1, *box.shape))], axis=-1), (*groups, box.shape[-1])
    if rho is not None:
        box = _diagonal(stack(rho, Q, 1))
        V = np.concatenate([V, np.broadcast_to(box, (Q + 1, *box.shape))], axis=-1)
    return ErrorRecursion(A, C, np.array(W), np.array(V), groups)


def in_coordinates(m: ErrorRecursion, T: Array) -> ErrorRecursion:
    """Recursion of T^-1 e, with the same residuals: reduced there, a set is boxed in the coordinates T.

    Parameters
    ----------
    m : ErrorRecursion
    T : ndarray (n, n)
        Common to all modes. The first error becomes ``T^-1 H0``.

    Returns
    -------
    recursion : ErrorRecursion
    """
    back = np.linalg.inv(T)
    return ErrorRecursion(back @ m.A @ T, m.C @ T, back @ m.W, m.V, m.groups)


def _diagonal(half: Array) -> Array:
    """Stacked diagonal matrices of stacked vectors."""
    return half[:, :, None] * np.eye(half.shape[1])
