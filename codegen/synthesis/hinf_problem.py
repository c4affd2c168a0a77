"""The plant of an H-infinity fault estimation filter: everything unknown in one input, normalised.

``x+ = (A + dA) x + (E + dE) d``, ``y = (C + dC) x + (F + dF) d`` with d = [disturbances; faults], the target of the
estimate ``-(Cz x + Fz d)``, and what is uncertain as feedback p = Delta s of s = S [x; d] into ``[dx; dy] = H p``. Of a
block either all of Delta is unknown (``|Delta| <= 1``) or it is one real number times the identity (``repeated``).

A command u is an unknown input that is measured without error: it gets a row of y. So the filter uses it, and what an
uncertain B does with it is covered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..algebra.automaton import Automaton, arbitrary, dwell_time
from ..algebra.dwell import ratio
from ..algebra.interval import sizes
from ..errors import DesignError

Array = np.ndarray


@dataclass(frozen=True)
class Block:
    """One uncertainty of a mode.

    Parameters
    ----------
    H : ndarray (n_x + n_y, k)
    S : ndarray (l, n_x + n_d)
        For a repeated real number l = k.
    repeated : bool
    """

    H: Array
    S: Array
    repeated: bool


@dataclass(frozen=True)
class FilterMode:
    """One mode; n_d = disturbances and faults.

    Parameters
    ----------
    A : ndarray (n_x, n_x), E : ndarray (n_x, n_d)
    C : ndarray (n_y, n_x), F : ndarray (n_y, n_d)
    Cz : ndarray (n_f, n_x), Fz : ndarray (n_f, n_d)
        The error is z = f_hat + Cz x + Fz d.
    blocks : tuple of Block
    """

    A: Array
    E: Array
    C: Array
    F: Array
    Cz: Array
    Fz: Array
    blocks: tuple[Block, ...] = ()


@dataclass(frozen=True)
class FilterProblem:
    """All modes and the switching.

    Parameters
    ----------
    names : tuple of str
    modes : tuple of FilterMode
    switching : Automaton
    order : int
        States of the plant itself; more than that are weights.
    """

    names: tuple[str, ...]
    modes: tuple[FilterMode, ...]
    switching: Automaton
    order: int

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """States, inputs, outputs and components of the estimate."""
        m = self.modes[0]
        return m.A.shape[0], m.E.shape[1], m.C.shape[0], m.Cz.shape[0]

    @property
    def nominal(self) -> FilterProblem:
        """The same without uncertainty."""
        return replace(self, modes=tuple(replace(m, blocks=()) for m in self.modes))

    def under(self, switching: Automaton) -> FilterProblem:
        """The same under another switching."""
        return replace(self, switching=switching)


def mode_of(A, E_d, E_f, C, F_d, F_f, blocks=()) -> FilterMode:
    """A mode whose estimate is the fault itself.

    Parameters
    ----------
    A : ndarray (n_x, n_x), E_d : ndarray (n_x, n_w), E_f : ndarray (n_x, n_f)
    C : ndarray (n_y, n_x), F_d : ndarray (n_y, n_w), F_f : ndarray (n_y, n_f)
    blocks : tuple of Block

    Returns
    -------
    FilterMode
    """
    A, E_d, E_f, C, F_d, F_f = (np.atleast_2d(np.asarray(M, dtype=float)) for M in (A, E_d, E_f, C, F_d, F_f))
    n_f = E_f.shape[1]
    return FilterMode(A, np.hstack([E_d, E_f]), C, np.hstack([F_d, F_f]), np.zeros((n_f, len(A))),
                      np.hstack([np.zeros((n_f, E_d.shape[1])), -np.eye(n_f)]), tuple(blocks))


def problem_of(plant) -> FilterProblem:
    """The problem of a Plant, as the firmware sees it; inputs are normalised to the size of their bounds.

    Parameters
    ----------
    plant : Plant
        With at least one fault. Unknown and measured parameters both count as unknown: the filter knows the mode only.
        Matrices other than A and B may depend on parameters that nobody measures, in discrete time.

    Returns
    -------
    FilterProblem

    Raises
    ------
    DesignError
        No fault to estimate, or a measured parameter outside A and B.
    """
    if not plant.f:
        raise DesignError(f"{plant.name}: hinf-filter estimates faults (signals.f is empty). Declare one.")
    for m in plant.modes:
        for name in () if unmeasured(plant) else set(m.theta_terms) - {"A", "B"}:
            raise DesignError(f'{plant.name}: modes.{m.name}.{name} depends on a parameter (hinf-filter takes measured '
                              "ones in A and B of a plant file). Bound its effect by w or v.")
    plant = plant.observed
    size = {v: sizes(*plant.limits(v)) for v in "uf"}
    modes = []
    for m in plant.modes:
        w, v = np.maximum(np.abs(m.w_lo), np.abs(m.w_hi)), np.maximum(np.abs(m.v_lo), np.abs(m.v_hi))  # 0: not met
        n_x, n_y, n_u = plant.n_x, plant.n_y, plant.n_u
        place = np.zeros((n_x + n_u, n_x + len(w) + len(v) + n_u + plant.n_f))
        place[:n_x, :n_x], place[n_x:, -n_u - plant.n_f:-plant.n_f] = np.eye(n_x), np.diag(size["u"])
        A, B, blocks = _uncertain(m, n_x + n_y + n_u, place, _others(m, (w, v, size["u"], size["f"])))
        E_d = np.hstack([m.Bw * w, np.zeros((n_x, len(v))), B * size["u"]])
        F_d = np.vstack([np.hstack([m.Dw * w, m.Dv * v, m.D * size["u"]]),
                         np.hstack([np.zeros((n_u, len(w) + len(v))), np.diag(size["u"])])])
        C = np.vstack([m.C, np.zeros((n_u, n_x))])
        F_f = np.vstack([m.Df * size["f"], np.zeros((n_u, plant.n_f))])
        modes.append(mode_of(A, E_d, m.Bf * size["f"], C, F_d, F_f, blocks))
    switching, tau = arbitrary(plant.n_modes), plant.switching.average_dwell
    if tau is not None and plant.n_modes > 1:
        add, drain = ratio(max(tau / plant.sample_period * (1 - 1e-9), 1.0))
        switching = dwell_time(plant.n_modes, add, drain, int(plant.switching.chatter * add))
    return FilterProblem(tuple(m.name for m in plant.modes), tuple(modes), switching, plant.n_x)


def unmeasured(plant) -> bool:
    """Whether a plant has parameters in discrete time that nobody measures, and no others."""
    return plant.kind == "discrete" and bool(plant.theta) and not any(s.measured for s in plant.theta)


def _others(m, sizes) -> list[Array]:
    """Effects of each unknown on [x+; y] through the matrices other than A and B, over [x; w; v; u; f] of size one."""
    more = getattr(m, "more", {})
    if not more:
        return []
    shapes = (("", "Bw", "", "", "Bf"), ("C", "Dw", "Dv", "D", "Df"))
    out = []
    for effect in range(len(m.A_unc)):
        rows = []
        for names, height in zip(shapes, (len(m.A), len(m.C))):
            rows.append(np.hstack([(more[name][effect] if name in more else np.zeros((height, len(s)))) * s
                                   for name, s in zip(names, (np.ones(len(m.A)), *sizes))]))
        out.append(np.vstack(rows))
    return out


def is_slight(block: Block) -> bool:
    """Whether a full block holds no more than what rounding leaves over: too little for a solver to see."""
    return not block.repeated and np.linalg.norm(block.H) * np.linalg.norm(block.S) < 1e-7


def without_slight(problem: FilterProblem) -> FilterProblem:
    """The same without those blocks; what is found for it has to be certified with them."""
    return replace(problem, modes=tuple(replace(m, blocks=tuple(b for b in m.blocks if not is_slight(b)))
                                        for m in problem.modes))


def in_coordinates(problem: FilterProblem, T: Array) -> FilterProblem:
    """The same problem with states T x: solvers want plants whose states are of one size.

    Parameters
    ----------
    problem : FilterProblem
    T : ndarray (n_x, n_x)
        Regular.

    Returns
    -------
    FilterProblem
    """
    n, back = len(T), np.linalg.inv(T)

    def moved(m: FilterMode) -> FilterMode:
        blocks = tuple(Block(np.vstack([T @ b.H[:n], b.H[n:]]), np.hstack([b.S[:, :n] @ back, b.S[:, n:]]), b.repeated)
                       for b in m.blocks)
        return FilterMode(T @ m.A @ back, T @ m.E, m.C @ back, m.F, m.Cz @ back, m.Fz, blocks)

    return replace(problem, modes=tuple(moved(m) for m in problem.modes))


def repeated(M: Array, rows: int) -> Block:
    """Block of one unknown number s, |s| <= 1, that adds s M to the first rows of [x+; y].

    Parameters
    ----------
    M : ndarray (m, n_x + n_d)
    rows : int
        n_x + n_y >= m.

    Returns
    -------
    Block
        Of the rank of M; H S is M but for rounding.
    """
    U, sigma, V = np.linalg.svd(M)
    rank = max(1, int(np.sum(sigma > 1e-12 * sigma[0])))
    H = np.zeros((rows, rank))
    H[:len(M)] = U[:, :rank] * np.sqrt(sigma[:rank])
    return Block(H, np.sqrt(sigma[:rank])[:, None] * V[:rank], True)


def elementwise(R: Array, rows: int) -> Block:
    """Full block that holds every matrix with |dM| <= R elementwise.

    With ``D = diag(h)^-1 R diag(s)^-1`` of Frobenius norm at most 1 every such dM is ``diag(h) Delta diag(s)`` with
    ``|Delta| <= 1``. Row and column sizes are taken as square roots of the sums.

    Parameters
    ----------
    R : ndarray (m, n_x + n_d)
        Nonnegative.
    rows : int
        n_x + n_y >= m.

    Returns
    -------
    Block
        Only the rows and columns of R that are not zero.
    """
    here, there = np.flatnonzero(R.sum(axis=1)), np.flatnonzero(R.sum(axis=0))
    K = R[np.ix_(here, there)]
    h, s = np.sqrt(K.sum(axis=1)), np.sqrt(K.sum(axis=0))
    size = np.sqrt(np.linalg.norm(K / np.outer(h, s)) * (1 + 1e-9))
    H, S = np.zeros((rows, len(here))), np.zeros((len(there), R.shape[1]))
    H[here, range(len(here))], S[range(len(there)), there] = h * size, s * size
    return Block(H, S, False)


def _uncertain(m, rows: int, place: Array, others: list[Array]) -> tuple[Array, Array, list[Block]]:
    """A, B in the middle of the bounds, and blocks of what is uncertain; ``place`` takes [x; d] to [x; u].

    ``others`` are what the first unknowns do through the other matrices, (n_x + n_y, n_x + n_d) each.
    """
    if not hasattr(m, "A_unc"):
        return m.A, m.B, []
    middle, radius = (m.theta_lo + m.theta_hi) / 2, (m.theta_hi - m.theta_lo) / 2
    slopes = [np.hstack([a, b]) for a, b in zip(m.A_theta, m.B_theta)]
    M = np.hstack([m.A, m.B])
    centre = M + sum((t * d for t, d in zip(middle, slopes)), 0 * M)
    effects = [np.hstack([a, b]) for a, b in zip(m.A_unc, m.B_unc)] + [r * d for r, d in zip(radius, slopes)]
    moved = [d @ place for d in effects]
    for k, d in enumerate(others):
        whole = d.copy()
        whole[:len(moved[k])] += moved[k]
        moved[k] = whole
    moved = [d for d in moved if np.any(d)]
    # What float64 loses of the centre and of the products H S.
    slip = np.abs(M) + sum((abs(t) * np.abs(d) for t, d in zip(middle, slopes)), 0 * M)
    slip = slip + sum((np.linalg.norm(d) + 0 * M for d in effects), 0 * M)
    rest = np.hstack([m.A_rad, m.B_rad]) + 2.0**-44 * slip
    rest = np.vstack([rest @ np.abs(place), np.zeros((rows - len(rest), place.shape[1]))])
    for d in moved if others else ():  # the factors of these have rows in y too
        rest[:len(d)] += 2.0**-44 * np.linalg.norm(d) * (np.abs(d).sum(axis=0) > 0)
    blocks = [repeated(d, rows) for d in moved]
    if moved or np.any(m.A_rad) or np.any(m.B_rad):
        blocks.append(elementwise(rest, rows))
    return centre[:, :m.A.shape[1]], centre[:, m.A.shape[1]:], blocks
