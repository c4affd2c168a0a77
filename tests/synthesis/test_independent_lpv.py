"""The independent checker of plants with parameters: its enclosure holds the truth, false designs are refused.

Truth here: the plant integrated by matrix exponentials over pieces with constant parameters and disturbances.
"""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from helpers.varying import HEATER, HELD, changed_design, heater_design
from scipy.linalg import expm

import codegen
from codegen.emit.package import generate
from codegen.plant.load import load

CERTIFY = Path(__file__).resolve().parents[2] / "codegen" / "certify"
FILES = ("independent_lpv.py", "independent_mode.py", "independent_step.py")
LATE = HELD.replace("[initial]", "[switching]\nlate = true\n[initial]")
NOISE = HEATER.replace('bounds = [-0.1, 0.1] }]\nf', 'bounds = [0.05, 0.3] }]\nf')  # that never vanishes
CONSTANT = HEATER[:HEATER.index("theta = [")] + HEATER[HEATER.index("[initial]"):].replace("0.2*flow", "0.2").replace(
    "flow", "1").replace("loss", "0.2").replace("bounds = { 1 = [0.5, 0.8] }\n", "").replace('theta = "uniform"\n', "")
DESIGNS = {
    "heater": lambda: heater_design(),
    "held": lambda: heater_design(HELD, "tnl-interval-lpv"),
    "late": lambda: heater_design(LATE, "tnl-interval-lpv"),
    "linf": lambda: heater_design(HEATER, "tnl-interval-lpv", criterion="linf"),
    "noise": lambda: heater_design(NOISE, "tnl-interval-lpv", criterion="linf"),
    "constant": lambda: heater_design(CONSTANT, "lpv-interval"),
    "euler": lambda: heater_design(HEATER, "lpv-interval", sampling="euler"),
    "discrete": lambda: codegen.design(load("zammali_lpv_dt"), "lpv-interval"),
    "signed": lambda: codegen.design(load("lamouchi"), "component-interval"),
    "changed": changed_design,
}


