"""What can be said of a plant before any design: stability, detectability, signs, boundedness; of descriptor systems.

Of a plant with parameters the worst corner of their box speaks for the mode. That is a hint: a plant may be stable at
every corner and still diverge while the parameters move.

So it is with the vertices of a polytopic plant. Nothing that holds at every vertex need hold between them: with E =
diag(1, 0) the vertices A = diag(-1, -1) and diag(-1, 1) are impulse-free and the middle is not even regular; [-1 8; 0
-1] and [-1 0; 8 -1] are stable and their middle has the eigenvalue 3; [-1 1; 0 -2] and [-1 -1; 0 -2] with C = [1 0]
are observable and their middle is not. The thesis calls vertex tests sufficient from a practical point of view
(Lopez-Estrada (2014), Remark 2.4.5); here they are printed as what they are, and `hull_admissible` tells what is
proved for every weight. Weights that move are covered by it too.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from codegen.algebra.admissibility import lyapunov_matrix
from codegen.algebra.discrete_admissibility import discrete_lyapunov_matrix
from codegen.algebra.visibility import Visibility, by_rank, by_svd, by_weierstrass

from .model import Mode, Plant

Array = np.ndarray


@dataclass(frozen=True)
class ModeProperties:
    """Properties of one mode; where it has parameters, what holds at every corner of their box.

    Parameters
    ----------
    name : str
    radius : float
        Spectral radius of A (discrete) or spectral abscissa (continuous); the largest of the corners.
    stable : bool
    observable : bool
    hidden : tuple of complex
        Eigenvalues that are unstable and invisible to the outputs: must be empty for detectability.
    cooperative : bool
        A >= 0 elementwise (discrete) or off the diagonal (continuous).
    """

    name: str
    radius: float
    stable: bool
    observable: bool
    hidden: tuple[complex, ...]
    cooperative: bool

    @property
    def detectable(self) -> bool:
        """No unstable eigenvalue is invisible."""
        return not self.hidden


def mode_properties(name: str, A: Array, C: Array, kind: str) -> ModeProperties:
    """Compute the properties of one mode with constant matrices.

    Parameters
    ----------
    name : str
    A : ndarray (n_x, n_x), C : ndarray (n_y, n_x)
    kind : {"discrete", "continuous"}

    Returns
    -------
    ModeProperties
    """
    eigenvalues = np.linalg.eigvals(A)
    size = np.abs(eigenvalues) if kind == "discrete" else eigenvalues.real
    limit = 1.0 if kind == "discrete" else 0.0
    hidden, observable = [], True
    for value, s in zip(eigenvalues, size):
        seen = np.linalg.matrix_rank(np.vstack([A - value * np.eye(len(A)), C])) == len(A)
        observable = observable and seen
        # An eigenvalue exactly on the limit counts: it does not decay.
        if not seen and s >= limit - 1e-12:
            hidden.append(complex(value))
    off_diagonal = A if kind == "discrete" else A - np.diag(np.diag(A))
    return ModeProperties(name, float(size.max()), bool(size.max() < limit), bool(observable), tuple(hidden),
                          bool(np.all(off_diagonal >= 0)))


def properties(plant: Plant) -> list[ModeProperties]:
    """Properties of every mode.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    list of ModeProperties
    """
    return [_worst([mode_properties(m.name, *matrices, plant.kind) for matrices in _corners(plant, m)])
            for m in plant.modes]


def _corners(plant: Plant, mode: Mode):
    """Yield A and C at every corner of the parameters' box in a mode; once where there are none."""
    for corner in product(*zip(*plant.theta_box(mode))):
        yield tuple(sum((value * slope for value, slope in zip(corner, mode.theta_terms.get(name, ()))),
                        getattr(mode, name)) for name in ("A", "C"))


def _worst(found: list[ModeProperties]) -> ModeProperties:
    """What holds at all corners."""
    hidden = tuple(value for p in found for value in p.hidden)
    return ModeProperties(found[0].name, max(p.radius for p in found), all(p.stable for p in found),
                          all(p.observable for p in found), hidden, all(p.cooperative for p in found))


@dataclass(frozen=True)
class DescriptorProperties:
    """Properties of E x' = A x, y = C x (x+ in discrete time); None where the three tests disagree.

    That happens where a matrix is so close to losing its rank that rounding decides.

    Parameters
    ----------
    name : str
    finite : ndarray (n1,) complex
        Finite eigenvalues; empty where the pencil is singular.
    regular, impulse_free, stable, admissible : bool or None
        Impulse-free: index 0 or 1; causal in discrete time. Admissible: all three.
    r_observable, c_observable, i_observable, detectable : bool or None
        Reachable states, all states, impulses; unstable finite eigenvalues.
    """

    name: str
    finite: Array
    regular: bool | None
    impulse_free: bool | None
    stable: bool | None
    admissible: bool | None
    r_observable: bool | None
    c_observable: bool | None
    i_observable: bool | None
    detectable: bool | None


def descriptor_properties(name: str, E: Array, A: Array, C: Array, kind: str) -> DescriptorProperties:
    """Compute the properties of one constant descriptor system by three tests.

    Parameters
    ----------
    name : str
    E, A : ndarray (n, n), C : ndarray (n_y, n)
    kind : {"discrete", "continuous"}

    Returns
    -------
    DescriptorProperties
    """
    tests = [test(E, A, C) for test in (by_rank, by_weierstrass, by_svd)]

    def agreed(of) -> bool | None:
        answers = {of(v) for v in tests}
        return answers.pop() if len(answers) == 1 else None

    plain = ("regular", "impulse_free", "r_observable", "c_observable", "i_observable")
    timed = ("stable", "admissible", "detectable")
    finite = next((v.finite for v in tests if v.regular), np.zeros(0, dtype=complex))
    return DescriptorProperties(name, finite, **{key: agreed(lambda v, key=key: getattr(v, key)) for key in plain},
                                **{key: agreed(lambda v, key=key: getattr(Visibility, key)(v, kind)) for key in timed})


def vertex_properties(plant: Plant) -> list[DescriptorProperties]:
    """Properties of every vertex of a polytopic plant.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    list of DescriptorProperties
    """
    p = plant.polytope
    return [descriptor_properties(v.name, p.E, v.A, p.C, plant.kind) for v in p.vertices]


def hull_admissible(plant: Plant) -> bool:
    """Whether one Lyapunov matrix proves a polytopic plant admissible for every weight, however it moves.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    bool
        False: none was found, which proves nothing.
    """
    find = lyapunov_matrix if plant.kind == "continuous" else discrete_lyapunov_matrix
    return find(plant.polytope.E, [v.A for v in plant.polytope.vertices]) is not None
