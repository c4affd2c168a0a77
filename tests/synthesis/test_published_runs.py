"""Simulated figures of Zammali (2020), section 5.6: widths, alarm rates, faults that are surely found.

The switching sequence, inputs and small-fault size of the thesis are lost, so whatever depends on a sequence is
compared on own random ones, with a tolerance that the docstring explains.
"""

import numpy as np
import pytest
from helpers.published import PLANT, PRINTED, SIDES, C, lmi, printed_design

from codegen.analysis.adjoint import ResidualModel
from codegen.analysis.detectability import along
from codegen.certify.freeze import freeze, limits
from codegen.observers import FramerTables
from codegen.observers.framer import propagate, residuals
from codegen.synthesis.problem import Problem
from codegen.synthesis.width import WidthProblem


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
