"""What all run-time families share around one sample: runs over arrays, and the answers to what the C refuses."""

from __future__ import annotations

import numpy as np

from .supervisor import BAD_INPUT, BAD_MODE, BAD_OUTPUT, BAD_PARAMETER, OK, Supervision
from .trace import Trace

Array = np.ndarray


class Runner:
    """An observer as the firmware runs it, on S independent runs at once.

    A family adds ``start(t, runs, x0_lo, x0_hi)``, ``sample(t, on, measured, u, y, q, theta, out)`` and
    ``reset(t, on)``: ``<p>_init``, ``<p>_step`` or ``<p>_predict``, ``<p>_reset`` of the runs in ``on``.

    Parameters
    ----------
    tables : dict
        "float32" and "float64" -> tables of the family (``tables_class``).
    supervision : Supervision
    """

    family = ""
    tables_class: type = object
    trace_class: type = Trace

    def __init__(self, tables: dict, supervision: Supervision):
        self.tables = tables
        self.supervision = supervision

    def empty(self, t, shape: tuple[int, ...]) -> Trace:
        """Allocate the answers of runs of the given leading shape."""
        return self.trace_class.empty(shape, len(t.box), t.C.shape[1], t.dtype)

    @classmethod
    def answers(cls, shape: tuple[int, ...], record: dict, dtype) -> Trace:
        """Allocate the answers of compiled C, whose ``resources.json`` is ``record``."""
        return cls.trace_class.empty(shape, record["n_x"], record["n_y"], dtype)

    @classmethod
    def read(cls, data: dict, sizes: tuple[int, int, int, int]):
        """Tables from design.json; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        return cls.tables_class.from_dict(data, sizes)

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """What another initial box puts into the members of the C's state that hold it, None where there is none.

        Parameters
        ----------
        x0_lo, x0_hi : ndarray (n_x,) or (S, n_x), or None
        shape : (int, int)
            S, n_x.
        record : dict
            Contents of ``resources.json``.
        dtype : numpy type

        Returns
        -------
        list of ndarray (S, ...) or None
            In the order of ``host.build.START``.
        """
        return [None if x0 is None else np.ascontiguousarray(np.broadcast_to(outward(x0, dtype, side), shape))
                for x0, side in ((x0_lo, -np.inf), (x0_hi, np.inf))]

    def run(self, u, y, q=None, theta=None, real="float32", x0_lo=None, x0_hi=None) -> Trace:
        """Run over K samples, exactly as the compiled C does.

        Parameters
        ----------
        u : ndarray (K, n_u), y : ndarray (K, n_y)
            A row of y with a NaN in it is a missing measurement (``<p>_predict``).
        q : ndarray (K,) int, optional
            Active mode, default 0.
        theta : ndarray (K, n_theta), optional
            Parameters, of which the measured ones are read (or these alone); needed where the tables have some.
        real : {"float32", "float64"}
        x0_lo, x0_hi : ndarray (n_x,), optional
            Another initial box than the plant file's.

        Returns
        -------
        Trace
        """
        y = np.asarray(y)
        q = np.zeros(len(y), dtype=np.int64) if q is None else np.asarray(q)
        theta = None if theta is None else np.asarray(theta)[None]
        return self.run_many(np.asarray(u)[None], y[None], q[None], real, x0_lo, x0_hi, theta).row(0)

    def run_many(self, u, y, q, real="float32", x0_lo=None, x0_hi=None, theta=None) -> Trace:
        """As ``run`` for S runs at once: u (S, K, n_u), y (S, K, n_y), q (S, K), theta (S, K, J)."""
        t = self.tables[real]
        u, y, q = np.asarray(u).astype(t.dtype), np.asarray(y).astype(t.dtype), np.asarray(q)
        theta = np.empty((*q.shape, 0)) if t.vary is None or theta is None else t.vary.read(np.asarray(theta))
        theta = theta.astype(t.dtype)
        runs, steps = q.shape
        trace = self.empty(t, (runs, steps))
        self.start(t, runs, x0_lo, x0_hi)
        for k in range(steps):
            self._one(t, u[:, k], y[:, k], q[:, k], theta[:, k], trace.row((slice(None), k)))
        return trace

    def _one(self, t, u, y, q, theta, out):
        """Check the inputs as the C does, then do what the header tells firmware to do on an error."""
        missing = np.isnan(y).any(axis=1)
        bad_mode = (q < 0) | (q >= len(t.A))
        bad_u = ~((u >= t.u_lo) & (u <= t.u_hi)).all(axis=1)
        bad_y = ~((y >= t.y_lo) & (y <= t.y_hi)).all(axis=1) & ~missing
        safe_theta = theta
        if t.vary is not None and t.vary.parameters:
            lo, hi = (b[np.where(bad_mode, 0, q)] for b in (t.vary.theta_lo, t.vary.theta_hi))
            bad_theta = ~((theta >= lo) & (theta <= hi)).all(axis=1)
            safe_theta = np.where(bad_theta[:, None], lo, theta)
        else:
            bad_theta = np.zeros(len(q), dtype=bool)
        status = np.where(bad_mode, BAD_MODE, np.where(bad_u, BAD_INPUT, np.where(
            bad_theta, BAD_PARAMETER, np.where(bad_y, BAD_OUTPUT, OK))))
        on = ~(bad_mode | bad_u | bad_theta)
        measured = on & ~bad_y & ~missing
        # Rows that are refused are computed with harmless numbers and then thrown away.
        safe_u, safe_y = np.where(on[:, None], u, t.u_lo), np.where(measured[:, None], y, t.y_lo)
        self.sample(t, on, measured, safe_u, safe_y, np.where(on, q, 0), safe_theta, out)
        if not on.all():
            self.reset(t, ~on)
        out.status[...] = status


def pack(bits: Array) -> Array:
    """Bits (S, n) to words (S,), bit j the column j."""
    return (bits.astype(np.uint32) << np.arange(bits.shape[1], dtype=np.uint32)).sum(axis=1, dtype=np.uint32)


def outward(x: Array, dtype, direction: float) -> Array:
    """Round to ``dtype`` towards ``direction`` (-inf or inf)."""
    x = np.asarray(x, dtype=np.float64)
    y = x.astype(dtype)
    wrong = (y.astype(np.float64) > x) if direction < 0 else (y.astype(np.float64) < x)
    return np.where(wrong, np.nextafter(y, np.array(direction, dtype=dtype)), y).astype(dtype)
