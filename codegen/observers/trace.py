"""What an observer answered over K samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Trace:
    """Answers of an interval observer; row k is what it says at sample k.

    Parameters
    ----------
    x_lo, x_hi : ndarray (K, n_x)
        State bounds. NaN where the status is an error that left nothing to say.
    r_lo, r_hi : ndarray (K, n_y)
        Residual bounds; NaN at a sample without measurement.
    alarm : ndarray (K,) bool
        Any alarm bit after the debounce.
    alarm_bits, latched_bits, raw_bits : ndarray (K,) uint32
        Bit j is output j; the bit after the last output means "framers crossed" (unequal gains only).
    assured : ndarray (K,) bool
    status : ndarray (K,) int
        0 done, 1 bad mode, 2 bad input, 3 bad output.
    """

    x_lo: Array
    x_hi: Array
    r_lo: Array
    r_hi: Array
    alarm: Array
    alarm_bits: Array
    latched_bits: Array
    raw_bits: Array
    assured: Array
    status: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype) -> Trace:
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        real = [np.full((*shape, n), np.nan, dtype=dtype) for n in (n_x, n_x, n_y, n_y)]
        bits = [np.zeros(shape, dtype=np.uint32) for _ in range(3)]
        return cls(*real, np.zeros(shape, bool), *bits, np.zeros(shape, bool), np.zeros(shape, dtype=np.int64))

    def row(self, index) -> Trace:
        """Return one run (or any index of the leading axes) as a Trace."""
        return Trace(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def differs(self, other: Trace) -> list[str]:
        """Names of the fields in which two traces are not ``==`` (NaN equals NaN)."""
        return [name for name in self.__dataclass_fields__
                if not np.array_equal(getattr(self, name), getattr(other, name),
                                      equal_nan=getattr(self, name).dtype.kind == "f")]
