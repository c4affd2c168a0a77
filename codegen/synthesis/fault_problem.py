r"""Sensor faults as states: a polytopic descriptor plant (x, f), and what of it is left to estimate.

    diag(E, 0) (x, f)' = sum_i h_i ([A_i Bf_i; 0 -I] (x, f) + [B_i; 0] u + [Bd_i; 0] d) + [g; f],
    y = [C Df] (x, f) + Dd d

The last rows say f = f and are there to make the plant square; what an observer does with them must be nothing, or it
believes in f = 0. So f may move as it likes.

A state that an output is exactly is no unknown. Its estimate is that output, x_k = y_o, its column is an input, and
its output says nothing of the others. What is left are `kept` states and `outputs`; the rows are those of the plant.

Directions v of what is left with C v = 0 and A_i v = s E v at all vertices keep their mode s whatever the observer is:
T1 E v = v - T2 C v = v, so that (T1 A_i + K_i C) v = s v. A sensor's fault that moves against its state is one, where
nothing else tells of that state.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, section 3.7. Differences from the print: T1 has
zero columns on the rows f = f; rank [E; C] of the whole is asked for, which fails where an algebraic state has no
sound sensor of its own; the rows f = f are no measure of what is observable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..algebra.pencil import rank
from .descriptor_problem import (
    DescriptorProblem,
    Scaling,
    kernel_of,
    pairs_of,
    problem_of,
    refusal,
    scaled,
    scaling_of,
    sizes,
)

Array = np.ndarray
TOLERANCE = 1e-9


@dataclass(frozen=True)
class FaultProblem:
    """The plant of (x, f), and what of it is unknown.

    Parameters
    ----------
    whole : DescriptorProblem
        Of n_x + n_f states; the inputs are u and the known terms g, the unknown inputs w, v and f.
    n_x, n_u : int
        Of the plant.
    names : tuple of str
        Of x and f.
    kept : tuple of int
        States that are not known exactly.
    outputs : tuple of int
        Outputs that are no state.
    exact : tuple of (int, int)
        (state, output) of the others.
    """

    whole: DescriptorProblem
    n_x: int
    n_u: int
    names: tuple[str, ...]
    kept: tuple[int, ...]
    outputs: tuple[int, ...]
    exact: tuple[tuple[int, int], ...]

    @property
    def tied(self) -> bool:
        """Whether the observer knows the plant's weights."""
        return all(i == j for i, j in self.whole.pairs)

    @property
    def E(self) -> Array:
        """Of what is kept (n_x rows)."""
        return self.whole.E[:self.n_x, self.kept]

    @property
    def C(self) -> Array:
        """Of what is kept."""
        return self.whole.C[np.ix_(self.outputs, self.kept)]

    @property
    def Dd(self) -> Array:
        """Of the outputs that are left."""
        return self.whole.Dd[list(self.outputs)]


def fault_problem(plant) -> tuple[FaultProblem, Scaling]:
    """The problem of a plant with sensor faults, and the units in which a solver should meet it.

    Parameters
    ----------
    plant : Plant
        With a polytope, and not refused by `inapplicable`.

    Returns
    -------
    problem : FaultProblem
        In the plant's units; z of ``whole`` is the error of the faults in units of their ranges.
    s : Scaling
    """
    p, n, k = plant.polytope, plant.n_x, plant.n_f
    base, f_unit = problem_of(plant), sizes(*plant.limits("f"))
    none, h, m = np.zeros, len(p.vertices), len(p.known)
    known = none((h, n + k, m))
    for j, term in enumerate(p.known):
        known[:, term.row, j] = 1.0
    Bf = np.array([v.Bf for v in p.vertices])
    A = np.concatenate([np.concatenate([base.A, Bf], axis=2),
                        np.tile(np.hstack([none((k, n)), -np.eye(k)]), (h, 1, 1))], axis=1)
    B = np.concatenate([np.concatenate([base.B, none((h, k, plant.n_u))], axis=1), known], axis=2)
    q = base.Bd.shape[2]
    Bd = none((h, n + k, q + k))
    Bd[:, :n, :q], Bd[:, n:, q:] = base.Bd, np.eye(k)
    E = none((n + k, n + k))
    E[:n, :n] = base.E
    g_unit = sizes(np.array([g.lo for g in p.known]), np.array([g.hi for g in p.known]))
    whole = DescriptorProblem(
        base.names, E, A, B, Bd, np.hstack([base.C, p.Df]), np.hstack([base.Dd, none((plant.n_y, k))]),
        np.hstack([none((k, n)), np.diag(1 / f_unit)]), none((k, q + k)), kernel_of(E),
        pairs_of(plant, p.exact), np.concatenate([base.u_unit, g_unit]), np.concatenate([base.d_unit, f_unit]),
        plant.kind)
    kept = tuple(i for i in range(n + k) if i not in p.exact)
    outputs = tuple(i for i in range(plant.n_y) if i not in p.exact.values())
    names = tuple(s.name for s in (*plant.x, *plant.f))
    problem = FaultProblem(whole, n, plant.n_u, names, kept, outputs, tuple(p.exact.items()))
    units = np.concatenate([sizes(*plant.limits("x")), f_unit]), sizes(*plant.limits("y"))
    return problem, scaling_of(whole, *units, plant.kind == "discrete")


