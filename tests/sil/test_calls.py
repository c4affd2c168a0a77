"""The four calls one by one: bytes on refusal, several instances, struct sizes, predict without y."""

import json

import numpy as np
import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import built, compile_, write

from codegen.errors import ToolError
from codegen.host import build

FAMILIES = ("interval", "tnl")


def make(driver):
    return [driver.ffi.new(f"{driver.prefix}_{struct} *") for struct in ("state", "in", "out")]


def call(driver, name, *arguments):
    return getattr(driver.lib, f"{driver.prefix}_{name}")(*arguments)


def fill(given, u, y, mode):
    for i, value in enumerate(u):
        given.u[i] = value
    for i, value in enumerate(y):
        given.y[i] = value
    given.mode = mode


def good(record):
    ranges = record["ranges"]
    return [0.25 * v for v in ranges["u_hi"]], [0.25 * v for v in ranges["y_hi"]]


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("family", FAMILIES)
def test_refusal_changes_no_byte(family, variant, real, tmp_path):
    driver = built(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, "loop")
    record = driver.record
    s, given, out = make(driver)
    assert driver.ffi.sizeof(s[0]) == record["state_bytes"]
    call(driver, "init", s)
    u, y = good(record)
    for k in range(3):
        fill(given, u, y, k % record["n_modes"])
        assert call(driver, "step", s, given, out) == 0
    n_modes, calls = record["n_modes"], []
    for mode in (n_modes, n_modes + 1, 2**31, 2**32 - 1):
        calls += [("step", u, y, mode, 1), ("predict", u, y, mode, 1)]
    for vector, status in (("u", 2), ("y", 3)):
        for i in range(record[f"n_{vector}"]):
            lo, hi = (np.array(record["ranges"][f"{vector}_{side}"][i]).astype(real) for side in ("lo", "hi"))
            inf = np.array(np.inf).astype(real)
            for bad in (np.nextafter(hi, inf), np.nextafter(lo, -inf), inf, -inf, np.nan):
                spoilt = [float(bad) if j == i else v for j, v in enumerate(u if vector == "u" else y)]
                calls.append(("step", *((spoilt, y) if vector == "u" else (u, spoilt)), 0, status))
                if vector == "u":
                    calls.append(("predict", spoilt, y, 0, status))
    # Order of the checks: mode before input before output.
    worst = [float("nan")]
    calls.append(("step", worst * len(u), worst * len(y), n_modes, 1))
    calls += [("step", worst * len(u), worst * len(y), 0, 2)] if u else []
    for name, bad_u, bad_y, mode, status in calls:
        fill(given, bad_u, bad_y, mode)
        before = [bytes(driver.ffi.buffer(p)) for p in (s, given, out)]
        assert call(driver, name, s, given, out) == status
        assert [bytes(driver.ffi.buffer(p)) for p in (s, given, out)] == before
    # The ends of the ranges are within them.
    for side in ("lo", "hi"):
        fill(given, record["ranges"][f"u_{side}"], record["ranges"][f"y_{side}"], n_modes - 1)
        assert call(driver, "step", s, given, out) == 0


@pytest.mark.parametrize("family", FAMILIES)
def test_two_instances_do_not_meet(family, tmp_path):
    """Two states stepped in turn answer as each would alone."""
    design = stand_in(family, prefix="cart", **VARIANTS["guarded"])
    driver = built(design, tmp_path)
    t, rng = design.observer.tables["float32"], np.random.default_rng(0)
    u = rng.uniform(t.u_lo, t.u_hi, (2, 60, 2)).astype(t.dtype)
    y = (rng.uniform(t.y_lo, t.y_hi, (2, 60, 2)) * 0.5).astype(t.dtype)
    q = rng.integers(0, 3, (2, 60))
    alone = driver.run_many(u, y, q)
    (a, given, out), (b, *_) = make(driver), make(driver)
    for state in (a, b):
        call(driver, "init", state)
    for k in range(60):
        for run, state in ((0, a), (1, b)):
            fill(given, u[run, k], y[run, k], int(q[run, k]))
            assert call(driver, "step", state, given, out) == 0
            assert list(out.x_lo) == list(alone.x_lo[run, k]) and list(out.r_hi) == list(alone.r_hi[run, k])
            assert (out.raw, out.alarm, out.latched, bool(out.assured)) == (
                alone.raw_bits[run, k], alone.alarm_bits[run, k], alone.latched_bits[run, k], alone.assured[run, k])


