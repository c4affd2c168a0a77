"""The compiled float32 observer contains the exact state at every sample; seven mutants of it do not.

The plant is simulated in exact rational arithmetic (``exact.py``) under worst-case disturbance and noise,
full inputs and the fastest switching; nothing is compared with a tolerance.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact import GALLERY, Q, campaign, false_alarms, feed, in_ranges, lost
from small_plants import LOPSIDED, SILENT

from codegen.certify.freeze import with_offsets
from codegen.observers import FramerTables
from codegen.observers.framer import open_loop, propagate
from codegen.observers.interval import IntervalObserver
from codegen.observers.tnl import FRESH, FULL, TnlObserver
from codegen.plant.load import loads

PILOTED = ("cart", "emps")  # a full input in one direction would carry them out of their ranges
DWELL = {"relay": (3, 4, 9)}  # its states grow without bound when it is switched at every sample

OWN = {"silent": (SILENT, "interval"), "silent tnl": (SILENT, "tnl-interval"),
       "lopsided": (LOPSIDED.replace("DIRECT", "D = [[0.3], [-0.2]]"), "interval"),
       "lopsided tnl": (LOPSIDED.replace("DIRECT", ""), "tnl-interval")}
CASES = [f"{plant} {method}" for plant, method in GALLERY] + list(OWN)
_RUNS = {}


def case(workshop, name):
    """Design and exact runs of a case, computed once."""
    if name not in _RUNS:
        if name in OWN:
            toml, method = OWN[name]
            # With noise-free gains every criterion is as good as another; these are the quickest.
            design = workshop.text(name.split()[0], toml, method, **{"criterion": "linf", "lambda": 0.3})
        else:
            design = workshop.gallery(*name.split())
        runs = campaign(design.plant, design.observer.tables["float32"], seed=len(name), runs=9,
                        piloted=design.plant.name in PILOTED,
                        **({"styles": DWELL[design.plant.name]} if design.plant.name in DWELL else {}))
        _RUNS[name] = design, runs
    return _RUNS[name]


# -- the house stands ------------------------------------------------------------------------------
@pytest.mark.parametrize("name", CASES)
def test_compiled_float32_contains_the_exact_state(workshop, name):
    design, runs = case(workshop, name)
    assert in_ranges(design.plant, runs), "the runs must keep to what the plant file declares"
    trace = feed(workshop.driver(design), runs)
    assert np.all(trace.status == 0)
    assert lost(runs, trace) == 0
    assert false_alarms(trace) == 0
    # And the mutants below run on the reference, which is the compiled C bit for bit on these very signals.
    assert trace.differs(feed(design.observer, runs)) == []


@pytest.mark.parametrize("name", ["zammali_fd interval", "press tnl-interval", "silent"])
def test_float64_contains_the_exact_state(workshop, name):
    design, _ = case(workshop, name)
    runs = campaign(design.plant, design.observer.tables["float64"], seed=5, runs=3, real="float64")
    trace = feed(workshop.driver(design, "float64"), runs)
    assert lost(runs, trace) == 0 and false_alarms(trace) == 0


@pytest.mark.parametrize("name", CASES)
def test_missing_measurements_are_bridged(workshop, name):
    design, runs = case(workshop, name)
    gappy = [replace(r, y_read=np.where(np.random.default_rng(3).random((len(r.q), 1)) < 0.3, np.nan, r.y_read))
             for r in runs]
    trace = feed(workshop.driver(design), gappy)
    assert np.all(trace.status == 0)
    assert lost(runs, trace) == 0
    with np.errstate(invalid="ignore"):
        assert false_alarms(trace) == 0


@pytest.mark.parametrize("name", [c for c in CASES if "silent" not in c])  # there every gap is rounding
def test_signals_press_against_the_bounds(workshop, name):
    """The runs are no easy ones: some bound is approached to less than 3 % of its distance at rest."""
    design, runs = case(workshop, name)
    trace = feed(design.observer, runs)
    x = np.array([[[float(a) for a in row] for row in r.x] for r in runs])[:, 10:]
    gap = np.minimum(trace.x_hi[:, 10:] - x, x - trace.x_lo[:, 10:])
    width = np.mean(trace.x_hi[:, 10:] - trace.x_lo[:, 10:], axis=(0, 1))
    assert np.min(gap / width) < 0.03


# -- mutants ---------------------------------------------------------------------------------------
def stack(plant, *names):
    return [np.stack([getattr(m, k) for m in plant.modes]) for k in names]


def parts(plant, t, side):
    """Worst noise terms of the offsets as they must be and as (5.2), (5.23) print them, (N, n_x) each."""
    Dv, v_lo, v_hi = stack(plant, "Dv", "v_lo", "v_hi")
    L, N = (np.asarray(getattr(t, k + side), dtype=float) for k in ("L_", "N_"))
    sign = 1 if side == "hi" else -1

    def worst(S, lo, hi):
        return np.einsum("qxv,qv->qx", np.maximum(S, 0), hi) - np.einsum("qxv,qv->qx", np.maximum(-S, 0), lo)

    right, printed = sign * worst(-sign * L @ Dv, v_lo, v_hi), sign * worst(sign * L @ Dv, v_lo, v_hi)
    each = [(sign * worst(-sign * N @ D, lo, hi), sign * worst(sign * N @ D, lo, hi))
            for D, lo, hi in zip(Dv, np.repeat(v_lo[:, None], len(N), 1), np.repeat(v_hi[:, None], len(N), 1))]
    extreme = np.max if side == "hi" else np.min
    return right + extreme([e[0] for e in each], axis=0), printed + extreme([e[1] for e in each], axis=0)


def with_tables(design, t, kind=None):
    return (kind or type(design.observer))({t.real: t}, design.observer.supervision)


def printed_signs(design):
    """(1) ``pos(L Dv) v_hi - neg(L Dv) v_lo`` as printed, margins kept."""
    t, new = design.observer.tables["float32"], {}
    for side in ("hi", "lo"):
        right, printed = parts(design.plant, t, side)
        new["d_" + side] = (getattr(t, "d_" + side) - right + printed).astype("float32")
    return with_tables(design, replace(t, **new))


class CurrentModesN(TnlObserver):
    """(2) The index trap of (5.23): N of the mode of this sample."""

    def _arrive(self, t, measured, y, theta, q):
        p, every = np.minimum(self.guard.mode, t.M_hi.shape[0] - 1), np.arange(len(q))
        mixed = replace(t, **{k + s: getattr(t, k + s)[p] for k in ("M_", "G_", "L_", "d_") for s in ("hi", "lo")},
                        N_hi=t.N_hi[q], N_lo=t.N_lo[q])
        corrected = propagate(mixed, every, self.lo, self.hi, self.u, self.y, y, theta)
        blind = open_loop(t, p, self.lo, self.hi, self.u)
        fresh, full = (self.phase == FRESH)[:, None], ((self.phase == FULL) & measured)[:, None]
        return tuple(np.where(fresh, own, np.where(full, c, b))
                     for own, c, b in zip((self.lo, self.hi), corrected, blind))


def current_n(design):
    return with_tables(design, design.observer.tables["float32"], CurrentModesN)


def no_margin(design):
    """(3) Offsets that would do for real numbers, rounded to nearest."""
    t, new = design.observer.tables["float32"], {}
    Bw, C, w_lo, w_hi = stack(design.plant, "Bw", "C", "w_lo", "w_hi")
    for side, sign in (("hi", 1), ("lo", -1)):
        TBw = Bw - np.asarray(getattr(t, "N_" + side), dtype=float) @ C @ Bw
        drive = np.einsum("qxw,qw->qx", np.maximum(sign * TBw, 0), w_hi)
        drive -= np.einsum("qxw,qw->qx", np.maximum(-sign * TBw, 0), w_lo)
        new["d_" + side] = (sign * drive + parts(design.plant, t, side)[0]).astype("float32")
    return with_tables(design, replace(t, **new))


def not_cooperative(design):
    """(5) One entry of M = T A - L C negative, everything else (G, offsets, margins) consistent with it."""
    plant, t = design.plant, design.observer.tables["float32"]
    m = plant.modes[0]
    i, j = 0, int(np.argmax(np.abs(m.C[0])))
    L = np.array(t.L_hi, dtype=float)
    now = float(t.M_hi[0, i, j])
    L[0, i, 0] += (now + 0.6) / m.C[0, j]
    L = L.astype("float32")
    M, G = np.array(t.M_hi), np.array(t.G_hi)
    T = np.eye(plant.n_x) - np.asarray(t.N_hi[0], dtype=float) @ m.C
    M[0], G[0] = T @ m.A - L[0].astype(float) @ m.C, T @ m.B - L[0].astype(float) @ m.D
    assert M[0, i, j] < -0.5
    return with_tables(design, with_offsets(plant.modes, replace(t, M_hi=M, M_lo=M, L_hi=L, L_lo=L, G_hi=G, G_lo=G)))


def swapped_offsets(design):
    """(6) d_hi := -d_lo and d_lo := -d_hi: no difference where everything is symmetric."""
    t = design.observer.tables["float32"]
    return with_tables(design, replace(t, d_hi=-t.d_lo, d_lo=-t.d_hi))


class CurrentU(TnlObserver):
    """(7) The TNL update with the input of this sample instead of the last one's."""

    def sample(self, t, on, measured, u, y, q, theta, out):
        self.u = u
        super().sample(t, on, measured, u, y, q, theta, out)


