"""Observers that solve the algebraic equations themselves: the equations, the exact error, tampering, refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.descriptors import GENERATED, plant

from codegen.certify import descriptor_bounds
from codegen.certify.descriptor_error import descriptor_errors, solved
from codegen.designs import read_design
from codegen.errors import CertificateError
from codegen.observers import DescriptorObserver
from codegen.observers.descriptor import of_pivots
from codegen.observers.polytopic_step import evaluate
from codegen.plant.load import load, loads
from codegen.selection.descriptor_designs import propose, tables
from codegen.selection.descriptors import problem_and_scaling
from codegen.selection.polytopes import in_turn
from codegen.selection.polytopic_designs import check
from codegen.selection.polytopic_tables import limited
from codegen.synthesis import METHODS, descriptor_direct
from codegen.synthesis.descriptor_lmi import Bounds
from codegen.synthesis.descriptor_problem import scaled

NAMES = ("disc_contact", "dlpv")  # one pivot and two equations; a pivot for each vertex


@lru_cache
def proposal(name: str):
    return propose(plant(name), "descriptor-direct", plant(name).options)


@lru_cache
def held(name: str):
    """Constants of a design in float64, without thresholds: what the recursion needs."""
    p = plant(name)
    t = tables(p, proposal(name), "float64")
    return problem_and_scaling(p)[0], limited(p, t, np.eye(p.n_x), np.zeros(p.n_x))


@lru_cache
def committed():
    return read_design(GENERATED / "disc_contact_descriptor-direct")


def samples(name: str, t, count: int = 40):
    """Plant at random weights, observer at its own: x, u, d, z, weights of both and what the observer answers."""
    p, (problem, _) = plant(name), held(name)
    rng, (h, n, *_) = np.random.default_rng(3), problem.sizes
    a, S = list(t.algebraic), problem.S
    box = [np.array(p.limits(v)) for v in "xuwv"]
    for _ in range(count):
        x, u, w, v = (rng.choice([lo, hi, (lo + hi) / 2 + rng.uniform(-0.5, 0.5, len(lo)) * (hi - lo)])
                      for lo, hi in box)
        d, own = np.concatenate([w, v]), rng.dirichlet(np.full(h, 0.3))
        A, B, Bd = (np.tensordot(own, M, 1) for M in (problem.A, problem.B, problem.Bd))
        x[a] = 0.0
        x[a] = -np.linalg.solve(S.T @ A[:, a], S.T @ (A @ x + B @ u + Bd @ d))
        z, theta = x + rng.uniform(-0.1, 0.1, n) * box[0][1], np.zeros((1, 0))
        y = problem.C @ x + problem.Dd @ d
        x_hat, r, _, after = DescriptorObserver.advance(t, z[None], u[None], y[None], theta, np.array([True]))
        weights = np.array(evaluate(t.weights, [*z[:, None], *u[:, None]], "float64"))[:h, 0].astype(float)
        change = A @ x + B @ u + Bd @ d
        later = x + p.sample_period * np.linalg.pinv(problem.E) @ change
        yield (x, u, d, z), (own, weights), (x_hat[0], r[0], after[0]), later


@pytest.mark.parametrize("name", NAMES)
def test_the_algebraic_equations_hold_for_all_weights(name):
    problem, t = held(name)

    def left(t):
        worst = 0.0
        for (_, u, _, _), (_, h), (x_hat, _, _), _ in samples(name, t):
            A, B = (np.tensordot(h, M, 1) for M in (problem.A, problem.B))
            worst = max(worst, np.abs(problem.S.T @ (A @ x_hat + B @ u)).max())
        return worst

    assert left(t) < 1e-12 and t.uneven == (name == "dlpv")
    assert left(replace(t, P=t.P[::-1].copy())) > 1e-3
    if t.uneven:
        assert left(replace(t, pivot=np.ones_like(t.pivot))) > 1e-3
        h = np.random.default_rng(0).dirichlet(np.ones(3), 50)
        assert np.abs(of_pivots(t, h).sum(axis=1) - 1).max() < 1e-15 and (h @ t.pivot).min() >= t.pivot.min()
        assert np.all(of_pivots(t, 0 * h) == 0)  # weights that are none meet the guard


@pytest.mark.parametrize("name", NAMES)
def test_the_error_model_is_what_plant_and_observer_do(name):
    """From outside: both simulated for one step; the same with a gain of the other sign is not that."""
    problem, t = held(name)

    def worst(t, model):
        found = [0.0]
        for (x, u, d, _), (own, h), (x_hat, _, after), later in samples(name, t):
            c = np.concatenate([x - x_hat, x, u / problem.u_unit, d / problem.d_unit])
            weights = {(i, j): own[i] * h[j] for i, j in model.pairs}
            step = sum(v * np.hstack([np.array(M, float) for M in model.pairs[k]]) for k, v in weights.items())
            tie = sum(v * np.array(model.ties[k], float) for k, v in weights.items())
            found += [np.abs((step @ c)[:len(x)] - later + after)[t.moving].max(), np.abs(tie @ c).max()]
        return max(found)

    # Weights of inputs are the same in both: these plants have none.
    assert len(problem.pairs) == len(problem.A) ** 2
    model = descriptor_errors(problem, t, plant(name).sample_period)
    assert worst(t, model) < 1e-12 < 1e-6 < worst(replace(t, K=-t.K), model)
    assert worst(replace(t, Q=-t.Q), model) > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_bounds_of_a_step_hold_for_all_weights(name, monkeypatch):
    """Means over the pairs (weights, solved weights); those of another gain, or without the mismatch, are none."""
    p, (problem, t) = plant(name), held(name)

    def worst(given):
        model, _ = descriptor_bounds.model(p, problem, given, p.sample_period)
        J, W, O, room = ([np.array(getattr(m, k), float) for m in model] for k in ("J", "W", "O", "room"))  # noqa: E741
        over = []
        for (x, _, _, z), (_, h), (_, r, after), later in samples(name, t):
            g, e = of_pivots(t, h[None])[0], (x - z)[t.moving]
            both = np.outer(h, [g[np.all(t.solved == t.solved[k], axis=(1, 2))].sum()
                                for k in descriptor_bounds.kinds(t)]).ravel()
            own = np.tensordot(both, J, 1) @ e, np.tensordot(both, np.abs(W).sum(axis=2), 1)
            over.append(np.max(np.abs((later - after)[t.moving] - own[0]) - own[1]))
            over.append(np.max(np.abs(r - np.tensordot(both, O, 1) @ e) - both @ np.array(room)))
        return max(over)

    assert worst(t) < 0 < worst(replace(t, K=-3 * t.K))
    wrong = descriptor_bounds.mismatch
    monkeypatch.setattr(descriptor_bounds, "mismatch", lambda *a: [0 * v for v in wrong(*a)])
    assert worst(t) > 0 or name == "disc_contact"  # its two vertices differ by less than it moves between samples


def spoilt(cert: dict, key: str, change) -> dict:
    part = "energy" if key in cert["energy"] else "thresholds"
    return cert | {part: cert[part] | {key: change(cert[part][key])}}


CONSTANTS = {"P": lambda v: v * 1.01, "Q": lambda v: -v, "K": lambda v: -v, "F": lambda v: v * 1.001,
             "h": lambda v: v * 0.95, "pivot": lambda v: v * 0.5 ** np.arange(len(v)), "C": lambda v: v * 1.02,
             "z_hi": lambda v: v * 4}
PROOFS = {"Rc": lambda v: (0 * np.array(v)).tolist(), "Re": lambda v: (0 * np.array(v)).tolist(),
          "P1": lambda v: (-np.array(v)).tolist(), "contraction": lambda v: 0.99 * v, "bounds": lambda v:
          (0.6 * np.array(v)).tolist(), "period": lambda v: 2 * v, "level2": lambda v: 0.5 * v}


@pytest.mark.parametrize("key", [*CONSTANTS, *PROOFS])
def test_tampering_is_refused(key):
    design = committed()
    t, cert = design.observer.tables["float32"], design.certificate["float32"]
    if key in CONSTANTS:
        t = replace(t, **{key: CONSTANTS[key](getattr(t, key)).astype(t.dtype)})
    else:
        cert = spoilt(cert, key, PROOFS[key])
    with pytest.raises(CertificateError):
        check(design.plant, t, cert)


def test_a_pivot_that_is_not_positive_is_refused():
    """Whatever the level says: the C divides by a mean of them."""
    problem, t = held("dlpv")
    for least in (0.0, -0.1, np.nan, 2.0**-61):
        wrong = replace(t, pivot=np.array([1.0, 0.8, least]))
        with pytest.raises(CertificateError, match="the least pivot"):
            descriptor_bounds.model(plant("dlpv"), problem, wrong, 0.01)


def test_the_committed_design_is_certified():
    design = committed()
    for real, t in design.observer.tables.items():
        claims = check(design.plant, t, design.certificate[real])
        assert any("no false alarm" in c for c in claims) and any("shrinks to at most 0.9" in c for c in claims)
        assert t.algebraic == (2, 3) and np.all(t.h[-1] < [0.0052, 0.018])


def test_euler_steps_are_part_of_the_design():
    """The gains that suit the plant's period diverge at one of six times that."""
    problem, s = problem_and_scaling(plant("dlpv"))
    p, period, loose = scaled(problem, s), 0.06, proposal("dlpv").found
    tight = descriptor_direct.design(p, Bounds(10.0, 1.0 / s.time, period * s.time))

    def limit(found):
        t1, a = np.linalg.pinv(p.E), list(range(2))
        solved = [M[:2, :2] - np.outer(M[:2, 2], M[2, :2]) / M[2, 2] for M in p.A - found.K @ p.C]
        assert np.allclose(found.K[:, 2], 0) and np.allclose(t1 @ p.E, np.diag([1, 1, 0]))
        modes = np.linalg.eigvals(t1[:2, :2] @ np.array(solved)[:, a])
        return min((-2 * modes.real / np.abs(modes) ** 2).ravel()) / s.time

    assert limit(loose) == pytest.approx(proposal("dlpv").limit, rel=1e-6)
    assert limit(loose) < period < limit(tight) and tight.gamma >= loose.gamma


