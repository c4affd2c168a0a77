"""Drive the compiled observer over numpy arrays; the sample loop runs in C."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..observers import Trace
from ..observers.interval import outward

Array = np.ndarray
NO_MODE = 2**32 - 1  # any mode that does not fit 32 bits: the C refuses it as it refuses every other


class Driver:
    """A compiled observer, with the calls of the numpy reference.

    Parameters
    ----------
    folder : Path
        Where its C is.
    record : dict
        Contents of ``resources.json``.
    ffi, lib
        cffi's interface and the loaded library; ``lib.<prefix>_step`` and the others can be called.
    """

    def __init__(self, folder: Path, record: dict, ffi, lib):
        self.folder = folder
        self.record = record
        self.prefix: str = record["prefix"]
        self.real: str = record["real"]
        self.layout: str = record["layout"]
        self.family: str = record["family"]
        self.ffi = ffi
        self.lib = lib

    def run(self, u, y, q=None, theta=None, x0_lo=None, x0_hi=None) -> Trace:
        """Run over K samples.

        Parameters
        ----------
        u : ndarray (K, n_u), y : ndarray (K, n_y)
            A row of y with a NaN in it is a missing measurement.
        q : ndarray (K,) int, optional
            Active mode, default 0.
        theta : ignored
            The interval families have no scheduling parameter.
        x0_lo, x0_hi : ndarray (n_x,), optional
            Another initial box than the plant file's; rounded outward.

        Returns
        -------
        trace : Trace

        Raises
        ------
        ValueError
            A shape or a type does not fit.
        """
        y = np.asarray(y)
        u = np.zeros((len(y), 0)) if u is None else np.asarray(u)
        q = np.zeros(len(y), dtype=np.uint32) if q is None else np.asarray(q)
        return self.run_many(u[None], y[None], q[None], x0_lo, x0_hi).row(0)

    def run_many(self, u, y, q, x0_lo=None, x0_hi=None) -> Trace:
        """Run S observers over K samples each.

        Arrays that are contiguous and of the C's type are passed without a copy.

        Parameters
        ----------
        u : ndarray (S, K, n_u), y : ndarray (S, K, n_y), q : ndarray (S, K) int
        x0_lo, x0_hi : ndarray (n_x,) or (S, n_x), optional

        Returns
        -------
        trace : Trace
            With (S, K) as leading axes.

        Raises
        ------
        ValueError
            A shape or a type does not fit.
        """
        n_x, n_u, n_y = (self.record[n] for n in ("n_x", "n_u", "n_y"))
        q = np.asarray(q)
        if q.ndim != 2 or q.dtype.kind not in "iu":
            raise ValueError(f"q: {q.dtype} of shape {q.shape} (expected integers, one per sample)")
        runs, steps = q.shape
        u = self._array("u", u, (runs, steps, n_u))
        y = self._array("y", y, (runs, steps, n_y))
        if q.dtype != np.uint32:
            q = np.where((q < 0) | (q > NO_MODE), NO_MODE, q).astype(np.uint32)
        dtype = np.dtype(self.real)
        boxes = [None if x0 is None else np.ascontiguousarray(np.broadcast_to(outward(x0, dtype, side), (runs, n_x)))
                 for x0, side in ((x0_lo, -np.inf), (x0_hi, np.inf))]
        trace = Trace.empty((runs, steps), n_x, n_y, dtype)
        reads = [self._pointer(a) for a in (u, y, np.ascontiguousarray(q), *boxes)]
        writes = [self._pointer(a, write=True) for a in (
            trace.x_lo, trace.x_hi, trace.r_lo, trace.r_hi, trace.alarm, trace.alarm_bits, trace.latched_bits,
            trace.raw_bits, trace.assured, trace.status)]
        self.lib.residua_run(runs, steps, *reads, *writes)
        return trace

    def _array(self, name: str, values, shape: tuple[int, ...]) -> Array:
        """Return a contiguous array of the C's type, the same object if it is one already."""
        values = np.asarray(values)
        if values.shape != shape:
            raise ValueError(f"{name}: shape {values.shape} (expected {shape})")
        with np.errstate(over="ignore"):  # what overflows becomes infinite, and is refused by the C
            return np.ascontiguousarray(values, dtype=self.real)

    def _pointer(self, array: Array | None, write: bool = False):
        """Return the C pointer to an array (NULL for none), its type taken from the array's."""
        if array is None or array.size == 0:
            return self.ffi.NULL
        kind = {"f4": "float", "f8": "double", "u4": "uint32_t", "i8": "int64_t", "b1": "unsigned char"}
        return self.ffi.from_buffer(f"{kind[array.dtype.str[1:]]}[]", array, require_writable=write)