def wrong_u(design):
    t = design.observer.tables["float32"]
    if isinstance(design.observer, TnlObserver):
        return with_tables(design, t, CurrentU)
    return with_tables(design, replace(t, G_hi=0 * t.G_hi, G_lo=0 * t.G_lo))


def late(q):
    """(4) Every mode one sample late."""
    return np.concatenate([q[:, :1], q[:, :-1]], axis=1)


MUTANTS = {
    "printed noise signs": (printed_signs, ("lopsided", "lopsided tnl", "press tnl-interval")),
    "N of the current mode": (current_n, ("zammali_fd tnl-interval", "press tnl-interval", "emps tnl-interval")),
    "no rounding margin": (no_margin, ("silent", "silent tnl", "zammali_fd interval")),
    "late mode": (lambda design: design.observer, tuple(" ".join(g) for g in GALLERY)),
    "negative entry in M": (not_cooperative, ("zammali_fd interval", "zammali_fd tnl-interval", "lopsided")),
    "offsets swapped": (swapped_offsets, ("lopsided", "lopsided tnl", "press tnl-interval", "emps tnl-interval")),
    "u of the wrong sample": (wrong_u, tuple(" ".join(g) for g in GALLERY)),
}


@pytest.mark.parametrize(("mutant", "name"), [(m, n) for m, (_, names) in MUTANTS.items() for n in names])
def test_mutant_loses_the_state(workshop, mutant, name):
    design, runs = case(workshop, name)
    q = np.stack([r.q for r in runs])
    observer = MUTANTS[mutant][0](design)
    assert isinstance(observer, IntervalObserver)
    # A mutant may alarm and restart: what counts is that the very assertions above fail.
    trace = feed(observer, runs, q=late(q) if mutant == "late mode" else q)
    assert lost(runs, trace) > 0


@pytest.mark.parametrize("name", CASES)
def test_unmutated_copy_survives(workshop, name):
    """The mutants die of their mutation, not of being copied: offsets rebuilt from the same gains are the same."""
    design, runs = case(workshop, name)
    t = with_offsets(design.plant.modes, design.observer.tables["float32"])
    assert isinstance(t, FramerTables)
    trace = feed(with_tables(design, t), runs)
    assert lost(runs, trace) == 0 and false_alarms(trace) == 0


def test_the_check_itself_is_exact():
    """One unit in the last place outside is outside."""
    third = Q(1) / 3
    assert not Q(np.float32(1 / 3)) <= third <= Q(np.nextafter(np.float32(1 / 3), np.float32(1)))
    assert Q(np.nextafter(np.float32(1 / 3), np.float32(0))) <= third <= Q(np.float32(1 / 3))
    assert loads(SILENT, "silent").n_w == 0
