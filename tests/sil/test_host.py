"""The driver: arrays reach the C without copies, what does not fit is named, many runs are as many single ones."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import built

from codegen.analysis.validate import validate
from codegen.designs import read_design
from codegen.errors import PlantError
from codegen.plant.simulate import simulate

GENERATED = Path(__file__).resolve().parents[2] / "generated"
RECORDS = {p.parent.name: json.loads(p.read_text(encoding="ascii")) for p in GENERATED.glob("*/resources.json")}
#: The smallest state of each run-time family, with and without parameters, that has scenarios to simulate: the driver
#: knows families, no plants.
DESIGNS = sorted({(r["family"], r["n_theta"] > 0): name for name, r in sorted(
    RECORDS.items(), key=lambda item: (-item[1]["n_x"], item[0])) if any(
        not s.csv for s in read_design(GENERATED / name).plant.scenarios)}.values())
SEEDS, STEPS = 5, 120
OUTPUTS = ("alarm", "alarm_bits", "latched_bits", "raw_bits", "assured")


def outputs(trace):
    """The arrays that the C writes, its numbers first."""
    return [*trace.numbers(), *(getattr(trace, name) for name in OUTPUTS), *trace.words(), trace.status]


@pytest.fixture(scope="module", params=DESIGNS)
def bench(request, tmp_path_factory):
    """Design, driver, and signals of the C's own types for several seeds of its first simulated scenario."""
    design = read_design(GENERATED / request.param)
    driver = built(design, tmp_path_factory.mktemp(request.param))
    scenario = next(s for s in design.plant.scenarios if not s.csv)
    brief = replace(scenario, steps=min(scenario.steps, STEPS))
    truths = [simulate(design.plant, brief, seed=seed) for seed in range(SEEDS)]
    u, y = (np.stack([getattr(t, name)[:STEPS] for t in truths]).astype(driver.real) for name in "uy")
    y[1, 7] = np.nan  # a missing measurement
    theta = np.stack([t.theta[:STEPS] for t in truths])[:, :, driver.record["theta_columns"]].astype(driver.real)
    return design, driver, u, y, np.stack([t.q[:STEPS] for t in truths]).astype(np.uint32), np.ascontiguousarray(theta)


def passed(driver, call):
    """The addresses that ``call`` hands to the C (NULL is 0), and what it returns."""
    addresses = []

    class Spy:
        def residua_run(self, runs, steps, *pointers):
            addresses.extend(int(driver.ffi.cast("uintptr_t", p)) for p in pointers)

    lib, driver.lib = driver.lib, Spy()
    try:
        return addresses, call()
    finally:
        driver.lib = lib


def address(array):
    return array.ctypes.data if array.size else 0


def test_the_c_reads_and_writes_the_callers_arrays(bench):
    _, driver, u, y, q, theta = bench
    addresses, trace = passed(driver, lambda: driver.run_many(u, y, q, theta=theta))
    own = [address(a) for a in outputs(trace)]
    assert addresses[-len(own):] == own
    reads = [address(u), address(y), address(theta), address(q)]
    assert addresses[:-len(own)] == [*reads, *[0] * (len(addresses) - len(own) - 4)]  # no other initial box: NULL
    addresses, trace = passed(driver, lambda: driver.run(u[2], y[2], q[2], theta[2]))  # a row: contiguous too
    assert addresses[:4] == [address(u[2]), address(y[2]), address(theta[2]), address(q[2])]
    assert addresses[-len(own):] == [address(a) for a in outputs(trace)]
    # The control: what does not fit arrives at another place.
    addresses, _ = passed(driver, lambda: driver.run_many(np.asfortranarray(u), y.astype(float), q.astype(np.int64),
                                                           theta=theta))
    assert not {address(y), address(q)} & set(addresses)


def test_many_runs_equal_single_ones(bench):
    """Seeds in one call, each from its own box: nothing leaks from one run into the next."""
    design, driver, u, y, q, theta = bench
    together = driver.run_many(u, y, q, copy=False, theta=theta)
    assert together.differs(design.observer.run_many(u, y, q, driver.real, theta=theta)) == []
    for i in range(SEEDS):
        assert driver.run(u[i], y[i], q[i], theta[i], copy=False).differs(together.row(i)) == []
    unlike = design.plant.w or design.plant.v or design.plant.theta  # another seed is another run
    assert not unlike or driver.run(u[0], y[0], q[0], theta[0]).differs(together.row(2))
    lo, hi = design.plant.limits("x")
    if driver.family in ("thresholds", "schedule", "blocks", "filter", "polytopic", "descriptor",
                         "bank"):  # only the file's box
        with pytest.raises(ValueError, match="x0_lo, x0_hi: given"):
            driver.run_many(u, y, q, np.tile(lo, (SEEDS, 1)), np.tile(hi, (SEEDS, 1)), theta=theta)
        return
    boxes = np.linspace(0.1, 1.0, SEEDS)[:, None]
    together = driver.run_many(u, y, q, boxes * lo, boxes * hi, theta=theta)
    for i in range(SEEDS):
        assert driver.run(u[i], y[i], q[i], theta[i], boxes[i] * lo, boxes[i] * hi).differs(together.row(i)) == []
    assert together.differs(driver.run_many(u, y, q, theta=theta))


