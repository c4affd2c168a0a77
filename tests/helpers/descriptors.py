"""The common example of the polytopic descriptor observers, and what a test needs to judge an observer from outside."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from codegen.designs import Design, read_design
from codegen.observers import PolytopicObserver, Supervision
from codegen.plant.load import load
from codegen.selection.descriptors import design_observer, problem_and_scaling, sampled_observer
from codegen.selection.polytopic_designs import certified, check, propose
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.descriptor_problem import DescriptorProblem, kernel_of

from .scripts import GENERATED as FOLDERS

GENERATED = FOLDERS[0].parent
GALLERY = Path(__file__).parents[2] / "codegen" / "gallery"
DECAY, GAIN = 3.0, 10.0


@lru_cache
def plant(name: str):
    return load(GALLERY / f"{name}.toml")


@lru_cache
def example(channel: str = "state") -> DescriptorProblem:
    """Section 3.5 of the thesis: one signal d on state and outputs, everything in its own unit."""
    p, n = plant("dlpv").polytope, 3
    A, B, Bd = (np.array([getattr(v, key) for v in p.vertices]) for key in ("A", "B", "Bw"))
    H, J = (np.eye(n), np.zeros((n, 1))) if channel == "state" else (p.C, p.Dv)
    pairs = tuple((i, j) for i in range(3) for j in range(3))
    return DescriptorProblem(("1", "2", "3"), p.E, A, B, Bd, p.C, p.Dv, H, J, kernel_of(p.E), pairs, np.ones(1),
                             np.ones(1))


def observer(method: str, real: str = "float32", period: float | None = None, **options):
    return _observer(method, real, period, tuple(options.items()))


@lru_cache
def _observer(method, real, period, options):
    return design_observer(example(), method, Bounds(GAIN, DECAY, period), real, **dict(options))


def sampled(name: str, real: str = "float32"):
    """The sampled observer of a gallery plant, and the limit of Euler steps."""
    return _sampled(name, real)


@lru_cache
def _sampled(name, real):
    p, s = problem_and_scaling(plant(name))
    period = plant(name).sample_period
    return sampled_observer(p, "descriptor-uncertain", Bounds(GAIN, p.slowest() / 2, period), period, real, s)


@lru_cache
def made(name: str):
    """The committed design of a gallery plant; else one in float32 alone."""
    folder, method = GENERATED / f"{name}_descriptor-uncertain", "descriptor-uncertain"
    if folder.exists():
        return read_design(folder)
    p, real = plant(name), "float32"
    t, cert = certified(p, propose(p, method, {}), {}, real)
    faults = [{"channel": f.name, "unit": f.unit, "by_delay": [None]} for f in p.f]
    return Design(p, method, PolytopicObserver({real: t}, Supervision()), {real: cert}, {real: check(p, t, cert)},
                  {real: faults})


def frozen_gain(problem: DescriptorProblem, gains, pair) -> float:
    """Largest gain over frequency with all weights held, of plant and observer as two systems.

    From the equations of both as they are printed, not from those of the error.
    """
    i, j = pair
    n, m = len(problem.E), problem.B.shape[2]
    none = np.zeros((n, n))
    inputs = np.hstack([problem.B[i], problem.Bd[i]])
    y = np.hstack([np.zeros((len(problem.C), m)), problem.Dd])
    if hasattr(gains, "T2"):  # x_hat = z + T2 y over [x; z] and over [u; d]
        estimate, direct = np.hstack([gains.T2 @ problem.C, np.eye(n)]), gains.T2 @ y
        residual = np.hstack([problem.C, 0 * problem.C]) - gains.C @ estimate
        row = gains.F[j] @ estimate - gains.K[j] @ residual
        into = gains.F[j] @ direct - gains.K[j] @ (y - gains.C @ direct)
        into[:, :m] += gains.G[j]
        left = np.eye(n)
    else:
        estimate, direct = np.hstack([none, np.eye(n)]), np.zeros((n, y.shape[1]))
        row = np.hstack([gains.L[j] @ problem.C, gains.A[j] - gains.L[j] @ gains.C])
        into, left = gains.L[j] @ y, problem.E
        into[:, :m] += gains.B[j]
    A, B = np.vstack([np.hstack([problem.A[i], none]), row]), np.vstack([inputs, into])
    E = np.block([[problem.E, none], [none, left]])
    out = problem.H @ (np.hstack([np.eye(n), none]) - estimate)
    through = np.hstack([np.zeros((len(problem.H), m)), problem.J]) - problem.H @ direct
    return max(np.linalg.norm(out @ np.linalg.solve(1j * w * E - A, B) + through, 2)
               for w in [0.0, *np.geomspace(1e-2, 1e4, 200)])
