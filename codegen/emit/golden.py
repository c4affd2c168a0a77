"""Golden vectors: a short run of the numpy reference, for the unit test that a user runs on the target.

The run visits every mode and has samples within bounds, samples at the ends of the measurement ranges
(faults), missing measurements, a quiet stretch in which the guarantee returns, and then in each mode a missing
measurement between two good ones, so that each coefficient of each map matters to some number. Where radii follow the
magnitude of x the tail also puts one bound of all framers to the end of the range first, so that either bound is the
larger one. It need not be a possible run of the plant: its purpose is to notice a compiler, an option or a machine
that calculates differently.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from random import Random

import numpy as np

from ..observers import BankTables, FilterObserver, ModeTables, PolytopicTables, SlidingTables, Trace
from .cprint import initialiser, literal

Array = np.ndarray
FAULTS, MISSING, RESETS = (4, 5, 13), (9, 30, 31), (24,)


@dataclass(frozen=True)
class Vector:
    """One sample: inputs, what is called, and what the reference answered; all printed.

    ``inputs`` holds one initialiser or none, ``read`` those of y and, where there are some, of theta; ``call`` is 0
    for predict, 1 for step, 2 for reset and then step; 3 and 4 for step, 5 and 6 for predict after the lower (3, 5) or
    upper (4, 6) bounds have been put to the ends of the ranges. ``always`` are the numbers of every answer,
    ``measured`` those that are 0 after a predict, and the words of a mode estimator, whose ``mode`` is its answer.
    """

    inputs: tuple[str, ...]
    read: tuple[str, ...]
    mode: int
    call: int
    always: tuple[str, ...]
    measured: tuple[str, ...]
    raw: int
    alarm: int
    latched: int
    assured: int


#: The tail, per mode: is the sample measured, and which bound is put to the end of its range before (1 lower, 2 upper)?
TAIL = ((True, 0), (False, 0), (True, 0))
WIDE_TAIL = (*TAIL, (True, 1), (True, 0), (False, 1), (True, 2), (True, 0), (False, 2))


def tail(t) -> tuple[tuple[bool, int], ...]:
    """Return the samples of the tail in one mode."""
    if isinstance(t, BankTables):
        return ((True, 0),) * t.gap + TAIL  # they pay for the sample without measurement
    # Boxes of S x, and estimates, have no bounds of x to put to the ends.
    return TAIL if t.vary is None or isinstance(t, ModeTables | PolytopicTables | SlidingTables) else WIDE_TAIL


def steps_of(t) -> int:
    """Length of the run: each mode twice, switching at each sample, 28 samples of slow switching, the tail."""
    return tail_of(len(t.A)) + len(tail(t)) * len(t.A)


def tail_of(n_modes: int) -> int:
    """First sample of the tail: each mode for some samples, some of them without measurement."""
    return 2 * n_modes + 36


def is_missing(k: int, t) -> bool:
    """Whether sample k has no measurement."""
    after = k - tail_of(len(t.A))
    return k in MISSING or (after >= 0 and not tail(t)[after % len(tail(t))][0])


def widened(k: int, t) -> int:
    """Which bounds are put to the ends of the ranges before sample k: 0 none, 1 the lower, 2 the upper ones."""
    after = k - tail_of(len(t.A))
    return tail(t)[after % len(tail(t))][1] if after >= 0 else 0


def widen(observer, t, which: int) -> None:
    """Put the lower (1) or upper (2) bounds to the ends of the ranges."""
    if which:
        name, end = ("lo", t.x_lo) if which == 1 else ("hi", t.x_hi)
        setattr(observer, name, np.broadcast_to(end, observer.lo.shape).astype(t.dtype))


def stimulus(observer, t) -> tuple[Array, Array, Array, Array]:
    """Return u (K, n_u), y (K, n_y), q (K,) and theta (K, J); ``random.Random`` draws the same numbers everywhere."""
    draw, n_modes = Random(1), t.A.shape[0]

    def between(lo, hi):
        drawn = [a + (b - a) * draw.random() for a, b in zip(lo.astype(float), hi.astype(float))]
        return np.clip(np.array(drawn, dtype=t.dtype), lo, hi)

    steps, last = steps_of(t), tail_of(n_modes)
    u, y, q = np.zeros((steps, len(t.u_lo)), t.dtype), np.zeros((steps, len(t.y_lo)), t.dtype), np.zeros(steps, int)
    theta = np.zeros((steps, 0 if t.vary is None else t.vary.parameters), t.dtype)
    observer = copy(observer)
    observer.start(t, 1)
    for k in range(steps):
        q[k] = k // 2 if k < 2 * n_modes else draw.randrange(n_modes) if k < last - 28 or k % 6 == 0 else q[k - 1]
        q[k] = (k - last) // len(tail(t)) if k >= last else q[k]
        u[k] = between(t.u_lo, t.u_hi)
        if theta.shape[1]:
            theta[k] = between(t.vary.theta_lo[q[k]], t.vary.theta_hi[q[k]])
        if k in RESETS:
            observer.reset(t, np.array([True]))
        widen(observer, t, widened(k, t))
        y[k] = _within_bounds(observer, t, u[k], q[k], theta[k], between(t.y_lo, t.y_hi))
        if k in FAULTS:
            y[k] = np.where([draw.random() < 0.5 for _ in y[k]], t.y_lo, t.y_hi)
        _sample(observer, t, u[k], y[k], q[k], theta[k], not is_missing(k, t))
        y[k] = np.nan if is_missing(k, t) else y[k]
    return u, y, q, theta


def _sample(observer, t, u: Array, y: Array, q: int, theta: Array, measured: bool) -> Trace:
    """Step the reference by one sample."""
    out = observer.empty(t, (1,))
    observer.sample(t, np.array([True]), np.array([measured]), u[None], y[None], np.array([q]), theta[None],
                    out)
    return out


def _within_bounds(observer, t, u: Array, q: int, theta: Array, y: Array) -> Array:
    """Return a measurement a little off the middle of its bounds; trials on copies find it.

    Framers that use the measurement of the same sample (N y+) move with it: the residual is affine in y, with a
    slope that is measured too. Of a filter: a measurement small enough for an estimate within its bounds.
    """
    if hasattr(observer, "quiet_output"):  # bounds over several modes may have gaps
        return observer.quiet_output(t, u, int(q), theta)

    def answer(y: Array) -> Trace:
        trial = copy(observer)
        trial.guard = copy(observer.guard)  # its arrays are replaced at each sample, never written to
        return _sample(trial, t, u, y, q, theta, True)

    if isinstance(observer, FilterObserver):
        smaller = (y * t.dtype.type(0.5**k) for k in range(30))
        fit = (z for z in smaller if np.all((z >= t.y_lo) & (z <= t.y_hi)) and answer(z).raw_bits[0] == 0)
        return next(fit, y)

    def offset(y: Array) -> Array:
        out = answer(y)
        return (0.45 * out.r_lo[0] + 0.55 * out.r_hi[0]).astype(float)

    here = offset(y)
    aside = np.where(y < t.y_lo / 2 + t.y_hi / 2, 0.25, -0.25) * (t.y_hi - t.y_lo)
    slope = np.array([(offset((y + a).astype(t.dtype)) - here) / a.sum() for a in np.diag(aside)]).T
    return np.clip(y - _solve(slope, here), t.y_lo, t.y_hi).astype(t.dtype)


def _solve(A: Array, b: Array) -> Array:
    """Solve A x = b by elimination, the same bits on every machine, which LAPACK does not promise."""
    M = np.column_stack([A, b])
    for j in range(len(b)):
        pivot = j + int(np.argmax(np.abs(M[j:, j])))
        M[[j, pivot]] = M[[pivot, j]]
        if M[j, j] != 0.0:  # else this measurement moves nothing: leave it
            M[j] = M[j] / M[j, j]
            for i in range(len(b)):
                M[i] = M[i] - (M[i, j] if i != j else 0.0) * M[j]
    return M[:, -1]


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
    u, y, q, theta = stimulus(design.observer, design.observer.tables[real])
    measured = ~np.isnan(y).any(axis=1)
    y = np.where(measured[:, None], y, 0).astype(y.dtype)
    trace = _answers(copy(design.observer), design.observer.tables[real], u, y, q, theta, measured)
    *states, first, second = trace.numbers()
    states, residuals = ([np.where(measured[:, None] | ~np.isnan(a), a, 0).astype(y.dtype) for a in numbers]
                         for numbers in (states, (first, second)))
    states, residuals = (states, residuals) if states else (residuals[:1], residuals[1:])
    return tuple(Vector((initialiser(u[k], real),) if u.shape[1] else (),
                        (initialiser(y[k], real), *([initialiser(theta[k], real)] * bool(theta.shape[1]))),
                        int(trace.words()[0][k]) if trace.words() else int(q[k]),
                        _call(k, design.observer.tables[real], bool(measured[k])),
                        tuple(initialiser(a[k], real) for a in states),
                        (*(initialiser(a[k], real) for a in residuals), *(f"{w[k]}U" for w in trace.words()[1:]),
                         *["0U"] * bool(trace.words())),
                        int(trace.raw_bits[k]),
                        int(trace.alarm_bits[k]), int(trace.latched_bits[k]), int(trace.assured[k]))
                 for k in range(len(q)))


def _call(k: int, t, measured: bool) -> int:
    """Number of what is called at sample k."""
    if widened(k, t):
        return widened(k, t) + (2 if measured else 4)
    return 2 if k in RESETS else int(measured)


def _answers(observer, t, u: Array, y: Array, q: Array, theta: Array, measured: Array) -> Trace:
    """Run the reference over the samples, with its resets."""
    trace = observer.empty(t, (len(q),))
    observer.start(t, 1)
    for k in range(len(q)):
        if k in RESETS:
            observer.reset(t, np.array([True]))
        widen(observer, t, widened(k, t))
        sample = _sample(observer, t, u[k], y[k], q[k], theta[k], measured[k])
        for name in trace.__dataclass_fields__:
            getattr(trace, name)[k] = getattr(sample, name)[0]
    return trace


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
    told = not isinstance(t, ModeTables | PolytopicTables | SlidingTables | BankTables)
    out = [Refusal(f"in.mode = {macro}_MODES;", "in.mode = vectors[0].mode;", "BAD_MODE", "BAD_MODE", 1001)] * told
    for vector, hi, predict, code in (("u", t.u_hi, "BAD_INPUT", 1002), ("y", t.y_hi, "OK", 1003)):
        beyond = np.nextafter(hi, np.array(np.inf, dtype=t.dtype))
        for i in np.flatnonzero(np.isfinite(beyond))[-1:]:
            out.append(Refusal(f"in.{vector}[{i}] = {literal(float(beyond[i]), t.real)};",
                               f"in.{vector}[{i}] = vectors[0].{vector}[{i}];",
                               "BAD_INPUT" if vector == "u" else "BAD_OUTPUT", predict, code))
    for hi in () if t.vary is None or not t.vary.parameters else (t.vary.theta_hi.max(axis=0),):
        above = np.nextafter(hi[-1], np.array(np.inf, dtype=t.dtype))
        out.append(Refusal(f"in.theta[{len(hi) - 1}] = {literal(float(above), t.real)};",
                           f"in.theta[{len(hi) - 1}] = vectors[0].theta[{len(hi) - 1}];", "BAD_PARAMETER",
                           "BAD_PARAMETER", 1004))
    return tuple(out)
