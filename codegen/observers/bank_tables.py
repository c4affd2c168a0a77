"""Numbers of family "bank": members, each an observer of some outputs, thresholds, limits, times."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from ..algebra.program import Operation, Program
from .point import plain
from .polytopic_tables import Measured

Array = np.ndarray


@dataclass(frozen=True)
class Member:
    """One observer of the bank; h vertices on the first axis.

    Parameters
    ----------
    seen : ndarray (p,) int
        Which outputs it reads.
    T2 : ndarray (n, p), C : ndarray (p, n)
    F : ndarray (h, n, n), G : ndarray (h, n, m), K : ndarray (h, n, p)
    M : ndarray (k, p)
        Weight of the residual.
    z0 : ndarray (n,)
        Start of z.
    weights : Program
        Those of the bank.
    """

    seen: Array
    T2: Array
    C: Array
    F: Array
    G: Array
    K: Array
    M: Array
    z0: Array
    weights: Program

    @property
    def real(self) -> str:
        """The type of its numbers."""
        return self.T2.dtype.name

    @property
    def known(self) -> Array:
        """Factors of known terms (``PolytopicTables``): a bank has none (n, 0)."""
        return self.T2[:, :0]

    @cached_property
    def gains(self) -> Array:
        """F, G and -K side by side (h, n, n + m + p): factors of (x_hat, u, r)."""
        return np.concatenate([self.F, self.G, -self.K], axis=2)

    @cached_property
    def shared(self) -> Array:
        """Entries of `gains` that are the same at all vertices (n, n + m + p)."""
        return np.all(self.gains == self.gains[0], axis=0)


#: Matrices of a member, as design.json names them.
MATRICES = ("T2", "C", "F", "G", "K", "M", "z0")
#: What design.json has of banks whose weights read parameters.
PARAMETERS = ("columns", "theta_lo", "theta_hi")


@dataclass(frozen=True)
class BankTables:
    """The numbers that the C holds (float32 or float64).

    Parameters
    ----------
    real : {"float32", "float64"}
    members : tuple of Member
        One per fault, in the order of the faults.
    bound : ndarray (P,)
        Largest level that is no alarm.
    rate : float
        Of the moving averages, in (0, 1].
    settle, begin : int
        Samples after a start from anywhere, and after one from the initial box, that are not judged.
    keep : int
        Samples for which a member stays raised after an alarm, at least 1.
    gap, bridge : int
        Measured samples that pay for a lost one, and lost ones that they pay for at most: see ``observers.bank``.
    limit : ndarray (n P,), most : ndarray (k_1 + .. + k_P,)
        Magnitudes of the members' states and averages, one member after the other; beyond them all start anew.
    weights : Program
        h weights and whether they are in force, of x_hat, u, theta.
    x_lo, x_hi, x0_lo, x0_hi : ndarray (n,)
        Declared range and initial box.
    u_lo, u_hi : ndarray (m,), y_lo, y_hi : ndarray (n_y,)
        What the input check accepts.
    columns : tuple of int
        Of theta, those that are measured.
    theta_lo, theta_hi : ndarray (J,)
        What the check accepts of these.
    """

    real: str
    members: tuple[Member, ...]
    bound: Array
    rate: float
    settle: int
    begin: int
    keep: int
    gap: int
    bridge: int
    limit: Array
    most: Array
    weights: Program
    x_lo: Array
    x_hi: Array
    x0_lo: Array
    x0_hi: Array
    u_lo: Array
    u_hi: Array
    y_lo: Array
    y_hi: Array
    columns: tuple[int, ...] = ()
    theta_lo: Array = field(default_factory=lambda: np.zeros(0))
    theta_hi: Array = field(default_factory=lambda: np.zeros(0))

    #: No other coordinates (``FramerTables``); nothing is cut to the declared range.
    change = None
    clamp = signed = False

    @property
    def vary(self) -> Measured | None:
        """The measured parameters, where there are some."""
        return Measured(self.columns, self.theta_lo[None], self.theta_hi[None]) if self.columns else None

    @property
    def A(self) -> Array:
        """One mode."""
        return np.zeros((1, len(self.x_lo), len(self.x_lo)))

    @property
    def box(self) -> Array:
        """Bounds of x: the declared range."""
        return self.x_hi

    @property
    def dtype(self) -> np.dtype:
        """The numpy type of the tables."""
        return np.dtype(self.real)

    @property
    def credit(self) -> int:
        """Measured samples that are counted at most."""
        return self.gap * self.bridge

    @property
    def incidence(self) -> Array:
        """Which members (columns) a fault (rows) raises (P, P): all but its own."""
        return ~np.eye(len(self.members), dtype=bool)

    def to_dict(self) -> dict:
        """Return plain lists and numbers for design.json; every float is exact."""
        w = self.weights
        own = {"members": [{"seen": [int(k) for k in m.seen]} | {key: plain(getattr(m, key)) for key in MATRICES}
                           for m in self.members],
               "weights": {"inputs": w.inputs, "constants": list(w.constants), "results": list(w.results),
                           "operations": [[op.name, *op.args] for op in w.operations]}}
        told = [f.name for f in fields(self) if self.columns or f.name not in PARAMETERS]
        own["columns"] = list(self.columns)
        return {name: own[name] if name in own else plain(getattr(self, name)) for name in told}

    @classmethod
    def from_dict(cls, data: dict, sizes: tuple[int, int, int, int]) -> BankTables:
        """Rebuild from ``to_dict``; ``sizes`` is (n_modes, n_x, n_u, n_y)."""
        _, n, m, n_y = sizes
        w, dtype = data["weights"], np.dtype(data["real"])
        weights = Program(int(w["inputs"]), tuple(w["constants"]),
                          tuple(Operation(name, tuple(args)) for name, *args in w["operations"]), tuple(w["results"]))

        def array(values, shape):
            return np.array(values, dtype=np.float64).reshape(shape).astype(dtype)

        members = []
        for own in data["members"]:
            h, p = len(own["F"]), len(own["seen"])
            shapes = {"T2": (n, p), "C": (p, n), "F": (h, n, n), "G": (h, n, m), "K": (h, n, p), "M": (-1, p),
                      "z0": (n,)}
            members.append(Member(np.array(own["seen"], dtype=int), weights=weights,
                                  **{key: array(own[key], shapes[key]) for key in MATRICES}))
        lengths = {"x": n, "x0": n, "u": m, "y": n_y}
        ranges = {f"{v}_{end}": array(data[f"{v}_{end}"], (k,)) for v, k in lengths.items() for end in ("lo", "hi")}
        sizes = {"bound": len(members), "limit": n * len(members), "most": sum(len(m.M) for m in members)}
        bound, limit, most = (array(data[key], (size,)) for key, size in sizes.items())
        columns = tuple(data.get("columns", ()))
        ranges |= {key: array(data.get(key, []), (len(columns),)) for key in PARAMETERS[1:]}
        return cls(data["real"], tuple(members), bound, float(data["rate"]), int(data["settle"]), int(data["begin"]),
                   int(data["keep"]), int(data["gap"]), int(data["bridge"]), limit, most, weights, columns=columns,
                   **ranges)
