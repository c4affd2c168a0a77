"""Surely detected faults of a fault estimation filter: a step that no disturbance, mode sequence or unknown can hide.

By superposition f_hat is that of the fault-free run, at most h of the last row once settled, and the response to the
fault alone from rest, at least ``|g| - radius`` times its size: g along the middle of the uncertain matrices, the
radius carried beside it elementwise. An alarm is sure where that exceeds 2 h (where the threshold is calibrated: it and
the guaranteed bound together). Every mode sequence counts, the slow ones
of a dwell time and the others alike.
"""

from __future__ import annotations

from itertools import product

import numpy as np

Array = np.ndarray
#: Upper limit on the mode sequences looked at; delays beyond are left out.
MOST_SEQUENCES = 6000


class Response:
    """Plant and filter of one mode, as far as a fault is concerned: [x; xi]+ and f_hat, and what is uncertain."""

    def __init__(self, m, t, q: int):
        n_s = len(t.limit)
        L, M, K, Dy = (getattr(t, k)[q].astype(float) for k in ("L", "M", "K", "Dy"))
        A, unsure = middle(m)
        spread = {name: np.abs(value).sum(axis=0) for name, value in getattr(m, "more", {}).items()}
        C_off, Df_off = spread.get("C", 0 * m.C), spread.get("Df", 0 * m.Df)
        self.A = np.block([[A, np.zeros((len(A), n_s))], [L @ m.C, M]])
        self.unsure = np.zeros_like(self.A)
        self.unsure[:len(A), :len(A)] = unsure
        self.unsure[len(A):, :len(A)] = np.abs(L) @ C_off
        self.unsure[len(A):, len(A):] = 2.0 * np.finfo(t.dtype).eps * (n_s + 2) * np.abs(M)
        self.E = np.concatenate([m.Bf, L @ m.Df])
        self.E_unsure = np.concatenate([spread.get("Bf", 0 * m.Bf), np.abs(L) @ Df_off])
        self.C_unsure = np.concatenate([np.abs(Dy) @ C_off, np.zeros_like(K)], axis=1)
        self.F_unsure = np.abs(Dy) @ Df_off
        self.C, self.F = np.concatenate([Dy @ m.C, K], axis=1), Dy @ m.Df


def middle(m) -> tuple[Array, Array]:
    """Middle of A over what is unknown or not read, and elementwise bounds of the rest."""
    if not hasattr(m, "A_unc"):
        return m.A, np.zeros_like(m.A)
    centre, radius = (m.theta_lo + m.theta_hi) / 2, (m.theta_hi - m.theta_lo) / 2
    A = m.A + np.einsum("j,jab->ab", centre, m.A_theta)
    return A, np.abs(m.A_unc).sum(axis=0) + np.einsum("j,jab->ab", radius, np.abs(m.A_theta)) + m.A_rad


def thresholds(plant, t, within: int, quiet: Array | None = None) -> Array:
    """Smallest sizes per fault channel and delay.

    Parameters
    ----------
    plant : Plant
    t : FilterTables
    within : int
    quiet : ndarray (N, n_f), optional
        What |f_hat| can be without a fault, where that is not the threshold itself.

    Returns
    -------
    ndarray (n_f, within + 1)
        Infinite where no size is sure.
    """
    modes = [Response(m, t, q) for q, m in enumerate(plant.observed.modes)]
    depth = within
    while len(modes) ** (depth + 1) > MOST_SEQUENCES and depth > 0:
        depth -= 1
    last = t.h[-1].astype(float)
    bound = last + (last if quiet is None else quiet)
    out = np.full((plant.n_f, within + 1), np.inf)
    for j in range(plant.n_f):
        worst = np.zeros(depth + 1)
        for path in product(range(len(modes)), repeat=depth + 1):
            worst = np.maximum(worst, along(modes, bound, path, j))
        out[j, :depth + 1], out[j, depth:] = worst, worst[depth]
    # The recursion runs in double precision; a part in a million covers its own rounding generously.
    return out * (1.0 + 1e-6)


def along(modes: list[Response], bound: Array, path, channel: int) -> Array:
    """Sizes of a step on one channel that are found by each sample of a path, the smallest so far."""
    e = np.zeros(len(modes[0].A))
    radius, found, best = e.copy(), [], np.inf
    for q in path:
        m = modes[q]
        least = np.abs(m.C @ e + m.F[:, channel]) - np.abs(m.C) @ radius
        least = least - m.C_unsure @ (np.abs(e) + radius) - m.F_unsure[:, channel]
        with np.errstate(divide="ignore"):
            best = min(best, np.min(np.where(least > 1e-12, bound[q] / np.maximum(least, 1e-300), np.inf)))
        found.append(best)
        radius = np.abs(m.A) @ radius + m.unsure @ (np.abs(e) + radius) + m.E_unsure[:, channel]
        e = m.A @ e + m.E[:, channel]
    return np.array(found)
