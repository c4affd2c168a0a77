"""Gains that put the direction of an actuator fault on chosen poles: (A - L C) F = F diag(poles).

All of them are ``L = K + S rest`` with ``K = (A F - F diag(poles)) (C F)^+`` and ``rest = I - C F (C F)^+``
(Zammali (2020), (6.7) and (6.11) with Lemma 9 corrected: B^+ = (B'B)^-1 B'). They exist if C F has full column rank;
only S rest is free, so n_y columns less one per fault. While the mode stays, a constant fault then shows as
C F f / (1 - pole).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DesignError
from .problem import Problem

Array = np.ndarray

#: A singular value of C F below this share of |C| |F| counts as zero: its inverse would be a huge gain.
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class FaultDirections:
    """The fixed and the free part of the gains of all modes.

    Parameters
    ----------
    F : ndarray (N, n_x, k)
        Directions.
    fixed : ndarray (N, n_x, n_y)
        K at poles 0.
    per_pole : ndarray (N, k, n_x, n_y)
        What a pole takes from K: K = fixed - sum_j poles[j] per_pole[j].
    rest : ndarray (N, n_y, n_y)
        Projection on what C F leaves free.
    """

    F: Array
    fixed: Array
    per_pole: Array
    rest: Array

    @property
    def unique(self) -> bool:
        """Whether the poles determine the gains."""
        return self.F.shape[2] == self.rest.shape[1]

    def gains(self, poles: Array, S: Array) -> Array:
        """Return the gains of (6.11) for given S.

        Parameters
        ----------
        poles : ndarray (k,)
        S : ndarray (N, n_x, n_y) or (n_x, n_y)

        Returns
        -------
        L : ndarray (N, n_x, n_y)
        """
        return self.fixed - np.einsum("j,qjab->qab", np.asarray(poles, float), self.per_pole) + S @ self.rest


def assignable(problem: Problem) -> list[int]:
    """Channels that push the state and no output: those whose direction can be given a pole."""
    return [j for j in range(problem.Bf.shape[2])
            if np.all(np.any(problem.Bf[:, :, j], axis=1)) and not np.any(problem.Df[:, :, j])]


def directions(problem: Problem, channels: list[int], names: list[str], subspace: str = "own") -> FaultDirections:
    """Decompose the gains for the given channels.

    Parameters
    ----------
    problem : Problem
    channels : list of int
    names : list of str
        Of all channels, for messages.
    subspace : {"own", "common"}
        "own": the channels' directions in each mode. "common": in every mode a basis of the span of the directions
        of all modes, so that the response to a fault keeps its pole across switches.

    Returns
    -------
    FaultDirections

    Raises
    ------
    DesignError
        C F has not full column rank in some mode.
    """
    F = problem.Bf[:, :, channels]
    if subspace == "common":
        F = np.stack([span(np.concatenate(list(F), axis=1))] * len(F))
    fixed, per_pole, rest = [], [], []
    for q, (A, C, f) in enumerate(zip(problem.A, problem.C, F)):
        CF = C @ f
        _require_rank(problem.names[q], C, f, [names[j] for j in channels], subspace)
        inverse = np.linalg.pinv(CF)
        fixed.append(A @ f @ inverse)
        per_pole.append([np.outer(f[:, j], inverse[j]) for j in range(f.shape[1])])
        rest.append(np.eye(len(C)) - CF @ inverse)
    return FaultDirections(np.array(F), np.array(fixed), np.array(per_pole), np.array(rest))


def span(vectors: Array) -> Array:
    """Orthonormal basis of the span of columns.

    Parameters
    ----------
    vectors : ndarray (n, k)

    Returns
    -------
    ndarray (n, rank)
    """
    U, s, _ = np.linalg.svd(vectors, full_matrices=False)
    return U[:, s > RANK_TOLERANCE * max(s[0], 1e-300)]


def _require_rank(mode: str, C: Array, F: Array, channels: list[str], subspace: str) -> None:
    """Raise where C F loses a direction of F, by a tolerance that knows the sizes of C and F."""
    size = np.linalg.norm(C, 2) * np.linalg.norm(F, axis=0)
    s = np.linalg.svd(C @ F / size, compute_uv=False) if F.shape[1] <= len(C) else np.zeros(1)
    if s.min() > RANK_TOLERANCE:
        return
    found = int(np.sum(np.linalg.svd(C @ F / size, compute_uv=False) > RANK_TOLERANCE))
    what = f'fault channel "{channels[0]}"' if len(channels) == 1 else "fault channels " + ", ".join(
        f'"{c}"' for c in channels)
    if subspace == "common":
        raise DesignError(f'{what}: the directions of all modes together span {F.shape[1]} dimensions, of which the '
                          f'outputs of mode "{mode}" see {found} in one sample. Leave subspace out, or measure more.')
    raise DesignError(f'{what}: C Bf has rank {found} in mode "{mode}", expected {F.shape[1]}: a pole can be given '
                      "only to directions that the outputs see and tell apart one sample after the onset. Use "
                      'criterion = "hinf", or name fewer channels in observer.poles.')


def zeros(problem: Problem, found: FaultDirections) -> Array | None:
    """Eigenvalues that no gain moves, per mode, where the poles determine the gains; None where S is free.

    They are the invariant zeros of (A_q, F_q, C_q): A - L C maps span F into itself, and this is what it does to
    the rest.

    Returns
    -------
    ndarray (N, n_x - k) or None
    """
    if not found.unique:
        return None
    out = []
    for A, C, F, K in zip(problem.A, problem.C, found.F, found.fixed):
        rest = np.linalg.svd(F)[0][:, F.shape[1]:]
        out.append(np.linalg.eigvals(rest.T @ (A - K @ C) @ rest))
    return np.array(out)
