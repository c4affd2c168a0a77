"""Golden vectors: a short run of the numpy reference, for the unit test that a user runs on the target.

The run visits every mode, has quiet samples, samples at the ends of the measurement ranges (faults),
missing measurements and refused ones. It need not be a possible run of the plant: its purpose is to
notice a compiler, an option or a machine that calculates differently.
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import numpy as np

from .cprint import initialiser, literal

Array = np.ndarray
STEPS = 32


@dataclass(frozen=True)
class Vector:
    """One sample: inputs, whether there is a measurement, and what the reference answered; all printed.

    ``inputs`` holds one initialiser or none.
    """

    inputs: tuple[str, ...]
    y: str
    mode: int
    measured: int
    x_lo: str
    x_hi: str
    r_lo: str
    r_hi: str
    raw: int
    alarm: int
    latched: int
    assured: int


def stimulus(t) -> tuple[Array, Array, Array]:
    """Return u (K, n_u), y (K, n_y) and q (K,); ``random.Random`` gives the same numbers everywhere."""
    draw, n_modes = Random(1), t.A.shape[0]
    n_x, n_u, n_y = t.A.shape[1], t.B.shape[2], t.C.shape[1]
    def between(lo, hi):
        return np.array([a + (b - a) * draw.random() for a, b in zip(lo.astype(float), hi.astype(float))])
    x = between(t.x0_lo, t.x0_hi)
    u, y, q = np.zeros((STEPS, n_u)), np.zeros((STEPS, n_y)), np.zeros(STEPS, dtype=np.int64)
    for k in range(STEPS):
        # The first 16 samples keep each mode for two samples, then it may change at each.
        q[k] = (k // 2) % n_modes if k < STEPS // 2 else draw.randrange(n_modes)
        u[k] = 0.25 * between(t.u_lo, t.u_hi)
        y[k] = t.C[q[k]] @ x + t.D[q[k]] @ u[k]
        x = np.clip(t.A[q[k]] @ x + t.B[q[k]] @ u[k], t.x_lo, t.x_hi) if n_x else x
        if k % 8 == 6:
            y[k] = np.where([draw.random() < 0.5 for _ in range(n_y)], t.y_lo, t.y_hi)
    y = np.clip(y, t.y_lo, t.y_hi)
    u = np.clip(u, t.u_lo, t.u_hi)
    y[11] = y[20] = y[21] = np.nan
    return u.astype(t.dtype), y.astype(t.dtype), q


def vectors(design, real: str) -> tuple[Vector, ...]:
    """Run the reference and print what it answers.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    vectors : tuple of Vector
    """
    u, y, q = stimulus(design.observer.tables[real])
    trace = design.observer.run(u=u, y=y, q=q, real=real)
    measured = ~np.isnan(y).any(axis=1)
    y, r_lo, r_hi = (np.where(measured[:, None], a, 0).astype(y.dtype) for a in (y, trace.r_lo, trace.r_hi))
    return tuple(Vector((initialiser(u[k], real),) if u.shape[1] else (), initialiser(y[k], real), int(q[k]),
                        int(measured[k]), initialiser(trace.x_lo[k], real), initialiser(trace.x_hi[k], real),
                        initialiser(r_lo[k], real), initialiser(r_hi[k], real), int(trace.raw_bits[k]),
                        int(trace.alarm_bits[k]), int(trace.latched_bits[k]), int(trace.assured[k]))
                 for k in range(len(q)))


@dataclass(frozen=True)
class Refusal:
    """A call that must be refused: statements that spoil and mend ``in``, the answers, the error number."""

    breaks: str
    mends: str
    step: str
    predict: str
    code: int


def refusals(t, macro: str) -> tuple[Refusal, ...]:
    """Return one refused call per kind: the next number beyond a range is already too much."""
    out = [Refusal(f"in.mode = {macro}_MODES;", "in.mode = vectors[0].mode;", "BAD_MODE", "BAD_MODE", 1001)]
    for vector, hi, predict, code in (("u", t.u_hi, "BAD_INPUT", 1002), ("y", t.y_hi, "OK", 1003)):
        beyond = np.nextafter(hi, np.array(np.inf, dtype=t.dtype))
        for i in np.flatnonzero(np.isfinite(beyond))[-1:]:
            out.append(Refusal(f"in.{vector}[{i}] = {literal(float(beyond[i]), t.real)};",
                               f"in.{vector}[{i}] = vectors[0].{vector}[{i}];",
                               "BAD_INPUT" if vector == "u" else "BAD_OUTPUT", predict, code))
    return tuple(out)
