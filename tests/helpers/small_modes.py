"""Small plants whose mode nobody tells, their tables without a certificate of delays, and exact true courses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from flint import arb, arb_mat, ctx

from codegen.designs import Design
from codegen.observers import ModeObserver, ModeTables, Supervision
from codegen.plant.load import loads
from codegen.synthesis.mode_tables import tables_of

Array = np.ndarray
TEXT = """
format = 1
name   = "valve"
title  = "Tank with a valve that nobody watches"
[time]
kind = "continuous"
sample_period = 0.05
[signals]
x = [{ name = "level", range = [-2.5, 2] }, { name = "flow", range = [-1, 2] }]
u = [{ name = "pump", range = [0.5, 2] }]
y = [{ name = "level", range = [-3, 3] }]
w = [{ name = "leak", bounds = [-0.002, 0.004] }]
v = [{ name = "noise", bounds = [-0.001, 0.002] }]
f = [{ name = "sensor", range = [-1, 1] }]
[initial]
x_lo = [-0.1, 0.1]
x_hi = [0.1, 0.3]
[common]
C  = [[1, 0]]
D  = [[0.1]]
Dv = [[1]]
Df = [[1]]
Bw = [[1], [0.5]]
[[mode]]
name = "open"
A = [[-2, 1], [0, -3]]
B = [[1], [1]]
[[mode]]
name = "shut"
A = [[-2, 1], [1, -4]]
B = [[-2], [2]]
[switching]
known = false
minimum_dwell = 1
[observer]
method = "mode-set"
[[scenario]]
name  = "between samples"
steps = 100
mode  = [[0, "open"], [30.25, "shut"], [60.5, "open"]]
u     = ["1 + 0.5*sin(t)"]
w     = "corner"
v     = "corner"
"""
THREE = """
format = 1
name   = "valve"
[time]
kind = "continuous"
sample_period = 0.05
[signals]
x = [{ name = "level", range = [-2.5, 2] }, { name = "flow", range = [-1, 3] }, { name = "lag", range = [-2, 2] }]
y = [{ name = "a", range = [-6, 9] }, { name = "b", range = [-6, 9] }]
w = [{ name = "leak", bounds = [-0.002, 0.004] }]
v = [{ name = "noise", bounds = [-0.01, 0.01] }]
[initial]
x_lo = [0.5, 0.1, 0]
x_hi = [1, 0.3, 1]
[common]
C  = [[1, 0, 1], [0, 1, 0]]
Dv = [[1], [0.5]]
Bw = [[1], [0.5], [0]]
[[mode]]
name = "open"
A = [[-2, 1, 0], [0, -3, 0], [0, 1, -1]]
[[mode]]
name = "shut"
A = [[-1, 0, 0.5], [1, -4, 0], [0, 0, -2]]
[[mode]]
name = "stuck"
A = [[-0.5, -1, 0], [0, -1, 0.2], [0.1, 0, -3]]
[switching]
known = false
minimum_dwell = 1
[observer]
method = "mode-set"
"""
PLANTS = {"one input": TEXT, "no input, two outputs": THREE}


@lru_cache
def plant(name: str = "one input"):
    return loads(PLANTS[name])


def quiet(p):
    """The same plant without disturbance and noise: rounding is all there is."""
    modes = tuple(replace(m, w_lo=0 * m.w_lo, w_hi=0 * m.w_hi, v_lo=0 * m.v_lo, v_hi=0 * m.v_hi) for m in p.modes)
    return replace(p, modes=modes)


@lru_cache
def tables(name: str, ages: int, real: str):
    return tables_of(ModeTables, plant(name), ages, real)


def stand_in(name: str = "one input", ages: int = 3, supervision=None, prefix: str = "") -> Design:
    """A design whose delays nobody certified; its constants hold the plant all the same."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, ages, real) for real in ("float32", "float64")}
    return Design(p, "mode-set", ModeObserver(made, supervision or Supervision()),
                  {real: {"kind": "mode"} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})


@dataclass(frozen=True)
class Exact:
    """A true course: x (K, n) in balls of 1e-50, u, y, theta (K, .) as floats, q (K,) the mode at each sample.

    Of a discrete plant q is the mode of the step that led to the sample.
    """

    x: Array
    u: Array
    y: Array
    q: Array
    theta: Array


