"""Point observers with a residual set: tables and arithmetic of the estimate, operation by operation as in the C.

The estimate obeys in mode q, with N = 0 for the Luenberger observer::

    x_hat+ = M x_hat + G u + L y + N y+ + d,      M = T A - L C,  G = T B - L D,  T + N C = I
    r      = y - (C x_hat + D u + c)

d and c are the centres of disturbance and noise. Without a fault ``x - x_hat`` lies in a set whose shape follows the
modes alone (``zonotope``, ``ellipsoid``), and r in its image. For N != 0 the set is that of
``x - x_hat + N Dv v``: the noise v of a sample enters x_hat through N *and* r directly, and kept together the two
copies partly cancel (by a factor of eight in area in the example of Zammali (2020), 6.3.5).

A sample is taken when its measurement arrives: the state keeps estimate, input, output and mode of the last one, so
that a missing measurement is bridged by ``x_hat+ = A x_hat + B u + a`` (as family "tnl" does).

All that rounding, rounded constants and rounded inputs can do is a box of constant size ``e`` beside the set (see
``certify.sets``). The margins rest on ``|x_hat| <= box``: without a fault the estimate cannot leave it, so cutting it
there changes nothing but what a fault may do.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .framer import add_terms
from .runner import Runner, pack
from .supervisor import SupervisorState, judge, undisturbed, watch_dwell
from .tnl import BLIND, FRESH, FULL
from .trace import PointTrace

Array = np.ndarray


@dataclass(frozen=True)
class PointTables:
    """The numbers of the estimate that the C holds (dtype float32 or float64); N modes on the first axis.

    Parameters
    ----------
    real : {"float32", "float64"}
    kind : {"luenberger", "tnl"}
    M : ndarray (N, n_x, n_x), G : ndarray (N, n_x, n_u), L, N : ndarray (N, n_x, n_y), d : ndarray (N, n_x)
        The measured step.
    A : ndarray (N, n_x, n_x), B : ndarray (N, n_x, n_u), a : ndarray (N, n_x)
        The step without a measurement.
    C : ndarray (N, n_y, n_x), D : ndarray (N, n_y, n_u), c : ndarray (N, n_y)
        The residual.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n_x,)
        Declared range and initial box.
    box : ndarray (n_x,)
        Bound on |x_hat| and |x| behind the margins.
    limit : ndarray (n_x,)
        Half widths beyond which the set starts again from the declared range.
    u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    shape : ZonotopeTables
        The set of the error.
    """

    real: str
    kind: str
    M: Array
    G: Array
    L: Array
    N: Array
    d: Array
    A: Array
    B: Array
    a: Array
    C: Array
    D: Array
    c: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    box: Array
    limit: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    shape: object

    #: No parameters, no other coordinates (``FramerTables``); the bounds are not cut to the declared range.
    vary = change = None
    clamp = False
    signed = False

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def origins(self) -> int:
        """Number of ways in which an estimate may hold its own sample's noise: the N of each mode, or none at all."""
        return len(self.A) + 1 if self.kind == "tnl" else 1

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int], shape_class) -> PointTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        n, x, u, y = sizes
        shapes = {"M": (n, x, x), "G": (n, x, u), "L": (n, x, y), "N": (n, x, y), "d": (n, x), "A": (n, x, x),
                  "B": (n, x, u), "a": (n, x), "C": (n, y, x), "D": (n, y, u), "c": (n, y), "x_lo": (x,), "x_hi": (x,),
                  "x0_lo": (x,), "x0_hi": (x,), "box": (x,), "limit": (x,), "u_lo": (u,), "u_hi": (u,), "y_lo": (y,),
                  "y_hi": (y,)}
        dtype = np.dtype(data["real"])
        arrays = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(dtype) for k, s in shapes.items()}
        return cls(real=data["real"], kind=data["kind"], **arrays,
                   shape=shape_class.from_dict(data["shape"], data["kind"], sizes, data["real"]))


