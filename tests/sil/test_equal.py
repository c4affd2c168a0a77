"""The compiled C and the numpy reference agree with ``==``, bit for bit, whatever comes in."""

import numpy as np
import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import built, write

from codegen.host import build
from codegen.observers import Trace

RUNS, STEPS = 130, 100
LAYOUTS = ("literal", "table", "loop")


def stimulus(t, rng, runs=RUNS, steps=STEPS):
    """Inputs of every kind: quiet, wild, corners of the ranges, missing, refused; modes held or switched at once."""
    def draw(lo, hi, share):
        n = len(lo)
        lo, hi = lo.astype(float), hi.astype(float)
        values = (lo + hi) / 2 + (rng.uniform(-0.5, 0.5, (runs, steps, n)) * (hi - lo)) * rng.random((runs, 1, 1))
        corner = np.where(rng.random(values.shape) < 0.5, lo, hi).astype(t.dtype)
        values = np.where(rng.random((runs, steps, 1)) < 0.05, corner, values.astype(t.dtype))
        factors = np.array([np.inf, -np.inf, 1e30, -1e30, 2.0, -2.0], dtype=t.dtype)
        wrong = factors[rng.integers(0, 6, values.shape)] * hi
        beyond = np.nextafter(hi.astype(t.dtype), np.array(np.inf, t.dtype))
        wrong = np.where(rng.random(values.shape) < 0.3, beyond, wrong)
        return np.where(rng.random(values.shape) < share, wrong, values).astype(t.dtype)

    n_modes = t.A.shape[0]
    u, y = draw(t.u_lo, t.u_hi, 0.004), draw(t.y_lo, t.y_hi, 0.01)
    y[rng.random(y.shape) < 0.01] = np.nan
    y[rng.random(y.shape[:2]) < 0.03] = np.nan
    u[rng.random(u.shape) < 0.001] = np.nan
    held = np.repeat(rng.integers(0, n_modes, (runs, steps // 10 + 1)), 10, axis=1)[:, :steps]
    q = np.where(rng.random((runs, 1)) < 0.5, held, rng.integers(0, n_modes, (runs, steps)))
    bad = np.array([-1, n_modes, 2**31, 2**32 - 1, 2**32, 2**40, -2**40])[rng.integers(0, 7, q.shape)]
    return u, y, np.where(rng.random(q.shape) < 0.004, bad, q)


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("family", ["interval", "tnl"])
def test_every_layout_equals_the_reference(family, variant, real, tmp_path):
    """RUNS x STEPS x 8 variants = 104 000 samples per family, layout and type."""
    design = stand_in(family, prefix="cart", **VARIANTS[variant])
    t = design.observer.tables[real]
    u, y, q = stimulus(t, np.random.default_rng(len(variant)))
    reference = design.observer.run_many(u, y, q, real)
    # The samples reach what they are to test.
    assert {0, 1, 3} <= set(np.unique(reference.status)) and (2 in reference.status) == (u.shape[2] > 0)
    assert reference.raw_bits.any() and not reference.raw_bits.all() and reference.latched_bits.any()
    assert reference.assured.any() and not reference.assured.all()
    for layout in LAYOUTS:
        driver = built(design, tmp_path / layout, real, layout)
        assert (driver.layout, driver.real, driver.prefix, driver.family) == (layout, real, "cart", family)
        trace = driver.run_many(u, y, q)
        assert trace.differs(reference) == [], layout
        assert trace.x_lo.dtype == t.dtype and trace.status.dtype == reference.status.dtype


def test_variants_reach_the_supervisors_branches():
    """Crossed framers, a full bucket, recovery while the alarm lasts, debounced alarms: each happens somewhere."""
    design = stand_in("tnl", prefix="cart", **VARIANTS["guarded"])
    t = design.observer.tables["float32"]
    u, y, q = stimulus(t, np.random.default_rng(7))
    trace = design.observer.run_many(u, y, q)
    debounced = (trace.raw_bits != trace.alarm_bits) & (trace.status == 0)
    assert debounced.any() and trace.alarm.any() and design.observer.guard.too_fast.any()
    crossed = stand_in("interval", **VARIANTS["unequal"]).observer
    trace = crossed.run_many(*stimulus(crossed.tables["float32"], np.random.default_rng(7)))
    assert (trace.raw_bits & 4).any()


@pytest.mark.parametrize("family", ["interval", "tnl"])
def test_a_mutant_is_noticed(family, tmp_path):
    """A sign, an operand, a selection, an offset, a mode: the comparison above sees each."""
    design = stand_in(family, prefix="cart")
    t = design.observer.tables["float32"]
    u, y, q = stimulus(t, np.random.default_rng(3))
    reference = design.observer.run_many(u, y, q)
    source = "s" if family == "tnl" else "out"
    changes = [("lo += (M[q][i][j]", "lo -= (M[q][i][j]"), (f"{source}->x_lo[j]", f"{source}->x_hi[j]"),
               ("[q][i][j] >= 0.0F", "[q][i][j] < 0.0F"), ("common + d_hi[q]", "common - d_hi[q]"),
               ("(L[q][i][j]", "(L[0][i][j]")]
    for number, (old, new) in enumerate(changes):
        folder = write(design, tmp_path / str(number), layout="loop")
        text = (folder / "cart.c").read_text()
        assert old in text
        (folder / "cart.c").write_text(text.replace(old, new))
        assert build(folder).run_many(u, y, q).differs(reference), new


def test_initial_box_and_single_run(tmp_path):
    design = stand_in("tnl", prefix="cart")
    driver = built(design, tmp_path)
    u, y, q = stimulus(design.observer.tables["float32"], np.random.default_rng(1), runs=4)
    box = {"x0_lo": np.array([-0.1, 0.2, 0.3]), "x0_hi": np.array([0.1, 0.7, 0.9])}  # not float32: rounded outward
    assert driver.run_many(u, y, q, **box).differs(design.observer.run_many(u, y, q, **box)) == []
    first = driver.run_many(u, y, q, **box).x_lo[:, 0][q[:, 0] == 0]
    assert (first.astype(float) <= box["x0_lo"]).all()
    alone = driver.run(u=u[0], y=y[0], q=q[0], theta=None)
    assert isinstance(alone, Trace) and alone.differs(design.observer.run(u=u[0], y=y[0], q=q[0])) == []
    assert driver.run(u[0], y[0]).differs(design.observer.run(u[0], y[0])) == []


def test_converts_only_what_does_not_fit(tmp_path):
    """float64, Fortran order, strides, lists and narrow integers give the same numbers as what the C wants."""
    design = stand_in("interval", prefix="cart")
    driver = built(design, tmp_path)
    u, y, q = stimulus(design.observer.tables["float32"], np.random.default_rng(2), runs=4)
    q = np.clip(q, 0, 2)
    expected = driver.run_many(u, y, q)
    for u2, y2, q2 in ((u.astype(float), y.astype(float), q.astype(np.int8)),
                       (np.asfortranarray(u), np.asfortranarray(y), np.asfortranarray(q.astype(np.uint32))),
                       (np.repeat(u, 2, axis=1)[:, ::2], y.tolist(), q.tolist())):
        assert driver.run_many(u2, y2, q2).differs(expected) == []
    with pytest.raises(ValueError, match="u: shape"):
        driver.run_many(u[:, :, :1], y, q)
    with pytest.raises(ValueError, match="y: shape"):
        driver.run_many(u, y[:, 1:], q)
    with pytest.raises(ValueError, match="q: float64"):
        driver.run_many(u, y, q.astype(float))
    with pytest.raises(ValueError, match="q: "):
        driver.run_many(u, y, q[0])
    empty = driver.run_many(u[:, :0], y[:, :0], q[:, :0])
    assert empty.x_lo.shape == (4, 0, 3)
