"""The certificate of a point observer's gains, and the judge that compares gains: each against what it must catch."""

from dataclasses import replace

import numpy as np
import pytest
from pole_cases import NONE, PLANT, PROBLEM, UNIT, C, F, hinf, lmi
from scipy.optimize import linprog

from codegen.algebra import zonotope as zonotope_set
from codegen.certify.residual_gain import check, prove
from codegen.errors import CertificateError
from codegen.plant.load import load
from codegen.synthesis import ellipsoid, zonotope
from codegen.synthesis.problem import Problem
from codegen.synthesis.residual_judge import Path, ResidualJudge, paths, thresholds
from codegen.synthesis.set_linf import SetLinfProblem

TNL = Problem.of(load("zammali_ellipsoid"), True)


# -- the judge -------------------------------------------------------------------------------------
def test_thresholds_are_sharp():
    """A fault above the threshold shows for every noise; for one below there is a noise that hides it.

    The whole history of noise is a linear program here: choose it so that the faulty residual of the last sample is
    one that another noise makes without a fault.
    """
    L = lmi("common").solve(0.3)["L"]
    sure = thresholds(PROBLEM, L, NONE, [3])
    for q in range(3):
        M, steps = PROBLEM.A[q] - L[q] @ C, 60
        drive = np.hstack([PROBLEM.Bw[q] * UNIT, -L[q] @ PROBLEM.Dv[q] * UNIT])
        G = np.hstack([PROBLEM.Dv[q] * UNIT] + [C @ np.linalg.matrix_power(M, k) @ drive for k in range(steps)])
        seen = C @ sum(np.linalg.matrix_power(M, k) for k in range(3)) @ F[q][:, 0]
        for share, hidden in ((0.999, True), (1.001, False)):
            f = share * sure[q, 0, 0]  # G z + seen f = G z', |z|, |z'| <= 1
            found = linprog(np.zeros(2 * G.shape[1]), A_eq=np.hstack([G, -G]), b_eq=-seen * f, bounds=(-1, 1))
            assert (found.status == 0) is hidden


def observed(period, L, N, w, v, f, first):
    """Residuals of a TNL observer beside its plant along a periodic sequence, everything zero before."""
    p, x, xi, out = TNL, np.zeros(3), np.zeros(3), []
    for k in range(len(w)):
        q, before = period[(first + k) % len(period)], period[(first + k - 1) % len(period)]
        y = p.C[q] @ x + p.Dv[q] @ v[k] + p.Df[q] @ f[k]
        x_hat = xi + N[before] @ y  # xi already holds all else of the sample before
        r = y - p.C[q] @ x_hat
        out.append(r)
        T = np.eye(3) - N[q] @ p.C[q]
        xi, x = T @ p.A[q] @ x_hat + L[q] @ r, p.A[q] @ x + p.Bw[q] @ w[k] + p.Bf[q] @ f[k]
    return np.array(out)


@pytest.mark.parametrize("period", [(1,), (0, 2), (0, 0, 1, 1, 2, 2)])
def test_sets_and_responses_along_a_sequence_are_those_of_the_plant(period):
    """Impulse by impulse: the support is the sum over all of them of what each does at that sample."""
    solved = SetLinfProblem(TNL).solve(0.7, 0.1)
    L, N, steps = solved["L"], solved["N"], 12 * len(period)
    path, directions = Path(TNL, period, L, N), np.array([[1.0, 0], [0, 1], [0.6, -0.8]])
    silent = {"w": np.zeros((steps, 1)), "v": np.zeros((steps, 2)), "f": np.zeros((steps, 1))}
    support = np.zeros(3)
    for name, size, half in (("w", 1, TNL.w_half[0]), ("v", 2, TNL.v_half)):
        for k in range(steps):
            for j in range(size):
                signals = {key: value.copy() for key, value in silent.items()}
                signals[name][k, j] = half[j]
                support += np.abs(directions @ observed(period, L, N, **signals, first=0)[-1])
    last = (steps - 1) % len(period)
    assert zonotope_set.support(path.residuals(last), directions) == pytest.approx(support, rel=1e-3)
    for onset in path.onsets(3):
        step = silent | {"f": np.ones((steps, 1))}
        seen = observed(period, L, N, **step, first=onset)[:4]
        assert path.response(onset, 3)[:, :, 0] == pytest.approx(seen, abs=1e-9)


