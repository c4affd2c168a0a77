"""Polytopic observers: the C equals the reference bit by bit, refuses what it must, and its weights are the model's."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.descriptors import made, sampled
from helpers.folders import CLANG, CXX, GCC, built, compile_, write
from helpers.scripts import load as script
from helpers.tools import need

from codegen.analysis.validate import validate
from codegen.designs import Design
from codegen.emit.cprint import count_operations
from codegen.emit.polytopic_parts import steps
from codegen.errors import EmitError
from codegen.host import build
from codegen.observers import PolytopicObserver, Supervision
from codegen.observers.polytopic_step import evaluate
from codegen.plant.load import gallery_names, load, loads
from codegen.plant.simulate import simulate
from codegen.plant.weight_program import weight_program
from codegen.selection.polytopic_tables import limited, tables_of
from codegen.synthesis.descriptor_gains import StandardGains

need("gcc")
POLYTOPIC = [name for name in gallery_names() if load(name).polytope is not None]
REALS = ["float32", "float64"]


def stand_in(plant, *reals: str, size: float = 1.0, room: float = 5.0) -> Design:
    """A design whose constants mean nothing; T2 lets the outputs through, so that they choose the estimate."""
    p = plant.polytope
    h, n, n_y, n_u = len(p.vertices), plant.n_x, plant.n_y, plant.n_u
    tables = {}
    for real in reals:
        rng = np.random.default_rng(4)
        F = size * rng.uniform(-0.2, 0.2, (h, n, n)) * (rng.random((h, n, n)) < 0.7)
        F[:, 0] = F[0, 0]  # a row that all vertices share
        G, K = rng.uniform(-1, 1, (h, n, n_u)), rng.uniform(-0.05, 0.05, (h, n, n_y))
        G[:, 0], K[:, 0], K[0, 1], G[:, 1] = G[0, 0], K[0, 0], 0.0, 1.0
        gains = StandardGains(*(M.astype(real).astype(float) for M in (p.C.T, F, G, K, p.C)))
        t = tables_of(plant, gains, rng.uniform(0.5, 1, (n_y, n_y)).astype(real).astype(float), real)
        t = limited(plant, t, np.eye(n), room * np.ones(n))
        size_y = (np.abs(t.y_hi) + 1).astype(real)
        tables[real] = replace(t, h=np.array([0.4 * size_y, 0.2 * size_y, 0.1 * size_y], real), shift=1, start=0)
    plant = replace(plant, target=replace(plant.target, prefix="obs", real=reals[0]))
    return Design(plant, "descriptor-uncertain", PolytopicObserver(tables, Supervision(debounce=(2, 3), recover=4)),
                  {r: {"kind": "polytopic"} for r in tables}, {r: ["nothing: constants of a test"] for r in tables},
                  {r: [] for r in tables})


def stimulus(t, rng, runs=20, steps=60):
    """Inputs of every kind: quiet, wild, the ends of the ranges, missing, refused."""
    def draw(lo, hi, share):
        lo, hi = lo.astype(float), hi.astype(float)
        size = rng.choice([0.02, 0.2, 1.0], (runs, 1, 1))
        values = (lo + hi) / 2 + size * rng.uniform(-0.5, 0.5, (runs, steps, len(lo))) * (hi - lo)
        values = np.where(rng.random(values.shape) < 0.02, np.where(rng.random(values.shape) < 0.5, lo, hi), values)
        wrong = np.array([np.inf, -np.inf, 1e30, 2.0, -2.0])[rng.integers(0, 5, values.shape)] * hi
        return np.where(rng.random(values.shape) < share, wrong, values).astype(t.dtype)

    u, y = draw(t.u_lo, t.u_hi, 0.004), draw(t.y_lo, t.y_hi, 0.01)
    y[rng.random(y.shape[:2]) < 0.05] = np.nan
    u[rng.random(u.shape) < 0.002] = np.nan
    theta = rng.uniform(t.theta_lo * 0.97, t.theta_hi * 1.03, (runs, steps, len(t.columns))).astype(t.dtype)
    return u, y, np.zeros((runs, steps), int), theta


def equal(design, folder, real="float32", settles: bool = True) -> bool:
    """Whether C and reference answer the same, to the last bit; the inputs reach every answer."""
    t = design.observer.tables[real]
    u, y, q, theta = stimulus(t, np.random.default_rng(len(t.C)))
    trace = design.observer.run_many(u, y, q, real, theta=theta)
    expected = {0, 2, 3} | ({4} if t.columns else set())
    assert set(np.unique(trace.status)) == expected and trace.raw_bits.any() and trace.assured.any()
    assert not settles or 0 < trace.settled.mean() < 1
    return build(folder).run_many(u, y, q, theta=theta).differs(trace) == []


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", POLYTOPIC)
def test_the_weights_are_those_of_the_model(name, real, tmp_path):
    """Every polytopic plant of the gallery, far beyond its ranges too; and the C computes the same bits."""
    plant = load(name)
    rng, p = np.random.default_rng(0), plant.polytope
    program = weight_program(replace(p, known=()), real)
    lo, hi = (np.concatenate(v) for v in zip(plant.limits("x"), plant.limits("u")))
    points = rng.uniform(lo, hi, (120, len(lo))).astype(real)
    points[80:] = rng.uniform(3 * lo - 2 * hi, 3 * hi - 2 * lo, (40, len(lo)))
    h = np.array(evaluate(program, list(points.T), real)).T
    for k, (row, point) in enumerate(zip(h, points.astype(float))):
        expected, inside = p.weights(point[:plant.n_x], point[plant.n_x:])
        assert np.abs(row[:-1] - expected).max() <= (2e-5 if real == "float32" else 1e-12)
        assert row[-1] == inside or k >= 80
        assert abs(row[:-1].sum() - 1) < 1e-5 and row[:-1].min() >= 0
    design = stand_in(plant, real)
    assert equal(design, write(design, tmp_path, real), real)


def test_a_division_by_zero_is_out_of_range_and_no_crash():
    """The bioreactor's km1 IpH/(ks1 + cod) at cod = -ks1; NaN and infinity too."""
    plant = load("bioreactor")
    program = weight_program(plant.polytope, "float32")
    assert program.count("div") == 1
    point = np.array([[0.5, -0.5, 0, 1.8, 0.4, 2], [0.5, np.nan, 0, 1.8, 0.4, 2], [0.5, np.inf, 0, 1.8, 0.4, 2],
                      [0.5, 0.3, 0, 1.8, 0.4, 2]], dtype=np.float32)
    with np.errstate(all="ignore"):
        *h, inside = evaluate(program, list(point.T), np.float32)
    assert inside.tolist() == [False, False, False, True]
    assert np.array(h).min() >= 0 and np.abs(np.array(h).sum(axis=0) - 1).max() < 1e-6