def test_what_stands_in_the_way_is_said():
    others, own = METHODS["descriptor-uncertain"].module, METHODS["descriptor-direct"].module
    contact, text = load("disc_contact"), load("dlpv").text
    assert others.inapplicable(contact).endswith('use method "descriptor-direct".')
    assert in_turn(contact) == ["descriptor-direct"] and own.inapplicable(contact) is None
    assert in_turn(load("dlpv")) == ["descriptor-uncertain", "descriptor-discrete"]
    mixed = loads(text.replace("[0, 1, 0], [0, 0, 0]]\nC", "[0, 1, 1], [0, 0, 0]]\nC"))
    assert own.inapplicable(mixed).startswith("E has 0 columns of zeros and 1 algebraic equations")
    turned = loads(text.replace("[-2, 4, 7]", "[-2, 4, -7]"))
    assert "(x3) the algebraic equations of the vertices are no positive multiples" in own.inapplicable(turned)
    problem, _ = held("disc_contact")
    A = problem.A.copy()
    A[1, 2, 2] *= 1.1  # one of two equations alone
    uneven = replace(problem, A=A)
    assert descriptor_direct.solved(problem) is not None and descriptor_direct.solved(uneven) is None
    with pytest.raises(CertificateError, match="no positive multiples of one matrix"):
        solved(uneven)
    discrete = loads(text.replace('"continuous"', '"discrete"'))
    assert "the plant is discrete" in own.inapplicable(discrete)
