"""L-infinity gains of a point observer: the published numbers of Zammali (2020), section 6.3.5, and what of them fails.

Printed data: tests/data/zammali_section_6_3_5.toml. "Recomputed" figures are those of the dossier, found there with
other code, for w and v in their own units and for a weight beta of mu in these units; all bounds of the plant are 0.1.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.algebra.dwell import shortest
from codegen.certify.residual_gain import GainModel, check, prove
from codegen.errors import CertificateError, DesignError
from codegen.plant.load import load
from codegen.plant.model import Switching
from codegen.synthesis import ellipsoid
from codegen.synthesis.point import Units, jump_factor
from codegen.synthesis.problem import Problem
from codegen.synthesis.refit import refit
from codegen.synthesis.set_linf import SetLinfProblem

PLANT = load("zammali_ellipsoid")
PRINTED = tomllib.loads((Path(__file__).parents[1] / "data" / "zammali_section_6_3_5.toml").read_text())
L0, N0, T0, P0 = (np.array(PRINTED[k]) for k in "LNTP")
PROBLEM = {tnl: Problem.of(PLANT, tnl) for tnl in (True, False)}
LMI = {tnl: SetLinfProblem(PROBLEM[tnl]) for tnl in (True, False)}
C, UNIT = PROBLEM[True].C[0], 0.1


def solve(tnl, lam, beta):
    """Solution for the dossier's weight: mu in the units of w and v, not in ours."""
    weight = beta / (1 - beta) * UNIT**2 / LMI[tnl].scale ** 2
    return LMI[tnl].solve(lam, weight / (1 + weight))


def linf(P, lam, rho=1.0, dwell=(1, 1)):
    return {"kind": "linf", "P": np.asarray(P).tolist(), "lam": lam, "rho": rho, "dwell_add": dwell[0],
            "dwell_drain": dwell[1], "chatter": 1.0}


def solved_design(lam=0.8, beta=0.01, tnl=True):
    """Rounded gains and their certificate."""
    solved = solve(tnl, lam, beta)
    L, N = solved["L"].astype(np.float32), solved["N"].astype(np.float32)
    rho = jump_factor(solved["P"])
    rho, dwell = (1.0, (1, 1)) if rho < 1 + 1e-4 else (rho * (1 + 1e-9), (9, 1))
    P = np.stack([1.001 * np.eye(3)] * 3) if rho == 1 else solved["P"]
    return L, N, prove(PLANT.modes, L, N, linf(P, lam, rho, dwell))


# -- the printed data ------------------------------------------------------------------------------
def test_one_entry_of_printed_T_is_wrong():
    """T_1(3,1) = .50 is -.49 of I - N C; the others differ by rounding. With .50 mode 1 has radius 1.24, else .32."""
    T = np.eye(3) - N0 @ C
    off = np.abs(T - T0)
    assert np.unravel_index(np.argmax(off), off.shape) == (0, 2, 0)
    assert T[0, 2, 0] == pytest.approx(-0.49, abs=5e-3)
    off[0, 2, 0] = 0
    assert off.max() <= 0.04 + 1e-9
    radius = [np.abs(np.linalg.eigvals(t @ PROBLEM[True].A[0] - L0[0] @ C)).max() for t in (T0[0], T[0])]
    assert radius == pytest.approx([1.24, 0.32], abs=5e-3)


def test_printed_mu_is_a_jump_factor():
    """tau_a > .9 follows from ln 7.61 at lambda = .9 (.881); the printed P jump by 3.9 at most, a2/a1 = 4.75."""
    assert shortest(PRINTED["rho"], 0.9) == pytest.approx(0.881, abs=5e-4)
    assert shortest(PRINTED["rho"], 0.9) < PRINTED["tau_a"]
    eigenvalues = np.linalg.eigvalsh(P0)
    assert eigenvalues.max() / eigenvalues.min() == pytest.approx(4.75, abs=5e-3)
    assert jump_factor(P0) == pytest.approx(3.9, abs=5e-3)
    assert jump_factor(P0) < eigenvalues.max() / eigenvalues.min()


def test_printed_gains_have_a_proof():
    """At lambda = .8 with P found for them; mu is far from 7.61."""
    proof = linf(P0, 0.8, 20.0)
    cert = prove(PLANT.modes, L0, N0, proof, lambda L, N: refit(PLANT, L, N, proof))
    assert cert["g"] / UNIT**2 < 0.1
    check(PLANT.modes, L0, N0, cert)


