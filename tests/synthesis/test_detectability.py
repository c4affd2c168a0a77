"""Surely detected faults by construction: what the adjoint calls the worst case is attained, and is the worst.

Everything is run on the float64 observer (its rounding margins are of order 1e-13), started with the errors
of its ultimate box; the signals come from ``exact.Pusher``, which shares no code with ``analysis.adjoint``.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from exact import Pusher, random_corners

from codegen.algebra.dwell import admissible
from codegen.analysis.adjoint import ResidualModel, extremes, fault_response
from codegen.analysis.detectability import along, limited, surely_detected, ultimate_errors

ADJOINT = (("zammali_fd", "interval"), ("zammali_fd", "tnl-interval"), ("press", "tnl-interval"))
FAULTS = (*ADJOINT, ("emps", "tnl-interval"), ("relay", "interval"))


@pytest.fixture
def design(workshop, request):
    return workshop.gallery(*request.param)


def gallery(cases):
    return pytest.mark.parametrize("design", cases, indirect=True, ids=lambda c: " ".join(c))


def parts(design):
    """Table, model and ultimate errors (hi, lo) of the float64 observer."""
    t = design.observer.tables["float64"]
    return t, ResidualModel.of(design.plant.modes, t), ultimate_errors(design.certificate["float64"])


def simulate(plant, q, w, v, f=None):
    """x, y of S runs from x = 0 in float64: q (S, K), w (S, K, n_w), v (S, K, n_v), f (S, K, n_f)."""
    stack = {k: np.stack([getattr(m, k) for m in plant.modes])[q] for k in ("A", "C", "Bw", "Dv", "Bf", "Df")}
    f = np.zeros((*q.shape, plant.n_f)) if f is None else f
    x, ys = np.zeros((len(q), plant.n_x)), []
    for k in range(q.shape[1]):
        at = {name: value[:, k] for name, value in stack.items()}
        ys.append(mul(at["C"], x) + mul(at["Dv"], v[:, k]) + mul(at["Df"], f[:, k]))
        x = mul(at["A"], x) + mul(at["Bw"], w[:, k]) + mul(at["Bf"], f[:, k])
    return np.stack(ys, axis=1)


def mul(A, x):
    return np.einsum("src,sc->sr", A, x)


def observe(design, q, w, v, tails, f=None):
    """Trace of the float64 observer, its framers at distance ``tails`` from the state at first."""
    y = simulate(design.plant, q, w, v, f)
    u = np.zeros((*q.shape, design.plant.n_u))
    return design.observer.run_many(u, y, q, real="float64", x0_lo=-tails[1], x0_hi=tails[0])


def hardest(pusher, q, i, side, rng, k=None):
    """w, v that make the residual bound ``side`` of output i largest at sample k (default the last)."""
    k = len(q) - 1 if k is None else k

    class Away(Pusher):
        def target(self, *args):
            return tuple(-a for a in super().target(*args))

    away = Away.__new__(Away)
    away.__dict__.update(pusher.__dict__)
    w, v, _ = away.signals(q, [(k, "y", side, i)], rng)
    return w, v


def all_sequences(plant, length):
    return np.array(list(product(range(plant.n_modes), repeat=length)))


@gallery(ADJOINT)
def test_supremum_is_attained(design):
    """Every mode sequence of 4 samples (5 for the small plant), every output, both sides, to 1e-9."""
    plant, rng = design.plant, np.random.default_rng(0)
    t, model, tails = parts(design)
    pusher = Pusher(plant, t)
    paths = all_sequences(plant, 5 if plant.n_x < 4 else 4)
    above, below = extremes(model, paths, *tails)
    for i in range(plant.n_y):
        for side, sup in (("hi", above), ("lo", below)):
            signals = [hardest(pusher, q, i, side, rng) for q in paths]
            trace = observe(design, paths, *(np.stack(s) for s in zip(*signals)), tails)
            got = trace.r_hi[:, -1, i] if side == "hi" else -trace.r_lo[:, -1, i]
            np.testing.assert_allclose(got, sup[:, i], rtol=1e-9)


@gallery(ADJOINT)
def test_nothing_exceeds_the_supremum(design):
    """Random corners, and the worst case of one output as a trial for all the others."""
    plant, rng = design.plant, np.random.default_rng(1)
    t, model, tails = parts(design)
    paths = all_sequences(plant, 4)[rng.integers(0, plant.n_modes**4, 1500)]
    signals = [random_corners(plant, q, rng) for q in paths]
    pusher = Pusher(plant, t)
    for s in range(0, len(paths), 3):
        signals[s] = hardest(pusher, paths[s], int(rng.integers(plant.n_y)), ("hi", "lo")[s % 2], rng)
    trace = observe(design, paths, *(np.stack(s) for s in zip(*signals)), tails)
    above, below = extremes(model, paths, *tails)
    assert np.all(trace.r_hi[:, -1] <= above * (1 + 1e-12)) and np.all(-trace.r_lo[:, -1] <= below * (1 + 1e-12))


def attained(design, model, paths, tails):
    """Relative distance between ``extremes`` of a model and what the observer attains, side "hi" of output 0."""
    rng, pusher = np.random.default_rng(0), Pusher(design.plant, design.observer.tables["float64"])
    signals = [hardest(pusher, q, 0, "hi", rng) for q in paths]
    trace = observe(design, paths, *(np.stack(s) for s in zip(*signals)), tails)
    sup = extremes(model, paths, *tails)[0][:, 0]
    return np.max(np.abs(trace.r_hi[:, -1, 0] - sup) / sup)


WRONG = {"v+": lambda m: replace(m, NDv={s: -a for s, a in m.NDv.items()}),
         "v": lambda m: replace(m, LDv={s: -a for s, a in m.LDv.items()}),
         "w": lambda m: replace(m, TBw={s: -a for s, a in m.TBw.items()}),
         "offset": lambda m: replace(m, top={s: a[::-1] for s, a in m.top.items()})}


@pytest.mark.parametrize("term", WRONG)
def test_mutant_adjoint_is_not_attained(workshop, term):
    """A wrong sign of the v+ term (or of another) shows at once; the right one agrees."""
    design = workshop.gallery("press", "tnl-interval")  # w and v are not symmetric there
    _, model, tails = parts(design)
    paths = all_sequences(design.plant, 3)
    assert attained(design, model, paths, tails) < 1e-9
    assert attained(design, WRONG[term](model), paths, tails) > 1e-3


# -- faults ----------------------------------------------------------------------------------------
def fault_runs(design, paths, onset, channel, size, rng):
    """Signals that work against detection: each residual bound at each sample after the onset in turn, and corners."""
    plant, pusher = design.plant, Pusher(design.plant, design.observer.tables["float64"])
    runs, ws, vs = [], [], []
    for q in paths:
        against = [hardest(pusher, q, i, side, rng, k) for i in range(plant.n_y) for side in ("hi", "lo")
                   for k in range(max(onset, 1), len(q))] + [random_corners(plant, q, rng) for _ in range(4)]
        runs += [q] * len(against)
        ws += [a[0] for a in against]
        vs += [a[1] for a in against]
    f = np.zeros((len(runs), paths.shape[1], plant.n_f))
    f[:, onset:, channel] = size
    return np.stack(runs), np.stack(ws), np.stack(vs), f


def histories(design, length, count, rng):
    """Mode sequences that the certificate admits, some of all there are."""
    every = np.array(list(product(range(design.plant.n_modes), repeat=length)))
    cert = design.certificate["float64"]
    slow = limited(cert) if cert["kind"] == "linf" else None
    if slow is not None:
        every = np.array([s for s in every if admissible(tuple(s), *slow)])
    return every[rng.permutation(len(every))[:count]]


@gallery(FAULTS)
def test_fault_above_the_threshold_is_detected_in_time(design):
    """1.001 times the figure of design.json, either sign, every delay that it gives, sensors and actuators.

    The figure is for errors that have been in the ultimate box for a few samples (up to 6) before the onset.
    """
    rng = np.random.default_rng(2)
    _, _, tails = parts(design)
    onset, count = 6, 0
    for j, channel in enumerate(design.detection["float64"]):
        for delay, size in enumerate(channel["by_delay"]):
            if size is None:
                continue
            paths = histories(design, onset + delay + 1, 12, rng)
            for sign in (1, -1):
                runs, w, v, f = fault_runs(design, paths, onset, j, sign * 1.001 * size, rng)
                trace = observe(design, runs, w, v, tails, f)
                assert not np.any(trace.raw_bits[:, :onset]), "no alarm before the fault"
                assert np.all(np.any(trace.raw_bits[:, onset:], axis=1)), (channel["channel"], delay, sign)
                count += len(runs)
    assert count > 100


@gallery(FAULTS)
def test_threshold_of_a_sequence_is_sharp(design):
    """Along one sequence: at 0.999 times (and half) the threshold the deciding output can be kept silent."""
    rng = np.random.default_rng(3)
    t, model, tails = parts(design)
    pusher, onset, tried = Pusher(design.plant, t), 2, 0
    for j in range(design.plant.n_f):
        for q in histories(design, onset + 3, 6, rng):
            for sign in (1, -1):
                best = deciding(model, q, j, onset, tails, sign)
                if best is None:
                    continue
                size, i, side, k = best
                w, v = (a[None] for a in hardest(pusher, q[:k + 1], i, side, rng, k))
                for share, silent in ((0.5, True), (0.999, True), (1.001, False)):
                    f = np.zeros((1, k + 1, design.plant.n_f))
                    f[:, onset:, j] = sign * share * size
                    trace = observe(design, q[None, :k + 1], w, v, tails, f)
                    if np.any(trace.raw_bits[:, onset:k]):
                        continue  # another sample saw it first, and the framers started afresh
                    r = trace.r_hi[0, k, i] if side == "hi" else -trace.r_lo[0, k, i]
                    assert (r >= 0) == silent, (j, q, sign, share)
                    tried += 1
    assert tried >= 6


def deciding(model, q, channel, onset, tails, sign):
    """Smallest size over outputs, sides and samples at which one residual must be out: (size, output, side, sample)."""
    out = []
    for k in range(onset, len(q)):
        head = q[None, :k + 1]
        g_hi, g_lo = fault_response(model, head, channel, onset)
        above, below = extremes(model, head, *tails)
        for i in range(g_hi.shape[1]):
            for side, push, room in (("hi", -sign * g_hi[0, i], above[0, i]), ("lo", sign * g_lo[0, i], below[0, i])):
                if push > 1e-9:
                    out.append((room / push, i, side, k))
    if not out:
        return None
    best = min(out)
    table = along(model, q[None], channel, onset, tails)[-1, 0]
    assert best[0] <= table, "the larger of both signs counts"
    return best


@gallery(FAULTS)
def test_figures_of_the_design_are_the_recomputed_ones(design):
    """design.json says what ``surely_detected`` finds, and more time never makes it worse."""
    for real, t in design.observer.tables.items():
        found = surely_detected(design.plant, t, design.certificate[real], 3)
        for row, f in zip(design.detection[real], found):
            sizes = [np.inf if s is None else s for s in row["by_delay"]]
            np.testing.assert_allclose(sizes, f.by_delay, rtol=1e-9)
            assert np.all(np.diff([s for s in sizes if s < np.inf]) <= 0)


def test_slow_switching_counts_only_where_it_is_watched():
    """A certificate with jump factor 1 holds for any switching, so its thresholds must not assume a dwell time.

    (The firmware has no dwell monitor in that case; ``limited`` once returned the declared dwell time.)
    """
    assert limited({"dwell_add": 5, "dwell_drain": 1, "rho": 1.0, "chatter": 1}) is None
    assert limited({"dwell_add": 1, "dwell_drain": 1, "rho": 2.0, "chatter": 1}) is None
    assert limited({"dwell_add": 5, "dwell_drain": 1, "rho": 2.0, "chatter": 1}) == (5.0, 1)
