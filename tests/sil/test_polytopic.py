"""Polytopic observers: the C equals the reference bit by bit, refuses what it must, and its weights are the model's."""

from __future__ import annotations

import ctypes
import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers.descriptors import sampled
from helpers.folders import CLANG, CXX, GCC, compile_
from helpers.scripts import load as script
from helpers.tools import need

from codegen.descriptors import CertifiedObserver
from codegen.emit.cprint import count_operations
from codegen.emit.polytopic_parts import steps, view
from codegen.emit.render import render
from codegen.errors import EmitError
from codegen.observers.polytopic import BAD_INPUT, BAD_OUTPUT, BAD_PARAMETER, OK, PolytopicObserver, evaluate
from codegen.plant.load import gallery_names, load, loads
from codegen.plant.simulate import simulate
from codegen.plant.weight_program import weight_program
from codegen.polytopic_firmware import print_c, tables_of
from codegen.synthesis.descriptor_gains import StandardGains

need("gcc")
POLYTOPIC = [name for name in gallery_names() if load(name).polytope is not None]
DESIGNED = ["disc", "dlpv"]
REALS = ["float32", "float64"]


def designed(name: str, real: str = "float32"):
    """The gallery plant and its sampled observer."""
    return load(name), sampled(name, real)[0]


def stand_in(plant, real: str):
    """An observer whose constants mean nothing; T2 lets the outputs through, so that they choose the estimate."""
    p, rng = plant.polytope, np.random.default_rng(4)
    h, n, n_y, n_u = len(p.vertices), plant.n_x, plant.n_y, plant.n_u
    F = rng.uniform(-0.2, 0.2, (h, n, n)) * (rng.random((h, n, n)) < 0.7)
    F[:, 0] = F[0, 0]  # a row that all vertices share
    G, K = rng.uniform(-1, 1, (h, n, n_u)), rng.uniform(-0.05, 0.05, (h, n, n_y))
    G[:, 0], K[:, 0], K[0, 1], G[:, 1] = G[0, 0], K[0, 0], 0.0, 1.0
    gains = StandardGains(*(M.astype(real).astype(float) for M in (p.C.T, F, G, K, p.C)))
    return CertifiedObserver(gains, 1.0, 1.0, {"time": "discrete"}, ["nothing: constants of a test"])


class Compiled:
    """The C of an observer as a library, driven sample by sample."""

    def __init__(self, files: dict[str, str], folder, tables, flags=("-O2",), compiler="gcc"):
        self.folder, self.t = folder, tables
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii")
        prefix = next(name[:-2] for name in files if name.endswith(".c"))
        compile_([compiler, "-std=c99", "-ffp-contract=off", *flags, "-fPIC", "-shared", f"{prefix}.c", "-o", "o.so",
                  "-lm"], folder)
        real = ctypes.c_float if tables.real == "float32" else ctypes.c_double
        n, p, m = tables.C.shape[1], len(tables.C), tables.G.shape[2]

        def struct(**members):
            return type("S", (ctypes.Structure,), {"_fields_": [(k, v) for k, v in members.items() if v]})

        theta = len(tables.theta_lo)
        self.In = struct(u=real * m if m else None, y=real * p, theta=real * theta if theta else None)
        self.Out = struct(x_hat=real * n, r=real * p, h=real * len(tables.F), inside=ctypes.c_uint32,
                          spare=ctypes.c_uint32 if tables.real == "float64" else None)
        self.State = struct(z=real * n, y=real * p)
        library = ctypes.CDLL(str(folder / "o.so"))
        self.init, self.step, self.predict = (getattr(library, f"{prefix}_{f}") for f in ("init", "step", "predict"))

    def run(self, u, y, theta=None):
        """As the reference does; every refusal must leave the bytes of state and answer alone."""
        s, out, answers = self.State(), self.Out(), []
        self.init(ctypes.byref(s))
        for k in range(len(y)):
            given = self.In()
            for name, values in (("u", u), ("y", y), ("theta", theta)):
                if hasattr(given, name):
                    getattr(given, name)[:] = values[k].tolist()
            missing = np.isnan(y[k]).any()
            before = bytes(s), bytes(out)
            status = (self.predict if missing else self.step)(ctypes.byref(s), ctypes.byref(given), ctypes.byref(out))
            assert status == OK or (bytes(s), bytes(out)) == before
            answers.append((status, *(np.array(getattr(out, name)[:]) for name in ("x_hat", "r", "h")), out.inside))
        return [np.array(a) for a in zip(*answers)], np.array(s.z[:])


