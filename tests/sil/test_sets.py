"""Point observers with a residual set: the C is the reference, and the sets hold what they must, rounding included."""

from fractions import Fraction

import numpy as np
import pytest
from helpers.folders import built, write
from helpers.points import VARIANTS, changed, in_turn, made, point_design, random_plant
from helpers.set_changes import (
    BASIS_CHANGES,
    BLOCK_CHANGES,
    BOX_CHANGES,
    CHANGES,
    PAIR_CHANGES,
    SCHEDULE_CHANGES,
    TABLE_CHANGES,
    TRACE_CHANGES,
    TURN_CHANGES,
)
from sil.test_equal import stimulus

from codegen.certify.boxes import BoxDemands
from codegen.host import build
from codegen.observers import PointTrace
from codegen.observers.thresholds import ThresholdObserver

TURN = [[1, 0.3, 0], [-0.2, 1, 0.4], [0.1, 0, 0.7]]
LAYOUTS = ("literal", "table", "loop")


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_c_equals_the_reference(variant, real, tmp_path):
    """13 000 samples of every kind: quiet, wild, missing, refused, modes that switch at every sample."""
    design = made(variant)
    t = design.observer.tables[real]
    u, y, q = stimulus(t, np.random.default_rng(len(variant)))
    q = in_turn(design, q, 3)
    y[::2] = quiet_outputs(design, u[::2], q[::2], y[::2])
    reference = design.observer.run_many(u, y, q, real)
    assert isinstance(reference, PointTrace) and {0, 1, 3} <= set(np.unique(reference.status))
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.assured.any()
    which = LAYOUTS if variant == "two outputs" else [LAYOUTS[len(variant) % 3]]
    for layout in which:
        driver = built(design, tmp_path / layout, real, layout)
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
    p = np.where((q >= 0) & (q < plant.n_modes), q, 0)
    inputs = np.where(np.abs(u) <= 0.3, u, 0.0)

    def drawn(side, size):
        lo, hi = (np.array([getattr(m, f"{side}_{end}") for m in plant.modes])[p] for end in ("lo", "hi"))
        return lo + (hi - lo) * rng.random((*p.shape, size))

    def times(name, k, vector):
        return np.einsum("rij,rj->ri", np.array([getattr(m, name) for m in plant.modes])[p[:, k]], vector)

    v, w = drawn("v", plant.n_v), drawn("w", plant.n_w)
    x = plant.x0_lo + (plant.x0_hi - plant.x0_lo) * rng.random((len(u), plant.n_x))
    for k in range(u.shape[1]):
        y = times("C", k, x) + times("D", k, inputs[:, k]) + times("Dv", k, v[:, k])
        out[:, k] = np.where(np.abs(wild[:, k]) <= 20.0, y, wild[:, k])
        x = times("A", k, x) + times("B", k, inputs[:, k]) + times("Bw", k, w[:, k])
    return out


@pytest.mark.parametrize("variant,changes", [("gain on the new output", CHANGES), ("table", TABLE_CHANGES),
                                             ("schedule", SCHEDULE_CHANGES), ("blocks", BLOCK_CHANGES),
                                             ("box", BOX_CHANGES), ("trace", TRACE_CHANGES),
                                             ("box, turned", TURN_CHANGES), ("three outputs", PAIR_CHANGES),
                                             ("other coordinates", BASIS_CHANGES)])
def test_a_mutant_is_noticed(variant, changes, tmp_path):
    """A tie, a column, a margin, a transposition, a mode: the comparison above sees each."""
    design = made(variant)
    u, y, q = stimulus(design.observer.tables["float32"], np.random.default_rng(3), runs=40)
    q = in_turn(design, q, 3)
    y[::2] = quiet_outputs(design, u[::2], q[::2], y[::2])
    y[::4] += np.random.default_rng(4).uniform(-0.06, 0.06, y[::4].shape).astype(y.dtype)  # on either side of the edges
    reference = design.observer.run_many(u, y, q)
    folder = write(design, tmp_path / "c", layout="loop")
    text = (folder / "pt.c").read_text()
    assert build(folder).run_many(u, y, q).differs(reference) == []
    for old, new in changes:
        assert old in text, old
        (folder / "pt.c").write_text(text.replace(old, new))
        assert build(folder).run_many(u, y, q).differs(reference), new


def exact_run(plant, steps, rng, q=None):
    """The plant in rational arithmetic under corner noise: exact x, and what the firmware reads, as float32."""
    def matrix(a):
        return [[Fraction(float(v)) for v in row] for row in a]

    def times(a, v):
        return [sum((p * q for p, q in zip(row, v)), Fraction(0)) for row in a]

    modes = [{k: matrix(getattr(m, k)) for k in ("A", "B", "C", "D", "Bw", "Dv")} for m in plant.modes]
    x = [Fraction(float(v)) for v in np.where(rng.random(plant.n_x) < 0.5, plant.x0_lo, plant.x0_hi)]
    q = rng.integers(0, plant.n_modes, steps) if q is None else q
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
    if design.observer.family == "ellipsoid_trace":
        return changed(design, shape={name: getattr(z, name) * 0 for name in ("k", "kr", "H", "V", "spread")})
    if design.observer.family == "box":
        noise, back = BoxDemands(design.plant.modes, design.observer.tables["float32"]).columns, np.linalg.inv(z.T)
        only = {name: np.abs(turn @ noise[f].astype(float)).sum(axis=3).astype(np.float32)
                for name, f, turn in (("g", "F", back), ("gb", "Fb", back), ("rho", "V", np.eye(2)))}
        return changed(design, shape=only | {"spread": z.spread * 0})
    return changed(design, shape={"e": z.e * 0, "rho": z.rho * 0, "spread": z.spread - np.float32(0.999) * z.e,
                            "inside": z.inside * 0})


