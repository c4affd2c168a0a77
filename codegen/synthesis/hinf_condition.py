"""A filter problem in a form that a solver sees well: blocks balanced, inputs that are nothing but rounding left out.

A repeated number commutes with diagonal matrices, a full block with multiples of the identity: ``H D``, ``D^-1 S`` are
the same uncertainty. D has powers of two, so that multipliers go back to the problem as stated without rounding.

States that move slowly reach other sizes than their declared ranges say; ``in_reach`` measures states and outputs by
what the unknowns make of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov

from .hinf_filter import FilterDesign
from .hinf_problem import Block, FilterMode, FilterProblem, in_coordinates

Array = np.ndarray
#: Inputs that move nothing by more than this, in units of what is of size one, are left out of a design.
NOTHING = 1e-9
#: Size of a state in units of ``in_reach``: with states of size one solvers fail from poles of about 0.995 on.
SIZE = 8.0


def scale_of(block: Block) -> Array:
    """The diagonal D of a block, (k,), or (1,) for a full one."""
    here, there = np.linalg.norm(block.H, axis=0), np.linalg.norm(block.S, axis=1)
    if not block.repeated:
        here, there = np.linalg.norm(here, keepdims=True), np.linalg.norm(there, keepdims=True)
    known = (here > 0) & (there > 0)
    return np.where(known, 2.0 ** np.round(np.log2(np.where(known, there / np.where(known, here, 1), 1)) / 2), 1.0)


def input_sizes(problem: FilterProblem) -> Array:
    """What each input moves at most in any mode, (n_d,)."""
    return np.max([np.linalg.norm(np.vstack([m.E, m.F, m.Fz]), axis=0) for m in problem.modes], axis=0)


def conditioned(problem: FilterProblem) -> tuple[FilterProblem, list[list[Array]]]:
    """Balance blocks and drop inputs that are next to nothing.

    Parameters
    ----------
    problem : FilterProblem

    Returns
    -------
    problem : FilterProblem
        Its level is that of the original but for those inputs.
    scales : list of list of ndarray
        D per mode and block, for ``unscaled``.
    """
    keep = np.flatnonzero(input_sizes(problem) > NOTHING)

    def mode(m: FilterMode, scales: list[Array]) -> FilterMode:
        n = len(m.A)
        columns = np.concatenate([np.arange(n), n + keep])
        blocks = tuple(replace(b, H=b.H * d, S=b.S[:, columns] / d[:, None]) for b, d in zip(m.blocks, scales))
        return replace(m, E=m.E[:, keep], F=m.F[:, keep], Fz=m.Fz[:, keep], blocks=blocks)

    scales = [[scale_of(b) for b in m.blocks] for m in problem.modes]
    return replace(problem, modes=tuple(mode(m, d) for m, d in zip(problem.modes, scales))), scales


def is_skewed(problem: FilterProblem) -> bool:
    """Whether a problem has inputs that are nothing but rounding: as it is stated solvers fail on it."""
    return bool(np.any(input_sizes(problem) <= NOTHING))


def unscaled(multipliers: list[list[dict]], scales: list[list[Array]]) -> list[list[dict]]:
    """Multipliers of the problem as stated, for those of ``conditioned``.

    Parameters
    ----------
    multipliers : list of list of dict
        "T" and "skew", or "tau", per mode and block.
    scales : list of list of ndarray

    Returns
    -------
    list of list of dict
    """
    def one(found: dict, d: Array) -> dict:
        if "tau" in found:
            return {"tau": float(found["tau"] / d[0] ** 2)}
        return {name: (np.array(value) / d[:, None] / d).tolist() for name, value in found.items()}

    return [[one(f, d) for f, d in zip(row, own, strict=True)] for row, own in zip(multipliers, scales, strict=True)]


def radii(problem: FilterProblem) -> Array:
    """Spectral radius of every mode (N,)."""
    return np.array([np.abs(np.linalg.eigvals(m.A)).max() for m in problem.modes])


def in_reach(problem: FilterProblem) -> tuple[FilterProblem, Array, Array]:
    """The same problem with states and outputs in units of what inputs of energy one make of them, powers of two.

    Parameters
    ----------
    problem : FilterProblem
        Its modes stable by themselves (``radii``).

    Returns
    -------
    problem : FilterProblem
    T : ndarray (n_x, n_x)
        Diagonal: its states are T x.
    seen : ndarray (n_y,)
        Units of the outputs.
    """
    W = [solve_discrete_lyapunov(m.A, m.E @ m.E.T) for m in problem.modes]
    y = [np.diag(m.C @ w @ m.C.T + m.F @ m.F.T) for m, w in zip(problem.modes, W)]
    x, seen = (_power(np.sqrt(np.maximum(np.max(v, axis=0), 0))) for v in ([np.diag(w) for w in W], y))
    n, T = problem.sizes[0], np.diag(SIZE / x)
    rows = seen[:, None]

    def moved(m: FilterMode) -> FilterMode:
        blocks = tuple(replace(b, H=np.vstack([b.H[:n], b.H[n:] / rows])) for b in m.blocks)
        return replace(m, C=m.C / rows, F=m.F / rows, blocks=blocks)

    problem = in_coordinates(problem, T)
    return replace(problem, modes=tuple(moved(m) for m in problem.modes)), T, seen


def out_of_reach(design: FilterDesign, T: Array, seen: Array) -> FilterDesign:
    """A design for ``in_reach`` as one for the problem as stated; T and seen are those of it."""
    both = block_diag(T, np.eye(len(design.gains[0][0])))
    return replace(design, gains=tuple((A, B / seen, C, D / seen) for A, B, C, D in design.gains),
                   proof=design.proof | {"P": [both.T @ np.asarray(p) @ both for p in design.proof["P"]]})


def _power(size: Array) -> Array:
    """Powers of two near sizes; 1 for none."""
    return np.where(size > 0, 2.0 ** np.round(np.log2(np.where(size > 0, size, 1.0))), 1.0)
