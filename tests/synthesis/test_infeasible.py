"""Plants without an observer are refused, naming mode and entry; and the plant that needs a dwell time."""

from itertools import product

import numpy as np
import pytest
from exact import ExactPlant, feed, in_ranges, inputs, lost, mode_sequence, random_corners

from codegen.certify.freeze import freeze, limits
from codegen.errors import CertificateError, DesignError
from codegen.observers import FramerTables
from codegen.plant.load import load, loads
from codegen.plant.simulate import range_violations, simulate
from codegen.selection import select
from codegen.selection.select import choose
from codegen.synthesis import METHODS
from codegen.synthesis.problem import Problem
from codegen.synthesis.structure import best_row, obstruction, unseen_growth

# A cart without its position: "braked" feeds the speed back with a negative sign that no output sees.
BASE = """
format = 1
name = "base"
title = "Small"
source = "own example"
time = { kind = "discrete", sample_period = 1 }
[signals]
x = [{ name = "s", range = [-9, 9] }, { name = "v", range = [-9, 9] }]
u = [{ name = "u", range = [-1, 1] }]
y = [{ name = "y", range = [-30, 30] }]
w = [{ name = "w", bounds = [-1, 1] }]
f = [{ name = "sensor", range = [-1, 1] }]
[initial]
x_lo = [-1, -1]
x_hi = [1, 1]
[common]
C = [[1, 0]]
Bw = [[1], [1]]
Df = [[1]]
[[mode]]
name = "free"
A = [[0.5, 0.1], [0.1, 0.5]]
B = [[0], [1]]
[[mode]]
name = "braked"
A = [[0.5, -0.13], [0.1, 0.4]]
B = [[0], [1]]
"""
GOOD = BASE.replace("-0.13", "0.13")
BRAKED = 'A = [[0.5, 0.13], [0.1, 0.4]]\nB = [[0], [1]]'
SWITCHED_C = (GOOD.replace("C = [[1, 0]]\n", "").replace("B = [[0], [1]]", "B = [[0], [1]]\nC = [[1, 0]]", 1)
              .replace(BRAKED, BRAKED + "\nC = [[2, 0]]"))


def refusal(text, method, **options):
    plant = loads(text, "base")
    with pytest.raises(DesignError) as caught:
        choose(plant, method, {**plant.options, **options}, lambda line: None)
    return str(caught.value)


