"""The published numbers of Zammali (2020), section 5.6 (C. Zammali, 2020), and what of them does not hold.

Printed gains: tests/data/zammali_section_5_6.toml. "Recomputed" figures are those of the dossier (sections 5.4
and 6), found there with other code. The switching sequence, inputs and small-fault size of the thesis are lost,
so whatever depends on a sequence is compared on own random ones, with a tolerance that the docstring explains.
"""

import tomllib
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

from codegen.algebra.dwell import shortest
from codegen.analysis.adjoint import ResidualModel
from codegen.analysis.detectability import along
from codegen.certify.freeze import freeze, limits
from codegen.errors import CertificateError
from codegen.observers import FramerTables
from codegen.observers.framer import propagate, residuals
from codegen.plant.load import load
from codegen.selection.select import choose
from codegen.synthesis.linf import LinfProblem, gamma, pairwise
from codegen.synthesis.problem import Problem
from codegen.synthesis.width import WidthProblem

PLANT = load("zammali_fd")
PRINTED = tomllib.loads((Path(__file__).parents[1] / "data" / "zammali_section_5_6.toml").read_text())
PRINTED = {name: {k: np.array(v) for k, v in d.items()} for name, d in PRINTED.items()}
A, C = np.stack([m.A for m in PLANT.modes]), PLANT.modes[0].C
SIDES, TNL = ("hi", "lo"), ("th16", "th18")
_LMI = {}


def method(name):
    return "tnl-interval" if name in TNL else "interval"


def per_mode(P):
    return np.broadcast_to(P, (3, 3))


def closed_loop(name, side):
    """L, N, M = T A - L C of a printed design, T := I - N C."""
    d = PRINTED[name]
    L, N = d["L_" + side], d.get("N_" + side, np.zeros((3, 3, 2)))
    return L, N, (np.eye(3) - N @ C) @ A - L @ C


def printed_design(name, **options):
    """The printed gains through the front door: ``[observer] gains``."""
    gains = {k: v.tolist() for k, v in PRINTED[name].items() if k[0] in "LN"}
    if "lambda" in options:
        gains |= {"P_" + s: per_mode(PRINTED[name]["P_" + s]).tolist() for s in SIDES}
    return choose(PLANT, method(name), {"gains": gains, **options}, lambda text: None)


def lmi(tnl, multiple=False):
    """The LMI of ``synthesis.linf``, built once."""
    if (tnl, multiple) not in _LMI:
        _LMI[tnl, multiple] = LinfProblem(Problem.of(PLANT, tnl), multiple)
    return _LMI[tnl, multiple]


# -- the printed data ------------------------------------------------------------------------------
def test_printed_matrices_are_consistent():
    """T + N C = I to the truncation of two decimals: .0168 (Theorem 16), .0190 (Theorem 18)."""
    for name, size in (("th16", 0.0168), ("th18", 0.0190)):
        off = max(np.max(np.abs(PRINTED[name]["T_" + s] + PRINTED[name]["N_" + s] @ C - np.eye(3))) for s in SIDES)
        assert off == pytest.approx(size, abs=5e-5)


def test_printed_gains_are_nonnegative_up_to_their_digits():
    """Smallest entry of A - L C: -.0012 (Theorem 14), -.0015 (17), none below zero for TNL.

    So the printed classical gains are no proof of containment. ``freeze`` puts the negative rest into the
    offsets and certifies what then is a slightly wider observer.
    """
    smallest = {name: min(closed_loop(name, s)[2].min() for s in SIDES) for name in PRINTED}
    assert smallest["th14"] == pytest.approx(-0.0012, abs=5e-5)
    assert smallest["th17"] == pytest.approx(-0.0015, abs=5e-5)
    assert smallest["th16"] >= 0 and smallest["th18"] >= 0
    assert all(np.min(t.M_lo) == 0 for t in printed_design("th17").observer.tables.values())