def in_units(problem: FaultProblem, s: Scaling) -> FaultProblem:
    """The problem in the units of a scaling.

    Parameters
    ----------
    problem : FaultProblem
    s : Scaling
    """
    return replace(problem, whole=scaled(problem.whole, s))


def inapplicable(plant) -> str | None:
    """Why the design does not apply to a plant; None where it does.

    Parameters
    ----------
    plant : Plant
    """
    reason = refusal(plant, known=True)
    if reason is not None:
        return f"{reason}."
    p = plant.polytope
    if not plant.f:
        return "it has no fault to estimate (signals.f is empty). Declare one."
    for vector in "xuywvf":
        for s in getattr(plant, vector):
            if not (np.isfinite(s.lo) and np.isfinite(s.hi)):
                return f'signals.{vector} "{s.name}" has no range, expected one: bounds rest on it. Add one.'
    unseen = [s.name for s, column in zip(plant.f, p.Df.T) if not column.any()]
    if unseen:
        return (f"the fault {unseen[0]} acts on no output (its column of Df is zero); how it moves is not modelled, so "
                "that nothing tells it from the state. Estimate faults of sensors, or make it a disturbance.")
    reads = unknown_to_the_weights(plant)
    if reads and p.known:
        return (f"its weights read {reads}, which no output gives exactly, beside known terms, expected inputs, "
                "parameters measured without error and states that an output is, without noise, fault or input: the "
                "bounds of known terms rest on weights that plant and observer share. Choose factors that vary with "
                "these.")
    return unseen_by(*fault_problem(plant), plant.kind)


def unknown_to_the_weights(plant) -> str:
    """The first state or parameter that the weights read and the observer does not know exactly; empty for none.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    """
    p = plant.polytope
    known = {p.symbols[k] for k in p.exact} | set(p.symbols[plant.n_x:plant.n_x + plant.n_u])
    known |= {s for s, t in zip(p.symbols[plant.n_x + plant.n_u:], plant.theta) if t.measured and t.error == 0}
    used = set().union(*(z.term.free_symbols for z in p.premises), *(w.free_symbols for w in p.raw))
    names = {s: t.name for s, t in zip(p.symbols, (*plant.x, *plant.u, *plant.theta))}
    return min((names[s] for s in used - known), default="")


def unseen_by(problem: FaultProblem, s: Scaling, kind: str) -> str | None:
    """Why states and faults cannot be told apart; None where they can.

    Parameters
    ----------
    problem : FaultProblem
        In the plant's units.
    s : Scaling
    kind : {"continuous", "discrete"}
    """
    tall = np.vstack([problem.E, problem.C])
    if rank(tall) < tall.shape[1]:
        v = np.linalg.svd(tall)[2][-1]
        share = [problem.names[problem.kept[i]] for i in np.argsort(-np.abs(v), kind="stable")
                 if abs(v[i]) > 1e-6]
        return (f"rank [E; C] of states and faults is {rank(tall)}, expected {tall.shape[1]}: a change of "
                f"{' and '.join(sorted(share[:3]))} is seen by no output and no derivative. Measure an algebraic state "
                "with a sensor that is sound, or take a fault out.")
    for v, mode in unmoved(in_units(problem, s)):
        if abs(mode) >= 1 - TOLERANCE if kind == "discrete" else mode >= -TOLERANCE:
            return (f"nothing tells {told(problem, v)} apart: they move together by a mode of {mode * s.time:.4g} that "
                    "no observer changes and that does not decay. Measure more, take a fault out, or choose other "
                    "factors.")
    return None


def told(problem: FaultProblem, v: Array) -> str:
    """The states and faults that a direction moves.

    Parameters
    ----------
    problem : FaultProblem
    v : ndarray (len(kept),)
    """
    return " and ".join(problem.names[i] for i, c in zip(problem.kept, v) if abs(c) > 1e-6 * np.abs(v).max())


def unmoved(problem: FaultProblem) -> list[tuple[Array, float]]:
    """Directions whose mode no observer changes, each with its mode; real and simple ones.

    Parameters
    ----------
    problem : FaultProblem

    Returns
    -------
    directions : list of (ndarray (len(kept),), float)
    """
    left, E = problem.C, problem.E
    full = np.linalg.svd(left)[2][rank(left):].T if left.size else np.eye(E.shape[1])
    if not full.shape[1]:
        return []
    A = [M[:problem.n_x, problem.kept] @ full for M in problem.whole.A]
    base = E @ full
    values, vectors = np.linalg.eig(np.linalg.pinv(base) @ A[0])
    found = []
    for s, c in zip(values, vectors.T):
        if abs(s.imag) > TOLERANCE * max(1.0, abs(s)) or np.abs(c.imag).max() > TOLERANCE:
            continue
        s, c = float(s.real), c.real
        if all(np.linalg.norm(M @ c - s * (base @ c)) <= TOLERANCE * max(np.linalg.norm(M), 1e-300) for M in A):
            found.append((full @ c, s))
    return found
