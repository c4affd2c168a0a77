"""The numbers of a tracking law, as ``observers.feedback`` and its C hold them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from .point import plain

Array = np.ndarray


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
        T, in s, a number of the type.
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

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name != "rows"} | {
            "rows": list(self.rows)}

    @classmethod
    def from_dict(cls, data: dict, dtype) -> FeedbackLaw:
        """Rebuild from ``to_dict``."""
        arrays = {k: np.array(data[k], dtype=np.float64).astype(dtype) for k in ("Kx", "Ki", "reference", "limit")}
        return cls(rows=tuple(int(i) for i in data["rows"]), period=float(data["period"]), **arrays)