def test_printed_dwell_times():
    """tau_a > 2.797 (Theorem 17, printed 2.79) from the printed P; .941 (Theorem 18, printed 1).

    The printed 1 of Theorem 18 comes from a rounded jump factor, 2 in place of the largest P entry 1.92.
    """
    rho = {name: max(d["P_" + s].max() for s in SIDES) for name, d in PRINTED.items()}
    assert rho["th17"] == 6.95 and shortest(rho["th17"], 0.5) == pytest.approx(2.797, abs=5e-4)
    assert rho["th18"] == 1.92 and shortest(rho["th18"], 0.5) == pytest.approx(0.941, abs=5e-4)
    assert shortest(2.0, 0.5) == 1.0


def test_pairwise_jump_factor_of_printed_P():
    """Pairwise 5.11 (Theorem 17) and 1.163, tau* .22 (Theorem 18): the latter needs no dwell time at all."""
    for name, rho in (("th17", 5.11), ("th18", 1.163)):
        assert max(pairwise(PRINTED[name]["P_" + s]) for s in SIDES) == pytest.approx(rho, abs=5e-3)
    assert shortest(pairwise(PRINTED["th18"]["P_hi"]), 0.5) == pytest.approx(0.22, abs=5e-3)


@pytest.mark.parametrize(("name", "mu", "rho"), [("th17", 11.09, 5.108), ("th18", 2.44, 1.163)])
def test_level_that_printed_gains_certify(name, mu, rho):
    """mu = 11.09 (Theorem 17) and 2.44 (18) at lambda = .5, in exact arithmetic on the rounded gains."""
    design = printed_design(name, **{"lambda": 0.5})
    for real in ("float32", "float64"):
        cert = design.certificate[real]
        assert cert["mu"] == pytest.approx(mu, abs=5e-3)
        assert cert["rho"] == pytest.approx(rho, abs=5e-4)
    assert design.observer.supervision.monitors_dwell == (name == "th17")


def test_level_of_printed_common_P():
    """The printed P of Theorem 14 proves nothing at lambda = .5 with the printed gains, but does at .3; lambda
    is not printed. That of Theorem 16 does at both.
    """
    with pytest.raises(CertificateError, match="no level mu"):
        printed_design("th14", **{"lambda": 0.5})
    assert printed_design("th14", **{"lambda": 0.3}).certificate["float32"]["mu"] == pytest.approx(15.65, abs=0.01)
    for lam in (0.3, 0.5):
        assert printed_design("th16", **{"lambda": lam}).certificate["float32"]["rho"] == 1


# -- synthesis again -------------------------------------------------------------------------------
GAMMA = {False: {0.05: 8.65, 0.2: 4.59, 0.4: 3.77, 0.5: 3.84, 0.7: 6.85},
         True: {0.05: 5.56, 0.2: 2.80, 0.3: 2.295663, 0.5: 1.81, 0.6: 1.667922, 0.8: 1.48, 0.9: 1.41, 0.95: 1.38}}


@pytest.mark.parametrize(("tnl", "lam"), [(tnl, lam) for tnl in (False, True) for lam in GAMMA[tnl]])
def test_gain_over_decay_rate(tnl, lam):
    """gamma(lambda) of Theorems 14 and 16, to the digits of the table (six for .3 and .6)."""
    solved = lmi(tnl).solve(lam)
    digits = 2e-6 if GAMMA[tnl][lam] in (2.295663, 1.667922) else 6e-3
    assert gamma(lam, solved["mu"]) == pytest.approx(GAMMA[tnl][lam], abs=digits)


@pytest.mark.parametrize("lam", [0.8, 0.9])
def test_classical_design_ends_below_decay_rate_0_8(lam):
    """No A - L C >= 0 decays that fast; neither of the two ways in which Clarabel says so is an exception here."""
    assert lmi(False).solve(lam) is None
    assert lmi(True).solve(lam) is not None


