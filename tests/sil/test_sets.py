"""Point observers with a residual set: the C is the reference, and the sets hold what they must, rounding included."""

from fractions import Fraction

import numpy as np
import pytest
from helpers.folders import write
from helpers.points import VARIANTS, changed, point_design, random_plant
from sil.test_equal import stimulus

from codegen.algebra import zonotope
from codegen.certify.boxes import BoxDemands
from codegen.host import build
from codegen.observers import PointTrace
from codegen.observers.thresholds import ThresholdObserver
from codegen.observers.zonotope import reduced

LAYOUTS = ("literal", "table", "loop")


@pytest.fixture(scope="module")
def made():
    """One certified design per variant."""
    cache = {}

    def of(name):
        if name not in cache:
            plant, options = VARIANTS[name]
            cache[name] = point_design(random_plant(**plant), **options)
        return cache[name]

    return of


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_c_equals_the_reference(variant, real, made, tmp_path):
    """13 000 samples of every kind: quiet, wild, missing, refused, modes that switch at every sample."""
    design = made(variant)
    t = design.observer.tables[real]
    u, y, q = stimulus(t, np.random.default_rng(len(variant)))
    y[::2] = quiet_outputs(design, u[::2], q[::2], y[::2])
    reference = design.observer.run_many(u, y, q, real)
    assert isinstance(reference, PointTrace) and {0, 1, 3} <= set(np.unique(reference.status))
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.assured.any()
    which = LAYOUTS if variant == "two outputs" else [LAYOUTS[len(variant) % 3]]
    for layout in which:
        driver = build(write(design, tmp_path / layout, real, layout))
        trace = driver.run_many(u, y, q)
        assert trace.differs(reference) == [], layout
        box = {} if isinstance(design.observer, ThresholdObserver) else {"x0_lo": np.full(len(t.box), -0.01),
                                                                 "x0_hi": np.full(len(t.box), 0.3)}
        assert driver.run_many(u[:4], y[:4], q[:4], **box).differs(
            design.observer.run_many(u[:4], y[:4], q[:4], real, **box)) == []


def quiet_outputs(design, u, q, wild):
    """Outputs of the plant itself under mild noise, with the samples that are missing in ``wild``."""
    plant, out = design.plant, wild.copy()
    rng = np.random.default_rng(0)
    for run in range(len(u)):
        x = plant.x0_lo + (plant.x0_hi - plant.x0_lo) * rng.random(plant.n_x)
        for k in range(u.shape[1]):
            m = plant.modes[q[run, k] if 0 <= q[run, k] < plant.n_modes else 0]
            inputs = np.where(np.abs(u[run, k]) <= 0.3, u[run, k], 0.0)
            y = m.C @ x + m.D @ inputs + m.Dv @ (m.v_lo + (m.v_hi - m.v_lo) * rng.random(plant.n_v))
            out[run, k] = np.where(np.abs(wild[run, k]) <= 20.0, y, wild[run, k])
            x = m.A @ x + m.B @ inputs + m.Bw @ (m.w_lo + (m.w_hi - m.w_lo) * rng.random(plant.n_w))
    return out


CHANGES = [("key[k] > key[best]", "key[k] >= key[best]"),
           ("for (uint32_t j = PT_KEPT;", "for (uint32_t j = PT_KEPT + 1U;"),
           ("box[i] = rounding[i]", "box[i] = 0.0F"), ("matrix[i][j] * box[j]", "matrix[j][i] * box[j]"),
           ("s->origin = p;", "s->origin = PT_MODES;"), ("raw |= PT_BIT_TOGETHER", "raw |= 0U"),
           ("radius[i] = spread[o][i]", "radius[i] = 0.0F"), ("noise[q][o]", "noise[q][0U]"),
           ("rho[q][i]", "rho[0][0]")]


TABLE_CHANGES = [("< 3U)", "< 4U)"), ("s->stage++;", "s->stage = 1U;"), ("(PT_ANEW - 1U)", "(PT_ANEW - 2U)"),
                 ("s->since++;", "s->since = 0U;"), ("inside = false", "inside = true"),
                 ("direction[i - PT_NY][j]", "direction[0][j]"),
                 ("return (s->since < PT_ROWS) ? s->since", "return (s->since < 1U) ? 0U")]


BOX_CHANGES = [("next[i] = added[p][o][i]", "next[i] = added[p][0U][i]"), ("size[p][i][k]", "size[p][k][i]"),
               ("s->origin = p;", "s->origin = PT_MODES;"), ("noise[q][o][i]", "noise[q][0U][i]"),
               ("radius[i] = spread[o][i] + ", "radius[i] = "),
               ("<= out->r_bound[i])", "<= (2.0F * out->r_bound[i]))")]


