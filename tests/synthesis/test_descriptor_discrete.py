"""Polytopic descriptor observers in discrete time: designed there, or sampled; certificate, mutants, runs."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.descriptors import example, plant, sampled

from codegen.certify.polytope_gain import check
from codegen.errors import CertificateError, DesignError
from codegen.plant.load import loads
from codegen.selection import descriptors
from codegen.selection.descriptors import design_observer, designed, euler_limit, problem_and_scaling, sampled_observer
from codegen.synthesis import descriptor_discrete
from codegen.synthesis.descriptor_gains import euler_gains
from codegen.synthesis.descriptor_lmi import Bounds

PERIOD = 0.01


def by_euler(problem, period=PERIOD):
    return replace(problem, A=problem.E + period * problem.A, B=period * problem.B, Bd=period * problem.Bd)


@lru_cache
def made():
    return design_observer(by_euler(example()), "descriptor-discrete", Bounds(10.0, 3 * PERIOD))


@pytest.mark.parametrize("channel, reject, level", [("state", True, 1.146), ("residual", False, 0.6210)])
def test_levels_of_appendix_c2_corrected(channel, reject, level):
    """The mismatch as a disturbance; the residual's level is that of the frozen observer, as the dossier found."""
    p = by_euler(example(channel))
    found = descriptor_discrete.design(p, Bounds(1e3, 0.0), False, "disturbance", reject)
    assert found.gamma == pytest.approx(level, abs=6e-4 if level > 1 else 6e-5)
    worst = 0.0
    for A, Bd, K in zip(p.A, p.Bd, found.K):
        N, Dt = found.T1 @ A + K @ p.C, (np.eye(3) - p.C @ found.T2) @ p.Dd
        B = np.hstack([found.T1 @ (Bd - A @ found.T2 @ p.Dd) + K @ Dt, found.T1])
        D = np.hstack([p.J - p.H @ found.T2 @ p.Dd, np.zeros((len(p.H), 3))])
        assert np.abs(np.linalg.eigvals(N)).max() < 0.5  # the confusion of d(k) with d(k+1) ends at 0.999
        worst = max(worst, *(np.linalg.norm(p.H @ np.linalg.solve(np.exp(1j * w) * np.eye(3) - N, B) + D, 2)
                             for w in np.linspace(0, np.pi, 200)))
    assert 0.95 * found.gamma < worst <= found.gamma * (1 + 1e-6)


def test_the_direct_design():
    found = made()
    assert check(by_euler(example()), found.gains, found.proof) == found.claims and len(found.claims) == 2
    assert found.gamma <= found.designed * (1 + 1e-6) and found.designed == pytest.approx(0.0402, abs=6e-5)


def run(problem, gains, steps, rng, weights, noise):
    """Energies of z and of (u, d) over a run from rest; plant and observer as two recursions."""
    n, m, q = len(problem.E), len(problem.u_unit), len(problem.d_unit)
    r = np.linalg.matrix_rank(problem.E)
    assert np.array_equal(problem.E, np.diag([1.0] * r + [0.0] * (n - r)))
    x1, z, got, spent = np.zeros(r), np.zeros(n), 0.0, 0.0
    for k in range(steps):
        u, d = noise(k, m + q)[:m], noise(k, m + q)[m:]
        h, g = rng.dirichlet(np.full(len(problem.A), 0.3), 2) if weights is None else weights
        A, B, Bd = (np.tensordot(h, getattr(problem, key), 1) for key in ("A", "B", "Bd"))
        drive = B @ (u * problem.u_unit) + Bd @ (d * problem.d_unit)
        x = np.concatenate([x1, -np.linalg.solve(A[r:, r:], A[r:, :r] @ x1 + drive[r:])])
        y = problem.C @ x + problem.Dd @ (d * problem.d_unit)
        x_hat = z + gains.T2 @ y
        residual = y - gains.C @ x_hat
        F, G, K = (np.tensordot(g, getattr(gains, key), 1) for key in ("F", "G", "K"))
        got += np.sum((problem.H @ (x - x_hat) + problem.J @ (d * problem.d_unit)) ** 2)
        spent += np.sum(u**2) + np.sum(d**2)
        z = F @ x_hat + G @ (u * problem.u_unit) - K @ residual
        x1 = (A @ x + drive)[:r]
    return got, spent