@pytest.mark.parametrize("family", FAMILIES)
def test_predict_reads_no_measurement(family, tmp_path):
    """NaN in y or any other number: the same answer, with zeros where there is nothing to say."""
    driver = built(stand_in(family, prefix="cart", **VARIANTS["guarded"]), tmp_path)
    u, y = good(driver.record)
    answers = []
    for other in (y, [float("nan")] * len(y)):
        s, given, out = make(driver)
        call(driver, "init", s)
        for name, mode, measured in (("step", 0, y), ("predict", 1, other), ("predict", 2, other), ("step", 0, y)):
            fill(given, u, measured, mode)
            assert call(driver, name, s, given, out) == 0
            if name == "predict":
                assert list(out.r_lo) == list(out.r_hi) == [0.0] * len(y) and out.raw == out.alarm == 0
            answers.append((bytes(driver.ffi.buffer(out)), bytes(driver.ffi.buffer(s))))
    half = len(answers) // 2
    assert answers[:half] == answers[half:]


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("family", FAMILIES)
def test_reset_forgets(family, real, tmp_path):
    """After reset nothing of the past is left but the declared ranges."""
    driver = built(stand_in(family, prefix="cart", **VARIANTS["guarded"]), tmp_path, real)
    record = driver.record
    (used, given, out), (fresh, *_) = make(driver), make(driver)
    call(driver, "init", used)
    for k in range(9):
        u, y = good(record)
        fill(given, u, record["ranges"]["y_hi" if k % 2 else "y_lo"], k % 3)
        assert call(driver, "step", used, given, out) == 0
    assert used.latched != 0 and used.too_fast == 1 and out.assured == 0
    call(driver, "reset", used)
    call(driver, "reset", fresh)
    assert bytes(driver.ffi.buffer(used)) == bytes(driver.ffi.buffer(fresh))
    assert list(used.x_lo) == record["ranges"]["x_lo"] and used.latched == 0


@pytest.mark.parametrize("layout", ["literal", "table", "loop"])
def test_any_state_is_survived(layout, tmp_path):
    """Bytes that no call ever wrote (an upset of the memory) read nothing out of bounds: ASan and UBSan are quiet."""
    folder = write(stand_in("tnl", prefix="cart", **VARIANTS["guarded"]), tmp_path, "float32", layout)
    (folder / "upset.c").write_text("""
#include "cart.h"
int main(void)
{
    uint32_t seed = 1U, sum = 0U;
    for (uint32_t n = 0U; n < 20000U; n++) {
        union { cart_state s; unsigned char b[sizeof(cart_state)]; } any;
        cart_in in = { { 0.1F, 0.1F }, { 0.1F, 0.1F }, n % 3U };
        cart_out out;
        for (uint32_t i = 0U; i < sizeof(any.b); i++) {
            seed = (seed * 1664525U) + 1013904223U;
            any.b[i] = (unsigned char)((n % 2U != 0U) ? (seed >> 24) : ((seed >> 24) & (seed >> 16) & 3U));
        }
        sum += (uint32_t)cart_step(&any.s, &in, &out) + (uint32_t)cart_predict(&any.s, &in, &out);
    }
    return (int)sum;
}
""")
    compile_(["gcc", "-std=c99", "-O1", "-g", "-fsanitize=address,undefined,bounds-strict", "-fno-sanitize-recover=all",
              "cart.c", "upset.c", "-o", "upset"], folder)
    compile_(["./upset"], folder)


def test_folders_that_are_not_ours(tmp_path):
    with pytest.raises(ToolError, match=r"resources.json: cannot be read"):
        build(tmp_path)
    (tmp_path / "resources.json").write_text(json.dumps([1]))
    with pytest.raises(ToolError, match="Make the folder with residua generate"):
        build(tmp_path)
    folder = write(stand_in(prefix="cart"), tmp_path / "cart")
    (folder / "cart.c").write_text("int broken(")
    with pytest.raises(ToolError, match="gcc: failed with status 1"):
        build(folder)