def test_level_at_decay_rate_0_3():
    """mu = 1.5806 in the dossier, 1.5810 here.

    The dossier's own gamma(.3) = 2.295663, which we reproduce to all digits, is sqrt(1.58102/.3); its 1.5806
    (gamma 2.2953) came from a run of the printed form with (5.12), solved to fewer digits.
    """
    mu = lmi(True).solve(0.3)["mu"]
    assert mu == pytest.approx(1.5806, abs=5e-4)
    assert mu == pytest.approx(0.3 * 2.295663**2, abs=1e-5)


def test_printed_P_is_that_of_a_small_decay_rate():
    """Ours at lambda = .28 is (1, 1, 1.2467), printed P2 (1.5, 1.5, 1.92) = 1.5 (1, 1, 1.28): the same up to scale."""
    P = lmi(True).solve(0.28)["P"][0]
    assert pytest.approx([1.505, 1.505, 1.876], abs=1e-3) == P * 1.505
    np.testing.assert_allclose(PRINTED["th16"]["P_lo"], 1.5 * P, rtol=0.03)


def test_tnl_is_never_worse_than_classical():
    """N = 0 is classical, so gamma_TNL <= gamma at every lambda; strictly, on this plant."""
    for lam in GAMMA[False]:
        assert lmi(True).solve(lam)["mu"] < lmi(False).solve(lam)["mu"]


def as_printed(lam):
    """Theorem 14 as it stands: both halves, (5.10)-(5.12), P not normalised, gamma minimised."""
    problem, n, p = Problem.of(PLANT, False), 3, 2
    P = [cp.Variable(n), cp.Variable(n)]
    W = [[cp.Variable((n, p)) for _ in range(3)] for _ in P]
    mu, g, nd = cp.Variable(), cp.Variable(), 2 * n + 2 * p
    D = cp.diag(cp.hstack(P))
    constraints = [cp.bmat([[lam * D, np.zeros((2 * n, nd)), np.eye(2 * n)],
                            [np.zeros((nd, 2 * n)), (g - mu) * np.eye(nd), np.zeros((nd, 2 * n))],
                            [np.eye(2 * n), np.zeros((2 * n, nd)), g * np.eye(2 * n)]]) >> 1e-7 * np.eye(4 * n + nd)]
    zero, none = np.zeros((n, n)), np.zeros((n, p))
    for q in range(3):
        M = [cp.diag(P[s]) @ problem.A[q] - W[s][q] @ problem.C[q] for s in (0, 1)]
        PA = cp.bmat([[M[0], zero], [zero, M[1]]])
        PH = cp.bmat([[cp.diag(P[0]), W[0][q], zero, none], [zero, none, cp.diag(P[1]), W[1][q]]])
        block = cp.bmat([[(1 - lam) * D, np.zeros((2 * n, nd)), PA.T],
                         [np.zeros((nd, 2 * n)), mu * np.eye(nd), PH.T], [PA, PH, D]])
        constraints += [M[0] >= 0, M[1] >= 0, (block + block.T) / 2 >> 1e-7 * np.eye(4 * n + nd)]
    cp.Problem(cp.Minimize(g), constraints).solve(solver=cp.CLARABEL)
    return float(g.value), float(mu.value), [v.value for v in P]


def test_printed_form_has_the_same_optimum():
    """Both halves with (5.12) and free scale: gamma = sqrt(mu/lambda) of the one half that we solve, P1 = P2."""
    lam = 0.4
    half = lmi(False).solve(lam)
    g, mu, P = as_printed(lam)
    assert g == pytest.approx(gamma(lam, half["mu"]), rel=2e-5)
    np.testing.assert_allclose(P[0], P[1], rtol=1e-3)
    np.testing.assert_allclose(P[0] / P[0].min(), half["P"][0], rtol=1e-3)


