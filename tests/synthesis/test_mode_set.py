"""Mode invalidation: the truth is never dropped, delays are certified, and wrong tables or proofs are caught."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.modes import DWELL, course, example, tables
from scipy.linalg import expm
from scipy.optimize import linprog

from codegen.analysis.mode_distinguishability import distinguishability
from codegen.certify.mode_claims import Claims, certify_delays
from codegen.certify.mode_delay import Course, Story, survival
from codegen.certify.mode_program import Program
from codegen.errors import CertificateError, DesignError
from codegen.observers import ModeTables
from codegen.observers.mode_set import ModeSet, ModeState
from codegen.plant.load import load
from codegen.plant.model import Signal
from codegen.synthesis.mode_tables import coordinates, tables_of

# (period s, noise) -> ages, certified delay in samples (an earlier certificate by pairs of samples alone: 3, 6, 9)
CASES = {(0.001, 0.0): (4, 3), (0.005, 0.02): (6, 4), (0.010, 0.05): (8, 5)}
#: Fast and noisy: it takes 18 ages (pairs of samples alone: 14).
FAST = {(0.001, 0.02): (18, 11)}
# Where the certificate is looked for: widths at a switch, last samples of the old mode per pair, the first mode first.
KNOWN = {(0.001, 0.0): ([1.133e-12, 0.1121, 0.2022], (1, 1, 1, 1, 1, 1)),
         (0.005, 0.02): ([0.04373, 0.5261, 1.002], (2, 1, 2, 1, 1, 2)),
         (0.010, 0.05): ([0.1093, 1.089, 2.024], (3, 1, 2, 2, 1, 3)),
         (0.001, 0.02): ([0.04504, 0.2329, 0.4599], (8, 2, 7, 5, 2, 6))}
STEPS = {0.001: 500, 0.005: 300, 0.010: 200}


@lru_cache
def delays(case):
    """All conditions of the certificate, at widths that were searched before."""
    plant, t = example(*case), tables(*case, (CASES | FAST)[case][0])
    claims = Claims(t, plant.limits("x"), plant.limits("u"), round(DWELL / case[0]), 60)
    widths, old = KNOWN[case]
    return claims.again(np.array(widths), dict(zip(claims.pairs, old, strict=True)))


def judge(estimator, run):
    """Samples at which the true mode was dropped, the state left its bounds, or an alarm was raised."""
    out = estimator.run(run.u, run.y)
    dropped = sum(not answer.mode_set >> int(q) & 1 for answer, q in zip(out, run.q))
    outside = sum(bool(np.any(x < a.x_lo) or np.any(x > a.x_hi)) for a, x in zip(out, run.x))
    return dropped, outside, sum(a.alarm for a in out), out


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("real", ["float64", "float32"])
def test_truth_is_never_dropped(case, real):
    period, noise = case
    for seed in range(3):
        run = course(example(*case), STEPS[period], seed)
        estimator = ModeSet(tables(*case, CASES[case][0], real))
        assert judge(estimator, run)[:3] == (0, 0, 0)


class NoBirths(ModeSet):
    """A switch is thought to fall on a sample."""

    def born(self, i, j, box, u):
        return self.carried(j, box, u)


class Forgetful(ModeSet):
    """Children are born by the decided mode only after its first sample as established."""

    def carry(self, state, u):
        out = super().carry(state, u)
        out.alive[:, 0] &= state.alive[:, -2].any()
        return out


def changed(**factors):
    def make(t):
        return ModeSet(replace(t, **{k: np.asarray(getattr(t, k)) * f for k, f in factors.items()}))
    return make


MUTANTS = {"switches on samples only": NoBirths, "no children": Forgetful,
           "no disturbance": changed(reach=0.0, birth=0.0), "half the noise": changed(v_lo=0.5, v_hi=0.5),
           "jump of the wrong sign": changed(J=-1.0, J_u=-1.0, J_shift=-1.0), "input forgotten": changed(Gamma=0.0),
           "modes exchanged": lambda t: ModeSet(replace(t, Phi=t.Phi[::-1].copy(), Gamma=t.Gamma[::-1].copy()))}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_runs_catch_a_wrong_estimator(mutant):
    case = (0.005, 0.02)

    def wrong(seed):
        return sum(judge(MUTANTS[mutant](tables(*case, 6)), course(example(*case), 300, seed))[:3])

    assert any(wrong(seed) for seed in range(3))


@pytest.mark.parametrize("case", CASES | FAST)
def test_certified_delays(case):
    """3, 20, 50 and 11 ms; and no run is slower."""
    period, d = case[0], delays(case)
    ages, worst = (CASES | FAST)[case]
    assert d.worst == worst and d.quiet <= ages
    assert d.start is not None and d.start <= 4
    slowest = 0.0
    for seed in range(2 if case in FAST else 6):
        run = course(example(*case), STEPS[period], 100 + seed)
        _, _, _, out = judge(ModeSet(tables(*case, ages)), run)
        before = int(run.q[0])
        assert all(out[k].mode == before for k in range(d.start, int(DWELL / period)))
        for at, mode in run.switches:
            first = int(np.floor(at / period))  # the last sample before the switch
            if first + int(DWELL / period) < len(out):
                span = range(first + 1, first + int(DWELL / period))
                wrong = [k for k in span if out[k].mode != mode]
                assert not wrong or wrong[-1] < first + d.identified[before, mode]
                slowest = max(slowest, (wrong[-1] + 1) * period - at if wrong else 0.0)
            before = mode
    assert (0.1 if case in FAST else 0.2) * d.worst * period < slowest <= d.worst * period


def plain_course(case, widths=0.3):
    plant = example(*case)
    width = np.array([2 * case[1], widths, widths])
    return Course(tables(*case, CASES[case][0]), *plant.limits("x"), *plant.limits("u"), width)


STORIES = [Story(0, 1, 0), Story(1, 0, 1), Story(0, 2, 1, 0), Story(0, 0, 1, 0), Story(2, 1, 0, 1)]


@pytest.mark.parametrize("story", STORIES)
def test_program_is_exact_about_the_estimator(story):
    """A solution is played to the estimator itself: the hypothesis lives as long as the program says."""
    case = (0.005, 0.02)
    c = plain_course(case)
    last = survival(c, story, 40)
    assert 1 <= last < 40
    program, _ = c.told(story, 0, last)
    A = np.zeros((len(program.rows), len(program.lo)))
    for r, row in enumerate(program.rows):
        A[r, list(row)] = list(row.values())
    found = linprog(np.zeros(A.shape[1]), A_ub=A, b_ub=program.right, bounds=[*zip(program.lo, program.hi)])
    assert found.success
    z = found.x.reshape(last + 1, -1)
    n, n_u, p = 3, 1, 1
    u, y = z[:, n:n + n_u], z[:, n + n_u:n + n_u + p]
    lo, hi = z[0, n + n_u + p:2 * n + n_u + p], z[0, 2 * n + n_u + p:3 * n + n_u + p]
    estimator = ModeSet(c.t)
    shape = (3, c.t.ages + 1, n)
    state = ModeState(np.broadcast_to(lo - 1e-7, shape).copy(), np.broadcast_to(hi + 1e-7, shape).copy(),
                      np.zeros(shape[:2], dtype=bool))
    state.alive[story.source, -1] = True
    for k in range(last + 1):
        if story.born is not None and k == story.born + 1:  # a birth is the one thing that is enclosed, not met
            state.lo[story.wrong, 0] = z[k, n + n_u + p:2 * n + n_u + p] - 1e-7
            state.hi[story.wrong, 0] = z[k, 2 * n + n_u + p:3 * n + n_u + p] + 1e-7
            state.alive[story.wrong, 0] = True
        out = estimator.step(state, u[k], y[k])
        if story.born is None:
            assert out.settled_set >> story.old & 1
        elif k > story.born:
            assert out.mode_set >> story.wrong & 1
        assert not out.alarm


@pytest.mark.parametrize("case, old, new, share", [((0.005, 0.02), 1, 0, 0.6), ((0.010, 0.05), 2, 1, 0.6)])
def test_delay_of_the_old_mode_is_nearly_reached(case, old, new, share):
    """The solution one sample earlier, played with the continuous plant and no disturbance."""
    plant, t, period = example(*case), tables(*case, CASES[case][0]), case[0]
    c = Course(t, *plant.limits("x"), *plant.limits("u"), delays(case).widths)
    last = survival(c, Story(old, new, old), 40)
    assert last + 1 == delays(case).old[old, new]
    slowest = 0.0
    for target in (last, last - 1):
        program, _ = c.told(Story(old, new, old), 0, target)
        A = np.zeros((len(program.rows), len(program.lo) + 1))
        for r, row in enumerate(program.rows):
            A[r, list(row)] = list(row.values())
        A[:, -1] = -1.0  # as much room as there is
        found = linprog(np.eye(A.shape[1])[-1], A_ub=A, b_ub=program.right,
                        bounds=[*zip(program.lo, program.hi), (-1e-4, None)])
        z = found.x[:-1].reshape(target + 1, -1)
        for share_of_period in (0.0, 0.5, 1.0):
            slowest = max(slowest, played(plant, t, z, old, new, share_of_period * period))
    assert share * (last + 1) * period <= slowest <= (last + 1) * period


def played(plant, t, z, old, new, at):
    """Time from the switch to the death of the old mode."""
    shape = (3, t.ages + 1, 3)
    state = ModeState(np.broadcast_to(z[0, 5:8], shape).copy(), np.broadcast_to(z[0, 8:11], shape).copy(),
                      np.zeros(shape[:2], dtype=bool))
    state.alive[old, -1] = True
    x, estimator, T = np.linalg.solve(t.S, z[0, :3]), ModeSet(t), plant.sample_period
    for k in range(20):
        v = np.clip(z[k, 4] - z[k, 0], t.v_lo, t.v_hi) if k < len(z) else 0.0
        estimator.step(state, np.array([5.0]), plant.modes[0].C @ x + v)
        if not state.alive[old, -1]:
            return k * T - at
        for q, span in ((old, at), (new, T - at)) if k == 0 else ((new, T),):
            M = np.zeros((4, 4))
            M[:3, :3], M[:3, 3] = plant.modes[q].A, plant.modes[q].B @ [5.0]
            x = (expm(M * span) @ np.append(x, 1))[:3]
    raise AssertionError("the old mode lives on")


def test_witness_is_checked():
    program = Program()
    x = program.variables([-1.0], [1.0])
    program.below([(np.eye(1), x)], [-0.5])
    assert not program.infeasible()
    program.below([(-np.eye(1), x)], [0.25])
    assert program.infeasible()
    assert program.witnessed(np.array([1.0, 1.0]))
    assert not program.witnessed(np.array([1.0, 0.0])) and not program.witnessed(np.zeros(2))
    assert program.most({0: 1.0}) == -np.inf
    loose = Program()
    y = loose.variables([-1.0, -1.0], [1.0, 1.0])
    loose.below([(np.ones((1, 2)), y)], [0.5])
    assert 0.5 <= loose.most({0: 1.0, 1: 1.0}) < 0.5 + 1e-9


def test_more_noise_or_less_disturbance_move_the_delay_the_right_way():
    few, many = plain_course((0.005, 0.02)), plain_course((0.010, 0.05))
    story = Story(0, 1, 0)
    base = survival(few, story, 60)
    t = few.t
    loud = Course(replace(t, v_lo=6 * t.v_lo, v_hi=6 * t.v_hi), *few.x, *few.u, few.widths * [6, 1, 1])
    assert survival(loud, story, 60) > base
    still = Course(replace(t, reach=0 * t.reach, birth=0 * t.birth), *few.x, *few.u, few.widths * 0)
    assert survival(still, story, 60) <= base
    assert survival(many, story, 60, guess=9) == survival(many, story, 60)


def test_certificate_says_why_not():
    quiet, noisy = (0.001, 0.0), (0.005, 0.02)
    ranges = [example(*quiet).limits(v) for v in "xu"]
    with pytest.raises(CertificateError, match="Use at least 3 ages"):
        certify_delays(tables(*quiet, 1), *ranges, 150)
    with pytest.raises(CertificateError, match="dwell time is 1"):
        certify_delays(tables(*quiet, 4), *ranges, 1)
    t = tables(*noisy, 6)
    with pytest.raises(CertificateError, match="cannot be told apart within 4"):
        certify_delays(replace(t, v_lo=100 * t.v_lo, v_hi=100 * t.v_hi), *ranges, 30, horizon=4)


# ---------------------------------------------------------------------------------------------- tables

@pytest.mark.parametrize("period", [0.001, 0.010])
def test_switch_within_a_period_is_enclosed(period):
    plant, t = example(period, 0.02), tables(period, 0.02, 4)
    rng = np.random.default_rng(3)
    estimator, escapes = ModeSet(t), 0
    lo, hi = plant.limits("x")
    for _ in range(300):
        i, j = rng.permutation(3)[:2]
        x = np.where(rng.random(3) < 0.5, lo, hi) if rng.random() < 0.5 else rng.uniform(lo, hi)
        s = period * rng.choice([0, 1, rng.random()])
        w = rng.choice([-1, 1], (2, 3)) * 0.02
        end = x
        for q, span, d in ((i, s, w[0]), (j, period - s, w[1])):
            m = plant.modes[q]
            M = np.zeros((4, 4))
            M[:3, :3], M[:3, 3] = m.A, m.B @ [5.0] + d
            end = (expm(M * span) @ np.append(end, 1))[:3]
        box = (t.S @ x, t.S @ x)
        low, high = estimator.born(i, j, box, np.array([5.0]))
        assert np.all(t.S @ end >= low - t.birth[i, j] - 1e-12) and np.all(t.S @ end <= high + t.birth[i, j] + 1e-12)
        low, high = estimator.carried(j, box, np.array([5.0]))
        escapes += np.any(np.abs(t.S @ end - low) > t.birth[i, j] + 1e-12)
    assert escapes > 150


def test_tables_survive_json_and_rounding():
    t = tables(0.005, 0.02, 6, "float32")
    again = ModeTables.from_dict(t.to_dict())
    for f in fields(t):
        assert np.array_equal(getattr(again, f.name), getattr(t, f.name))
    exact = tables(0.005, 0.02, 6)
    assert np.all(t.reach > exact.reach) and np.all(t.v_hi > exact.v_hi) and t.Phi.dtype == np.float32


def test_coordinates_contract_where_the_outputs_help():
    A = [np.array([[0.0, 1.0], [0.0, 0.5]]), np.array([[0.0, 1.0], [-1.0, 0.2]])]  # the rest grows by itself
    S = coordinates(np.array([[1.0, 0.0]]), A)
    assert np.array_equal(S[0], [1, 0])
    assert max((S @ a @ np.linalg.inv(S))[1, 1] for a in A) < 0
    with pytest.raises(DesignError, match="dependent rows"):
        coordinates(np.array([[1.0, 0.0], [2.0, 0.0]]), A)


@pytest.mark.parametrize("change, words", [
    ({"theta": (Signal("load"),)}, "reads no parameters"),
    ({"modes": "C"}, "C common to all modes"),
    ({"x": None}, 'range of "x1"')])
def test_what_it_does_not_take(change, words):
    plant = example(0.005, 0.02)
    if "modes" in change:
        change = {"modes": (plant.modes[0], replace(plant.modes[1], C=2 * plant.modes[1].C), plant.modes[2])}
    if "x" in change:
        change = {"x": (replace(plant.x[0], hi=np.inf), *plant.x[1:])}
    with pytest.raises(DesignError, match=words):
        tables_of(ModeTables, replace(plant, **change), 6)


# ---------------------------------------------------------------------------------------------- faults, start

def test_sensor_fault_raises_an_alarm_and_nothing_else_does():
    case = (0.001, 0.02)
    t = tables(*case, 10)
    for seed in (1, 2):
        run = course(example(*case), 400, seed)
        assert judge(ModeSet(t), run)[2] == 0
        faulty = replace(run, y=run.y + np.where(np.arange(400) >= 80, 2.0, 0.0)[:, None])
        _, _, alarms, out = judge(ModeSet(t), faulty)
        assert alarms >= 1 and not any(a.alarm for a in out[:80])


# ---------------------------------------------------------------------------------------------- distinguishability

def test_modes_of_the_example_can_be_told_apart():
    plant = example(0.001, 0.0)
    thesis = replace(plant, x=(*plant.x[:2], replace(plant.x[2], lo=-4.5)))
    found = {(p.first, p.second): p for p in distinguishability(thesis, 10)}
    assert [found[k].rate for k in ((0, 1), (0, 2), (1, 2))] == pytest.approx([11, 64, 20])
    assert all(p.worst is not None and p.worst <= 3 for p in found.values())
    # What the estimator does within its certificate cannot be sooner than what anybody could.
    noisy = {(p.first, p.second): p for p in distinguishability(example(0.005, 0.02), 20)}
    assert max(p.worst for p in noisy.values()) == 4


def test_modes_that_look_alike():
    plant = example(0.005, 0.02)
    twin = replace(plant.modes[1], name="twin")
    pairs = {(p.first, p.second): p for p in distinguishability(replace(plant, modes=(plant.modes[1], twin)), 15)}
    found = pairs[0, 1]
    assert found.worst is None and found.best is None and found.rate == 0.0
    assert found.example["x"].shape == (2, 3)
    # Three modes that are alike at rest: it takes an input to see the difference.
    for pair in distinguishability(load("zammali_fd"), 10):
        assert pair.worst is None and pair.best is not None
        assert np.allclose(pair.example["u"].shape, (11, 1))
