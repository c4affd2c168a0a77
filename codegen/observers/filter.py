"""Run-time family "filter": a switched filter that estimates faults, and thresholds for a decision on the estimate.

At sample k, in mode q, from the filter's state xi::

    1  f_hat = Du u + Dy y + K xi                    estimate of the faults
    2  alarm where |f_hat| > h[since >> shift, q]    no fault: |f_hat| cannot exceed it
    3  xi+   = G u + L y + M xi                      the state is kept at switches

``since`` counts the samples since the last start, up to the last row, which holds for ever. There are two kinds of
starts: anywhere, the plant in its declared range and xi within its limit (reset, the end of a fault that has been seen,
switching faster than declared), and a sample without measurement, after which xi is zero and the plant where it can be
without a fault. So nothing that the firmware may meet makes a false alarm, only higher thresholds for a while. While a
fault is seen nothing starts again: the estimate goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .framer import add_terms
from .point import plain
from .runner import Runner, pack
from .supervisor import SupervisorState, judge, undisturbed, watch_dwell
from .thresholds import refuse
from .trace import FilterTrace

Array = np.ndarray


@dataclass(frozen=True)
class FilterTables:
    """The numbers that the C holds (dtype float32 or float64); N modes on the first axis.

    Parameters
    ----------
    real : {"float32", "float64"}
    M : ndarray (N, n_s, n_s), G : ndarray (N, n_s, n_u), L : ndarray (N, n_s, n_y)
        The step of the filter.
    K : ndarray (N, n_f, n_s), Du : ndarray (N, n_f, n_u), Dy : ndarray (N, n_f, n_y)
        The estimate.
    h : ndarray (R, N, n_f)
        Thresholds: rows 0 to lost - 1 from anywhere, rows lost to R - 2 after a sample without measurement, the last.
    lost : int
    start : int
        Row after init: 0, or ``lost`` or the last where the initial box allows it.
    shift : int
        A row holds for 2^shift samples.
    limit : ndarray (n_s,)
        Beyond it the filter starts with xi = 0; measurements and inputs within their ranges should not lead there.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n_x,)
        Declared range and initial box.
    u_lo, u_hi : ndarray (n_u,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    """

    real: str
    M: Array
    G: Array
    L: Array
    K: Array
    Du: Array
    Dy: Array
    h: Array
    lost: int
    start: int
    shift: int
    limit: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array

    #: No parameters, no other coordinates (``FramerTables``); nothing is cut to the declared range.
    vary = change = None
    clamp = False
    signed = False

    @property
    def A(self) -> Array:
        """The matrices whose number is that of the modes."""
        return self.M

    @property
    def box(self) -> Array:
        """Bounds of x: the declared range."""
        return self.x_hi

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def last(self) -> int:
        """The row that holds for ever."""
        return len(self.h) - 1

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> FilterTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        n, x, u, y = sizes
        s, f = len(data["limit"]), len(data["K"][0])
        shapes = {"M": (n, s, s), "G": (n, s, u), "L": (n, s, y), "K": (n, f, s), "Du": (n, f, u), "Dy": (n, f, y),
                  "h": (-1, n, f), "limit": (s,), "x_lo": (x,), "x_hi": (x,), "x0_lo": (x,), "x0_hi": (x,),
                  "u_lo": (u,), "u_hi": (u,), "y_lo": (y,), "y_hi": (y,)}
        dtype = np.dtype(data["real"])
        arrays = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(dtype) for k, s in shapes.items()}
        return cls(real=data["real"], lost=int(data["lost"]), start=int(data["start"]),
                   shift=int(data["shift"]), **arrays)


class FilterObserver(Runner):
    """The filter as the firmware runs it, on S independent runs at once; see ``Runner`` for the calls."""

    family = "filter"
    tables_class = FilterTables
    trace_class = FilterTrace

    def empty(self, t, shape: tuple[int, ...]) -> FilterTrace:
        """Allocate the answers of runs of the given leading shape."""
        return FilterTrace.empty(shape, t.K.shape[1], 0, t.dtype)

    @classmethod
    def answers(cls, shape: tuple[int, ...], record: dict, dtype) -> FilterTrace:
        """Allocate the answers of compiled C, whose ``resources.json`` is ``record``."""
        return FilterTrace.empty(shape, next(n for name, _, n in record["out"] if name == "f_hat"), 0, dtype)

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Nothing: the thresholds hold for the initial box of the plant file."""
        refuse(x0_lo, x0_hi)
        return []

    def start(self, t: FilterTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None):
        """Set all runs to the initial box (``<p>_init``).

        Raises
        ------
        ValueError
            Another initial box than the plant file's, for which the thresholds hold.
        """
        refuse(x0_lo, x0_hi)
        self._fill(t, runs, t.start << t.shift)

    def _fill(self, t, runs: int, since: int):
        self.xi = np.zeros((runs, len(t.limit)), dtype=t.dtype)
        self.since = np.full(runs, since)
        self.guard = SupervisorState(runs, t.K.shape[1], len(t.M))

    def sample(self, t: FilterTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: FilterTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        f_hat = np.zeros((len(q), t.K.shape[1]), dtype=t.dtype)
        f_hat = add_terms(add_terms(add_terms(f_hat, t.Du[q], u), t.Dy[q], y), t.K[q], self.xi)
        f_bound = t.h[np.minimum(self.since >> t.shift, t.last), q]
        raw = ~(np.abs(f_hat) <= f_bound)
        watch_dwell(self.supervision, self.guard, on, q, len(t.M))
        seen = on & measured
        alarm, again, assured = judge(self.supervision, self.guard, seen, raw)
        free = undisturbed(self.supervision, self.guard)
        fault = raw.any(axis=1)
        self.guard.run = np.where(seen & again & fault, 1, self.guard.run)  # at the first quiet sample it still counts
        again = (again & ~fault) | self.guard.too_fast
        self._leave(t, on, seen, again, q, u, y)
        out.f_hat[seen], out.f_bound[seen] = f_hat[seen], f_bound[seen]
        out.raw_bits[seen] = pack(raw)[seen]
        out.alarm_bits[seen] = pack(alarm)[seen]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[seen] = alarm[seen].any(axis=1)
        out.assured[on] = np.where(measured, assured, free)[on]

    def _leave(self, t, on, seen, again, q, u, y):
        """Move the filter, and start its table again, for the runs in ``on``."""
        xi = add_terms(add_terms(add_terms(np.zeros_like(self.xi), t.G[q], u), t.L[q], y), t.M[q], self.xi)
        beyond = ~(np.abs(xi) <= t.limit).all(axis=1)
        lost, last = t.lost << t.shift, t.last << t.shift
        since = np.where(self.since + 1 == lost, last, np.minimum(self.since + 1, last))
        since = np.where(again | beyond, 0, since)
        # What the plant may have become is known where it was known before; the filter starts anew.
        late = np.where((self.since >= lost) & ~self.guard.too_fast, lost, 0)
        xi = np.where((beyond | ~seen)[:, None], 0, xi)
        self.xi = np.where(on[:, None], xi, self.xi)
        self.since = np.where(on, np.where(seen, since, late), self.since)

    def reset(self, t: FilterTables, on: Array) -> None:
        """Restart the runs in ``on`` from the declared ranges, alarms cleared (``<p>_reset``)."""
        xi, since, guard = self.xi, self.since, self.guard
        self._fill(t, len(on), 0)
        self.xi = np.where(on[:, None], self.xi, xi)
        self.since = np.where(on, self.since, since)
        for name, value in vars(guard).items():
            mask = on if value.ndim == 1 else on[:, None]
            setattr(self.guard, name, np.where(mask, getattr(self.guard, name), value))