def run(folder):
    return subprocess.run([sys.executable, "-I", "-S", str(CERTIFY / "independent.py"), str(folder)],
                          capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders of designs, made when asked for."""
    home, known = tmp_path_factory.mktemp("varying"), {}

    def folder(name):
        if name not in known:
            known[name] = home / name
            generate(DESIGNS[name](), known[name])
        return known[name]

    return folder


@pytest.mark.parametrize("name", FILES)
def test_is_short_and_uses_the_standard_library_only(name):
    text = (CERTIFY / name).read_text()
    assert len(text.splitlines()) < 250
    names = {a.name.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module.split(".")[0] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)}
    assert names <= {*sys.stdlib_module_names, "independent", "independent_mode", "independent_step"}


@pytest.mark.parametrize("name", DESIGNS)
def test_proves_every_kind_of_design(name, made):
    done = run(made(name))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("proved for float") == 2 and "constants of" in done.stdout
    assert ("of the continuous plant" in done.stdout) == (name not in ("discrete", "signed", "changed"))


def test_the_command_that_the_assurance_file_names_runs(made):
    done = subprocess.run([sys.executable, "-m", "codegen.certify.independent", str(made("held"))], check=False,
                          cwd=CERTIFY.parents[1], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.count("proved for float") == 2, done.stderr


def scaled(*path, factor):
    """Scale a number of the float32 tables: the first one that is not zero below the path."""
    def change(data):
        data = data["tables"]["float32"]
        *way, last = path
        for key in way:
            data = data[key]
        while isinstance(data[last], list):
            data = data[last]
            last = next(i for i, x in enumerate(data) if np.any(x))
        data[last] *= factor
    return change


def text(old, new):
    """Change the plant text."""
    def change(data):
        assert data["plant"]["toml"].count(old) == 1
        data["plant"]["toml"] = data["plant"]["toml"].replace(old, new)
    return change


def claimed(path, factor):
    def change(data):
        data = data["certificate"]["float32"]
        *way, last = path
        for key in way:
            data = data[key]
        data[last] *= factor
    return change


def midpoint(data):
    for t in data["tables"].values():
        t["vary"]["midpoint"] = True


FALSE = {
    "radius": ("heater", scaled("vary", "R", factor=0.5), "offset d_"),
    "radius of the input": ("heater", scaled("vary", "S", factor=0.5), "offset d_"),
    "radius of the noise": ("heater", scaled("vary", "E", factor=0.5), "offset d_"),
    "blind radius": ("heater", scaled("vary", "Ra", factor=0.5), "offset a_"),
    "blind radius of the input": ("heater", scaled("vary", "Sa", factor=0.5), "offset a_"),
    "slope of M": ("heater", scaled("vary", "M", factor=1.001), "offset d_"),
    "slope of G": ("heater", scaled("vary", "G", factor=1.001), "offset d_"),
    "slope of L": ("heater", scaled("vary", "L", factor=1.001), "offset d_"),
    "slope, discrete": ("discrete", scaled("vary", "M", factor=1.001), "offset d_"),
    "sign": ("discrete", scaled("vary", "M", factor=-100), "T A - L C < 0"),
    "wider box of theta": ("heater", scaled("vary", "theta_hi", factor=1.01), "theta box"),
    "narrower box of theta": ("discrete", scaled("vary", "theta_hi", 1, factor=0.99), "theta box"),
    "offset": ("held", scaled("d_hi", factor=1 - 1e-4), "offset d_hi"),
    "offset, discrete": ("discrete", scaled("d_lo", factor=1 - 1e-3), "offset d_lo"),
    "blind offset": ("held", scaled("a_lo", factor=1 - 1e-3), "offset a_lo"),
    "output offset": ("held", scaled("c_hi", factor=1 - 1e-3), "offset c_hi"),
    "gain": ("signed", scaled("L_lo", factor=1.001), "equal gains"),
    "radius, unmeasured": ("signed", scaled("vary", "R", factor=0.9), "offset d_"),
    "coordinates": ("changed", scaled("change", "Z", factor=1.001), "offset d_"),
    "way back": ("changed", scaled("change", "X", factor=1.001), "offset b_"),
    "rounding to z": ("changed", scaled("change", "e_hi", factor=0.5), "offset e_hi"),
    "rounding to x": ("changed", scaled("change", "b_lo", factor=0.5), "offset b_lo"),
    "range of z": ("changed", scaled("change", "z_hi", factor=0.999), "range of z"),
    "box of z": ("changed", scaled("change", "box", factor=0.5), "range of z"),
    "M of z": ("changed", scaled("M_hi", factor=1.001), "equal gains"),
    "radius of z": ("changed", scaled("vary", "R", factor=0.9), "offset d_"),
    "ultimate box of z": ("changed", claimed(("steady_box", "width", 0), 0.99), "ultimate box width"),
    "widths of x": ("changed", claimed(("x_width", 1), 0.999), "ultimate width of x[1]"),
    "both ends": ("heater", midpoint, "mean of both ends"),
    "sample period": ("heater", text("sample_period = 0.02", "sample_period = 0.0201"), "lacks"),
    "shorter sample period": ("held", text("sample_period = 0.02", "sample_period = 0.0199"), "lacks"),
    "rate": ("held", text("rate = 0.5", "rate = 0.6"), "lacks"),
    "error of the measurement": ("heater", text("error = 0.02", "error = 0.021"), "theta box"),
    "bounds of what is not measured": ("heater", text("bounds = [0.1, 0.3]", "bounds = [0.1, 0.31]"), "offset a_"),
    "input that moves": ("heater", text("rate = 2 }", "rate = 2.2 }"), "lacks"),
    "disturbance": ("held", text("bounds = [-0.1, 0.1] }]\nv", "bounds = [-0.1, 0.11] }]\nv"), "offset a_"),
    "entry": ("discrete", text("0.025*e1 + 0.035*e2", "0.0251*e1 + 0.035*e2"), "lacks"),
    "told late": ("late", text("late = true", "late = false"), "what is measured"),
    "ultimate box": ("heater", claimed(("steady_box", "width", 0), 0.99), "ultimate box width"),
    "ultimate box, late": ("late", claimed(("steady_box", "hi", 0), 0.99), "ultimate box hi"),
    "Lyapunov matrix": ("linf", claimed(("P_hi", 0, 0), 1.5), ""),
    "mu": ("linf", claimed(("mu",), 0.9), "Lyapunov inequality"),
    "level": ("linf", claimed(("level",), 0.8), "L-infinity level"),
}


@pytest.mark.parametrize("name", FALSE)
def test_refuses_false_claims(name, made, tmp_path):
    folder, change, words = FALSE[name]
    copy = tmp_path / "copy"
    shutil.copytree(made(folder), copy)
    data = json.loads((copy / "design.json").read_text())
    change(data)
    (copy / "design.json").write_text(json.dumps(data))
    done = run(copy)
    assert done.returncode == 1 and done.stderr.startswith("refused: ") and words in done.stderr, done.stderr


@pytest.mark.parametrize("table", ["R", "M", "theta_hi"])
def test_refuses_another_constant_in_the_c(table, made, tmp_path):
    """The C keeps its number, the tables get another one: one of the two is foreign."""
    copy = tmp_path / "copy"
    shutil.copytree(made("heater"), copy)
    t = json.loads((copy / "design.json").read_text())["tables"]["float32"]["vary"]
    value = next(x for x in np.ravel(t[table]) if x)
    literal = f"{np.format_float_positional(np.float32(abs(value)), trim='0')}F"
    source = (copy / "heater.c").read_text()
    other = f"{np.format_float_positional(np.nextafter(np.float32(abs(value)), np.float32(9)), trim='0')}F"
    changed = source.replace(literal, other) if literal in source else source.replace(
        f"{np.format_float_scientific(np.float32(abs(value)), trim='0', exp_digits=2)}F", other)
    assert changed != source
    (copy / "heater.c").write_text(changed)
    done = run(copy)
    assert done.returncode == 1 and ("no table does" in done.stderr or "missing in the C" in done.stderr)


@pytest.fixture(scope="module")
def step_module():
    sys.path.append(str(CERTIFY))
    try:
        import independent_step
    finally:
        sys.path.remove(str(CERTIFY))
    return independent_step


def floats(A):
    return np.array([[float(x) for x in row] for row in A])


def truth(rng, mode, signals, F, h, x, u, rates):
    """One period with jumping unknowns, a parameter within its rate, u moving; returns the state and measured ends."""
    pieces, ds = 4, h / 4
    (lo, hi), (ulo, uhi) = ([float(b) for b in box] for box in mode["theta"])
    rate = signals["theta"][0]["rate"]
    theta = [rng.uniform(lo, hi)]
    for _ in range(pieces):
        theta.append(np.clip(theta[-1] + rng.choice([-1, 1]) * rate * ds, lo, hi))
    z, Bw = np.concatenate([x, u]), F[-1]
    n, push = len(x), rng.choice([-1, 1], len(u)) * rates
    for k in range(pieces):
        a, b, w = (theta[k] + theta[k + 1]) / 2, rng.choice([ulo, uhi]), rng.choice([float(c) for c in mode["w"][0]])
        big = np.zeros((len(z) + 1, len(z) + 1))
        big[:n, :-1], big[:n, -1], big[n:-1, -1] = F[0] + a * F[1] + b * F[2], Bw[:, 0] * w, push
        z = (expm(big * ds) @ np.append(z, 1))[:-1]
    return z[:n], np.array([theta[0], theta[-1]])


class Enclosure:
    """A step as floats: value of the polynomial, how far the truth may be from it."""

    def __init__(self, z):
        n = len(z["rest"])
        self.poly, self.middle = {which: floats(A) for which, A in z["poly"].items()}, float(z["middle"][0])
        self.radius = floats(z["rest"]) + sum(np.abs(floats(A)) for A in z["first"])
        one = [[Fraction(i == j) for j in range(n)] for i in range(n)]
        self.above, self.below = (np.array([float(v) for v in z["W"](one, s)]) for s in (1, -1))

    def __call__(self, end, seen, x, u):
        """What is left of the room above and below, relative to it, and whether W alone would do."""
        xu, p = np.concatenate([x, u]), seen - self.middle
        away = end - sum(A * p ** len(which) for which, A in self.poly.items()) @ xu
        room = self.radius @ np.abs(xu)
        used = np.maximum(away / (room + self.above), -away / (room + self.below))
        return np.max(used), bool(np.all((away <= self.above) & (-away <= self.below)))


def matrices(mode):
    return [*map(floats, mode["F"]), floats(mode["Bw"])]


@pytest.mark.parametrize("both", [False, True])
def test_the_enclosure_holds_the_integrated_plant(both, step_module):
    modes, _, signals, h, _ = step_module.read_plant(HEATER)
    rng, h = np.random.default_rng(3), 10 * h  # ten times the period: larger effects of second order
    for mode in modes:
        inside, F, used, enough = Enclosure(step_module.transition(mode, signals, h, both)), matrices(mode), [], []
        for _ in range(80):
            x, u = rng.choice([-20, 20], 2), rng.choice([-5, 5], 2)
            end, ends = truth(rng, mode, signals, F, float(h), x, u, np.array([2.0, 0.0]))
            one, alone = inside(end, (ends.mean() if both else ends[0]) + rng.choice([-0.02, 0.02]), x, u)
            used.append(one)
            enough.append(alone)
        assert max(used) <= 1 + 1e-9
        assert max(used) > 0.6 and sum(enough) < 40  # the excitation needs most of the room, and W is not all of it


@pytest.mark.parametrize("name, old, new, moved", [
    ("unknown", "bounds = [0.1, 0.3]", "bounds = [0.19, 0.21]", True), ("error", "error = 0.02", "error = 0", True),
    ("moving input", ", rate = 2 }", " }", False),
    ("disturbance", "[-0.1, 0.1] }]\nv", "[-0.09, 0.09] }]\nv", False)])
def test_what_the_enclosure_forgets_shows(name, old, new, moved, step_module):
    """Without the unknown, the error, the moving input or some of the disturbance the truth leaves the enclosure."""
    modes, _, signals, h, _ = step_module.read_plant(HEATER)
    assert HEATER.count(old) == 1
    (mode, *_), _, other, _, _ = step_module.read_plant(HEATER.replace(old, new))
    inside, F = Enclosure(step_module.transition(mode, other, h, False)), matrices(modes[0])
    rng, used = np.random.default_rng(5), []
    for _ in range(80):
        x, u = rng.choice([-20, 20], 2) * moved, rng.choice([-5, 5], 2) * moved
        end, ends = truth(rng, modes[0], signals, F, float(h), x, u, np.array([2.0, 0.0]))
        used.append(inside(end, ends[0] + rng.choice([-0.02, 0.02]), x, u)[0])
    assert max(used) > 1