def plain(value):
    """Make lists of arrays, and dicts of tables, for JSON."""
    if isinstance(value, np.ndarray):
        return value.astype(np.float64).tolist()
    return value.to_dict() if hasattr(value, "to_dict") else value


def centred(lo: Array, hi: Array, dtype) -> tuple[Array, Array]:
    """Centre and half widths, in the type of the C, of a box that holds [lo, hi] (given in double precision)."""
    lo, hi = np.asarray(lo, dtype=np.float64), np.asarray(hi, dtype=np.float64)
    centre = (lo / 2 + hi / 2).astype(dtype)
    half = np.maximum(hi - centre, centre - lo)
    half = np.where(half > 0, np.nextafter(half, np.inf), 0.0)  # the difference itself was rounded
    return centre, outward_up(half, dtype)


def outward_up(x: Array, dtype) -> Array:
    """Round up to ``dtype``."""
    y = x.astype(dtype)
    return np.where(y.astype(np.float64) < x, np.nextafter(y, np.array(np.inf, dtype=dtype)), y).astype(dtype)


def forward(t: PointTables, p: Array, x: Array, u: Array, y: Array, y_next: Array) -> Array:
    """Move the estimate by a measured step of the modes p; all (S, n)."""
    total = add_terms(np.zeros_like(x), t.G[p], u)
    total = add_terms(add_terms(total, t.L[p], y), t.N[p], y_next)
    return cut(t, add_terms(total + t.d[p], t.M[p], x))


def blind(t: PointTables, p: Array, x: Array, u: Array) -> Array:
    """Move the estimate by a step whose measurement is missing."""
    return cut(t, add_terms(add_terms(np.zeros_like(x), t.B[p], u) + t.a[p], t.A[p], x))


def cut(t: PointTables, x: Array) -> Array:
    """Cut to the box behind the margins: no change unless a fault acts."""
    x = np.where(x < -t.box, -t.box, x)
    return np.where(x > t.box, t.box, x)


def residual(t: PointTables, q: Array, x: Array, u: Array, y: Array) -> Array:
    """Return y - (C x + D u + c)."""
    return y - add_terms(add_terms(np.zeros_like(y), t.D[q], u) + t.c[q], t.C[q], x)


