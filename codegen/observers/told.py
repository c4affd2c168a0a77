"""What observers that a mode estimator drives share: tables of both in one, and answers of both in one.

Each class here stands before the estimator's own among the bases: its tables, answers and observer come with what is
driven as ``told``.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from .inner import alone
from .point import PointObserver, centred

Array = np.ndarray


def behind(cls, own, *more, **named):
    """An instance of a dataclass that begins with the fields of ``own``, the others behind them."""
    return cls(*(getattr(own, f.name) for f in fields(own)), *more, **named)


class Told:
    """Tables of an estimator, those of what it drives in ``told``."""

    def to_dict(self) -> dict:
        """Return plain lists for design.json; every float is exact."""
        return {**super().to_dict(), "told": self.told.to_dict()}


class ToldPoint(Told):
    """Tables of an estimator, those of a point observer in ``told``, its family in ``set``."""

    @property
    def widest(self) -> Array:
        """Half widths of the observer's range (n_x,): a start that is wider is the whole range."""
        return centred(self.told.x_lo, self.told.x_hi, self.dtype)[1]

    @property
    def alone(self) -> PointObserver:
        """The observer that is told its mode, by itself."""
        return alone(self.told, self.set)

    @property
    def by_table(self) -> bool:
        """Whether a set is a place in a table."""
        return self.set == "starts"


class PointAnswers:
    """Answers of an estimator (of class ``estimator``) with ``x_hat`` behind them."""

    @classmethod
    def empty(cls, shape: tuple[int, ...], n_x: int, n_y: int, dtype):
        """Allocate for runs of the given leading shape, e.g. (K,) or (S, K)."""
        own = cls.estimator.empty(shape, n_x, n_y, dtype)
        return behind(cls, own, np.full((*shape, n_x), np.nan, dtype=dtype))

    def numbers(self) -> list[Array]:
        """The fields that are numbers, the estimate first."""
        return [self.x_hat, self.x_lo, self.x_hi, self.r_lo, self.r_hi]


class FaultAnswers:
    """Answers of an estimator (of class ``estimator``) with ``f_hat`` and ``f_bound`` behind them."""

    @classmethod
    def of(cls, shape: tuple[int, ...], sizes: tuple[int, int, int], dtype):
        """Allocate for runs of the given leading shape; ``sizes`` is (n_x, n_y, n_f)."""
        own = cls.estimator.empty(shape, *sizes[:2], dtype)
        return behind(cls, own, *(np.full((*shape, sizes[2]), np.nan, dtype=dtype) for _ in range(2)))


class FaultObserver:
    """An observer whose answers are ``FaultAnswers``."""

    def empty(self, t, shape: tuple[int, ...]):
        """Allocate the answers of runs of the given leading shape."""
        _, n_x, _, n_y = t.sizes
        return self.trace_class.of(shape, (n_x, n_y, t.told.K.shape[1]), t.dtype)

    @classmethod
    def answers(cls, shape: tuple[int, ...], record: dict, dtype):
        """Allocate the answers of compiled C, whose ``resources.json`` is ``record``."""
        n_f = next(n for name, _, n in record["out"] if name == "f_hat")
        return cls.trace_class.of(shape, (record["n_x"], record["n_y"], n_f), dtype)