def test_multiple_functions_gain_little():
    """Theorem 17 at lambda = .5: mu 7.365 with P per mode, 7.376 with a common one, 0.15 per cent.

    The dossier has jump factor 4.63 = max P (reproduced) and 2.88 pairwise. The P are not unique: with the
    jump factor held at 1.5 the same mu comes out, so arbitrary switching costs nothing (tau* = .6 < 1).
    """
    common, free = lmi(False).solve(0.5), lmi(False, True).solve(0.5, 6.95)
    held = lmi(False, True).solve(0.5, 1.5)
    assert common["mu"] == pytest.approx(7.376, abs=5e-4)
    assert free["mu"] == pytest.approx(7.365, abs=5e-4)
    assert free["P"].max() == pytest.approx(4.63, abs=0.01)
    assert held["mu"] == pytest.approx(free["mu"], rel=1e-4)
    assert shortest(pairwise(held["P"]), 0.5) < 1
    assert (common["mu"] - free["mu"]) / free["mu"] == pytest.approx(0.0015, abs=1e-4)
    # At lambda = .1: gamma 6.127 against 6.234, 1.7 per cent.
    assert gamma(0.1, lmi(False, True).solve(0.1, 1e3)["mu"]) == pytest.approx(6.127, abs=5e-4)
    assert gamma(0.1, lmi(False).solve(0.1)["mu"]) == pytest.approx(6.234, abs=5e-4)


def test_theorem_18_at_jump_factor_one():
    """mu = 1.656 with rho = a2/a1 = 1; 1.637 here.

    rho = a2/a1 = 1 forces all entries of all P_q to be equal, P = I, and then mu is 1.656. A common P that is
    not a multiple of I also allows any switching (pairwise jump factor 1) and reaches 1.6371, which P per mode
    does not improve: the smallest level is 1.1 per cent below the dossier's, with the same guarantee.
    """
    common, multiple = lmi(True).solve(0.5), lmi(True, True).solve(0.5, 2.0)
    assert common["mu"] == pytest.approx(1.6371, abs=5e-4)
    assert multiple["mu"] == pytest.approx(common["mu"], rel=1e-5)
    identity = LinfProblem(Problem.of(PLANT, True), False)
    identity.cvx = cp.Problem(cp.Minimize(identity.mu), identity.cvx.constraints + [identity.P[0] <= 1 + 1e-9])
    assert identity.solve(0.5)["mu"] == pytest.approx(1.656, abs=5e-4)