# -- synthesis -------------------------------------------------------------------------------------
def test_level_over_decay_and_weight():
    """mu from .0106 (beta = 0) to .035 over the grid; .0116 and .0349 at lambda = .5, .9 with beta = .01."""
    grid = {(lam, beta): solve(True, lam, beta)["mu"] / UNIT**2 for lam in (0.1, 0.5, 0.8, 0.9)
            for beta in (0.0, 0.01, 0.1)}
    assert min(grid.values()) == pytest.approx(0.0106, abs=5e-5)
    assert max(grid.values()) == pytest.approx(0.035, abs=5e-4)
    assert grid[0.5, 0.01] == pytest.approx(0.0116, abs=6e-5)
    assert grid[0.9, 0.01] == pytest.approx(0.0349, abs=6e-5)


@pytest.mark.parametrize("beta", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("lam", [0.5, 0.7, 0.9])
def test_one_common_P_is_enough_for_tnl(lam, beta):
    """beta >= .01: P_q = I, rho = 1, so any switching; and then exactly P = I proves the level."""
    solved = solve(True, lam, beta)
    assert solved["P"] == pytest.approx(np.stack([np.eye(3)] * 3), abs=2e-3)
    assert jump_factor(solved["P"]) == pytest.approx(1.0, abs=2e-3)
    cert = prove(PLANT.modes, solved["L"], solved["N"], linf(np.stack([1.00001 * np.eye(3)] * 3), lam))
    assert cert["g"] == pytest.approx(solved["mu"], rel=5e-3) and cert["rho"] == 1
    assert "arbitrary switching" in check(PLANT.modes, solved["L"], solved["N"], cert)[0]


def test_tnl_against_luenberger():
    """mu / lambda from .0197 to .0388 with N, from .21 on without, over the same grid."""
    grid = [(lam, beta) for lam in (0.5, 0.8, 0.9) for beta in (0.0, 0.01, 0.1)]
    level = {tnl: [solve(tnl, *at)["mu"] / UNIT**2 / at[0] for at in grid] for tnl in (True, False)}
    assert [min(level[True]), max(level[True])] == pytest.approx([0.0197, 0.0388], abs=1e-4)
    assert min(level[False]) == pytest.approx(0.21, abs=5e-3)
    assert all(b > 8 * a for a, b in zip(level[True], level[False]))


def test_luenberger_has_no_N():
    solved = solve(False, 0.5, 0.0)
    assert not solved["N"].any() and jump_factor(solved["P"]) > 2


def simulated_errors(L, N, seed=0, runs=60, steps=80, dwell=1):
    """Largest |e| after 20 samples, w and v at corners of their boxes."""
    rng = np.random.default_rng(seed)
    p, T = PROBLEM[True], np.eye(3) - N @ C
    M, largest = T @ p.A - L @ C, 0.0
    for _ in range(runs):
        q = np.repeat(rng.integers(0, 3, steps // dwell + 1), dwell)
        w = UNIT * rng.choice([-1, 1], (steps + 1, 1))
        v = UNIT * rng.choice([-1, 1], (steps + 1, 2))
        e = np.zeros(3)
        for k in range(steps):
            m = q[k]
            e = M[m] @ e + T[m] @ p.Bw[m] @ w[k] - L[m] @ p.Dv[m] @ v[k] - N[m] @ p.Dv[m] @ v[k + 1]
            largest = max(largest, np.linalg.norm(e)) if k > 20 else largest
    return largest


def test_bound_on_the_error():
    """.0375 at lambda = .8, beta = .01: sqrt(mu/lambda (w^2 + 2 v^2)). The printed bound, without the root, is .0014;
    simulated errors reach .028 (largest of our own runs, so to ten per cent).
    """
    L, N, cert = solved_design()
    assert cert["level"] == pytest.approx(0.0375, abs=1e-4)
    assert cert["g"] / cert["lam"] * GainModel(PLANT.modes, L, N).channels == pytest.approx(0.0014, abs=5e-5)
    largest = simulated_errors(L, N)
    assert 0.0014 < largest <= cert["level"]
    assert largest == pytest.approx(0.0283, rel=0.1)


def test_bound_holds_under_slow_switching():
    """P per mode that jumps by 5: with a switch every 9 samples errors stay below the level, which has the factor."""
    L, N, cert = solved_design(0.5, 0.0)
    assert cert["rho"] > 4 and cert["level"] ** 2 > 2 * cert["g"] / cert["lam"] * GainModel(PLANT.modes, L, N).channels
    assert 0.2 * cert["level"] < simulated_errors(L, N, dwell=9, steps=90) <= cert["level"]


# -- the front -------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def chosen():
    said = []
    return list(ellipsoid.candidates(PLANT, {}, progress=said.append)), said


def test_candidates_certify_in_both_number_types(chosen):
    made, said = chosen
    assert [c.kind for c in made] == ["luenberger", "tnl"]
    assert not made[0].N.any() and made[1].N.any()
    for c in made:
        for real in (np.float32, np.float64):
            L, N = c.L.astype(real), c.N.astype(real)
            cert = prove(PLANT.modes, L, N, c.proof)
            assert cert["level"] == pytest.approx(c.figures["error_bound"], rel=1e-4)
            assert "arbitrary switching" in check(PLANT.modes, L, N, cert)[0]
    assert made[1].figures["error_bound"] < 0.5 * made[0].figures["error_bound"]
    assert said and all(", " in line and " of " in line and ": " in line for line in said)


def test_options_fix_what_they_name():
    made = list(ellipsoid.candidates(PLANT, {"structure": "tnl", "lambda": 0.6, "beta": 0.1}))
    assert [c.label for c in made] == ["linf tnl, lambda 0.6, beta 0.1"] and made[0].proof["lam"] == 0.6


def test_a_callers_judge_decides():
    """It goes before the error bound: this one likes what the bound dislikes."""
    made = {}
    for sign in (-1, 1):
        def judge(L, N, sign=sign):
            return float(np.exp(5 * sign * N[0, 0, 0]))

        made[sign] = next(ellipsoid.candidates(PLANT, {"structure": "tnl"}, judge=judge)).N[0, 0, 0]
    assert made[-1] > made[1]


def test_a_dwell_time_is_looked_for_where_nothing_else_holds():
    """Two states that no output sees grow by 1.9 a round under alternate switching, though each mode is stable."""
    base, hidden = PLANT.modes[0], np.array([[0.5, 1.2, 0], [0, 0.5, 0], [0, 0, 0.5]])
    C = np.array([[0.0, 0, 1], [0, 0, 2]])
    plant = replace(PLANT, modes=tuple(replace(base, name=str(i), A=A, C=C) for i, A in enumerate((hidden, hidden.T))))
    with pytest.raises(CertificateError, match=r'Modes "0", "1" in turn would multiply the error by 1.907'):
        prove(plant.modes, np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), linf(np.stack([2 * np.eye(3)] * 2), 0.5))
    free = list(ellipsoid.candidates(plant, {"structure": "luenberger", "lambda": 0.5}))[0]
    slow = list(ellipsoid.candidates(replace(plant, switching=Switching(average_dwell=8.0)),
                                     {"structure": "luenberger", "lambda": 0.5}))[0]
    for c in (free, slow):
        L, N = c.L.astype(np.float32), c.N.astype(np.float32)
        cert = prove(plant.modes, L, N, c.proof)
        assert "average dwell time" in check(plant.modes, L, N, cert)[0]
    assert 1.5 < free.proof["dwell_add"] / free.proof["dwell_drain"] < 6
    assert slow.proof["dwell_add"] / slow.proof["dwell_drain"] == 8
    with pytest.raises(DesignError, match="longer switching.average_dwell"):
        list(ellipsoid.candidates(replace(plant, switching=Switching(average_dwell=1.0)), {"structure": "luenberger"}))


def test_what_N_hides_is_refused(monkeypatch):
    """C N = I swallows a sensor fault at once; a design near it is refused, and named if there is no other."""
    assert ellipsoid.hides(PROBLEM[True], N0) is None
    N = np.stack([np.linalg.pinv(C) * (1 - 1e-4)] * 3)
    channel, mode, share = ellipsoid.hides(PROBLEM[True], N)
    assert (channel, mode) == (0, "1") and share == pytest.approx(1e-4, rel=1e-3)
    monkeypatch.setattr(SetLinfProblem, "solve", lambda self, *args: {
        "L": np.zeros((3, 3, 2)), "N": Units.of(PLANT).own_gains(N), "P": np.stack([np.eye(3)] * 3), "mu": 1.0})
    with pytest.raises(DesignError, match=r'every design hides fault "sensor" in mode "1".*0.0001 \|s\|'):
        list(ellipsoid.candidates(PLANT, {"structure": "tnl"}))


def test_tnl_needs_one_C_and_no_D():
    other = replace(PLANT, modes=(replace(PLANT.modes[0], C=1.1 * PLANT.modes[0].C), *PLANT.modes[1:]))
    with pytest.raises(DesignError, match="C differs between modes"):
        list(ellipsoid.candidates(other, {"structure": "tnl"}))
    with pytest.raises(CertificateError, match='C of mode "2" differs'):
        prove(other.modes, L0, N0, linf(P0, 0.8, 20.0))
    assert [c.kind for c in ellipsoid.candidates(other, {"lambda": 0.5, "beta": 0.0})] == ["luenberger"]


# -- the certificate -------------------------------------------------------------------------------
@pytest.mark.parametrize(("tnl", "beta"), [(True, 0.01), (True, 0.0), (False, 0.0)])
def test_the_certificate_catches_what_is_changed(tnl, beta):
    L, N, cert = solved_design(0.5, beta, tnl)
    assert len(check(PLANT.modes, L, N, cert)) == 1
    P = np.array(cert["P"])
    changes = [{"P": (0.5 * P).tolist()}, {"P": (2 * P).tolist()}, {"P": (P * [[[1]], [[1]], [[1.3]]]).tolist()},
               {"level": cert["level"] * (1 - 1e-9)}, {"g": cert["g"] * (1 - 1e-4)}, {"lam": 0.99}, {"lam": 0.0},
               {"kind": "width"}]
    if cert["rho"] > 1:
        changes += [{"rho": 1 + 0.9 * (cert["rho"] - 1)}, {"dwell_add": 1}]
    for change in changes:
        with pytest.raises(CertificateError):
            check(PLANT.modes, L, N, cert | change)
    for gains, name in ((L, "L"), (N, "N")):
        other = gains.copy()
        other[1, 0, 0] += np.float32(2.0)
        with pytest.raises(CertificateError, match='mode "2"'):
            check(PLANT.modes, *((other, N) if name == "L" else (L, other)), cert)


def test_units_are_part_of_the_certificate(chosen):
    """In larger units of x the same P proves less than is claimed of it; the level scales with them."""
    c = chosen[0][1]
    L, N = c.L.astype(np.float32), c.N.astype(np.float32)
    cert = prove(PLANT.modes, L, N, c.proof)
    assert cert["x_unit"] == [50.0] * 3 and "in units of the half ranges of x" in check(PLANT.modes, L, N, cert)[0]
    for wrong in ([49.0, 50.0, 50.0], [50.0, 50.0, 0.0], [50.0]):
        with pytest.raises(CertificateError):
            check(PLANT.modes, L, N, cert | {"x_unit": wrong})
    plain = {k: v for k, v in c.proof.items() if k not in ("x_unit", "y_unit")}
    plain["P"] = (2500 * np.array(plain["P"])).tolist()
    assert prove(PLANT.modes, L, N, plain)["level"] == pytest.approx(50 * cert["level"], rel=1e-6)
    assert simulated_errors(L, N) <= 50 * cert["level"]


def test_noise_of_the_next_mode_is_in_the_proof():
    """N acts on v of the next sample: where Dv switches, its matrix is that of another mode."""
    L, N, cert = solved_design(0.5, 0.01)
    loud = replace(PLANT.modes[2], Dv=20 * PLANT.modes[2].Dv)
    quiet = np.array(L)
    quiet[2] = 0  # mode 3 itself does not read the louder noise
    N3 = np.array(N)
    N3[2] = 0
    model = GainModel((*PLANT.modes[:2], loud), quiet, N3)
    assert [len(p) for p in model.pushes] == [2, 2, 2]
    with pytest.raises(CertificateError, match='mode "1"'):
        check((*PLANT.modes[:2], loud), L, N, cert)


def test_coarse_gains_get_another_P():
    """Gains cut to four bits behind the point: the old P does not hold, another does, with a longer dwell time."""
    solved = solve(False, 0.9, 0.0)
    L = np.round(solved["L"] * 16) / 16
    proof = linf(solved["P"], 0.9, jump_factor(solved["P"]) * (1 + 1e-9), (4, 1))
    with pytest.raises(CertificateError, match='does not shrink by 0.9 in mode "1"'):
        prove(PLANT.modes, L, solved["N"], proof)
    cert = prove(PLANT.modes, L, solved["N"], proof, lambda *gains: refit(PLANT, *gains, proof | {"rho": 200.0}))
    check(PLANT.modes, L, solved["N"], cert)
    assert solved["mu"] < cert["g"] < 3 * solved["mu"]