@pytest.mark.parametrize("variant,changes", [("gain on the new output", CHANGES), ("table", TABLE_CHANGES),
                                             ("box", BOX_CHANGES)])
def test_a_mutant_is_noticed(variant, changes, made, tmp_path):
    """A tie, a column, a margin, a transposition, a mode: the comparison above sees each."""
    design = made(variant)
    u, y, q = stimulus(design.observer.tables["float32"], np.random.default_rng(3), runs=40)
    y[::2] = quiet_outputs(design, u[::2], q[::2], y[::2])
    reference = design.observer.run_many(u, y, q)
    folder = write(design, tmp_path / "c", layout="loop")
    text = (folder / "pt.c").read_text()
    assert build(folder).run_many(u, y, q).differs(reference) == []
    for old, new in changes:
        assert old in text, old
        (folder / "pt.c").write_text(text.replace(old, new))
        assert build(folder).run_many(u, y, q).differs(reference), new


def exact_run(plant, steps, rng):
    """The plant in rational arithmetic under corner noise: exact x, and what the firmware reads, as float32."""
    def matrix(a):
        return [[Fraction(float(v)) for v in row] for row in a]

    def times(a, v):
        return [sum((p * q for p, q in zip(row, v)), Fraction(0)) for row in a]

    modes = [{k: matrix(getattr(m, k)) for k in ("A", "B", "C", "D", "Bw", "Dv")} for m in plant.modes]
    x = [Fraction(float(v)) for v in np.where(rng.random(plant.n_x) < 0.5, plant.x0_lo, plant.x0_hi)]
    q = rng.integers(0, plant.n_modes, steps)
    u = np.where(rng.random((steps, plant.n_u)) < 0.5, -0.3, 0.3)
    states, y = [], np.empty((steps, plant.n_y), dtype=np.float32)
    for k in range(steps):
        m, p = modes[q[k]], plant.modes[q[k]]
        w, v = ([Fraction(float(a)) for a in np.where(rng.random(len(lo)) < 0.5, lo, hi)]
                for lo, hi in ((p.w_lo, p.w_hi), (p.v_lo, p.v_hi)))
        inputs = [Fraction(float(a)) for a in u[k]]
        states.append(x)
        exact = [sum(parts) for parts in zip(times(m["C"], x), times(m["D"], inputs), times(m["Dv"], v))]
        y[k] = [float(a) for a in exact]
        x = [sum(parts) for parts in zip(times(m["A"], x), times(m["B"], inputs), times(m["Bw"], w))]
    return u, y, q, states


def lost(trace, states):
    """Samples at which an exact state is outside the bounds that the C gave."""
    return sum(any(not Fraction(float(lo)) <= v <= Fraction(float(hi)) for v, lo, hi in zip(x, a, b))
               for x, a, b in zip(states, trace.x_lo, trace.x_hi))


def without_rounding(design):
    """The same tables without the boxes and factors that hold rounding (of an ellipsoid: without noise as well)."""
    z = design.observer.tables["float32"].shape
    if design.observer.family == "ellipsoid":
        return changed(design, shape={"k": z.k * 0, "kr": z.kr * 0, "H": z.H * 0, "V": z.V * 0,
                                      "spread": z.spread * 0})
    if design.observer.family == "box":
        noise = BoxDemands(design.plant.modes, design.observer.tables["float32"]).columns
        only = {name: np.abs(noise[f].astype(float)).sum(axis=3).astype(np.float32)
                for name, f in (("g", "F"), ("gb", "Fb"), ("rho", "V"))}
        return changed(design, shape=only | {"spread": z.spread * 0})
    return changed(design, shape={"e": z.e * 0, "rho": z.rho * 0, "spread": z.spread - np.float32(0.999) * z.e})


@pytest.mark.parametrize("kind,options", [("luenberger", {"order": 6}), ("tnl", {"order": 6}),
                                          ("tnl", {"set": "ellipsoid"}), ("tnl", {"set": "interval"})])
def test_rounding_is_inside_the_set(kind, options, tmp_path):
    """Noise a millionth of the states: the margins decide. Without them the same run loses states or alarms falsely."""
    plant = random_plant(noise=1e-8, seed=7)
    plant = type(plant)(**{**{f: getattr(plant, f) for f in plant.__dataclass_fields__}, "x0_lo": np.full(3, 0.1),
                           "x0_hi": np.full(3, 0.1)})
    design = point_design(plant, kind, **options)
    bare = without_rounding(design)
    drivers = [build(write(d, tmp_path / name, "float32", "loop")) for name, d in (("sound", design), ("bare", bare))]
    found = np.zeros((2, 2), dtype=int)
    for seed in range(2):
        u, y, q, states = exact_run(plant, 200, np.random.default_rng(seed))
        for i, driver in enumerate(drivers):
            trace = driver.run(u=u, y=y, q=q)
            found[i] += lost(trace, states), int((trace.raw_bits != 0).sum())
    assert found[0].tolist() == [0, 0]
    assert found[1].sum() > 0