# -- simulation ------------------------------------------------------------------------------------
def sequences(dwell, runs, steps, seed):
    """Random mode sequences: a new mode (or the same) every ``dwell`` samples."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.integers(0, 3, (runs, steps // dwell + 1)), dwell, axis=1)[:, :steps]


def bare_run(t, q, f, seed):
    """Framers and residuals without alarm handling, as in the thesis: r_lo, r_hi (S, K, n_y), samples lost.

    x0 = 0, framers +-.1, u = 1, w and v uniform.
    """
    rng, (runs, steps) = np.random.default_rng(seed), q.shape
    stack = {k: np.stack([getattr(m, k) for m in PLANT.modes]) for k in ("A", "B", "Bw", "Dv", "Df")}
    x, lo, hi = np.zeros((runs, 3)), np.full((runs, 3), -0.1), np.full((runs, 3), 0.1)
    u, out, lost, y_old = np.ones((runs, 1)), [], 0, None
    for k in range(steps):
        w, v = rng.uniform(-1, 1, (runs, 1)), rng.uniform(-0.1, 0.1, (runs, 2))
        m = {a: b[q[:, k]] for a, b in stack.items()}
        y = x @ C.T + np.einsum("src,sc->sr", m["Dv"], v) + m["Df"][:, :, 0] * f[k]
        if k:
            lo, hi = propagate(t, q[:, k - 1], lo, hi, u, y_old, y)
        out.append(residuals(t, q[:, k], lo, hi, u, y))
        lost += int(np.any((x < lo) | (x > hi), axis=1).sum()) if f[k] == 0 else 0
        x = np.einsum("src,sc->sr", m["A"], x) + m["B"][:, :, 0] + np.einsum("src,sc->sr", m["Bw"], w)
        y_old = y
    return np.stack([r[0] for r in out], axis=1), np.stack([r[1] for r in out], axis=1), lost


def fault(size):
    f = np.zeros(100)
    f[35:56] = size
    return f


WIDTHS = {"th14": (0.326, 0.497), "th16": (0.155, 0.237), "th17": (0.223, 0.421), "th18": (0.123, 0.172)}
RATES = {"th14": (0.67, 0.21, 0.01), "th16": (0.64, 0.42, 0.10), "th17": (0.86, 0.56, 0.12), "th18": (0.81, 0.58, 0.18)}
SURE = {"th14": (0.971, 0.475), "th16": (0.789, 0.527), "th17": (0.658, 0.222), "th18": (0.747, 0.297)}


@pytest.fixture(scope="module")
def simulated():
    """Printed designs over 200 sequences of dwell 7: table, widths, alarms per fault size."""
    out = {}
    q = sequences(7, 200, 100, 0)
    for name in PRINTED:
        t = printed_design(name).observer.tables["float64"]
        lo, hi, lost = bare_run(t, q, fault(0), 1)
        alarms = {}
        for size in (1.0, 0.3, 0.2, 0.1):
            f_lo, f_hi, _ = bare_run(t, q, fault(size), 1)
            alarms[size] = np.any((f_lo > 0) | (f_hi < 0), axis=2)
        out[name] = {"table": t, "width": (hi - lo)[:, 20:].mean(axis=(0, 1)), "lost": lost,
                     "false": int(np.sum((lo > 0) | (hi < 0))), "alarms": alarms}
    return out


@pytest.mark.parametrize("name", WIDTHS)
def test_mean_residual_widths(simulated, name):
    """Within 8 per cent: widths depend on how often each mode is active, and our sequences are our own."""
    np.testing.assert_allclose(simulated[name]["width"], WIDTHS[name], rtol=0.08)


@pytest.mark.parametrize("name", RATES)
def test_alarm_rates(simulated, name):
    """Share of fault samples with an alarm for f = .3, .2, .1, within .08 (own sequences, uniform signals)."""
    rates = [simulated[name]["alarms"][size][:, 35:56].mean() for size in (0.3, 0.2, 0.1)]
    np.testing.assert_allclose(rates, RATES[name], atol=0.08)


@pytest.mark.parametrize("name", SURE)
def test_certain_detection_thresholds(simulated, name):
    """First sample / best in 35..55: between the smallest and the largest of 60 sequences.

    Exact per sequence, but a sequence of another order of modes has quite another threshold (.2 to 1.3 at the
    first sample), so the dossier's figures can only be located, not reproduced.
    """
    t = simulated[name]["table"]
    q = np.concatenate([sequences(d, 20, 56, d) for d in (1, 5, 10)])
    found = along(ResidualModel.of(PLANT.modes, t), q, 0, 35, (np.full(3, 0.1), np.full(3, 0.1)))
    for got, published in ((found[0], SURE[name][0]), (found[-1], SURE[name][1])):
        assert got.min() < published < got.max()


def test_claim_no_false_alarm_and_inclusion(simulated):
    """Figures 5.2-5.7: 0 lost samples and 0 false alarms before the fault."""
    assert all(s["lost"] == s["false"] == np.sum(s["alarms"][1.0][:, :35]) == 0 for s in simulated.values())


def test_claim_unit_fault_is_detected_at_once(simulated):
    """f = 1 from sample 35 on: printed "detected at k = 36" for TNL; all four designs alarm at 35, always.

    One sample earlier than printed, because the residual at k already holds the fault of y_k.
    """
    for s in simulated.values():
        assert np.all(s["alarms"][1.0][:, 35])


def test_claim_tnl_is_tighter(simulated):
    """TNL narrower than classical, with a common P and with P per mode; P per mode narrower than a common one."""
    w = {name: s["width"] for name, s in simulated.items()}
    assert np.all(w["th16"] < 0.55 * w["th14"]) and np.all(w["th18"] < 0.65 * w["th17"])
    assert np.all(w["th17"] < w["th14"]) and np.all(w["th18"] < w["th16"])


def test_claim_small_fault(simulated):
    """Figure 5.5: "small fault seen by TNL only". Holds as a rate for f = .2 and .1, not for f = .3.

    Common P: the TNL alarm rate at f = .2 and .1 is more than twice the classical one; at f = .3 the classical
    design is not worse.
    """
    rate = {(n, f): s["alarms"][f][:, 35:56].mean() for n, s in simulated.items() for f in (0.3, 0.2, 0.1)}
    assert rate["th16", 0.2] > 2 * rate["th14", 0.2] and rate["th16", 0.1] > 2 * rate["th14", 0.1]
    assert rate["th14", 0.3] > rate["th16", 0.3] - 0.05
    assert rate["th14", 0.2] > 0.1


def frozen(solved):
    gains = {k + s: solved[k[0]] for k in ("L_", "N_") for s in SIDES}
    return freeze(FramerTables, PLANT.modes, limits(PLANT), gains, "float64")


@pytest.mark.parametrize(("tnl", "lam", "widths"), [(False, 0.4, (0.226, 0.401)), (True, 0.8, (0.090, 0.116)),
                                                    (True, 0.95, (0.080, 0.082))])
def test_widths_of_our_designs(tnl, lam, widths):
    """Optimised gains: TNL .08/.08 against classical .23/.40. Within 10 per cent, as above."""
    lo, hi, lost = bare_run(frozen(lmi(tnl).solve(lam)), sequences(7, 200, 100, 0), fault(0), 1)
    np.testing.assert_allclose((hi - lo)[:, 20:].mean(axis=(0, 1)), widths, rtol=0.1)
    assert lost == 0


def test_narrowest_design_is_a_bad_detector():
    """LP width-optimal TNL: .043 + .060 wide in the dossier, and blind (threshold 3.5).

    The LP minimises one weighted sum, so width can be traded between the outputs: compared is the sum, best
    over the contraction rates, within 5 per cent. Of these narrow designs some detect only faults above the
    full range 1, while a detection design three times as wide is sure of .22.
    """
    lp, q = WidthProblem(Problem.of(PLANT, True)), sequences(7, 200, 100, 0)
    total, sure = [], []
    for a in (0.3, 0.5, 0.7, 0.9, 0.97):
        t = frozen(lp.solve(a))
        lo, hi, _ = bare_run(t, q, fault(0), 1)
        total.append((hi - lo)[:, 20:].mean(axis=(0, 1)).sum())
        found = along(ResidualModel.of(PLANT.modes, t), sequences(5, 30, 56, 3), 0, 35, (np.full(3, 0.1),) * 2)
        sure.append(found[0].max())
    assert min(total) == pytest.approx(0.103, rel=0.05)
    assert max(sure) > 1


def test_surely_detected_fault_of_our_designs(workshop):
    """Box designs: f >= .2254 seen at output 2, .2945 at output 1, classical 1.27 (dossier, certified by boxes).

    Ours are at most that: the same box LP, then the exact adjoint over all mode sequences, which knows the
    order of modes and lets one noise sample act with one sign. Classical: 1.03 at the first sample, .48 within
    three more.
    """
    tnl, classical = (workshop.gallery("zammali_fd", m) for m in ("tnl-interval", "interval"))
    at_output = {o: min(c["surely_detected"][0] for c in tnl.choice if f"aim at output {o}" in c["design"])
                 for o in (0, 1)}
    assert at_output[1] == pytest.approx(0.2254, rel=0.015) and at_output[1] <= 0.2254
    assert at_output[0] == pytest.approx(0.2945, rel=1e-3)
    by_delay = classical.detection["float32"][0]["by_delay"]
    assert by_delay[0] < 1.27 and tnl.detection["float32"][0]["by_delay"][-1] < by_delay[-1] < 0.5