def equal(compiled: Compiled, u, y, theta=None) -> bool:
    """Whether C and reference answer the same, to the last bit."""
    u, y = (np.asarray(v, compiled.t.real) for v in (u, y))
    trace = PolytopicObserver(compiled.t).run_many(u[None], y[None], None if theta is None else theta[None])
    (status, *numbers, inside), z = compiled.run(u, y, theta)
    on = status == OK
    assert np.array_equal(status, trace.status[0])
    pairs = [*zip(numbers, (trace.x_hat[0], trace.r[0], trace.h[0])), (inside.astype(bool), trace.inside[0])]
    return all(np.array_equal(a[on], b[on], equal_nan=True) for a, b in pairs) and np.array_equal(
        z, trace.z[0], equal_nan=True)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", DESIGNED)
def test_the_c_equals_the_reference_on_the_plant(name, real, tmp_path):
    plant, found = designed(name, real)
    compiled = Compiled(print_c(plant, found, real, "obs"), tmp_path, tables_of(plant, found, real))
    for scenario in plant.scenarios[:2]:
        truth = simulate(plant, replace(scenario, steps=60), seed=1)
        y = truth.y.copy()
        y[10:12], y[5] = np.nan, 1e6  # messages lost, a measurement beyond its range
        u = truth.u.copy()
        u[7] = np.nan
        assert equal(compiled, u, y)
    assert compiled.run(u, y)[0][0][[5, 7, 10]].tolist() == [BAD_OUTPUT, BAD_INPUT, OK]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", POLYTOPIC)
def test_the_weights_are_those_of_the_model(name, real, tmp_path):
    """Every polytopic plant of the gallery, far beyond its ranges too; and the C computes the same bits."""
    plant = load(name)
    t = tables_of(plant, stand_in(plant, real), real)
    wide = {f"{v}_{end}": np.full(len(getattr(t, f"{v}_{end}")), sign * 1e6) for v in ("u", "y")
            for end, sign in (("lo", -1), ("hi", 1))}
    t = replace(t, **wide)
    rng, p = np.random.default_rng(0), plant.polytope
    lo, hi = (np.concatenate(v) for v in zip(plant.limits("x"), plant.limits("u")))
    points = rng.uniform(lo, hi, (120, len(lo))).astype(real)
    points[80:] = rng.uniform(3 * lo - 2 * hi, 3 * hi - 2 * lo, (40, len(lo)))
    h = np.array(evaluate(t.weights, list(points.T), real)).T
    for k, (row, point) in enumerate(zip(h, points.astype(float))):
        expected, inside = p.weights(point[:plant.n_x], point[plant.n_x:])
        assert np.abs(row[:-1] - expected).max() <= (2e-5 if real == "float32" else 1e-12)
        assert row[-1] == inside or k >= 80
        assert abs(row[:-1].sum() - 1) < 1e-5 and row[:-1].min() >= 0
    view_ = view(plant, t, ["nothing"], "obs", "test")
    files = {f"obs.{end}": render(f"polytopic.{end}.jinja", d=view_) for end in "ch"}
    y = rng.uniform(-1, 1, (100, plant.n_y)) * np.geomspace(0.1, 1e5, 100)[:, None]
    y[::17, -1] = 0.0
    y[40:43] = np.nan
    assert equal(Compiled(files, tmp_path, t), rng.uniform(-1, 1, (100, plant.n_u)), y)


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


