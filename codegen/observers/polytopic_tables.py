"""The numbers of a polytopic observer, as ``observers.polytopic`` and its C hold them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..algebra.program import Operation, Program
from .feedback_law import FeedbackLaw
from .point import plain

Array = np.ndarray


@dataclass(frozen=True)
class Measured:
    """The measured parameters of the weights: their columns in theta and what the check accepts, (1, J)."""

    columns: tuple[int, ...]
    theta_lo: Array
    theta_hi: Array

    @property
    def parameters(self) -> int:
        """Their number."""
        return len(self.columns)

    def read(self, theta: Array) -> Array:
        """Take the measured columns; all of them where these alone are given."""
        return theta if theta.shape[-1] == len(self.columns) else theta[..., list(self.columns)]


@dataclass(frozen=True)
class PolytopicTables:
    """The numbers that the C holds (dtype float32 or float64); h vertices on the first axis.

    Parameters
    ----------
    real : {"float32", "float64"}
    T2 : ndarray (n, p), C : ndarray (p, n)
    F : ndarray (h, n, n), G : ndarray (h, n, m), K : ndarray (h, n, p)
    known : ndarray (n, g)
        Factors of the terms of z+ that the weights' program computes beside the weights.
    M : ndarray (p, p)
        Weight of the residual.
    z0, z_mid : ndarray (n,)
        Start of z from the initial box, and from the declared range.
    y0, y_mid : ndarray (p,)
        Measurements that stand for a first one that is missing.
    h : ndarray (R, p)
        Thresholds of |M r|: rows 0 to R - 2 since a start from anywhere, the last.
    start : int
        Row after init: 0, or the last where the initial box allows it.
    shift : int
        A row holds for 2^shift samples.
    z_lo, z_hi : ndarray (n,)
        Limits of z.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n,)
        Declared range and initial box.
    u_lo, u_hi : ndarray (m,), y_lo, y_hi : ndarray (p,), theta_lo, theta_hi : ndarray (n_theta,)
        What the input check accepts.
    columns : tuple of int
        Of theta, those that are measured.
    weights : Program
        h weights, g known terms and whether they are in force, of x_hat, u, theta.
    faults : int
        Entries of x_hat that are faults, the last ones. C does not read them, so that the residual is what the faults
        do to y, and its thresholds hold around that, fault or not.
    law : FeedbackLaw, optional
        A tracking law beside the observer.
    """

    real: str
    T2: Array
    C: Array
    F: Array
    G: Array
    K: Array
    known: Array
    M: Array
    z0: Array
    z_mid: Array
    y0: Array
    y_mid: Array
    h: Array
    start: int
    shift: int
    z_lo: Array
    z_hi: Array
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    theta_lo: Array
    theta_hi: Array
    columns: tuple[int, ...]
    weights: Program
    faults: int = 0
    law: FeedbackLaw | None = None

    #: No other coordinates (``FramerTables``); nothing is cut to the declared range.
    change = None
    clamp = False
    signed = False

    @property
    def vary(self) -> Measured | None:
        """The measured parameters, where there are some."""
        return Measured(self.columns, self.theta_lo[None], self.theta_hi[None]) if self.columns else None

    @property
    def gains(self) -> Array:
        """F, G, -K and known side by side (h, n, n + m + p + g): factors of (x_hat, u, r, known terms)."""
        return np.concatenate([self.F, self.G, -self.K, np.tile(self.known, (len(self.F), 1, 1))], axis=2)

    @property
    def shared(self) -> Array:
        """Entries of `gains` that are the same at all vertices (n, n + m + p + g)."""
        return np.all(self.gains == self.gains[0], axis=0)

    @property
    def moving(self) -> Array:
        """The states that z holds an estimate of by itself: all."""
        return np.arange(len(self.z0))

    @property
    def outputs(self) -> Array:
        """Per entry of x_hat the output that it is, with nothing of z in it; -1 where it is none (n,)."""
        alone = np.sum(self.T2 != 0, axis=1) == 1
        alone &= (self.T2.max(axis=1, initial=0) == 1) & (self.z0 == 0) & (self.z_mid == 0)
        alone &= ~self.gains.any(axis=(0, 2))
        return np.where(alone, np.argmax(self.T2 != 0, axis=1), -1)

    @property
    def at_estimate(self) -> bool:
        """Whether the weights read entries of x_hat that are no output."""
        read = {k for op in self.weights.operations for k in op.args if k < len(self.T2)}
        return any(self.outputs[k] < 0 for k in read)

    @property
    def weighted(self) -> bool:
        """Whether the answer is another one than r."""
        return not np.array_equal(self.M, np.eye(len(self.M)))

    @property
    def A(self) -> Array:
        """A stack whose length is that of the modes: there is one."""
        return self.C[None]

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
        w = self.weights
        program = {"inputs": w.inputs, "constants": list(w.constants), "results": list(w.results),
                   "operations": [[op.name, *op.args] for op in w.operations]}
        unsaid = {"weights", "columns", "law"} | ({"known", "faults"} if not self.faults else set())
        return {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name not in unsaid} | {
            "columns": list(self.columns), "weights": program,
            **({} if self.law is None else {"law": self.law.to_dict()})}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> PolytopicTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        _, _, m, p = sizes
        data, n = {"known": np.zeros((len(data["T2"]), 0))} | data, len(data["T2"])  # n_x, or n_x + n_f
        v, j, g = len(data["F"]), len(data["columns"]), np.shape(data["known"])[1]
        shapes = {"T2": (n, p), "C": (p, n), "F": (v, n, n), "G": (v, n, m), "K": (v, n, p), "known": (n, g),
                  "M": (p, p), "z0": (n,), "z_mid": (n,), "y0": (p,), "y_mid": (p,),
                  "h": (-1, p), "z_lo": (n,), "z_hi": (n,), "x_lo": (n,),
                  "x_hi": (n,), "x0_lo": (n,), "x0_hi": (n,), "u_lo": (m,), "u_hi": (m,), "y_lo": (p,), "y_hi": (p,),
                  "theta_lo": (j,), "theta_hi": (j,)}
        dtype, w = np.dtype(data["real"]), data["weights"]
        arrays = {k: np.array(data[k], dtype=np.float64).reshape(s).astype(dtype) for k, s in shapes.items()}
        weights = Program(w["inputs"], tuple(w["constants"]), tuple(Operation(name, tuple(args))
                                                                    for name, *args in w["operations"]),
                          tuple(w["results"]))
        return cls(real=data["real"], start=int(data["start"]), shift=int(data["shift"]),
                   columns=tuple(data["columns"]), weights=weights, faults=int(data.get("faults", 0)),
                   law=FeedbackLaw.from_dict(data["law"], dtype) if "law" in data else None, **arrays)
