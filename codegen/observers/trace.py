"""What an observer answered over K samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


class Rows:
    """What all traces can do; a trace is a frozen dataclass of arrays with the same leading axes."""

    def row(self, index) -> Rows:
        """Return one run (or any index of the leading axes) as a trace."""
        return type(self)(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @property
    def bounded(self) -> bool:
        """Whether it has bounds of the state."""
        return hasattr(self, "x_lo")

    def numbers(self) -> list[Array]:
        """The fields that are numbers, in their order."""
        fields = (getattr(self, name) for name in self.__dataclass_fields__)
        return [value for value in fields if value.dtype.kind == "f"]

    def words(self) -> list[Array]:
        """The fields that are words of one family alone."""
        return []

    def word_names(self) -> list[str]:
        """The names of these fields."""
        words = self.words()
        return [name for name in self.__dataclass_fields__ if any(getattr(self, name) is w for w in words)]

    def differs(self, other: Rows) -> list[str]:
        """Names of the fields in which two traces are not ``==`` (NaN equals NaN)."""
        return [name for name in self.__dataclass_fields__
                if not np.array_equal(getattr(self, name), getattr(other, name),
                                      equal_nan=getattr(self, name).dtype.kind == "f")]


def blank(shape: tuple[int, ...], numbers: tuple[int, ...], dtype, own: int = 0) -> list[Array]:
    """Fields of a trace: vectors of NaN, alarm, its three words of bits, assured, status; and words of a family.

    Parameters
    ----------
    shape : tuple of int
        Leading axes, e.g. (K,) or (S, K).
    numbers : tuple of int
        Sizes of the vectors.
    dtype : numpy type
    own : int
        Words that only this family has.
    """
    real = [np.full((*shape, n), np.nan, dtype=dtype) for n in numbers]
    words = [np.zeros(shape, dtype=np.uint32) for _ in range(3 + own)]
    alarm, assured = (np.zeros(shape, dtype=bool) for _ in range(2))
    return [*real, alarm, *words[:3], assured, np.zeros(shape, dtype=np.int64), *words[3:]]


@dataclass(frozen=True)
class Trace(Rows):
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
        return cls(*blank(shape, (n_x, n_x, n_y, n_y), dtype))


@dataclass(frozen=True)
class PointTrace(Rows):
    """Answers of a point observer with a residual set; row k is what it says at sample k.

    Parameters
    ----------
    x_hat : ndarray (K, n_x)
        Estimate. NaN where the status is an error that left nothing to say.
    x_lo, x_hi : ndarray (K, n_x)
        Bounds of the state: x_hat and the hull of the error set.
    r : ndarray (K, n_y)
        Residual, y minus what the estimate expects; NaN at a sample without measurement.
    r_bound : ndarray (K, n_y)
        Largest |r| that is possible without a fault.
    alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; with several outputs the bit after the last means "outside of the set, though each residual
        is within its bound".
    """

    x_hat: Array
    x_lo: Array
    x_hi: Array
    r: Array
    r_bound: Array
    alarm: Array
    alarm_bits: Array
    latched_bits: Array
    raw_bits: Array
    assured: Array
    status: Array

    @property
    def r_lo(self) -> Array:
        """Lower bound of what y may be, minus y, as the interval family answers."""
        return -self.r - self.r_bound

    @property
    def r_hi(self) -> Array:
        """Upper bound of what y may be, minus y."""
        return -self.r + self.r_bound

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype) -> PointTrace:
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        return cls(*blank(shape, (n_x, n_x, n_x, n_y, n_y), dtype))


@dataclass(frozen=True)
class FilterTrace(Rows):
    """Answers of a fault estimation filter; row k is what it says at sample k.

    Parameters
    ----------
    f_hat : ndarray (K, n_f)
        Estimates of the (weighted) faults; NaN at a sample without measurement.
    f_bound : ndarray (K, n_f)
        Largest |f_hat| that is possible without a fault.
    alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; bit j is fault channel j.
    """

    f_hat: Array
    f_bound: Array
    alarm: Array
    alarm_bits: Array
    latched_bits: Array
    raw_bits: Array
    assured: Array
    status: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_f: int, n_y: int, dtype) -> FilterTrace:
        """Allocate for runs of the given leading shape; ``n_y`` is not used."""
        del n_y
        return cls(*blank(shape, (n_f, n_f), dtype))
