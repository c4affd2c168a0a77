r"""Largest values that a system of bounded inputs reaches: M^k summed up in ball arithmetic, with its tail.

    xi+ = (M + G(k)) xi + d(k),    |G(k)| <= D,  |d(k)| <= e,  |xi(0)| <= x0    elementwise, G and d as they like.

With S >= sum_k |M^k|, A >= |M^k| for every k: every b >= A x0 + S (e + D b) bounds |xi| at all times, by induction. The
same sums of rows O M^k bound an output O xi, sharper than |O| b. The first K terms are computed in balls of `BITS`
bits; if |M^K| p <= q p for a p > 0 and a q < 1, then what follows is within q/(1 - q) of the first K, in terms of p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb_mat, ctx

from ..errors import CertificateError

Array = np.ndarray
BITS, LONGEST, LEFT = 160, 4000, 1e-3
#: What sums of upper bounds in float64 are raised by: more than the rounding of LONGEST of them.
RAISE = 1 + 1e-9


@dataclass(frozen=True)
class Sums:
    """Bounds of |O M^k| for rows O, the identity above them: their sum over all k, and the largest.

    Parameters
    ----------
    total : ndarray (n + n_o, n)
    most : ndarray (n + n_o, n)
    """

    total: Array
    most: Array

    @classmethod
    def of(cls, M: Array, O: Array) -> Sums:  # noqa: E741
        """Sum up.

        Parameters
        ----------
        M : object array (n, n), O : object array (n_o, n)
            Exact.

        Raises
        ------
        CertificateError
            The powers of M do not die away.
        """
        before, ctx.prec = ctx.prec, BITS
        try:
            return cls._of(arb_mat(M.tolist()), arb_mat(O.tolist()) if len(O) else None)
        finally:
            ctx.prec = before

    @classmethod
    def _of(cls, M, O) -> Sums:  # noqa: E741
        n = M.nrows()
        power, rows = arb_mat([[int(i == j) for j in range(n)] for i in range(n)]), O
        total, most, far = 0.0, 0.0, _upper(rows) if O is not None else np.zeros((0, n))
        far = np.vstack([np.eye(n), far])
        for k in range(LONGEST):
            size = _upper(power) if rows is None else np.vstack([_upper(power), _upper(rows)])
            if k and k % 16 == 0:
                left, p = size[:n], total[:n].sum(axis=1)
                q = float(np.max(left @ p / p)) * RAISE
                if q < LEFT:
                    # A column of the sum is at most c p; what follows of it is within c q/(1 - q) p.
                    c = (total[:n] / p[:, None]).max(axis=0)
                    tail = q / (1 - q) * np.outer(far @ p, c)
                    return cls((total + tail) * RAISE, np.maximum(most, tail) * RAISE)
            total, most = total + size, np.maximum(most, size)
            power = power * M
            rows = None if rows is None else rows * M
        raise CertificateError(f"certificate: after {LONGEST} samples the system still remembers its start (found), "
                               "expected a system that decays. Ask for a faster decay.")

    def reached(self, e: Array, D: Array, x0: Array) -> Array:
        """Return bounds of [xi; O xi], without what disturbs the outputs themselves.

        Parameters
        ----------
        e : ndarray (n,), D : ndarray (n, n), x0 : ndarray (n,)

        Raises
        ------
        CertificateError
            What D adds grows without end.
        """
        n, start = self.total.shape[1], self.most @ x0
        b = start[:n]
        for _ in range(1000):
            after = (start[:n] + self.total[:n] @ (e + D @ b)) * RAISE
            if np.all(after <= b * (1 + 1e-12)):
                break
            b = np.maximum(b, after)
            if not np.max(b) < 1e12 * (1 + np.max(start) + np.max(e)):
                break
        b = b * (1 + 1e-6)
        if not np.all((start[:n] + self.total[:n] @ (e + D @ b)) * RAISE <= b):
            raise CertificateError("certificate: what the weights may change makes the bounds grow without end "
                                   "(found), expected bounds. Narrow the ranges of the premises.")
        return np.concatenate([b, (start + self.total @ (e + D @ b))[n:] * RAISE])


def _upper(M) -> Array:
    """Upper bounds of the magnitudes, in float64."""
    rows = [[float(x.abs_upper()) for x in row] for row in M.tolist()]
    return np.nextafter(np.array(rows), np.inf)
