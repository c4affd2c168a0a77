"""Drive the compiled observer over numpy arrays; the sample loop runs in C.

The C reads the caller's arrays and writes the trace's: nothing is copied where an array is contiguous and of the
C's type (u, y: the ``real`` of the design; q: uint32). Others are converted, or refused with ``copy=False``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..observers import FAMILIES, Trace
from .steer import CompiledTracker

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

    def run(self, u, y, q=None, theta=None, x0_lo=None, x0_hi=None, copy: bool = True) -> Trace:
        """Run over K samples.

        Parameters
        ----------
        u : ndarray (K, n_u), y : ndarray (K, n_y)
            A row of y with a NaN in it is a missing measurement.
        q : ndarray (K,) int, optional
            Active mode, default 0.
        theta : ndarray (K, n_theta), optional
            The plant's parameters, of which the firmware reads the measured ones (or these alone).
        x0_lo, x0_hi : ndarray (n_x,), optional
            Another initial box than the plant file's; rounded outward.
        copy : bool
            Convert u, y, q where they are not contiguous or not of the C's type; False: refuse them.

        Returns
        -------
        trace : Trace

        Raises
        ------
        ValueError
            A shape or a type does not fit, or an array would have to be copied; names it, says what is expected.
        """
        y = np.asarray(y)
        u = np.zeros((len(y), 0), self.real) if u is None else np.asarray(u)
        q = np.zeros(len(y), dtype=np.uint32) if q is None else np.asarray(q)
        theta = None if theta is None else np.asarray(theta)[None]
        return self.run_many(u[None], y[None], q[None], x0_lo, x0_hi, copy, theta).row(0)

    def run_many(self, u, y, q, x0_lo=None, x0_hi=None, copy: bool = True, theta=None) -> Trace:
        """Run S observers over K samples each, e.g. many seeds or many scenarios.

        Parameters
        ----------
        u : ndarray (S, K, n_u), y : ndarray (S, K, n_y), q : ndarray (S, K) int
        x0_lo, x0_hi : ndarray (n_x,) or (S, n_x), optional
        copy : bool
            As for ``run``.
        theta : ndarray (S, K, n_theta), optional

        Returns
        -------
        trace : Trace
            With (S, K) as leading axes.

        Raises
        ------
        ValueError
            As for ``run``.
        """
        n_x, n_u, n_y = (self.record[n] for n in ("n_x", "n_u", "n_y"))
        q, dtype = np.asarray(q), np.dtype(self.real)
        if q.ndim != 2 or q.dtype.kind not in "iu":
            raise ValueError(f"q: {q.dtype} of shape {q.shape} (expected integers, one per sample)")
        runs, steps = q.shape
        u = array("u", u, (runs, steps, n_u), dtype, copy)
        y = array("y", y, (runs, steps, n_y), dtype, copy)
        theta = array("theta", self._measured(theta, runs, steps), (runs, steps, self.record["n_theta"]), dtype, copy)
        if copy and q.dtype != np.uint32:
            q = np.where((q < 0) | (q > NO_MODE), NO_MODE, q)
        q = array("q", q, (runs, steps), np.dtype(np.uint32), copy)
        family = FAMILIES[self.family]
        boxes = family.initial(x0_lo, x0_hi, (runs, n_x), self.record, dtype)
        trace = family.answers((runs, steps), self.record, dtype)
        reads = [self._pointer(a) for a in (u, y, theta, q, *boxes)]
        writes = [self._pointer(a, write=True) for a in (
            *trace.numbers(), trace.alarm, trace.alarm_bits, trace.latched_bits,
            trace.raw_bits, trace.assured, *trace.words(), trace.status)]
        self.lib.residua_run(runs, steps, *reads, *writes)
        return trace

    def tracker(self) -> CompiledTracker:
        """The observer with its tracking law, started: ``step(ref, y)`` for a loop with a plant."""
        return CompiledTracker(self)

    def _measured(self, theta, runs: int, steps: int) -> Array:
        """Take the measured columns; none where the firmware reads no parameter."""
        if not self.record["n_theta"]:
            return np.empty((runs, steps, 0), self.real)
        if theta is None:
            raise ValueError(f"theta: missing (expected shape {(runs, steps, self.record['n_theta'])}: the observer is "
                             "scheduled)")
        theta = np.asarray(theta)
        wider = theta.ndim == 3 and theta.shape[2] > self.record["n_theta"]
        return np.ascontiguousarray(theta[:, :, self.record["theta_columns"]]) if wider else theta

    def _pointer(self, array: Array | None, write: bool = False):
        """Return the C pointer to an array (NULL for none), its type taken from the array's."""
        if array is None or array.size == 0:
            return self.ffi.NULL
        kind = {"f4": "float", "f8": "double", "u4": "uint32_t", "i8": "int64_t", "b1": "unsigned char"}
        return self.ffi.from_buffer(f"{kind[array.dtype.str[1:]]}[]", array, require_writable=write)


def array(name: str, values, shape: tuple[int, ...], dtype: np.dtype, copy: bool) -> Array:
    """Return a contiguous array of the C's type: the same object if it is one already.

    Raises
    ------
    ValueError
        Not of that shape; not real numbers; or it would have to be copied and must not be.
    """
    values = np.asarray(values)
    if values.shape != shape:
        raise ValueError(f"{name}: shape {values.shape} (expected {shape})")
    if values.dtype.kind not in "fiub":
        raise ValueError(f"{name}: {values.dtype} (expected real numbers, best {dtype})")
    fits = values.dtype == dtype and values.flags.c_contiguous and values.flags.aligned
    if not (copy or fits or values.size == 0):
        order = "contiguous" if values.flags.c_contiguous else "not contiguous"
        raise ValueError(f"{name}: {values.dtype}, {order} (expected {dtype}, contiguous: it would have to be copied). "
                         f'Make it with np.require({name}, "{dtype}", "CA"), or allow copy=True.')
    with np.errstate(over="ignore"):  # what overflows becomes infinite, and is refused by the C
        return np.require(values, dtype, ["C", "A"])