def test_an_observer_that_would_grow_is_cut_alike(tmp_path):
    """No certified one does; z stays within its limits, and every cut starts the table of thresholds anew."""
    design = stand_in(load("bioreactor"), "float32", size=1e30)
    assert equal(design, write(design, tmp_path), settles=False)
    t = design.observer.tables["float32"]
    assert np.all((design.observer.z >= t.z_lo) & (design.observer.z <= t.z_hi))
    assert np.any((design.observer.z == t.z_lo) | (design.observer.z == t.z_hi))


def test_weights_that_are_no_weights_are_told_and_replaced():
    text = load("dlpv").text.replace('"exp(-0.5*((x1 + 0.4)/0.5)**2)"', '"max(0.5 - x1, 0)"')
    text = text.replace('"exp(-0.5*((x1 - 0.4)/0.1)**2)"', '"max(0.9 + x1, 0)"')
    text = text.replace('"exp(-0.5*((x1 - 1)/0.5)**2)"', '"0*x1"').replace('range = [-1, 1] }', 'range = [-0.5, 0.4] }')
    program = weight_program(loads(text).polytope, "float64")
    x1 = np.array([0.0, 0.2, np.inf, np.nan])
    zero = np.zeros(4)
    with np.errstate(all="ignore"):
        *h, inside = evaluate(program, [x1, zero, zero, zero], np.float64)
    assert inside.tolist() == [True, True, False, False]
    assert np.allclose(np.array(h)[:, 1], [0.3 / 1.4, 1.1 / 1.4, 0]) and np.all(np.array(h)[:, 2:] == 1 / 3)