@pytest.mark.parametrize("name", ["bioreactor", "dlpv"])
def test_an_observer_that_overflows_is_told_alike(name, tmp_path):
    """No certified one does; comparisons with NaN and infinity must still be those of the C."""
    plant = load(name)
    found = stand_in(plant, "float32")
    found = replace(found, gains=replace(found.gains, F=64 * found.gains.F))
    compiled = Compiled(print_c(plant, found, "float32", "obs"), tmp_path, tables_of(plant, found, "float32"))
    (lo, hi), (first, last) = plant.limits("y"), plant.limits("u")
    y, u = np.tile((lo + hi) / 2, (60, 1)), np.tile((first + last) / 2, (60, 1))
    assert equal(compiled, u, y)
    (_, x_hat, _, h, inside), _ = compiled.run(u.astype("float32"), y.astype("float32"))
    assert np.isnan(x_hat[-1]).any() and not inside[-1] and abs(h[-1].sum() - 1) < 1e-6


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


MUTANTS = [("h[1] * v[1]", "h[0] * v[1]"), ("x_hat[0] = s->z[0]", "x_hat[0] = -s->z[0]"),
           ("s->y[i] = in->y[i];", ""), ("expf(", "sinf("), ("r[0] = y[0] -", "r[0] = y[0] +"),
           ("s->z[2] = (h[0]", "s->z[1] = (h[0]")]


@pytest.mark.parametrize("old, new", MUTANTS)
def test_a_mutant_of_the_c_is_noticed(old, new, tmp_path):
    plant, found = designed("dlpv")
    files = print_c(plant, found, "float32", "obs")
    assert old in files["obs.c"]
    files["obs.c"] = files["obs.c"].replace(old, new, 1)
    truth = simulate(plant, replace(plant.scenarios[1], steps=60), seed=1)
    y = truth.y.copy()
    y[30:33] = np.nan
    assert not equal(Compiled(files, tmp_path, tables_of(plant, found, "float32")), truth.u, y)


def test_inconsistent_starts_do_no_harm():
    """The printed x3(0) = -1 contradicts the algebraic equation: the first measurement brings what is algebraic."""
    plant, found = designed("dlpv")
    truth = simulate(plant, replace(plant.scenarios[0], steps=150), seed=2)
    t = tables_of(plant, found, "float32")
    x0 = (plant.x0_lo + plant.x0_hi) / 2
    assert np.abs(x0 - truth.x[0]).max() > 0.2
    trace = PolytopicObserver(t).run_many(truth.u[None], truth.y[None])
    error = np.abs(trace.x_hat[0] - truth.x)
    assert error[0].max() < 0.3 * np.abs(x0 - truth.x[0]).max() and error[100:].max() < 0.1
    assert trace.inside.all() and np.abs(trace.r[0] - (truth.y - trace.x_hat[0] @ plant.polytope.C.T)).max() < 1e-5


@pytest.mark.parametrize("name", DESIGNED)
def test_the_estimate_follows_a_continuous_plant_with_a_held_input(name):
    """A check of the whole way, model, weights, Euler steps, against the simulated plant: no bound, but a figure."""
    plant, found = designed(name)
    truth = simulate(plant, replace(plant.scenarios[0], steps=200), seed=3)
    trace = PolytopicObserver(tables_of(plant, found, "float32")).run_many(truth.u[None], truth.y[None])
    error = np.sqrt(np.mean((trace.x_hat[0] - truth.x)[100:] ** 2, axis=0))
    assert np.all(error < 0.03 * np.maximum(*np.abs(plant.limits("x"))))


