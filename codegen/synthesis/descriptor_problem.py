r"""The problem of a polytopic descriptor observer: E x' = sum_i h_i (A_i x + B_i u + Bd_i d), y = C x + Dd d.

The weights h_i depend on the state, which nobody measures; the observer takes them at its estimate. So the plant is at
vertex i and the observer at vertex j, and every condition is one per `pairs`: all of them, but where a premise depends
on the inputs and measured parameters alone, both have the same bit of it.

d holds disturbance and noise. The energy gain is from (u, d) to z = H (x - x_hat) + J d.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..algebra.admissibility import left_kernel
from ..algebra.interval import sizes
from ..algebra.pencil import finite_eigenvalues, rank

Array = np.ndarray
TOLERANCE = 1e-9
#: Options of thresholds that come from simulated runs.
CALIBRATED = {"threshold": ("guaranteed", "calibrated"), "false_alarm": (0.0, 1.0), "confidence": (0.0, 1.0),
              "campaign_steps": (10, 100000), "rank": (1, 100)}


@dataclass(frozen=True)
class DescriptorProblem:
    """What a design sees of the plant.

    Parameters
    ----------
    names : tuple of str
        Of the vertices.
    E : ndarray (n, n)
    A : ndarray (h, n, n), B : ndarray (h, n, m), Bd : ndarray (h, n, q)
    C : ndarray (p, n), Dd : ndarray (p, q)
    H : ndarray (k, n), J : ndarray (k, q)
    S : ndarray (n, n - r)
        Of full column rank, E' S = 0.
    pairs : tuple of (int, int)
        (vertex of the plant, vertex of the observer).
    u_unit : ndarray (m,), d_unit : ndarray (q,)
        What u and d are measured in; B, Bd, Dd and J are for their own units.
    kind : {"continuous", "discrete", ""}
        Of the plant; empty where it is not told.
    """

    names: tuple[str, ...]
    E: Array
    A: Array
    B: Array
    Bd: Array
    C: Array
    Dd: Array
    H: Array
    J: Array
    S: Array
    pairs: tuple[tuple[int, int], ...]
    u_unit: Array
    d_unit: Array
    kind: str = ""

    @property
    def sizes(self) -> tuple[int, int, int, int, int]:
        """Vertices h, states n, outputs p, inputs m, unknown inputs q."""
        return *self.A.shape[:2], len(self.C), self.B.shape[2], self.Bd.shape[2]

    def slowest_step(self) -> float:
        """Largest magnitude of the finite eigenvalues of any vertex, of a discrete plant."""
        return max((float(np.abs(finite_eigenvalues(self.E, A)).max(initial=0.0)) for A in self.A), default=0.0)

    def slowest(self) -> float:
        """Decay rate of the slowest finite eigenvalue of any vertex; negative where one grows."""
        return min((-float(finite_eigenvalues(self.E, A).real.max(initial=-np.inf)) for A in self.A), default=0.0)


@dataclass(frozen=True)
class Scaling:
    """Units in which a solver meets a problem: x = columns xs, y = outputs ys, rows of E x', time = t of it per second.

    Parameters
    ----------
    columns : ndarray (n,), outputs : ndarray (p,), rows : ndarray (n,)
    time : float
    """

    columns: Array
    outputs: Array
    rows: Array
    time: float

    def gain(self, K: Array) -> Array:
        """K of z' = .. - K r, back in the plant's units.

        Parameters
        ----------
        K : ndarray (n, p)
        """
        return self.time * self.columns[:, None] * K / self.outputs

    def factor1(self, T1: Array) -> Array:
        """T1 of T1 E + T2 C = I, back in the plant's units.

        Parameters
        ----------
        T1 : ndarray (n, n)
        """
        return self.time * self.columns[:, None] * T1 * self.rows

    def factor2(self, T2: Array) -> Array:
        """T2 of T1 E + T2 C = I, back in the plant's units.

        Parameters
        ----------
        T2 : ndarray (n, p)
        """
        return self.columns[:, None] * T2 / self.outputs

    def injection(self, L: Array) -> Array:
        """L of E x_hat' = .. + L r, back in the plant's units.

        Parameters
        ----------
        L : ndarray (n, p)
        """
        return L / self.rows[:, None] / self.outputs


def plain(problem: DescriptorProblem) -> Scaling:
    """The scaling that changes nothing.

    Parameters
    ----------
    problem : DescriptorProblem
    """
    _, n, p, _, _ = problem.sizes
    return Scaling(np.ones(n), np.ones(p), np.ones(n), 1.0)


def scaling_of(problem: DescriptorProblem, columns: Array, outputs: Array, discrete: bool = False) -> Scaling:
    """Rows and time that bring the pencil near norm 1 in given units of states and outputs.

    Parameters
    ----------
    problem : DescriptorProblem
    columns : ndarray (n,), outputs : ndarray (p,)
    discrete : bool
        The time of E x+ is the sample.
    """
    size_e = np.linalg.norm(problem.E * columns, axis=1)
    size_a = np.linalg.norm(np.max(np.abs(problem.A), axis=0) * columns, axis=1)
    both = (size_e > 0) & (size_a > 0)
    time = float(np.exp(np.mean(np.log(size_a[both] / size_e[both])))) if both.any() and not discrete else 1.0
    size = np.where(size_e > 0, time * size_e, size_a)  # E near norm 1: T1 and T2 are of one size then
    return Scaling(columns, outputs, 1 / np.where(size > 0, size, 1.0), time)


def scaled(problem: DescriptorProblem, s: Scaling) -> DescriptorProblem:
    """The problem in the units of a scaling, u and d in theirs.

    Parameters
    ----------
    problem : DescriptorProblem
    s : Scaling
    """
    rows, out, u, d = s.rows[:, None], s.outputs[:, None], problem.u_unit, problem.d_unit
    return replace(problem, E=s.time * rows * problem.E * s.columns, A=rows * problem.A * s.columns,
                   B=rows * problem.B * u, Bd=rows * problem.Bd * d, C=problem.C * s.columns / out,
                   Dd=problem.Dd / out * d, H=problem.H * s.columns, J=problem.J * d, S=problem.S / rows,
                   u_unit=np.ones(len(u)), d_unit=np.ones(len(d)))


def refusal(plant, known: bool = False) -> str | None:
    """Why these designs do not apply to a plant; None where they do.

    Parameters
    ----------
    plant : Plant
    known : bool
        Whether the design takes terms that are known at run time.
    """
    p = plant.polytope
    if p is None:
        return "it has modes; these designs are for a polytope of vertices ([[vertex]] or [nonlinear])"
    if any(np.any(v.offset) for v in p.vertices):
        return ("its vertices have constants (the offsets of a linearisation), and the energy of a constant has no "
                "end. Model it by sectors")
    if np.any(p.D):
        return "its outputs contain the inputs (D is not zero). Declare y - D u as the output"
    if p.known and not known:
        return ("its equations have known terms, which descriptor-fault-estimation alone takes. Leave "
                "[nonlinear] known out, with factors and premises for all of f")
    if any(not s.measured for s in plant.theta):
        return "a parameter is not measured. Make it a disturbance, or a state"
    return None


def inapplicable(plant, continuous: bool = True, seen: bool = True) -> str | None:
    """Why a plant cannot have an observer of these methods, with what to change; None if it can.

    Parameters
    ----------
    plant : Plant
    continuous : bool
        The method is one in continuous time.
    seen : bool
        It takes the algebraic states from the outputs.
    """
    reason = refusal(plant)
    if reason is not None:
        return f"{reason}."
    if continuous and plant.kind != "continuous":
        return 'the plant is discrete, expected continuous. Use method "descriptor-discrete".'
    for vector in "xuywv":
        for s in getattr(plant, vector):
            if not (np.isfinite(s.lo) and np.isfinite(s.hi)):
                return f'signals.{vector} "{s.name}" has no range, expected one: thresholds rest on it. Add one.'
    if seen and not visible(problem_of(plant)):
        other = ', or use method "descriptor-direct"' if plant.kind == "continuous" else ""
        return ("rank [E; C] is less than the number of states: no T1, T2 with T1 E + T2 C = I exist, an algebraic "
                f"state is not seen by the outputs. Measure it{other}.")
    return None


def problem_of(plant, channel: str = "state") -> DescriptorProblem:
    """The problem of a Plant: inputs and unknown inputs in units of their bounds, z in those of the ranges.

    Parameters
    ----------
    plant : Plant
        One that `refusal` does not refuse.
    channel : {"state", "residual"}
        z is x - x_hat, or y - C x_hat.

    Returns
    -------
    DescriptorProblem
    """
    p = plant.polytope
    unit = {vector: sizes(*plant.limits(vector)) for vector in "xuywv"}
    Bd = np.array([np.hstack([v.Bw, np.zeros((plant.n_x, plant.n_v))]) for v in p.vertices])
    Dd = np.hstack([np.zeros((plant.n_y, plant.n_w)), p.Dv])
    H, J = np.diag(1 / unit["x"]), np.zeros((plant.n_x, Dd.shape[1]))
    if channel == "residual":
        H, J = p.C / unit["y"][:, None], Dd / unit["y"][:, None]
    return DescriptorProblem(tuple(v.name for v in p.vertices), p.E, np.array([v.A for v in p.vertices]),
                             np.array([v.B for v in p.vertices]), Bd, p.C, Dd, H, J, kernel_of(p.E), pairs_of(plant),
                             unit["u"], np.concatenate([unit["w"], unit["v"]]), plant.kind)


def kernel_of(E: Array) -> Array:
    """S with E' S = 0 and full column rank; exact entries, rounded.

    Parameters
    ----------
    E : ndarray (n, n)
    """
    return np.array([[float(x) for x in row] for row in left_kernel(E)]).reshape(len(E), -1)


def pairs_of(plant, exact=()) -> tuple[tuple[int, int], ...]:
    """Vertices that plant and observer can be at together.

    Where they share a bit, the proof takes it that both compute the same weight of it, without rounding.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    exact : collection of int
        States that the observer's weights take from an output which is just that.
    """
    p = plant.polytope
    known = {p.symbols[k] for k in exact} | set(p.symbols[plant.n_x:plant.n_x + plant.n_u])
    known |= {s for s, t in zip(p.symbols[plant.n_x + plant.n_u:], plant.theta) if t.measured and t.error == 0}
    h = range(len(p.vertices))
    if p.premises:
        shared = [k for k, z in enumerate(p.premises) if z.term.free_symbols <= known]
        return tuple((i, j) for i, j in product(h, h) if all((i ^ j) >> k & 1 == 0 for k in shared))
    if all(w.free_symbols <= known for w in p.raw):
        return tuple((i, i) for i in h)
    return tuple(product(h, h))


def visible(problem: DescriptorProblem) -> bool:
    """Whether rank [E; C] = n: the outputs see what the differential equations do not.

    Parameters
    ----------
    problem : DescriptorProblem
    """
    return rank(np.vstack([problem.E, problem.C])) == len(problem.E)


def factors(problem: DescriptorProblem, reject: bool = True) -> tuple[Array, Array, Array]:
    """T1, T2 of least norm with T1 E + T2 C = I (and T2 Dd = 0 where that is possible), and what may be added.

    Parameters
    ----------
    problem : DescriptorProblem
        `visible`.
    reject : bool
        Ask for T2 Dd = 0.

    Returns
    -------
    T1 : ndarray (n, n), T2 : ndarray (n, p)
    free : ndarray (l, n + p)
        Any Z free may be added to [T1 T2].
    """
    _, n, p, _, q = problem.sizes
    tall = np.vstack([problem.E, problem.C])
    noise = np.vstack([np.zeros((n, q)), problem.Dd])
    if reject and rank(np.hstack([tall, noise])) == n + rank(noise):
        tall = np.hstack([tall, noise])
    T = np.linalg.pinv(tall, rcond=TOLERANCE)[:n]
    free = np.linalg.svd(tall.T)[2][rank(tall):]
    return T[:, :n], T[:, n:], free