def residual_of(plant, t, q, w, v):
    """Residual at the last sample from an exact start; w (K, n_w), v (K, n_v) about their centres."""
    e = -t.N[q[0]] @ plant.modes[q[0]].Dv @ v[0] * 0
    for k, p in enumerate(q[:-1]):
        m, later = plant.modes[p], plant.modes[q[k + 1]]
        T = np.eye(len(e)) - t.N[p] @ m.C
        e = t.M[p] @ e + T @ m.Bw @ w[k] - t.L[p] @ m.Dv @ v[k] - t.N[p] @ later.Dv @ v[k + 1]
    m = plant.modes[q[-1]]
    return m.C @ e + m.Dv @ v[-1]


def worst_noise(plant, t, q, direction):
    """Corners of the noise that push the last residual as far as it goes, by unit responses."""
    zero = np.zeros((len(q), plant.n_w)), np.zeros((len(q), plant.n_v))
    chosen = []
    for which, ends in ((0, ("w_lo", "w_hi")), (1, ("v_lo", "v_hi"))):
        values = np.zeros_like(zero[which])
        for k, i in np.ndindex(values.shape):
            unit = [z.copy() for z in zero]
            unit[which][k, i] = 1.0
            lo, hi = (getattr(plant.modes[q[k]], e)[i] for e in ends)
            values[k, i] = hi if direction @ residual_of(plant, t, q, *unit) > 0 else lo
        chosen.append(values)
    return chosen


def driven(plant, q, w, v):
    """Outputs of the plant from the middle of its initial box, without input."""
    x, y = (plant.x0_lo + plant.x0_hi) / 2, []
    for k, p in enumerate(q):
        m = plant.modes[p]
        y.append(m.C @ x + m.Dv @ v[k])
        x = m.A @ x + m.Bw @ w[k]
    return np.array(y)


def smaller_sets(design):
    """Name and tables of mutants: a generator dropped, thresholds or shapes too small."""
    z = design.observer.tables["float32"].shape
    if design.observer.family == "ellipsoid":
        return {"step": {"H": z.H * np.float32(0.02)}, "residual": {"V": z.V * np.float32(0.02)}}
    if design.observer.family == "box":
        return {"step": {"g": z.g * np.float32(0.5)}, "residual": {"rho": z.rho * np.float32(0.6)},
                "carried": {"P": z.P * np.float32(0.2)}, "output": {"S": z.S * np.float32(0.5)}}
    if design.observer.family == "thresholds":
        return {"thresholds": {"h": z.h * np.float32(0.9)}}
    out = {}
    for name in ("F", "V"):
        for j in range(getattr(z, name).shape[3]):
            out[f"{name}{j}"] = {name: getattr(z, name).copy()}
            out[f"{name}{j}"][name][..., j] = 0
    return out


@pytest.mark.parametrize("kind,options", [
    ("luenberger", {"order": 12}), ("tnl", {"order": 12}), ("tnl", {"set": "ellipsoid"}),
    ("tnl", {"set": "interval"}), ("tnl", {"tables": "dwell", "rows": 8, "stages": 5})])
def test_no_alarm_under_the_worst_noise(kind, options, tmp_path):
    """Corners aligned with the residual at one sample. A generator dropped from the tables, and it alarms falsely."""
    design = point_design(random_plant(seed=9), kind, **options)
    plant = design.plant
    drivers = {"sound": build(write(design, tmp_path / "sound"))}
    for name, shape in smaller_sets(design).items():
        drivers[name] = build(write(changed(design, shape=shape), tmp_path / name))
    runs, rng = [], np.random.default_rng(0)
    for angle in np.linspace(0, np.pi, 12, endpoint=False):
        q = rng.integers(0, plant.n_modes, 14)
        w, v = worst_noise(plant, design.observer.tables["float64"], q, np.array([np.cos(angle), np.sin(angle)]))
        runs.append((driven(plant, q, w, v), q))
    y, q = (np.stack(a) for a in zip(*runs))
    u = np.zeros((*q.shape, plant.n_u))
    alarms = {name: bool(d.run_many(u, y.astype(np.float32), q).raw_bits.any()) for name, d in drivers.items()}
    assert not alarms.pop("sound")
    assert all(alarms.values()), alarms