def unaligned(array):
    """The same values, one byte off."""
    raw = np.zeros(array.nbytes + 1, np.uint8)
    out = raw[1:].view(array.dtype).reshape(array.shape)
    out[...] = array
    assert not out.flags.aligned
    return out


def test_what_would_be_copied_is_refused_on_request(bench):
    _, driver, u, y, q, theta = bench
    other = {"float32": "float64", "float64": "float32"}[driver.real]
    expected = driver.run_many(u, y, q, theta=theta)
    for name, wrong, message in (
            ("y", y.astype(other), rf"y: {other}, contiguous \(expected {driver.real}, contiguous"),
            ("y", y.astype(y.dtype.newbyteorder()), "y: >f"),
            ("y", np.repeat(y, 2, axis=1)[:, ::2], f"y: {driver.real}, not contiguous"),
            ("y", unaligned(y), r"y: float.*np\.require\(y, "),
            ("q", q.astype(np.int64), r"q: int64, contiguous \(expected uint32"),
            ("q", np.asfortranarray(q), "q: uint32, not contiguous")):
        given = {"u": u, "y": y, "q": q, "theta": theta} | {name: wrong}
        with pytest.raises(ValueError, match=message):
            driver.run_many(**given, copy=False)
        assert driver.run_many(**given).differs(expected) == []  # else it is converted
    if u.size:
        with pytest.raises(ValueError, match=f"u: {other}, contiguous"):
            driver.run_many(u.astype(other), y, q, copy=False, theta=theta)


def test_what_does_not_fit_is_named(bench):
    _, driver, u, y, q, theta = bench
    with pytest.raises(ValueError, match=r"u: shape \(5, 119, "):
        driver.run_many(u[:, 1:], y, q, theta=theta)
    with pytest.raises(ValueError, match=r"y: shape \(4, 120, "):
        driver.run_many(u, y[1:], q, theta=theta)
    with pytest.raises(ValueError, match="y: shape"):
        driver.run(u[0], y, q[0], theta[0])
    with pytest.raises(ValueError, match=rf"y: shape \(5, {y.shape[2]}, 120\) \(expected \(5, 120, {y.shape[2]}\)\)"):
        driver.run_many(u, y.transpose(0, 2, 1), q, theta=theta)
    with pytest.raises(ValueError, match="q: float64 of shape"):
        driver.run_many(u, y, q.astype(float))
    with pytest.raises(ValueError, match="y: complex128 .expected real numbers"):
        driver.run_many(u, y + 1j * y.astype(float), q)
    with pytest.raises(ValueError, match="y: <U3 .expected real numbers"):
        driver.run_many(u, np.full(y.shape, "0.1"), q)
    if theta.size:
        with pytest.raises(ValueError, match=r"theta: missing \(expected shape \(5, 120, "):
            driver.run_many(u, y, q)
        with pytest.raises(ValueError, match=r"theta: shape \(5, 119, "):
            driver.run_many(u, y, q, theta=theta[:, 1:])


def test_validation_drives_all_scenarios_in_one_call(bench):
    """Scenarios of different lengths side by side answer as each alone; the C is called once."""
    design, driver, *_ = bench
    scenarios = [s for s in design.plant.scenarios if not s.csv][:2]
    design = replace(design, plant=replace(design.plant, scenarios=tuple(scenarios)))
    short = replace(design.plant, scenarios=(replace(scenarios[0], steps=37, fault=()), *scenarios))
    calls, lib = [], driver.lib

    class Spy:
        def residua_run(self, runs, steps, *pointers):
            calls.append((runs, steps))
            lib.residua_run(runs, steps, *pointers)

    driver.lib = Spy()
    try:
        outcomes = validate(replace(design, plant=short), driver, [s.name for s in short.scenarios], seed=3)
    finally:
        driver.lib = lib
    assert calls == [(len(outcomes), max(s.steps for s in scenarios))] and len(outcomes) == len(scenarios) + 1
    for scenario, o in zip(short.scenarios, outcomes):
        truth = simulate(short, scenario, seed=3)
        assert len(o.truth.q) == len(o.trace.status) == scenario.steps and o.passed
        assert o.trace.differs(driver.run(truth.u, truth.y, truth.q, truth.theta)) == []
    names = [scenarios[-1].name]
    assert [o.scenario.name for o in validate(design, driver, names)] == names
    with pytest.raises(PlantError, match='scenario "none"'):
        validate(design, driver, ["none"])