@pytest.mark.parametrize("which", ["direct", "sampled"])
def test_runs_from_rest_stay_below_the_level(which):
    """Weights of plant and observer that have nothing to do with each other: the certificate covers them all."""
    if which == "direct":
        problem, found = by_euler(example()), made()
    else:
        found, _ = sampled("dlpv")
        problem = by_euler(problem_and_scaling(plant("dlpv"))[0])
    rng, worst = np.random.default_rng(5), 0.0
    for case in range(18):
        rate, part = rng.uniform(0, 0.05), rng.normal(size=(2, len(problem.u_unit) + len(problem.d_unit)))
        # At random, or plant and observer each at a vertex.
        weights = None if case < 9 else (np.eye(3)[case % 3], np.eye(3)[case // 3 % 3])
        got, spent = run(problem, found.gains, 150, rng, weights,
                         lambda k, m, rate=rate, part=part: np.cos(rate * k) * part[0] + np.sin(rate * k) * part[1])
        worst = max(worst, got / spent)
        assert got <= found.gamma**2 * spent
    assert worst > 0.05 * found.gamma**2


@pytest.mark.parametrize("name", ["disc", "dlpv"])
def test_sampled_observers_are_certified_again(name):
    found, limit = sampled(name)
    period = plant(name).sample_period
    assert period < limit and found.proof["time"] == "discrete" and found.proof["period"] == period
    assert 0 < found.proof["contraction"] < 1 and f"Euler steps of {period:.6g} s" in found.claims[1]
    assert found.gamma <= found.designed * 1.05  # what the continuous design claims is near, and not what is claimed


def test_the_limit_of_euler_steps_is_where_they_diverge(monkeypatch):
    p, s = problem_and_scaling(plant("dlpv"))
    bounds = Bounds(10.0, p.slowest() / 2)
    design = designed(p, "descriptor-uncertain", bounds, s, {})
    limit = euler_limit(p, design, s)
    for share, stable in ((0.99, True), (1.01, False)):
        gains = euler_gains(p, design, s, share * limit, "float64")
        radius = max(np.abs(np.linalg.eigvals(F + K @ p.C)).max() for F, K in zip(gains.F, gains.K))
        assert (radius < 1) == stable
    monkeypatch.setattr(descriptors, "designed", lambda *arguments: design)
    with pytest.raises(DesignError, match=f"diverge .found., expected less than {limit:.4g} s"):
        sampled_observer(p, "descriptor-uncertain", bounds, limit * 1.01, "float64", s)
    with pytest.raises(DesignError, match="only their observers are ordinary differential equations"):
        sampled_observer(p, "descriptor-direct", bounds, 0.001, "float64", s)
    # A continuous certificate says nothing of it: the discrete check refuses the recursion at that period.
    found, _ = sampled("dlpv")
    for period in (0.02, 0.2):
        with pytest.raises(CertificateError):
            check(p, found.gains, found.proof | {"period": period})


def lower_level(gains, proof):
    proof["level2"] *= 0.9


def faster(gains, proof):
    proof["contraction"] *= 0.98


def no_algebra(gains, proof):
    proof["R"] = [[0.0 for _ in row] for row in proof["R"]]


def storage_off(gains, proof):
    proof["P2"] = (np.array(proof["P2"]) * 1e-3).tolist()


def indefinite(gains, proof):
    proof["P1"][1][1] *= -1


def gain_sign(gains, proof):
    gains.K[2] *= -1


def weights_mixed(gains, proof):
    gains.F[[0, 1]] = gains.F[[1, 0]]


def one_entry(gains, proof):
    gains.T2[0, 0] += 0.05


@pytest.mark.parametrize("mutant", [lower_level, faster, no_algebra, storage_off, indefinite, gain_sign, weights_mixed,
                                    one_entry], ids=lambda m: m.__name__)
def test_the_exact_check_refuses(mutant):
    problem = by_euler(example())
    gains, proof = deepcopy(made().gains), deepcopy(made().proof)
    mutant(gains, proof)
    with pytest.raises(CertificateError):
        check(problem, gains, proof)


def test_a_discrete_plant_file_is_designed_as_it_is():
    """The same plant written down by its Euler steps: E, A and B of the file are those of x+."""
    p = plant("dlpv").polytope
    text, A = plant("dlpv").text.replace('"continuous"', '"discrete"'), [v.A for v in p.vertices]
    for M, B in zip(A, [v.B for v in p.vertices]):
        for old, new in ((M, p.E + PERIOD * M), (B, PERIOD * B)):
            rows = "[" + ", ".join("[" + ", ".join(f"{v:g}" for v in row) + "]" for row in old) + "]"
            assert rows in text
            text = text.replace(rows, str(new.tolist()), 1)
    text = text.replace("Bw = [[1], [0], [0.5]]", f"Bw = [[{PERIOD}], [0], [{0.5 * PERIOD}]]")
    discrete = loads(text)
    problem, s = problem_and_scaling(discrete)
    assert s.time == 1.0
    found = design_observer(problem, "descriptor-discrete", Bounds(10.0, 0.01), "float32", s)
    again, _ = sampled("dlpv")
    assert found.gamma < 1.05 * again.gamma and found.proof["contraction"] < np.exp(-0.01)
    with pytest.raises(DesignError, match="the plant is discrete .found., expected continuous"):
        design_observer(problem, "descriptor-direct", Bounds(10.0, 0.01), s=s)
    with pytest.raises(DesignError, match="expected one of plant, disturbance"):
        design_observer(problem, "descriptor-discrete", Bounds(10.0, 0.01), s=s, mismatch="other")