def test_a_longer_dwell_time_is_another_sample_of_switching():
    assert paths(2, 3) == [(0,), (1,), (0, 0, 0, 1, 1, 1)]
    assert paths(3) == [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2), (2, 1, 0)]
    unstable = np.stack([[[0.5, 1.2], [0, 0.5]], [[0.5, 0], [1.2, 0.5]]])  # stable modes, unstable in turn
    plain = replace(PROBLEM, A=unstable, C=np.zeros((2, 2, 2)), Bw=np.ones((2, 2, 1)), Dv=np.stack([np.eye(2)] * 2),
                    Bf=np.zeros((2, 2, 1)), Df=np.ones((2, 2, 1)), w_half=np.ones((2, 1)), v_half=np.ones(2))
    none = np.zeros((2, 2, 2))
    assert np.isinf(ResidualJudge(plain)(none, none)) and np.isfinite(ResidualJudge(plain, dwell=9)(none, none))


def test_unstable_gains_promise_nothing():
    L = 0 * NONE + 50.0
    assert np.isinf(ResidualJudge(PROBLEM)(L, NONE))


# -- the certificate -------------------------------------------------------------------------------
def certified(kind):
    """Rounded gains at pole .3 and their certificate."""
    args = (0.3, 0.2, 1.2) if kind == "multiple" else (0.3,)
    solved = lmi(kind).solve(*args)
    proof, _ = hinf(PLANT, kind, *(args[1:] or (0.0, 1.0)))
    L = solved["L"].astype(np.float32)
    return L, prove(PLANT.modes, L, NONE, proof | {"P": solved["P"].tolist()})


def tampered(cert, what):
    P = np.array(cert["P"])
    out = dict(cert)
    if what == "P halved":
        out["P"] = (0.5 * P).tolist()
    elif what == "P doubled":
        out["P"] = (2.0 * P).tolist()
    elif what == "P of one mode":
        P[1] *= 1.6
        out["P"] = P.tolist()
    elif what == "asymmetric":
        P[0, 0, 1] *= 1.0 + 1e-12
        out["P"] = P.tolist()
    elif what == "level":
        out["level"] = cert["level"] * (1 - 1e-9)
    elif what == "g":
        out["g"] = cert["g"] * (1 - 1e-4)
    elif what == "dwell":
        out["rho"], out["dwell_add"], out["dwell_drain"] = 2.0, 3, 1
    return out


@pytest.mark.parametrize("kind", ["common", "switched", "multiple"])
def test_the_certificate_catches_what_is_changed(kind):
    L, cert = certified(kind)
    assert len(check(PLANT.modes, L, NONE, cert)) == 2
    for what in ("P halved", "P doubled", "P of one mode", "asymmetric", "level", "g", "dwell"):
        if what == "dwell" and kind != "multiple":
            continue
        wrong = tampered(cert, what)
        if what == "dwell":  # a longer jump than the dwell time allows
            wrong["lam"] = cert["lam"]
        with pytest.raises(CertificateError):
            check(PLANT.modes, L, NONE, wrong)
    for i in range(2):
        other = L.copy()
        other[1, 2, i] += np.float32(0.02)
        with pytest.raises(CertificateError, match='mode "2"'):
            check(PLANT.modes, other, NONE, cert)
    modes = list(PLANT.modes)
    modes[2] = replace(modes[2], A=modes[2].A + 0.02)
    with pytest.raises(CertificateError, match='mode "3"'):
        check(modes, L, NONE, cert)


