"""A filter problem in a form that a solver sees well: blocks balanced, inputs that are nothing but rounding left out.

A repeated number commutes with diagonal matrices, a full block with multiples of the identity: ``H D``, ``D^-1 S`` are
the same uncertainty. D has powers of two, so that multipliers go back to the problem as stated without rounding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .hinf_problem import Block, FilterMode, FilterProblem

Array = np.ndarray
#: Inputs that move nothing by more than this, in units of what is of size one, are left out of a design.
NOTHING = 1e-9


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