def exact_course(p, ages: int, steps: int, seed: int, side: int = 0) -> Exact:
    """Everything at a corner, switches as fast as allowed: on a sample, a hair before or after it, or inside.

    ``side``: disturbances and parameters stay at the upper (1) or lower (-1) end and noise at the other one, so that
    bounds are met.
    """
    def end(ends) -> float:
        return float(rng.choice(ends) if side == 0 else ends[side > 0])

    rng, before = np.random.default_rng(seed), ctx.prec
    ctx.prec = 200
    try:
        T = arb(p.sample_period)
        x = [arb(float(rng.choice(ends))) for ends in zip(p.x0_lo, p.x0_hi)]
        mode, due = int(rng.integers(p.n_modes)), arb(1)  # in periods
        due = due + arb(float(rng.choice([0, 2 ** -40, 0.3, 0.5, 1 - 2 ** -40])))
        jumps = (0, 2 ** -40, 0.37) if p.kind == "continuous" else (0,)
        due = due if p.kind == "continuous" else arb(2)
        out = Exact(*([] for _ in range(5)))
        for k in range(steps):
            m = p.modes[mode]
            u = np.array([rng.choice(ends) for ends in zip(*p.limits("u"))])
            v = [arb(end(ends)) for ends in (zip(m.v_lo, m.v_hi) if side == 0 else zip(m.v_hi, m.v_lo))]
            y = [float(sum((arb(float(a)) * b for row, vec in ((m.C, x), (m.D, [arb(float(z)) for z in u]), (m.Dv, v))
                            for a, b in zip(row[i], vec)), arb(0)).mid()) for i in range(p.n_y)]
            out.x.append(x)
            out.u.append(u)
            out.y.append(y)
            out.q.append(mode)
            corners = [[end(ends) for ends in zip(*p.limits("theta"))] for _ in range(3)]
            out.theta.append(corners[0])
            cuts = [arb(k), arb(k) + arb(float(rng.random())), arb(k + 1)] if p.kind == "continuous" else [
                arb(k), arb(k + 1)]
            if due < k + 1 and p.kind == "continuous":
                cuts = sorted([*cuts, due], key=lambda c: float((c - k).mid()))
            for a, b, theta in zip(cuts, cuts[1:], corners):
                if due < k + 1 and a >= due:
                    mode = int(rng.choice([q for q in range(p.n_modes) if q != mode]))
                    step = rng.choice(jumps) if rng.random() < 0.7 or len(jumps) == 1 else rng.random()
                    due = due + (ages + 1) + arb(float(step))
                now = p.modes[mode]
                w = [end(ends) for ends in zip(now.w_lo, now.w_hi)]
                x = moved(now, x, u, w, theta, (b - a) * T if p.kind == "continuous" else None)
        return Exact(*(np.array(part, dtype=object if i == 0 else None) for i, part in enumerate(
            (out.x, out.u, out.y, out.q, out.theta))))
    finally:
        ctx.prec = before


def moved(m, x: list, u: Array, w: list, theta: list, t: arb | None) -> list:
    """Exact solution of x' = A(theta) x + B(theta) u + Bw w; without a time of x+ = the same."""
    n = len(x)
    A, B = ([[sum((arb(float(S[i][k])) * arb(p) for S, p in zip(m.theta_terms.get(name, ()), theta)),
                  arb(float(M[i, k]))) for k in range(M.shape[1])] for i in range(n)]
            for name, M in (("A", m.A), ("B", m.B)))
    push = [sum((a * arb(float(b)) for a, b in (*zip(B[i], u), *zip(map(arb, map(float, m.Bw[i])), w))), arb(0))
            for i in range(n)]
    if t is None:
        return [sum((A[i][j] * x[j] for j in range(n)), push[i]) for i in range(n)]
    whole = arb_mat([[a * t for a in A[i]] + [push[i] * t] for i in range(n)] + [[arb(0)] * (n + 1)])
    E = whole.exp().tolist()
    return [sum((E[i][j] * x[j] for j in range(n)), E[i][n]) for i in range(n)]