def without(plant, vectors):
    """The plant without its disturbances, noise or faults."""
    empty = {"w": {"Bw": np.zeros((3, 0)), "w_lo": np.zeros(0), "w_hi": np.zeros(0)},
             "v": {"Dv": np.zeros((2, 0)), "v_lo": np.zeros(0), "v_hi": np.zeros(0)},
             "f": {"Bf": np.zeros((3, 0)), "Df": np.zeros((2, 0))}}
    parts = {k: v for vector in vectors for k, v in empty[vector].items()}
    return replace(plant, modes=tuple(replace(m, **parts) for m in plant.modes), **dict.fromkeys(vectors, ()))


@pytest.mark.parametrize("module", [zonotope, ellipsoid])
@pytest.mark.parametrize("vectors", ["w", "v", "wv", "f", "wvf"])
def test_plants_without_disturbance_noise_or_fault(module, vectors):
    """Nothing to suppress, nothing to detect: still gains and a proof."""
    plant = without(PLANT, vectors)
    fixed = {"lyapunov": "common", "evaluations": 5} if module is zonotope else {"lambda": 0.5, "beta": 0.1}
    made = list(module.candidates(plant, {**fixed, **({"criterion": "hinf"} if module is zonotope else {})}))
    assert made
    for c in made:
        L, N = c.L.astype(np.float32), c.N.astype(np.float32)
        cert = prove(plant.modes, L, N, c.proof)
        assert check(plant.modes, L, N, cert)
        assert (cert["level"] == 0) == ("w" in vectors and "v" in vectors)
        with pytest.raises(CertificateError):
            check(plant.modes, L + np.float32(3), N, cert)


def test_P_is_found_anew_after_coarse_rounding():
    """Near the largest pole gains cut to eight bits: the old P does not hold, another does."""
    solved = lmi("common").solve(0.65)
    coarse = np.round(solved["L"] * 256) / 256
    proof, resolve = hinf(PLANT)
    old = proof | {"P": solved["P"].tolist()}
    with pytest.raises(CertificateError, match=r"does not decrease by \|C e\|\^2"):
        prove(PLANT.modes, coarse, NONE, old)
    cert = prove(PLANT.modes, coarse, NONE, old, resolve)
    assert cert["P"] != old["P"] and cert["level"] == pytest.approx(solved["gamma"], rel=0.1)
    check(PLANT.modes, coarse, NONE, cert)


@pytest.mark.parametrize("kind", ["common", "multiple"])
def test_the_level_holds_in_simulation_and_not_much_less_does(kind):
    """Energy of r over energy of d for disturbances that push along the worst direction, switching as admitted."""
    L, cert = certified(kind)
    rng, drives = np.random.default_rng(1), []
    M = PROBLEM.A - L @ C
    for q in range(3):
        drives.append((np.hstack([PROBLEM.Bw[q], -L[q] @ PROBLEM.Dv[q]]) * UNIT,
                       np.hstack([np.zeros((2, 3)), PROBLEM.Dv[q]]) * UNIT))
    every = max(1, -(-cert["dwell_add"] // cert["dwell_drain"]))
    reached = 0.0
    for _ in range(10):
        modes = np.repeat(rng.integers(0, 3, 60 // every + 1), every)[:60]
        rows = []  # the map from all d to all r
        state = np.zeros((3, 6 * len(modes)))
        for k, q in enumerate(modes):
            H, Z = drives[q]
            row = C @ state
            row[:, 6 * k:6 * k + 6] += Z
            rows.append(row)
            state = M[q] @ state
            state[:, 6 * k:6 * k + 6] += H
        reached = max(reached, np.linalg.norm(np.vstack(rows), 2))
    assert reached <= cert["level"]
    if kind == "common":
        assert reached > 0.8 * cert["level"]
