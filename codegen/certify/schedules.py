"""Tables of thresholds along a known schedule on the numbers of the C: rounding, proof from every start.

The recursion is that of ``thresholds``. What the firmware looks up from the initial box on, and from any error at any
phase on, is laid out along the samples as it will be and proved for ever (``schedule_bounds``); a mode that is not in
the schedule has one row, which holds for any error.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..errors import CertificateError
from .exact import product, rational, up
from .schedule_bounds import prove_schedule
from .thresholds import check_middle, claimed_rows, directions_of, emitted_rows, recursion, starts, table_words

Array = np.ndarray


def freeze_schedule(shape_class, t, table, directions: Array):
    """Round a table outward.

    Parameters
    ----------
    shape_class : type
        ``ScheduleTables``.
    t : PointTables
    table : PhaseTable
    directions : ndarray (m, n_y)
        As emitted.

    Returns
    -------
    ScheduleTables
    """
    h = np.concatenate([table.first, table.anew.reshape(-1, table.anew.shape[2]), table.lap])
    h, hx = emitted_rows(t, h, directions)
    P = len(table.cycle)
    entered = [next((k for k in range(P) if table.cycle[k] == q != table.cycle[k - 1]), None)
               for q in range(table.anew.shape[1])]
    entry = tuple((table.cycle.index(q) if q in table.cycle else P) if k is None else k for q, k in enumerate(entered))
    return shape_class(cycle=table.cycle, entry=entry, rows=len(table.first), directions=directions, h=h, hx=hx)


def certificate(t, proof: dict) -> dict:
    """What ``check`` needs beside the tables, and the ultimate width."""
    half = (1 + 1e-9) * t.shape.hx[-len(t.shape.cycle):].astype(float).max(axis=0)
    return {**proof, "set": "schedule", "steady_box": {"width": (2 * half).tolist(), "hi": half.tolist(),
                                                       "lo": half.tolist()}}


def proved(modes, t) -> dict[str, float]:
    """Prove the rows from every start; return the least room of each.

    Raises
    ------
    CertificateError
        Naming start, sample and direction.
    """
    z, m, h = t.shape, recursion(modes, t), claimed_rows(t)
    P, J, N = len(z.cycle), z.rows, len(modes)
    if J < 1 or len(h) != J + J * N + P or not all(0 <= q < N for q in z.cycle) or len(z.entry) != N:
        raise CertificateError(f"certificate: {len(h)} rows (found), expected {J} from the start, {J} anew for each of "
                               f"{N} modes and {P} of the schedule.")
    for q, k in enumerate(z.entry):
        if not (k == P or 0 <= k < P and z.cycle[k] == q):
            raise CertificateError(f"certificate: mode {q} is entered at phase {k} (found), where the schedule has "
                                   "another.")
    directions = directions_of(t, z.directions.astype(float))
    first, anywhere = starts(t)
    length, known, out = P * (-(-J // P) + 1), {}, {}

    def prove(what: str, H0: Array, phase: int, rows: list[int]) -> None:
        claim = SimpleNamespace(directions=directions, h=h[rows], period=P)
        cycle = [*z.cycle[phase:], *z.cycle[:phase]]
        try:
            out[what] = prove_schedule(m, H0, (), cycle, claim, known)
        except CertificateError as error:
            raise CertificateError(f"certificate: from {what}: {error}") from None

    def row(start: int | None, k: int) -> int:
        """Row that the firmware reads k samples after the initial box (None) or after it started anew at a phase."""
        phase = (k + (start or 0)) % P
        return J + J * N + phase if k >= J else k if start is None else J + k * N + z.cycle[phase]

    prove("the initial box", first, 0, [row(None, k) for k in range(length)])
    for phase in range(P):
        prove(f"any error at phase {phase}", anywhere, phase, [row(phase, k) for k in range(length)])
    D = rational(directions)
    for q in range(N):
        row_of = product(product(D, rational(m.C[q])), rational(anywhere))
        need = abs(row_of).sum(axis=1) + abs(product(D, rational(m.V[m.start, q]))).sum(axis=1)
        out[f"mode {q} out of turn"] = room = float(np.min(h[J + q] - np.array([up(x) for x in need])))
        if room < 0:
            raise CertificateError(f"certificate: mode {q} out of turn: the thresholds of any error are too small.")
    return out


def check(modes, t, cert: dict) -> list[str]:
    """Re-check the certificate of a table along a schedule; return what is proved, one sentence per claim.

    Raises
    ------
    CertificateError
        Naming start, sample and direction.
    """
    z, P = t.shape, len(t.shape.cycle)
    proved(modes, t)
    check_middle(t)
    width = np.array(cert["steady_box"]["width"])
    if np.any(rational(width) < 2 * np.max(rational(z.hx[-P:]), axis=0)):
        raise CertificateError("certificate: the ultimate width is less than in the rows that repeat.")
    return ["the residual lies within its thresholds at every sample while no fault acts, so there is no false alarm, "
            f"for any switching, rounding included ({t.real}, with or without fused multiply-add); a mode that is not "
            f"that of the schedule of {P} samples makes the thresholds start anew",
            "x_lo <= x <= x_hi at every sample while no fault acts, for any switching",
            table_words(z),
            f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], while the modes follow "
            "the schedule"]