CASES = {
    "negative entry, classical": (
        BASE, "interval", {},
        'base: no L give A - L C >= 0 in mode "braked": best entry (s, v) is -0.13. Try method '
        '"tnl-interval", or measure v.'),
    "negative entry, TNL": (
        BASE.replace("[[0.5, -0.13], [0.1, 0.4]]", "[[0.5, 0], [0.1, -0.13]]"), "tnl-interval", {},
        'base: no L, N give T A - L C >= 0 in mode "braked": best entry (v, v) is -0.13. Measure v.'),
    "invisible growing direction": (
        GOOD.replace("[[0.5, 0.13], [0.1, 0.4]]", "[[0.5, 0], [0.1, 1.02]]"), "tnl-interval", {},
        'base: the direction z = 1 v is invisible to the outputs of mode "braked" (C z = 0, C A z = '
        "0) and does not decay (A z >= z), whatever the gains. Measure one of these states."),
    "invisible constant": (
        GOOD.replace("[[0.5, 0.13], [0.1, 0.4]]", "[[0.5, 0.13], [0.1, 1]]"), "interval", {},
        'base: the direction z = 1 v is invisible to the outputs of mode "braked" (C z = 0) and does '
        "not decay (A z >= z), whatever the gains. Measure one of these states."),
    "continuous": (
        GOOD.replace('kind = "discrete"', 'kind = "continuous"'), "interval", {},
        'base: method "interval" does not apply: the plant is continuous, expected discrete. '
        'Use method "tnl-interval-lpv" or "lpv-interval".'),
    "no range": (
        GOOD.replace(", range = [-30, 30]", ""), "interval", {},
        'base: method "interval" does not apply: signals.y "y" has no range, expected range = [lo, '
        "hi]: rounding margins, input checks and recovery need it. Add one."),
    "mode not known": (
        GOOD + "[switching]\nknown = false\n", "tnl-interval", {},
        'base: method "tnl-interval" does not apply: the mode is not known at run time, and it '
        "cannot be found there: no dwell time is declared, expected switching.minimum_dwell."),
    "C switches": (
        SWITCHED_C, "tnl-interval", {},
        'base: method "tnl-interval" does not apply: C differs between modes, so T + N C = I would '
        'need one N per pair of modes. Use method "interval", or a common C.'),
    "feedthrough": (
        GOOD.replace("Df = [[1]]", "Df = [[1]]\nD = [[0.5]]"), "tnl-interval", {},
        'base: method "tnl-interval" does not apply: D is not zero; the new measurement would need '
        'the new input. Use method "interval".'),
    "unknown method": (
        GOOD, "sliding", {},
        f'base: observer.method is "sliding", expected one of {", ".join(METHODS)}. Did you mean "mode-sliding"?'),
    "unknown option": (
        GOOD, "interval", {"lamda": 0.5},
        "base: observer.lamda is no option of this method (expected one of criterion, lyapunov, lambda, contraction, "
        "sampling, interpolation, design, decay, metzler, coordinates, gain_cap, evaluations, within, gains, modes, "
        "ages, horizon, restart, found_within, gain_limit, weight, slope, blank, window, share). "
        'Did you mean "lambda"?'),
    "option of calibrated thresholds": (
        GOOD, "hinf-filter", {"rank": 2},
        'base: observer.rank is given, which threshold = "calibrated" alone reads. Remove it, or let the thresholds be '
        "calibrated."),
    "criterion": (
        GOOD, "interval", {"criterion": "best"},
        "base: observer.criterion is 'best', "
        'expected "linf" or "width" or "detection".'),
    "lambda of 2": (
        GOOD, "interval", {"lambda": 2},
        "base: observer.lambda is 2, expected a number from 0 to 1."),
    "lambda true": (
        GOOD, "interval", {"lambda": True},
        "base: observer.lambda is True, expected a number from 0 to 1."),
    "gains no table": (
        GOOD, "interval", {"gains": 3},
        "base: observer.gains is 3, expected a table with L, one matrix per mode, at least."),
    "no gains": (
        GOOD, "zonotope", {"gains": {}},
        "base: observer.gains is {}, expected a table with L, one matrix per mode, at least."),
    "gains of the wrong shape": (
        GOOD, "interval", {"gains": {"L": [[0.1], [0.2]]}},
        "base: observer.gains.L_hi has shape (2, 1), expected (2, 2, 1) finite numbers (one matrix "
        "per mode)."),
    "unknown gain": (
        GOOD, "interval", {"gains": {"K": 1}},
        "base: observer.gains.K is unknown, expected one of L, N, L_hi, L_lo, N_hi, N_lo, P, P_hi, "
        "P_lo."),
}


@pytest.mark.parametrize("name", CASES)
def test_refusal_names_what_obstructs(name):
    text, method, options, message = CASES[name]
    assert refusal(text, method, **options) == message


def test_without_a_method_the_first_reason_is_told():
    """No method given: all are tried; "braked" works with N, so the classical refusal is not the end of it."""
    plant = loads(BASE, "base")
    design = choose(plant, None, {"criterion": "width", "contraction": 0.2}, lambda line: None)
    assert design.method == "tnl-interval"


def test_bounds_of_the_options_themselves():
    """A decay rate at which nothing exists is a DesignError too, not a solver's."""
    message = refusal(GOOD, "interval", criterion="linf", **{"lambda": 0.999})
    assert message.startswith("base: T A - L C can be made nonnegative in every mode, but no gains make all modes")


def test_good_plant_has_a_design():
    """The refusals above are due to what was changed."""
    for method in ("interval", "tnl-interval"):
        plant = loads(GOOD, "base")
        assert choose(plant, method, {"criterion": "width", "contraction": 0.2}, lambda line: None).method == method