@pytest.mark.parametrize("kind,options", [
    ("luenberger", {"order": 6}), ("tnl", {"order": 6}), ("tnl", {"set": "ellipsoid"}), ("tnl", {"set": "interval"}),
    ("tnl", {"set": "interval", "turn": TURN}), ("tnl", {"set": "ellipsoid", "weights": "trace"}),
    ("luenberger", {"order": 6, "reduction": VARIANTS["other coordinates"][1]["reduction"]})])
def test_rounding_is_inside_the_set(kind, options, tmp_path):
    """Noise a millionth of the states: the margins decide. Without them the same run loses states or alarms falsely."""
    plant = random_plant(noise=1e-8, seed=7)
    plant = type(plant)(**{**{f: getattr(plant, f) for f in plant.__dataclass_fields__}, "x0_lo": np.full(3, 0.1),
                           "x0_hi": np.full(3, 0.1)})
    design = point_design(plant, kind, **options)
    bare = without_rounding(design)
    drivers = [built(d, tmp_path / name, "float32", "loop") for name, d in (("sound", design), ("bare", bare))]
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
    if design.observer.family in ("ellipsoid", "ellipsoid_trace"):
        return {"step": {"H": z.H * np.float32(0.02)}, "residual": {"V": z.V * np.float32(0.02)}}
    if design.observer.family == "box":
        return {"step": {"g": z.g * np.float32(0.5)}, "residual": {"rho": z.rho * np.float32(0.6)},
                "carried": {"P": z.P * np.float32(0.2)}, "output": {"S": z.S * np.float32(0.5)}}
    if design.observer.family == "thresholds":
        return {"thresholds": {"h": z.h * np.float32(0.9)}}
    if design.observer.family == "schedule":
        share = np.ones((len(z.h), 1), dtype=np.float32)
        share[-len(z.cycle):] = 0.9
        return {"for ever": {"h": z.h * share}}
    if design.observer.family == "blocks":
        return {"scalars": {"scalars": z.scalars * np.float32(0.8)}, "added": {"pushed": z.pushed * 0}}
    out = {}
    for name in ("F", "V"):
        for j in range(getattr(z, name).shape[3]):
            out[f"{name}{j}"] = {name: getattr(z, name).copy()}
            out[f"{name}{j}"][name][..., j] = 0
    return out


@pytest.mark.parametrize("kind,options", [
    ("luenberger", {"order": 12}), ("tnl", {"order": 12}), ("tnl", {"set": "ellipsoid"}), ("tnl", {"set": "interval"}),
    ("tnl", {"set": "ellipsoid", "weights": "trace"}), ("tnl", {"tables": "dwell", "rows": 8, "stages": 5}),
    ("tnl", {"tables": "schedule", "rows": 6}), ("tnl", {"tables": "arbitrary", "rows": 4, "order": 8})])
def test_no_alarm_under_the_worst_noise(kind, options, tmp_path):
    """Corners aligned with the residual at one sample. A generator dropped from the tables, and it alarms falsely."""
    design = point_design(random_plant(seed=9, schedule=(0, 1, 1, 2, 0, 0)), kind, **options)
    plant = design.plant
    drivers = {"sound": built(design, tmp_path / "sound")}
    for name, shape in smaller_sets(design).items():
        drivers[name] = built(changed(design, shape=shape), tmp_path / name)
    runs, rng = [], np.random.default_rng(0)
    for angle in np.linspace(0, np.pi, 12, endpoint=False):
        q = rng.integers(0, plant.n_modes, 14)
        if design.observer.family == "schedule":
            q = np.resize(plant.switching.schedule, 14)
        w, v = worst_noise(plant, design.observer.tables["float64"], q, np.array([np.cos(angle), np.sin(angle)]))
        runs.append((driven(plant, q, w, v), q))
    y, q = (np.stack(a) for a in zip(*runs))
    u = np.zeros((*q.shape, plant.n_u))
    alarms = {name: bool(d.run_many(u, y.astype(np.float32), q).raw_bits.any()) for name, d in drivers.items()}
    assert not alarms.pop("sound")
    assert all(alarms.values()), alarms


@pytest.mark.parametrize("variant", ["two outputs", "gain on the new output", "one mode", "table", "table of one mode",
                                     "schedule", "blocks", "box", "box, turned", "box, one output", "trace",
                                     "trace, one output"])
def test_surely_detected_faults_are_found(variant):
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
                q = np.resize(plant.switching.schedule, 30) if plant.switching.schedule else q
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