@pytest.mark.parametrize("name, real", [("disc", "float64"), ("dlpv", "float32")])
def test_compilers_and_misra_find_nothing(name, real, tmp_path):
    need("gcc", "clang", "g++", "clang-tidy-19", "cppcheck")
    plant, found = designed(name, real)
    for file, text in print_c(plant, found, real, "obs").items():
        (tmp_path / file).write_text(text, encoding="ascii")
    (tmp_path / "resources.json").write_text(json.dumps({"prefix": "obs"}))
    for compiler, flags in (("gcc", GCC), ("clang", CLANG), ("g++", CXX)):
        compile_([compiler, *flags, "-O2", "-c", "obs.c", "-o", "obs.o"], tmp_path)
    needed = set(compile_(["nm", "-u", "obs.o"], tmp_path).split()) - {"U"}
    assert needed == ({"expf"} if name == "dlpv" else set())
    assert name == "disc" or script("analyse").unlisted(tmp_path) == []
    refused = subprocess.run(["gcc", "-std=c99", "-ffast-math", "-c", "obs.c"], cwd=tmp_path, capture_output=True,
                             text=True, check=False)
    assert "#error" in refused.stderr


def test_the_step_is_cheaper_than_the_form_that_blends_first():
    """91 multiply-adds, 3 exponentials, 1 division for n = 3, p = 2, h = 3 (dossier); here the vertices act first."""
    plant, rng = load("dlpv"), np.random.default_rng(3)
    shapes = {"T2": (3, 2), "F": (3, 3, 3), "G": (3, 3, 1), "K": (3, 3, 2)}  # no entry is zero, one or shared
    gains = StandardGains(**{k: rng.normal(size=shape).astype("float32").astype(float) for k, shape in shapes.items()},
                          C=np.array([[1.0, 1, 1], [1, 0, 1]]))
    found = CertifiedObserver(gains, 1.0, 1.0, {"time": "discrete"}, ["nothing: constants of a test"])
    t = tables_of(replace(plant, y=plant.y[:2]), found, "float32")
    _, parts = steps(t)
    counts = [count_operations(terms) for key in parts for terms in parts[key]]
    assert sum(c[0] for c in counts) <= 69 and max(map(sum, zip(*counts))) <= 75
    assert (t.weights.count("exp"), t.weights.count("div")) == (3, 1)


def test_what_cannot_be_printed_is_refused():
    plant, found = designed("dlpv")
    with pytest.raises(EmitError, match="continuous time"):
        tables_of(plant, replace(found, proof={"time": "continuous"}), "float32")
    gains = replace(found.gains, T2=found.gains.T2 + 1e-12)
    with pytest.raises(EmitError, match="no float32"):
        tables_of(plant, replace(found, gains=gains), "float32")


def test_measured_parameters_schedule_too(tmp_path):
    """Weights of a parameter: range checked, read by the weights, no libm."""
    text = load("dlpv").text.replace('w = [{', 'theta = [{ name = "speed", bounds = [1, 3] }]\nw = [{', 1)
    for old, new in (('"exp(-0.5*((x1 + 0.4)/0.5)**2)"', '"3 - speed"'),
                     ('"exp(-0.5*((x1 - 0.4)/0.1)**2)"', '"speed - 1"'),
                     ('"exp(-0.5*((x1 - 1)/0.5)**2)"', '"(speed - 1)*(3 - speed)/sqrt(speed)"')):
        assert old in text
        text = text.replace(old, new)
    plant = loads(text)
    found = stand_in(plant, "float32")
    compiled = Compiled(print_c(plant, found, "float32", "obs"), tmp_path, tables_of(plant, found, "float32"))
    rng = np.random.default_rng(1)
    theta = rng.uniform(0.95, 3.05, (200, 1)).astype("float32")
    u, y = rng.uniform(-4, 4, (200, 1)).astype("float32"), rng.uniform(-2, 2, (200, 3)).astype("float32")
    assert equal(compiled, u, y, theta)
    refused = compiled.run(u, y, theta)[0][0] == BAD_PARAMETER
    assert np.array_equal(refused, ((theta < 1) | (theta > 3))[:, 0]) and 0 < refused.sum() < 100