def test_best_entry_is_the_best():
    """LP against a grid: no g makes the smallest entry of A_i - g C larger, for random rows and one output."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        A, c = rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, (1, 3))
        value, j = best_row(A, c, 0, False)
        grid = np.linspace(-60, 60, 40001)
        best = np.max(np.min(A[0] - grid[:, None] * c, axis=1))
        assert value == pytest.approx(min(best, 0.0), abs=5e-3)
        assert 0 <= j < 3


def test_unseen_direction_is_one():
    """z >= 0, C z = 0, A z >= z, put back; and none where the state decays or is seen."""
    A, seen = np.array([[0.2, 0, 0], [0, 0.4, 0.9], [0, 0.8, 0.3]]), np.array([[1.0, 0, 0]])
    z = unseen_growth(A, seen, False)
    assert np.all(z >= 0) and abs(seen @ z)[0] < 1e-9 and np.all(A @ z >= z - 1e-9) and z.sum() == pytest.approx(1)
    assert unseen_growth(0.8 * A, seen, False) is None
    assert unseen_growth(A, np.array([[0.0, 1, 0]]), False) is None
    A2 = A.copy()
    A2[0, 1] = 0.5  # now the output sees the direction one sample later, which N can use
    assert unseen_growth(A2, seen, False) is not None and unseen_growth(A2, seen, True) is None


# -- the plant that needs a dwell time -------------------------------------------------------------
RELAY = load("relay")


@pytest.mark.parametrize("method", ["interval", "tnl-interval"])
@pytest.mark.parametrize("options", [{"criterion": "linf", "lyapunov": "common"}, {"criterion": "width"},
                                     {"criterion": "detection"}], ids=["linf", "width", "detection"])
def test_relay_has_no_design_for_arbitrary_switching(method, options):
    plant = loads(RELAY.text, "relay")
    with pytest.raises(DesignError, match='Declare switching.average_dwell with lyapunov = "multiple"'):
        choose(plant, method, options, lambda line: None)


def test_no_gain_can_stop_the_growth():
    """Why: T A - L C >= 0 leaves rows 0, 1 at least [[.1 - .25n, 1.2 - .25n], ...] with n <= .4, as the file says.

    For every admissible choice the round trip of two samples has an eigenvalue of at least 1.1^2 (TNL), 1.2^2.
    """
    assert obstruction(Problem.of(RELAY, False)) is None and obstruction(Problem.of(RELAY, True)) is None
    def round_trip(n, m):
        first, second = [[0.1 - n / 4, 1.2 - n / 4], [0, 0.1]], [[0.1, 0], [1.2 - m / 4, 0.1 - m / 4]]
        return np.max(np.abs(np.linalg.eigvals(np.array(first) @ np.array(second))))

    worst = min(round_trip(n, m) for n, m in product(np.linspace(0, 0.4, 21), repeat=2))
    assert worst >= 1.1**2 - 1e-9
    A1, A2 = (m.A for m in RELAY.modes)
    assert np.max(np.abs(np.linalg.eigvals(A1 @ A2))) > 1.44
    assert max(np.max(np.abs(np.linalg.eigvals(m.A))) for m in RELAY.modes) <= 0.5
    # Framers of gains that suit each mode alone diverge when switched at every sample.
    zero = np.zeros((2, 3, 1))
    gains = dict.fromkeys(("L_hi", "L_lo", "N_hi", "N_lo"), zero)
    t = freeze(FramerTables, RELAY.modes, limits(RELAY), gains, "float64")
    assert t.clamp, "there is no invariant box, so the framers are cut to the ranges"


def test_relay_design_rests_on_its_dwell_time(workshop):
    design = workshop.gallery("relay", "interval")
    cert = design.certificate["float32"]
    assert cert["kind"] == "linf" and cert["rho"] > 1 and cert["steady_box"] is None
    assert cert["dwell_add"] / cert["dwell_drain"] == 3
    s = design.observer.supervision
    assert s.monitors_dwell and (s.dwell_add, s.dwell_drain, s.dwell_limit) == (3, 1, 3)
    assert any("for average dwell time at least 3 samples with chatter bound 1" in c for c in design.claims("float32"))
    assert not any("Ultimate width" in c for c in design.claims("float32"))


def test_relay_keeps_to_its_ranges():
    """The scenarios switch as fast as the dwell time allows, and the file's ranges hold under it."""
    for k in range(len(RELAY.scenarios)):
        for seed in range(5):
            assert range_violations(RELAY, simulate(RELAY, k, seed=seed)) == []
    assert [s.name for s in RELAY.scenarios] == ["no fault", "injection fault"]
    assert set(np.diff([at for at, _ in RELAY.scenarios[0].mode])) == {3}


