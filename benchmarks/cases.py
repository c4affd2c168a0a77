"""The observers that are compared: seeded random plants, their tables, samples and the answers expected.

Both observers answer, from their state and one sample, the state's estimate at this sample, the residual, and
move the state on::

    point      r = C x - y                                     x+ = A x + B u + K r
    interval   r_hi = pos(C) x_hi - neg(C) x_lo + c_hi - y     x_hi+ = M x_hi + G u + L y + d_hi,  M >= 0
               r_lo = pos(C) x_lo - neg(C) x_hi + c_lo - y     x_lo+ = M x_lo + G u + L y + d_lo

(K = -L of the textbook). Structure as plants have it: states couple to their neighbours and to one in seven of
the others; a mode changes every third row of A or M, its couplings too; inputs act on half of the states; B, G and
C are the same in all modes; a sensor measures one state, the last of several a combination of two; gains are full
and change with the mode. ``dense`` plants have no zero at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
SAMPLES = 32
OUTPUTS = {2: 1, 4: 2, 6: 3, 10: 4}
INPUTS = {2: 1, 4: 1, 6: 2, 10: 3}
SIDES = {"point": ("",), "interval": ("_lo", "_hi")}


@dataclass(frozen=True)
class Case:
    """One observer with its numbers and samples.

    Parameters
    ----------
    observer : {"point", "interval"}
    real : {"float32", "float64"}
    dense : bool
    tables : dict
        Name -> ndarray (N, rows, columns) or (N, rows), exactly representable in ``real``.
    u, y : ndarray (K, n)
    q : ndarray (K,)
    start : dict
        Struct member -> its first value.
    """

    observer: str
    real: str
    dense: bool
    tables: dict[str, Array]
    u: Array
    y: Array
    q: Array
    start: dict[str, Array]

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """(n_modes, n_x, n_u, n_y)."""
        modes, n_y, n_x = self.tables["C"].shape
        return modes, n_x, self.u.shape[1], n_y

    @property
    def sides(self) -> tuple[str, ...]:
        """Suffixes of the struct members: none, or those of both bounds."""
        return SIDES[self.observer]

    @property
    def answers(self) -> tuple[tuple[str, int], ...]:
        """Members of the output struct, each with its length, in order."""
        _, n_x, _, n_y = self.sizes
        return (*((f"x{s}", n_x) for s in self.sides), *((f"r{s}", n_y) for s in self.sides))

    def once(self, name: str) -> bool:
        """Whether a table is the same in all modes."""
        return bool(np.all(self.tables[name] == self.tables[name][0]))


def make(observer: str, n: int, modes: int, real: str, dense: bool = False) -> Case:
    """Draw a case; the same arguments give the same numbers.

    Parameters
    ----------
    observer : {"point", "interval"}
    n : int
        States; the other sizes follow.
    modes : int
    real : {"float32", "float64"}
    dense : bool

    Returns
    -------
    case : Case
    """
    rng = np.random.default_rng([n, modes, observer == "point", dense])
    n_u, n_y = INPUTS[n], OUTPUTS[n]

    def draw(*shape):
        return rng.uniform(0.1, 1.0, shape) * rng.choice([-1.0, 1.0], shape)

    def to_real(x, scale=1.0):
        return np.asarray(np.asarray(x) * scale, dtype=real).astype(np.float64)

    C = draw(n_y, n) if dense else np.zeros((n_y, n))
    if not dense:
        measured = rng.permutation(n)[:n_y]
        C[np.arange(n_y), measured] = 1.0
        if n_y > 1:
            C[-1, measured[-1]], C[-1, (measured[-1] + 1) % n] = 0.7, -1.2
    B = draw(n, n_u) * (dense or rng.random((n, n_u)) < 0.5)
    inner, changed = np.repeat(draw(1, n, n), modes, axis=0), np.arange(n) % 3 == 0
    inner[1:, changed] = draw(modes - 1, changed.sum(), n)
    if not dense:
        near = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 1
        far = np.repeat(rng.random((1, n, n)) < 1 / 7, modes, axis=0)
        far[:, changed] = rng.random((modes, changed.sum(), n)) < 1 / 7
        inner *= near | far
    gain = draw(modes, n, n_y)
    everywhere = {"C": np.repeat(C[None], modes, axis=0)}
    # Every update shrinks the largest entry, whatever the modes do: all numbers stay of the order of 1.
    fed = np.abs(gain) @ np.abs(C) if observer == "point" else 0.0
    scale = 0.9 / (np.abs(inner) + fed).sum(axis=2).max()
    if observer == "point":
        tables = everywhere | {"A": inner * scale, "B": np.repeat(B[None], modes, axis=0), "K": gain * scale}
    else:
        width = rng.uniform(0.01, 0.1, (2, modes, n))
        noise = np.repeat(rng.uniform(0.01, 0.1, (2, 1, n_y)), modes, axis=1)
        tables = everywhere | {"M": np.abs(inner) * scale, "G": np.repeat(B[None], modes, axis=0), "L": gain,
                               "d_lo": -width[0], "d_hi": width[1], "c_lo": -noise[0], "c_hi": noise[1]}
    spread = 0.0 if observer == "point" else 0.5
    middle = draw(n)
    start = {f"x{s}": to_real(middle + (spread if s == "_hi" else -spread)) for s in SIDES[observer]}
    return Case(observer, real, dense, {name: to_real(t) for name, t in tables.items()}, to_real(draw(SAMPLES, n_u)),
                to_real(draw(SAMPLES, n_y)), np.arange(SAMPLES) % modes, start)


def expected(case: Case) -> Array:
    """Return the answers (K, all outputs) in the order of ``Case.answers``, calculated in double.

    Written from the equations above, apart from everything that prints C.
    """
    t, x, rows = case.tables, dict(case.start), []
    for u, y, q in zip(case.u, case.y, case.q):
        C = t["C"][q]
        if case.observer == "point":
            r = C @ x["x"] - y
            rows.append(np.concatenate([x["x"], r]))
            x = {"x": t["A"][q] @ x["x"] + t["B"][q] @ u + t["K"][q] @ r}
        else:
            pos, neg = np.maximum(C, 0), np.maximum(-C, 0)
            lo, hi = x["x_lo"], x["x_hi"]
            r_lo = pos @ lo - neg @ hi + t["c_lo"][q] - y
            r_hi = pos @ hi - neg @ lo + t["c_hi"][q] - y
            rows.append(np.concatenate([lo, hi, r_lo, r_hi]))
            common = t["G"][q] @ u + t["L"][q] @ y
            x = {"x_lo": t["M"][q] @ lo + common + t["d_lo"][q], "x_hi": t["M"][q] @ hi + common + t["d_hi"][q]}
    return np.array(rows)