@lru_cache
def mutated():
    """A stand-in of the academic example, which has it all: exponentials, a weight of the residual, votes."""
    return stand_in(load("dlpv"), "float32", room=-0.4)


MUTANTS = [("h[1] * v[1]", "h[0] * v[1]"), ("s->y[i] = in->y[i];", ""), ("expf(", "sinf("),
           ("s->z[i] = most[i];", "s->z[i] = least[i];"), ("if (anew || (!kept))", "if (!kept)"),
           ("if (anew || (!kept))", "if (anew)"), ("again && (out->raw == 0U)", "again"),
           ("if (!inside)", "if (inside)"), ("s->run = 1U;", ""), ("s->since >> 1U", "s->since >> 2U")]


@pytest.mark.parametrize("old, new", MUTANTS)
def test_a_mutant_of_the_c_is_noticed(old, new, tmp_path):
    design = mutated()
    folder = write(design, tmp_path)
    text = (folder / "obs.c").read_text()
    assert old in text
    (folder / "obs.c").write_text(text.replace(old, new, 1))
    assert not equal(design, folder)


@pytest.mark.parametrize("name, real", [("disc", "float64"), ("dlpv", "float32")])
def test_designs_keep_their_promise_on_the_c(name, real, tmp_path):
    """C == reference, and no false alarm at the ends of disturbance and noise; all scenarios: residua run."""
    design = made(name)
    runs = tuple(replace(s, name=f"run {k}", w="corner", v="corner", steps=60)
                 for k, s in enumerate([design.plant.scenarios[0]] * 2))
    driver = built(design, tmp_path, real)
    for o in validate(replace(design, plant=replace(design.plant, scenarios=runs)), driver):
        assert o.passed and o.trace.assured.all() and o.trace.inside.all()


def test_a_threshold_that_is_too_low_is_found_out(tmp_path):
    """The same runs, thresholds a tenth: false alarms."""
    design = made("dlpv")
    tables = {r: replace(t, h=t.h / 60) for r, t in design.observer.tables.items()}
    design = replace(design, observer=PolytopicObserver(tables, design.observer.supervision))
    short = replace(design.plant, scenarios=(replace(design.plant.scenarios[1], steps=60),))
    corner = validate(replace(design, plant=short), built(design, tmp_path))[0]
    assert corner.false_alarms > 0 and not corner.differences


def test_faults_of_the_disc_are_found(tmp_path):
    design = made("disc")
    given = enumerate(design.plant.scenarios[1].fault)
    faults = tuple(replace(f, start=20 + 40 * k, stop=40 + 40 * k) for k, f in given)
    short = replace(design.plant, scenarios=(replace(design.plant.scenarios[1], steps=120, fault=faults),))
    outcome = validate(replace(design, plant=short), built(design, tmp_path))[0]
    assert [e.delay for e in outcome.episodes] == [0, 0] and outcome.passed


@lru_cache
def simulated(name: str):
    plant = load(name)
    return simulate(plant, replace(plant.scenarios[0], steps=150), seed=2)