@pytest.mark.parametrize("variant", ["two outputs", "gain on the new output", "one mode", "table", "table of one mode",
                                     "box", "box, one output"])
def test_surely_detected_faults_are_found(variant, made):
    """Modes as slow as the promise asks, hostile noise: a step of the promised size shows by the promised sample."""
    from codegen.analysis.detectability import surely_detected

    design = made(variant)
    plant, t = design.plant, design.observer.tables["float32"]
    faults = surely_detected(plant, t, design.certificate["float32"], 2)
    rng, checked = np.random.default_rng(5), 0
    for j, fault in enumerate(faults):
        for d, size in enumerate(fault.by_delay):
            if not np.isfinite(size):
                continue
            for _ in range(8):
                q = np.repeat(rng.integers(0, plant.n_modes, 10), 3)  # as the dwell time of the tables
                f = np.zeros((30, plant.n_f))
                f[20:, j] = size * rng.choice([-1.0, 1.0])
                y = noisy(plant, q, f, rng)
                trace = design.observer.run(np.zeros((30, plant.n_u)), y, q)
                assert not trace.raw_bits[:20].any()
                assert trace.raw_bits[20:20 + d + 1].any(), (fault.channel, d)
                checked += 1
    assert checked >= 8


def noisy(plant, q, f, rng):
    """Outputs under corner noise and a fault, from a corner of the initial box, without input."""
    x, y = np.where(rng.random(plant.n_x) < 0.5, plant.x0_lo, plant.x0_hi), []
    for k, p in enumerate(q):
        m = plant.modes[p]
        w, v = (np.where(rng.random(len(lo)) < 0.5, lo, hi) for lo, hi in ((m.w_lo, m.w_hi), (m.v_lo, m.v_hi)))
        y.append(m.C @ x + m.Dv @ v + m.Df @ f[k])
        x = m.A @ x + m.Bw @ w + m.Bf @ f[k]
    return np.array(y)


def test_membership_is_exact_for_two_outputs(made):
    """Against the gauge of the same generators: inside and outside alike, but for the room of the rounding."""
    design = made("two outputs")
    t, run = design.observer.tables["float64"], design.observer
    rng = np.random.default_rng(0)
    H = 0.05 * rng.uniform(-1, 1, (200, 3, t.shape.columns))
    q, origin = rng.integers(0, 3, 200), np.zeros(200, dtype=int)
    sets = [np.concatenate([t.C[a] @ h, t.shape.V[a, 0]], axis=1) for a, h in zip(q, H)]
    r, wanted = rng.uniform(-1, 1, (200, 2)), 1 + 1e-9 * rng.choice([-1.0, 1.0], 200)
    r *= (wanted / [zonotope.gauge(G, x) for G, x in zip(sets, r)])[:, None]
    bound, raw = run.judged(t, q, origin, H, r)
    assert (raw.any(axis=1) == (wanted > 1)).all()
    assert raw[:, 2].sum() > raw[:, :2].any(axis=1).sum()  # the set says more than its hull
    np.testing.assert_allclose(bound, [zonotope.hull(G) for G in sets], rtol=1e-9)


def test_reduction_is_the_algebra_s(made):
    """The same columns as ``algebra.zonotope.reduce``, ties by the lowest index; the compare count is the dossier's."""
    z = made("two outputs").observer.tables["float64"].shape
    rng = np.random.default_rng(1)
    H = rng.integers(-2, 3, (50, 3, z.columns)).astype(float)  # small integers: many ties
    kept, box = reduced(z, H * (1 / np.sqrt(z.weight.astype(float)))[:, None])
    scale = np.sqrt(z.weight.astype(float))
    for i in range(len(H)):
        G = zonotope.reduce(H[i], z.order)
        np.testing.assert_allclose(kept[i] * scale[:, None], G[:, :z.order - 3])
        np.testing.assert_allclose((box[i] - z.e) * scale, np.diag(G[:, z.order - 3:]), atol=1e-9)


def test_nan_alarms(made):
    """A set spoilt by an upset of the memory starts again; a residual that is no number is outside."""
    design = made("two outputs")
    t, run = design.observer.tables["float32"], design.observer
    run.start(t, 1)
    _, raw = run.judged(t, np.zeros(1, int), np.zeros(1, int), run.set, np.full((1, 2), np.nan, np.float32))
    assert raw.all()
    run.phase[:], run.guard.mode[:] = 2, 0
    run.set = np.full_like(run.set, np.nan)
    out = run.empty(t, (1,))
    run.sample(t, np.array([True]), np.array([True]), np.zeros((1, 1), np.float32), np.zeros((1, 2), np.float32),
               np.zeros(1, int), None, out)
    assert np.isfinite(out.r_bound).all() and not out.alarm.any()
