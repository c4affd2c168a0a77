r"""Tracking law beside a polytopic observer, as the C does it: reference and measurement in, held inputs out.

At sample k, from the observer's z and the law's own s::

    1  x_hat = z + T2 y,  h = weights at x_hat                        what the observer will say of this sample
    2  u = sum_j h_j (Kx_j x_hat + Ki_j s), cut to its range
    3  s+ = s + T (ref - y[rows]), cut to its limits                  not without a measurement

and then the observer takes its step with this u. Entries that all vertices share are added once. Where a cut was needed
`limited` says so: while references, disturbances and the start are as declared and no fault acts, that never happens.
The integral stops at its limit, which is all there is of anti-windup.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .polytopic_step import evaluate, summed
from .supervisor import BAD_INPUT, BAD_OUTPUT, OK

Array = np.ndarray
#: Bits of `limited`.
CUT_INPUT, CUT_INTEGRAL = 1, 2


@dataclass(frozen=True)
class Command:
    """Answers of a law, S runs: u (S, m), limited (S,), status (S,); zeros where the status is an error."""

    u: Array
    limited: Array
    status: Array


class Feedback:
    """A law as the firmware runs it, on S independent runs at once.

    Parameters
    ----------
    tables : PolytopicTables
        With a law.
    runs : int
    """

    def __init__(self, tables, runs: int = 1):
        self.tables = tables
        self.s = np.zeros((runs, len(tables.law.limit)), tables.dtype)

    def control(self, z: Array, ref: Array, y: Array) -> Command:
        """One sample with its measurement (``<p>_control``).

        Parameters
        ----------
        z : ndarray (S, n)
            State of the observer.
        ref : ndarray (S, k), y : ndarray (S, p)

        Returns
        -------
        Command
        """
        t, law = self.tables, self.tables.law
        ref, y = np.asarray(ref, t.dtype), np.asarray(y, t.dtype)
        status = np.where(_within(ref, -law.reference, law.reference), OK, BAD_INPUT)
        status = np.where((status == OK) & ~_within(y, t.y_lo, t.y_hi), BAD_OUTPUT, status)
        u, limited = self._inputs(z, y)
        with np.errstate(all="ignore"):
            s = self.s + t.dtype.type(law.period) * (ref - y[:, list(law.rows)])
        cut, fits = _cut(s, -law.limit, law.limit)
        on = status == OK
        limited = limited | np.where(fits, 0, CUT_INTEGRAL).astype(np.uint32)
        self.s = np.where(on[:, None], cut, self.s)
        return Command(np.where(on[:, None], u, 0).astype(t.dtype), np.where(on, limited, 0).astype(np.uint32), status)

    def hold(self, z: Array, last: Array) -> Command:
        """One sample without (``<p>_hold``): the last measurement stands for it, s waits.

        Parameters
        ----------
        z : ndarray (S, n), last : ndarray (S, p)
        """
        u, limited = self._inputs(z, np.asarray(last, self.tables.dtype))
        return Command(u, limited, np.full(len(u), OK))

    def _inputs(self, z: Array, y: Array) -> tuple[Array, Array]:
        """u, cut, and whether that changed it."""
        t, law = self.tables, self.tables.law
        with np.errstate(all="ignore"):
            x_hat = summed(t.T2, y, z)
            *h, inside = evaluate(t.weights, [*x_hat.T, *np.zeros((len(t.u_lo), len(z)), t.dtype)], t.dtype)
            h = np.stack([np.broadcast_to(w, inside.shape) for w in h], axis=1).astype(t.dtype)
            values = np.concatenate([x_hat, self.s], axis=1)
            u = summed(np.where(law.shared, law.gains[0], 0), values)
            for j, M in enumerate(law.gains):
                own = np.where(law.shared, 0, M)
                u = np.where(np.any(own != 0, axis=1), u + h[:, [j]] * summed(own, values), u)
        cut, fits = _cut(u, t.u_lo, t.u_hi)
        return cut, np.where(fits, 0, CUT_INPUT).astype(np.uint32)


class Tracker:
    """Observer and law as one unit: what a firmware does at every sample.

    Parameters
    ----------
    observer : PolytopicObserver
        Whose tables have a law.
    real : {"float32", "float64"}
    runs : int
    """

    def __init__(self, observer, real: str = "float32", runs: int = 1):
        self.tables, self.observer = observer.tables[real], observer
        self.law = Feedback(self.tables, runs)
        observer.start(self.tables, runs)

    def step(self, ref: Array, y: Array):
        """One sample; a row of y with a NaN in it is a missing measurement.

        Parameters
        ----------
        ref : ndarray (S, k), y : ndarray (S, p)

        Returns
        -------
        command : Command
        answer : PolytopicTrace
            Of the observer at this sample.

        Raises
        ------
        ValueError
            A reference beyond its range.
        """
        t, runs = self.tables, len(y)
        y = np.asarray(y, t.dtype)
        if not _within(np.asarray(ref, t.dtype), -t.law.reference, t.law.reference).all():
            raise ValueError(f"a reference is beyond its range {t.law.reference.tolist()}")
        before = self.law.s
        # A measurement that is refused is a missing one: both call hold.
        held = self.law.hold(self.observer.z, self.observer.y)
        given = self.law.control(self.observer.z, ref, y)
        seen = given.status == OK
        self.law.s = np.where(seen[:, None], self.law.s, before)
        command = Command(np.where(seen[:, None], given.u, held.u), np.where(seen, given.limited, held.limited),
                          given.status)
        answer = self.observer.empty(t, (runs,))
        self.observer._one(t, command.u, np.where(seen[:, None], y, np.nan), np.zeros(runs, np.int64),
                           np.zeros((runs, 0), t.dtype), answer)
        return command, answer


def _within(values: Array, lo: Array, hi: Array) -> Array:
    """Whether all numbers of a row are in their ranges; NaN is not."""
    return ((values >= lo) & (values <= hi)).all(axis=1)


def _cut(values: Array, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Cut to a range, and whether nothing of a row was; NaN, of which every comparison is false, is its lower end."""
    above = values >= lo
    out = np.where(above, np.where(values <= hi, values, hi), lo)
    return out, (above & (values <= hi)).all(axis=1)