def test_inconsistent_starts_do_no_harm():
    """The printed x3(0) = -1 contradicts the algebraic equation: the first measurement brings what is algebraic."""
    design = made("dlpv")
    plant = design.plant
    truth = simulated("dlpv")
    x0 = (plant.x0_lo + plant.x0_hi) / 2
    assert np.abs(x0 - truth.x[0]).max() > 0.2
    trace = design.observer.run(truth.u, truth.y)
    error = np.abs(trace.x_hat - truth.x)
    assert error[0].max() < 0.3 * np.abs(x0 - truth.x[0]).max() and error[100:].max() < 0.1
    assert trace.inside.all() and np.abs(trace.r - (truth.y - trace.x_hat @ plant.polytope.C.T)).max() < 1e-5


@pytest.mark.parametrize("name", ["disc", "dlpv"])
def test_the_estimate_follows_a_continuous_plant_with_a_held_input(name):
    """A check of the whole way, model, weights, Euler steps, against the simulated plant: no bound, but a figure."""
    design = made(name)
    truth = simulated(name)
    error = np.sqrt(np.mean((design.observer.run(truth.u, truth.y).x_hat - truth.x)[100:] ** 2, axis=0))
    assert np.all(error < 0.03 * np.maximum(*np.abs(design.plant.limits("x"))))


def test_compilers_and_misra_find_nothing(tmp_path):
    """Of the design with functions of the libm; the others are committed (tests/emit)."""
    need("gcc", "clang", "g++", "clang-tidy-19", "cppcheck")
    folder = write(made("dlpv"), tmp_path)
    for compiler, flags in (("gcc", GCC), ("clang", CLANG), ("g++", CXX)):
        compile_([compiler, *flags, "-O2", "-c", "dlpv.c", "-o", "obs.o"], folder)
    assert set(compile_(["nm", "-u", "obs.o"], folder).split()) - {"U"} == {"expf"}
    assert script("analyse").unlisted(folder) == []
    refused = subprocess.run(["gcc", "-std=c99", "-ffast-math", "-c", "dlpv.c"], cwd=folder, capture_output=True,
                             text=True, check=False)
    assert "#error" in refused.stderr


def test_the_step_is_cheaper_than_the_form_that_blends_first():
    """91 multiply-adds, 3 exponentials, 1 division for n = 3, p = 2, h = 3 (dossier); here the vertices act first."""
    plant, rng = load("dlpv"), np.random.default_rng(3)
    shapes = {"T2": (3, 2), "F": (3, 3, 3), "G": (3, 3, 1), "K": (3, 3, 2)}  # no entry is zero, one or shared
    gains = StandardGains(**{k: rng.normal(size=shape).astype("float32").astype(float) for k, shape in shapes.items()},
                          C=np.array([[1.0, 1, 1], [1, 0, 1]]))
    t = tables_of(replace(plant, y=plant.y[:2]), gains, np.eye(2), "float32")
    _, parts = steps(t)
    counts = [count_operations(terms) for key in parts for terms in parts[key]]
    assert sum(c[0] for c in counts) <= 69 and max(map(sum, zip(*counts))) <= 75
    assert (t.weights.count("exp"), t.weights.count("div")) == (3, 1)


def test_what_cannot_be_printed_is_refused():
    plant, (found, _) = load("dlpv"), sampled("dlpv")
    gains = replace(found.gains, T2=found.gains.T2 + 1e-12)
    with pytest.raises(EmitError, match="no float32"):
        tables_of(plant, gains, np.eye(3), "float32")


def test_measured_parameters_schedule_too(tmp_path):
    """Weights of a parameter: range checked, read by the weights, no libm."""
    text = load("dlpv").text.replace('w = [{', 'theta = [{ name = "speed", bounds = [1, 3] }]\nw = [{', 1)
    for old, new in (('"exp(-0.5*((x1 + 0.4)/0.5)**2)"', '"3 - speed"'),
                     ('"exp(-0.5*((x1 - 0.4)/0.1)**2)"', '"speed - 1"'),
                     ('"exp(-0.5*((x1 - 1)/0.5)**2)"', '"(speed - 1)*(3 - speed)/sqrt(speed)"')):
        assert old in text
        text = text.replace(old, new)
    design = stand_in(loads(text), "float32")
    assert equal(design, write(design, tmp_path))