def relay_run(workshop, q, seed=0):
    """Compiled observer on an exact run with small inputs (so that fast switching stays in range for a while)."""
    design, rng = workshop.gallery("relay", "interval"), np.random.default_rng(seed)
    w, v = random_corners(RELAY, q, rng)
    run = ExactPlant(RELAY).run(q, w, v, [0, 0, 0], u=0.01 * inputs(RELAY, q, rng))
    return design, [run], feed(workshop.driver(design), [run]).row(0)


def test_assured_drops_when_switching_is_too_fast_and_comes_back(workshop):
    """In the compiled C: from the very sample of the early switch until the bucket is empty; bounds hold throughout."""
    slow = np.repeat([0, 1] * 8, 3)
    fast = np.concatenate([slow, [0, 1, 0, 1, 0, 1], np.repeat([0, 1], 20)])
    design, run, trace = relay_run(workshop, fast)
    assert in_ranges(RELAY, run)
    assert np.all(trace.status == 0) and not np.any(trace.alarm)
    start = len(slow)  # a switch three samples after the last one: still admitted
    assert np.all(trace.assured[:start + 1])
    assert not np.any(trace.assured[start + 1:start + 6])
    # The last fast switch is at start + 6, which fills the bucket to its limit 3: empty three samples later.
    assert not np.any(trace.assured[start + 6:start + 9])
    assert np.all(trace.assured[start + 9:])
    x = np.array([[float(a) for a in row] for row in run[0].x])
    assert np.all(x <= trace.x_hi) and np.all(x >= trace.x_lo), "containment needs no dwell time"
    assert lost(run, feed(workshop.driver(design), run)) == 0


def test_chatter_is_admitted_once(workshop):
    """N0 = 1: a single switch any time, two within three samples never."""
    single = np.array([0] * 7 + [1] * 9)
    assert np.all(relay_run(workshop, single)[2].assured)
    for gap in (1, 2, 3, 4):
        q = np.array([0] * 5 + [1] * gap + [0] * 12)
        trace = relay_run(workshop, q)[2]
        assert np.all(trace.assured) == (gap >= 3)
        if gap < 3:
            assert not trace.assured[5 + gap] and trace.assured[-1]


def test_level_holds_under_admitted_switching(workshop):
    """Errors settle below the certified level along the fastest admitted sequences, and not idly far below."""
    design, share = workshop.gallery("relay", "interval"), 0.0
    level = design.certificate["float32"]["level"]
    for seed in range(4):
        q = mode_sequence(2, 200, 3, np.random.default_rng(seed)) if seed else np.resize(np.repeat([0, 1], 3), 200)
        _, run, trace = relay_run(workshop, q, seed)
        x = np.array([[float(a) for a in row] for row in run[0].x])
        for e in (trace.x_hi - x, x - trace.x_lo):
            share = max(share, np.max(np.linalg.norm(e[60:], axis=1)) / level)
    assert 0.05 < share <= 1


def test_where_no_method_certifies_the_others_are_named(monkeypatch):
    def refused(plant, name, options, progress):
        raise CertificateError(f"certificate: {name} fails.")

    monkeypatch.setattr(select, "choose", refused)
    with pytest.raises(CertificateError) as caught:
        select.first_certified(load("dlpv"), ["descriptor-uncertain", "descriptor-discrete"], {}, str)
    told = str(caught.value)
    assert told.startswith("certificate: descriptor-uncertain fails. (Tried: descriptor-uncertain, descriptor-discrete")
    named = told.split("method that applies: ")[1]
    assert "descriptor-error" in named and "descriptor-uncertain" not in named and "tnl-interval" not in named
