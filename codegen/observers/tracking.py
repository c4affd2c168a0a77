r"""Observer and tracking law as one unit, as the C does it: references and measurements in, held inputs out.

    x_hat = z + T2 y,  r = y - C x_hat,  h = h(x_hat)              the polytopic observer (``polytopic``)
    u = sum_j h_j (Kx_j x_hat + Ki_j s), cut to its range,  s+ = s + T (ref - y[rows]), cut to its limit

The observer moves on with the cut u. Where a cut was needed `limited` says so: by the certificate that never happens
while references, disturbances and the start are as declared and no fault acts. `assured` is 1 until the first sample
that was cut, outside the premises, without measurement or with an alarm; only a new start brings it back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .polytopic import BAD_INPUT, BAD_OUTPUT, OK, PolytopicTables, step, summed, within

Array = np.ndarray
#: Bits of `limited`.
CUT_INPUT, CUT_INTEGRAL = 1, 2


@dataclass(frozen=True)
class FeedbackLaw:
    """The numbers of the law.

    Parameters
    ----------
    Kx : ndarray (h, m, n), Ki : ndarray (h, m, k)
        With their signs.
    rows : tuple of int
        Outputs that follow the reference.
    period : float
        T, in s.
    reference : ndarray (k,)
        Largest magnitude of ref.
    limit : ndarray (k,)
        Of s.
    """

    Kx: Array
    Ki: Array
    rows: tuple[int, ...]
    period: float
    reference: Array
    limit: Array

    @property
    def gains(self) -> Array:
        """Kx and Ki side by side (h, m, n + k): factors of (x_hat, s)."""
        return np.concatenate([self.Kx, self.Ki], axis=2)

    @property
    def shared(self) -> Array:
        """Entries of `gains` that are the same at all vertices (m, n + k)."""
        return np.all(self.gains == self.gains[0], axis=0)


@dataclass(frozen=True)
class TrackingTables:
    """The numbers that the C holds.

    Parameters
    ----------
    observer : PolytopicTables
        Its u_lo, u_hi are the range to which u is cut.
    law : FeedbackLaw
    r_bound : ndarray (p,)
        Largest |r| without a fault.
    """

    observer: PolytopicTables
    law: FeedbackLaw
    r_bound: Array

    @property
    def real(self) -> str:
        """Number type."""
        return self.observer.real


@dataclass(frozen=True)
class TrackingAnswer:
    """Answers of one sample, S runs; of all samples with (S, K) in front.

    Parameters
    ----------
    u : ndarray (S, m), x_hat : ndarray (S, n), r : ndarray (S, p), h : ndarray (S, h)
    raw, latched, limited, inside, assured, status : ndarray (S,)
    """

    u: Array
    x_hat: Array
    r: Array
    h: Array
    raw: Array
    latched: Array
    limited: Array
    inside: Array
    assured: Array
    status: Array


class TrackingObserver:
    """The unit as the firmware runs it, on S independent runs at once.

    Parameters
    ----------
    tables : TrackingTables
    runs : int
    """

    def __init__(self, tables: TrackingTables, runs: int = 1):
        o, self.tables, self.dtype = tables.observer, tables, np.dtype(tables.real)
        self.z = np.tile(o.z0.astype(self.dtype), (runs, 1))
        self.y = np.tile(o.y0.astype(self.dtype), (runs, 1))
        self.s = np.zeros((runs, len(tables.law.limit)), self.dtype)
        self.latched, self.doubt = np.zeros(runs, np.uint32), np.zeros(runs, bool)

    def step(self, ref: Array, y: Array) -> TrackingAnswer:
        """One sample; a row of y with a NaN in it is a missing measurement.

        Parameters
        ----------
        ref : ndarray (S, k), y : ndarray (S, p)

        Returns
        -------
        answer : TrackingAnswer
            Zeros where the status is an error, and the state is as it was.
        """
        t, o, law = self.tables, self.tables.observer, self.tables.law
        ref, y = np.asarray(ref, self.dtype), np.asarray(y, self.dtype)
        measured = ~np.isnan(y).any(axis=1)
        status = np.where(~within(ref, -law.reference, law.reference), BAD_INPUT, OK)
        status = np.where((status == OK) & measured & ~within(y, o.y_lo, o.y_hi), BAD_OUTPUT, status)
        on = status == OK
        now = np.where(measured[:, None], y, self.y)
        u, limited = self._law(now, ref)
        x_hat, r, h, inside, z = step(o, self.z, u, now, np.zeros((len(y), 0), self.dtype), measured)
        s, cut = self._integral(ref, now)
        limited = limited | np.where(cut & measured, CUT_INTEGRAL, 0).astype(np.uint32)
        beyond = ~(np.where(r < 0, -r, r) <= t.r_bound.astype(self.dtype))
        raw = (beyond.astype(np.uint32) << np.arange(r.shape[1], dtype=np.uint32)).sum(axis=1, dtype=np.uint32)
        raw = np.where(measured, raw, 0).astype(np.uint32)
        doubt = self.doubt | ~measured | ~inside | (limited != 0)
        latched = self.latched | raw
        self.z, self.y = np.where(on[:, None], z, self.z), np.where(on[:, None], now, self.y)
        self.s = np.where((on & measured)[:, None], s, self.s)
        self.doubt = np.where(on, doubt | (raw != 0), self.doubt)
        self.latched = np.where(on, latched, self.latched).astype(np.uint32)
        parts = (u, x_hat, r, h, raw, latched, limited, inside, ~doubt)
        return TrackingAnswer(*(np.where(on if v.ndim == 1 else on[:, None], v, 0).astype(v.dtype) for v in parts),
                              status)

    def _law(self, y: Array, ref: Array) -> tuple[Array, Array]:
        """u, cut, and what was cut."""
        o, law = self.tables.observer, self.tables.law
        with np.errstate(all="ignore"):
            x_hat = summed(o.T2, y, self.z)
            h = weights(o, x_hat)
            values = np.concatenate([x_hat, self.s], axis=1)
            u = summed(np.where(law.shared, law.gains[0], 0), values)
            for j, M in enumerate(law.gains):
                own = np.where(law.shared, 0, M)
                some = np.any(own != 0, axis=1)
                u = np.where(some, u + h[:, [j]] * summed(own, values), u)
        lo, hi = o.u_lo.astype(self.dtype), o.u_hi.astype(self.dtype)
        # A comparison with NaN is false: then u is its lower end.
        cut = np.where(u > lo, u, lo)
        cut = np.where(cut < hi, cut, hi)
        return cut, np.where((cut != u).any(axis=1), CUT_INPUT, 0).astype(np.uint32)

    def _integral(self, ref: Array, y: Array) -> tuple[Array, Array]:
        """s+, cut, and whether that changed it."""
        law = self.tables.law
        with np.errstate(all="ignore"):
            s = self.s + self.dtype.type(law.period) * (ref - y[:, list(law.rows)])
        limit = law.limit.astype(self.dtype)
        cut = np.where(s > -limit, s, -limit)
        cut = np.where(cut < limit, cut, limit)
        return cut, (cut != s).any(axis=1)

    def run(self, ref: Array, y: Array) -> TrackingAnswer:
        """Feed K samples.

        Parameters
        ----------
        ref : ndarray (S, K, k), y : ndarray (S, K, p)

        Returns
        -------
        answers : TrackingAnswer
            (S, K) in front.
        """
        found = [self.step(ref[:, k], y[:, k]) for k in range(y.shape[1])]
        return TrackingAnswer(*(np.stack([getattr(a, name) for a in found], axis=1) for name in vars(found[0])))


def weights(t: PolytopicTables, x_hat: Array) -> Array:
    """Weights of the vertices at an estimate (S, h); no input is read.

    Parameters
    ----------
    t : PolytopicTables
    x_hat : ndarray (S, n)
    """
    from .polytopic import evaluate
    none = np.zeros((len(x_hat), len(t.u_lo)), x_hat.dtype)
    *h, inside = evaluate(t.weights, [*x_hat.T, *none.T], x_hat.dtype)
    return np.stack([np.broadcast_to(w, inside.shape) for w in h], axis=1).astype(x_hat.dtype)