class PointObserver(Runner):
    """A point observer as the firmware runs it; a family adds the arithmetic of its set.

    A family has ``whole(t, half, first)`` (the set of a box, for S runs; ``first``: of the initial one),
    ``moved(t, p, q, origin, set, measured)``, ``radius(t, q, origin, set)``, ``fits(t, x, radius)`` (whether the
    margins still hold) and ``judged(t, q, origin, set, r)`` -> (r_bound, raw bits).
    """

    tables_class = PointTables
    trace_class = PointTrace
    shape_class: type = object

    @classmethod
    def read(cls, data: dict, sizes: tuple[int, int, int, int]) -> PointTables:
        """Tables from design.json."""
        return PointTables.from_dict(data, sizes, cls.shape_class)

    def start(self, t: PointTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None):
        """Set all runs to the initial box (``<p>_init``)."""
        self._fill(t, runs, t.x0_lo if x0_lo is None else x0_lo, t.x0_hi if x0_hi is None else x0_hi, True)

    def bits(self, n_y: int) -> int:
        """Alarm bits: one per output, and with several one for what only their set shows."""
        return n_y + (n_y > 1)

    def fits(self, t: PointTables, x: Array, radius: Array) -> Array:
        """Whether the set has not grown beyond what the margins are proved for, per run."""
        return (radius <= t.limit).all(axis=1)

    def _fill(self, t, runs, lo, hi, first):
        centre, half = centred(lo, hi, t.dtype)
        n_y = t.C.shape[1]
        self.x_hat = np.broadcast_to(centre, (runs, len(t.box))).astype(t.dtype)
        self.set = self.whole(t, np.broadcast_to(half, (runs, len(t.box))), first)
        self.u = np.zeros((runs, t.G.shape[2]), dtype=t.dtype)
        self.y = np.zeros((runs, n_y), dtype=t.dtype)
        self.phase = np.full(runs, FRESH)
        self.origin = np.full(runs, t.origins - 1)
        self.guard = SupervisorState(runs, self.bits(n_y), len(t.A))

    def _arrive(self, t, measured, y, q):
        """Estimate and set at this sample, started again where the set has grown beyond its limit."""
        p = np.minimum(self.guard.mode, len(t.A) - 1)  # only read where a mode has been seen
        full, fresh = (self.phase == FULL) & measured, self.phase == FRESH

        def chosen(now, corrected, predicted):
            pick = [m.reshape(-1, *[1] * (now.ndim - 1)) for m in (fresh, full)]
            return np.where(pick[0], now, np.where(pick[1], corrected, predicted))

        x = chosen(self.x_hat, forward(t, p, self.x_hat, self.u, self.y, y), blind(t, p, self.x_hat, self.u))
        shape = chosen(self.set, self.moved(t, p, q, self.origin, self.set, True),
                       self.moved(t, p, q, self.origin, self.set, False))
        last = t.origins - 1
        origin = chosen(self.origin, p if last else np.zeros_like(p), np.full_like(p, last))
        radius = self.radius(t, q, origin, shape)
        grown = ~self.fits(t, x, radius)
        if grown.any():
            centre, half = centred(t.x_lo, t.x_hi, t.dtype)
            everywhere = self.whole(t, np.broadcast_to(half, x.shape), False)
            x = np.where(grown[:, None], centre, x)
            shape = np.where(grown.reshape(-1, *[1] * (shape.ndim - 1)), everywhere, shape)
            origin = np.where(grown, last, origin)
            radius = self.radius(t, q, origin, shape)
        return x, shape, origin, radius

    def sample(self, t: PointTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: PointTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        x, shape, origin, radius = self._arrive(t, measured, y, q)
        r = residual(t, q, x, u, y)
        r_bound, raw = self.judged(t, q, origin, shape, r)
        watch_dwell(self.supervision, self.guard, on, q, len(t.A))
        alarm, again, assured = judge(self.supervision, self.guard, on & measured, raw)
        free = undisturbed(self.supervision, self.guard)
        seen = on & measured
        self._leave(t, on, seen, again & measured, x, shape, origin, u, y)
        out.x_hat[on] = x[on]
        out.x_lo[on], out.x_hi[on] = (x - radius)[on], (x + radius)[on]
        out.r[seen], out.r_bound[seen] = r[seen], r_bound[seen]
        out.raw_bits[seen] = pack(raw)[seen]
        out.alarm_bits[seen] = pack(alarm)[seen]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[seen] = alarm[seen].any(axis=1)
        out.assured[on] = np.where(measured, assured, free)[on]

    def _leave(self, t, on, seen, again, x, shape, origin, u, y):
        """Store what the next sample needs, for the runs in ``on``."""
        centre, half = centred(t.x_lo, t.x_hi, t.dtype)
        wide = again.reshape(-1, *[1] * (shape.ndim - 1))
        shape = np.where(wide, self.whole(t, np.broadcast_to(half, x.shape), False), shape)
        self.x_hat = np.where(on[:, None], np.where(again[:, None], centre, x), self.x_hat)
        self.set = np.where(on.reshape(wide.shape), shape, self.set)
        self.origin = np.where(on, np.where(again, t.origins - 1, origin), self.origin)
        self.u = np.where(on[:, None], u, self.u)
        self.y = np.where(seen[:, None], y, self.y)
        self.phase = np.where(on, np.where(again, FRESH, np.where(seen, FULL, BLIND)), self.phase)

    def reset(self, t: PointTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        old = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        guard = self.guard
        self._fill(t, len(on), t.x_lo, t.x_hi, False)
        for place, values in ((self, old), (self.guard, dict(vars(guard)))):
            for name, value in values.items():
                mask = on.reshape(-1, *[1] * (value.ndim - 1))
                setattr(place, name, np.where(mask, getattr(place, name), value))
