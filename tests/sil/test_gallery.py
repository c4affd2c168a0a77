"""Every committed design: the compiled C equals the reference over 10^5 samples, for each layout and number type."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import built
from helpers.kept import first_of_each, whole

from codegen.designs import read_design
from codegen.emit.package import generate
from codegen.host.build import build

GENERATED = Path(__file__).resolve().parents[2] / "generated"
DESIGNS = sorted(p.parent.name for p in GENERATED.glob("*/design.json"))
RUNS, STEPS = 500, 200


@lru_cache(maxsize=4)
def design_of(name):
    return read_design(GENERATED / name)


def signals(plant, real, seed=1):
    """Inputs and outputs random in their ranges, at their ends, near the bounds, missing, refused; every mode."""
    rng = np.random.default_rng(seed)

    def drawn(vector):
        lo, hi = plant.limits(vector)
        shape = (RUNS, STEPS, len(lo))
        value = lo + (hi - lo) * rng.random(shape)
        ends = np.where(rng.random(shape) < 0.5, lo, hi)
        return np.where(rng.random(shape) < 0.3, ends, value)

    u, y = drawn("u"), drawn("y")
    if plant.polytope is not None:
        return of_polytope(plant, u, y, rng, real)
    q = rng.integers(0, plant.n_modes, (RUNS, STEPS))
    q[: RUNS // 2] = (np.arange(STEPS) // 7 + np.arange(RUNS // 2)[:, None]) % plant.n_modes  # slower switching
    y[rng.random((RUNS, STEPS)) < 0.02] = np.nan
    y[rng.random((RUNS, STEPS)) < 0.01] *= 100.0
    q[rng.random((RUNS, STEPS)) < 0.005] = plant.n_modes
    theta = parameters(plant, q, rng)
    # Half of the runs see the plant itself, so that there are samples without alarm.
    y[::2] = truths(plant.observed, u[::2], q[::2] % plant.n_modes, theta[::2], rng)
    return u.astype(real), y.astype(real), q, theta.astype(real)


def of_polytope(plant, u, y, rng, real):
    """No modes; half of the runs near the middle of the ranges, so that there are samples without alarm."""
    middle = np.add(*plant.limits("x")) / 2 @ plant.polytope.C.T
    u[::2] *= 0.1
    y[::2] = middle + (y[::2] - middle) * rng.choice([1e-3, 0.1], (RUNS // 2, 1, 1))
    y[rng.random((RUNS, STEPS)) < 0.02] = np.nan
    y[rng.random((RUNS, STEPS)) < 0.01] *= 100.0
    return u.astype(real), y.astype(real), np.zeros((RUNS, STEPS), int), np.empty((RUNS, STEPS, 0))


def parameters(plant, q, rng):
    """Measured parameters random in the box of their mode, at its ends, sometimes beyond; (RUNS, STEPS, J)."""
    boxes = [(m.theta_lo, m.theta_hi) if hasattr(m, "theta_lo") else (np.empty(0),) * 2 for m in plant.observed.modes]
    lo, hi = (np.array([b[i] for b in boxes])[q % plant.n_modes] for i in (0, 1))
    value = lo + (hi - lo) * rng.random(lo.shape)
    value = np.where(rng.random(lo.shape) < 0.3, np.where(rng.random(lo.shape) < 0.5, lo, hi), value)
    value[rng.random(q.shape) < 0.003] *= 50.0
    return value


def truths(plant, u, q, theta, rng):
    """Outputs of the plant itself, runs side by side; (runs, STEPS, n_y)."""
    runs, (lo, hi) = len(u), plant.limits("y")
    x = plant.x0_lo + (plant.x0_hi - plant.x0_lo) * rng.random((runs, plant.n_x))
    out = np.empty((runs, STEPS, plant.n_y))
    for k in range(STEPS):
        after = np.empty_like(x)
        for i, m in enumerate(plant.modes):
            on = q[:, k] == i
            v, w = (np.where(rng.random((on.sum(), len(a))) < 0.5, a, b) for a, b in ((m.v_lo, m.v_hi),
                                                                                     (m.w_lo, m.w_hi)))
            out[on, k] = x[on] @ m.C.T + u[on, k] @ m.D.T + v @ m.Dv.T
            A, B = m.A, m.B
            if theta.shape[2]:
                p = theta[on, k]
                p = np.concatenate([p, *(p[:, [a]] * p[:, [b]] for a, b in m.products)], axis=1)
                A, B = A + np.tensordot(p, m.A_theta, 1), B + np.tensordot(p, m.B_theta, 1)
            after[on] = (A @ x[on, :, None] + B @ u[on, k][:, :, None])[:, :, 0] + w @ m.Bw.T
        x = after
    return np.clip(out, lo, hi)


@pytest.fixture(scope="module")
def reference():
    """Signals and answers of the reference, once per design and number type."""
    cache = {}

    def answers(name, real):
        if (name, real) not in cache:
            design = design_of(name)
            u, y, q, theta = signals(design.plant, real)
            cache[name, real] = (u, y, q, theta, design.observer.run_many(u, y, q, real, theta=theta))
        return cache[name, real]

    return answers


def printed():
    """The first design of every run-time family, with and without parameters, in every layout and type; of the others
    the layout and type that is committed, and one more."""
    every_kind = whole(first_of_each([GENERATED / name for name in DESIGNS]))
    for name in DESIGNS:
        record = json.loads((GENERATED / name / "resources.json").read_text(encoding="ascii"))
        own = record["real"], record["layout"]
        every = [(real, layout) for real in ("float32", "float64") for layout in ("literal", "table", "loop")]
        other = next(p for p in every if p[0] != own[0] and p[1] != own[1])
        yield from ((name, *pair) for pair in (every if GENERATED / name in every_kind else (own, other)))


@pytest.mark.parametrize(("name", "real", "layout"), list(printed()))
def test_c_equals_reference(name, real, layout, reference, tmp_path):
    u, y, q, theta, expected = reference(name, real)
    driver = built(design_of(name), tmp_path / "c", real=real, layout=layout)
    assert driver.run_many(u, y, q, theta=theta).differs(expected) == []
    assert RUNS * STEPS >= 10**5
    # The signals do reach what there is to reach.
    assert expected.alarm.any() and not expected.alarm.all()
    assert expected.assured.any() == design_of(name).observer.supervision.assures
    plant = design_of(name).plant
    told = {1} if plant.modes and plant.switching.known else set()
    assert set(np.unique(expected.status)) >= {0, 3} | told


def test_a_changed_constant_shows(reference, tmp_path):
    """The comparison is not blind: one offset off by a unit in the last place, and it fails."""
    name = "emps_tnl-interval"
    u, y, q, theta, expected = reference(name, "float32")
    folder = generate(design_of(name), tmp_path / "c", real="float32", layout="literal")
    t = design_of(name).observer.tables["float32"]
    from codegen.emit.cprint import literal

    text = (folder / "emps.c").read_text()
    old = literal(abs(float(t.d_hi[1, 0])), "float32")
    new = literal(abs(float(np.nextafter(t.d_hi[1, 0], np.float32(1)))), "float32")
    assert old in text
    (folder / "emps.c").write_text(text.replace(old, new))
    assert build(folder).run_many(u, y, q).differs(expected)
