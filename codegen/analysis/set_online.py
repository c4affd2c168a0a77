"""How large a zonotope that is reduced online can be once settled: what its own test can miss.

Boxing leaves the hull b of the error set as it is, so ``b+ <= |Ac_q| b + |W| 1`` whatever order is kept; the largest
solution over all mode sequences that the dwell time admits bounds the set, and one exact step from it gives thresholds

    h(d) <= |d' C Ac_q| b + |d' C W|_1 + |d' V|_1.

(Reduced once per block, as in ``set_blocks``, the set obeys the same bound.) A fault whose response exceeds h(d) and
the largest fault-free d' r (``set_tables``) together is surely detected: ``surely_detected`` of the mean of the two
tables says how large that is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..algebra import zonotope
from ..algebra.error_set import ErrorRecursion
from .set_stay import OUTWARD
from .set_tables import DwellTable

Array = np.ndarray

#: By so much the boxes are larger than the fixed point that they are approached to.
INFLATE = 1.001


def largest_boxes(m: ErrorRecursion, dwell: int, rows: int) -> Array | None:
    """Return half widths that hold every settled reduced error set, by mode and samples since it was entered.

    Parameters
    ----------
    m : ErrorRecursion
    dwell : int
        Samples a mode lasts at least.
    rows : int
        The last row holds for all later samples.

    Returns
    -------
    boxes : ndarray (Q, J + 1, n) or None
        J is the larger of ``rows`` and ``dwell``. None: they grow without bound; the order that is kept matters then.
    """
    Q, n, last = m.modes, m.A.shape[1], max(rows, dwell)
    size = np.abs(m.A)
    own = np.array([zonotope.hull(m.W[q, q]) for q in range(Q)])
    entering = np.array([np.max([zonotope.hull(m.W[i, q]) for i in m.others(q) or [q]], axis=0) for q in range(Q)])
    push = np.repeat(own[:, None], last + 1, axis=1)
    push[:, 0] = entering

    def onward(box: Array, more: float = 0.0) -> Array:
        moved = np.einsum("qij,qsj->qsi", size, box) + push + more  # after the step of row s
        out = np.zeros_like(box)
        out[:, 1:] = moved[:, :-1]
        out[:, -1] = np.maximum(out[:, -1], moved[:, -1])
        leaving = moved[:, dwell - 1:].max(axis=1)  # that step is the dwell-th or a later one
        for q in range(Q):
            out[q, 0] = np.max(leaving[m.others(q)], axis=0, initial=0.0)
        return out

    box, most = np.zeros((Q, last + 1, n)), 1e9 * (np.max(push) or 1.0)
    for _ in range(20000):
        larger = onward(box, 1e-15 * most)  # a little more than is needed, so that what is reached holds strictly
        if not np.max(larger) < most:
            return None
        if np.all(larger <= box * (1.0 + 1e-9)):
            wide = larger * INFLATE
            return wide if np.all(onward(wide) <= wide) else None
        box = larger
    return None


def online_table(m: ErrorRecursion, table: DwellTable) -> DwellTable | None:
    """Return thresholds that no settled reduced set exceeds, for every order; laid out like the last stage of a table.

    Parameters
    ----------
    m : ErrorRecursion
    table : DwellTable
        Its directions, rows and dwell time are read.

    Returns
    -------
    bounds : DwellTable or None
        None: the boxes grow without bound.
    """
    J = table.h.shape[2] - 1
    boxes = largest_boxes(m, table.dwell, J)
    if boxes is None:
        return None
    D, last = table.directions, boxes.shape[1] - 1
    h = np.zeros((m.modes, last + 1, len(D)))
    for q in range(m.modes):
        for s in range(last + 1):
            before = [(q, s - 1)] if s else [(i, j) for i in m.others(q) for j in range(table.dwell - 1, last + 1)]
            before += [(q, last)] if s == last else []
            for i, j in before:
                pasts = [i] if j else m.others(i) or [i]
                fresh = np.max([zonotope.support(m.C[q] @ m.W[p, i], D) for p in pasts], axis=0)
                carried = np.abs(D @ m.C[q] @ m.A[i]) @ boxes[i, j]
                h[q, s] = np.maximum(h[q, s], carried + fresh + zonotope.support(m.V[i, q], D))
    kept = np.concatenate([h[:, :J], h[:, J:].max(axis=1, keepdims=True)], axis=1)
    return replace(table, h=kept[None] * OUTWARD, boxes=table.boxes[-1:])


def mean_table(exact: DwellTable, online: DwellTable) -> DwellTable:
    """Return the mean of the last stage's thresholds and those of an online set, for ``surely_detected``.

    Parameters
    ----------
    exact, online : DwellTable
        Of the same directions and rows.

    Returns
    -------
    table : DwellTable
    """
    free = np.minimum(exact.h[-1:], online.h)  # either bounds what is fault-free
    return replace(exact, h=(free + online.h) / 2.0, boxes=exact.boxes[-1:])
