"""Gappa confirms the rounding margins of every design that is kept; what is wrong it does not confirm."""

import json
import re
import shutil
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import KEPT, OTHERS, POINTS, ROUNDED, family_of
from helpers.scripts import GENERATED
from helpers.tools import need

from codegen import design as make
from codegen.certify.exact import Q
from codegen.certify.sets import SetDemands
from codegen.cli import main
from codegen.designs import read_design
from codegen.emit import files
from codegen.emit.gappa import rounding
from codegen.emit.render import render
from codegen.emit.view import build
from codegen.errors import ToolError, ValidationError
from codegen.observers import FAMILIES
from codegen.observers.framer import Variation, open_loop, propagate, residuals, scheduled
from codegen.observers.point import blind, forward, residual
from codegen.plant.load import gallery_names, load
from codegen.plant.uncertain import is_uncertain
from codegen.synthesis import METHODS
from codegen.target.gappa import nothing_to_prove, prove_rounding, require_rounding
from codegen.target.prove import ProofResult

REALS = ("float32", "float64")
SMALL = 30  # sums: a larger script is proved in the number type of the plant file only
PLANTS = [name for name in gallery_names() if load(name).modes and is_uncertain(load(name))
          and load(name).switching.known and METHODS[load(name).method].framers]
RADIUS = r"\n    [+-] [^\n]*\b(?:m|a|size)_\d[^\n]*$"
DEFINITION = r"(?m)^{} (?:r=|=)\n((?:    .*\n)*?    .*);$"


def copy(folder, to, real=None, layout=None):
    """Copy a kept folder, with the script as it is printed now; return the copy and the script's path."""
    design = read_design(folder)
    made = Path(shutil.copytree(folder, to / "copy"))
    name = f"rounding_{design.plant.target.prefix}.g"
    (made / name).write_text(script_of(design, real, layout), encoding="ascii")
    return made, made / name


def script_of(design, real, layout=None):
    """Return the script alone."""
    view = build(design, real, layout)
    return render("harness/rounding.g.jinja", d=view, g=rounding(design, view))


@cache
def varying_script(plant):
    """Print the script of a gallery plant in its own number type, from its folder where it has one."""
    kept_design = next((folder for folder in ROUNDED if folder.name.startswith(f"{plant}_")), None)
    design = make(load(plant)) if kept_design is None else read_design(kept_design)
    return script_of(design, design.plant.target.real)


def put(text, to):
    """Write what ``prove_rounding`` needs of a folder."""
    prefix = re.search(r"rounding_(\w+)\.g", text)[1]
    (to / "resources.json").write_text(json.dumps({"prefix": prefix, "n_u": 0}))
    (to / f"rounding_{prefix}.g").write_text(text, encoding="ascii")
    return to


def kept():
    """Every kept design in the plant file's type; framers and filters with a small script in the other type too."""
    for folder in ROUNDED:
        own = json.loads((folder / "resources.json").read_text())["real"]
        small = next(folder.glob("rounding_*.g")).read_text().count(" r=\n") <= SMALL
        both = small and folder not in POINTS and family_of(folder) not in (
            "mode", "polytopic", "descriptor")
        yield from (pytest.param(folder, real, id=f"{folder.name}-{real}") for real in REALS if real == own or both)


@pytest.mark.parametrize(("folder", "real"), list(kept()))
def test_every_kept_design_is_confirmed(folder, real, tmp_path):
    need("gappa")
    made, _ = copy(folder, tmp_path, real)
    result = prove_rounding(made)
    assert result.proved and not result.alarms, result.alarms
    n_x = read_design(folder).plant.n_x
    assert result.rows >= (2 * n_x + 1) * (1 if folder in POINTS + OTHERS else 2) and result.version.startswith("1")


def test_a_family_without_margins_says_so(tmp_path, monkeypatch):
    """Of calibrated thresholds there is no margin to prove: no script is printed, and the command says why."""
    folder = next(f for f in KEPT if f not in ROUNDED)
    assert not list(folder.glob("*.g")) and not any(name.endswith(".g") for name in files(
        read_design(folder), measure=False))
    assert "calibrated on the arithmetic of the C itself" in nothing_to_prove(folder)
    assert all(nothing_to_prove(f) == "" for f in ROUNDED)
    header = " ".join(next(folder.glob("*.h")).read_text().replace("*", " ").split())
    assert "so that there are no rounding margins to prove" in header
    monkeypatch.setattr("codegen.target.prove.prove", lambda _: ProofResult(True, (), 0.1, "0", {"step": 1}, 100))
    done = CliRunner().invoke(main, ["prove", str(shutil.copytree(folder, tmp_path / "copy"))])
    assert done.exit_code == 0 and "no rounding margins to prove" in done.output and "Gappa" not in done.output
    with pytest.raises(ToolError, match="not found"):
        prove_rounding(folder)


#: Those without a folder, whose scripts are not confirmed whole above.
ELSEWHERE = [p for p in PLANTS if not any(folder.name.startswith(f"{p}_") for folder in ROUNDED)]


@pytest.mark.parametrize("plant", ELSEWHERE)
def test_plants_that_vary_are_confirmed(plant, tmp_path):
    need("gappa")
    text = varying_script(plant)
    result = prove_rounding(put(text, tmp_path))
    assert result.proved and not result.alarms, result.alarms
    assert all(f"_{m}_" in text for m in ("residual", "forward", "blind"))


def scaled(number, factor):
    return (float.fromhex(number) * factor).hex()


def shrink(text, name, factor=0.4):
    return re.sub(rf"(exact_{name}\| <= )(\S+)", lambda m: m[1] + scaled(m[2], factor), text)


def widen(text, name):
    """Widen the range of every operand of the sum."""
    operands = set(re.findall(r"\b(?:in|out|s|m|a|z|y|u|x_hat|r|h|v|g)_\w+", re.search(
        DEFINITION.format(name), text)[1]))
    return re.sub(r"(?m)^( +(\w+) in )\[(\S+), (\S+)\]",
                  lambda m: f"{m[1]}[{scaled(m[3], 1000)}, {scaled(m[4], 1000)}]" if m[2] in operands else m[0], text)


def change(text, name, factor=1.001):
    """Change the last coefficient or offset of the exact sum by a thousandth, before the radius."""
    found = re.search(DEFINITION.format(f"exact_{name}"), text)
    affine = re.sub(RADIUS, "", found[1])
    last = list(re.finditer(r"0x[0-9a-f.]+p[+-]\d+", affine))[-1]
    at = found.start(1)
    return text[:at + last.start()] + scaled(last[0], factor) + text[at + last.end():]


def forget(text, name):
    """Leave the radius out of the exact sum."""
    found = re.search(DEFINITION.format(f"exact_{name}"), text)
    return text[:found.start(1)] + re.sub(RADIUS, "", found[1]) + text[found.end(1):]


def rows(text):
    """Rows that round at all: those with a product or a sum of numbers that are not alone."""
    return [n for n in re.findall(r"(?m)^(\w+) r=$", text) if len(re.findall("0x", re.search(
        DEFINITION.format(n), text)[1])) > 1]


def only(text, names):
    """Keep some rows, with the coefficients behind them."""
    every = re.findall(r"(?m)^(\w+) r=$", text)
    taken = set(re.findall(r"\bsize_(\w+)", " ".join(re.search(DEFINITION.format(n), text)[1] for n in names)))
    text = re.sub(r"(?m)^ +# The magnitude of .*\n +size_(\w+) (?:.*\n){3}",
                  lambda m: m[0] if m[1] in taken else "", text)
    for other in set(every) - set(names) - {n for n in every for m in taken if n.endswith(f"_{m}")}:
        text = re.sub(DEFINITION.format(other), "", re.sub(DEFINITION.format(f"exact_{other}"), "", text))
        text = re.sub(rf"(?m)^ +\|{other} .*\n", "", text)
    return text


@pytest.mark.parametrize("wrong", [shrink, widen, change])
@pytest.mark.parametrize("folder", ROUNDED, ids=lambda f: f.name)
def test_what_is_wrong_is_not_confirmed(folder, wrong, tmp_path):
    """One row of each design, another one for each mistake; without the mistake it is confirmed."""
    need("gappa")
    made, script = copy(folder, tmp_path)
    text = script.read_text()
    known = rows(text)
    row = known[[shrink, widen, change].index(wrong) * len(known) // 3]
    refuse(made, text, row, FARTHER.get(wrong, wrong) if folder in OTHERS else wrong)


#: Of filters and boxes, whose margins are what a proof holds for all sums of a step: no tight ones.
FARTHER = {shrink: lambda text, name: shrink(text, name, 0.1), change: lambda text, name: change(text, name, 1.5)}


@pytest.mark.parametrize(("plant", "wrong"), [
    (p, w) for p in PLANTS for w in (shrink, widen, change, forget) if w is forget or p in ELSEWHERE])
def test_what_is_wrong_where_the_plant_varies_is_not_confirmed(plant, wrong, tmp_path):
    need("gappa")
    text = varying_script(plant)
    known = [n for n in rows(text) if re.search(RADIUS, re.search(DEFINITION.format(n), text)[1])]
    refuse(put(text, tmp_path), text, known[[shrink, widen, change, forget].index(wrong) * len(known) // 4], wrong)


def refuse(folder, text, name, wrong):
    """One row is confirmed, and with a mistake it is not."""
    script = next(folder.glob("rounding_*.g"))
    text = only(text, [name])
    script.write_text(text)
    assert prove_rounding(folder).proved
    script.write_text(wrong(text, name))
    assert script.read_text() != text
    result = prove_rounding(folder)
    assert not result.proved and any(name in alarm for alarm in result.alarms), result.alarms
    with pytest.raises(ValidationError, match="margins are not all proved"):
        require_rounding(result)


def evaluate(text, name, values, number):
    """Calculate a sum of the script with numbers of a type, in the order in which C would."""
    source = re.sub(r"0x[0-9a-f.]+p[+-]\d+", lambda m: f"number(float.fromhex('{m[0]}'))",
                    " ".join(re.search(DEFINITION.format(name), text)[1].split()))
    return eval(source, {"number": number, "float": float, **{k: number(v) for k, v in values.items()}})


def fraction(value):
    return Fraction(float(value))


def varied(family, same_bounds):
    """Give a stand-in random slopes, radii and constants that take the opposite bound."""
    design, rng = stand_in(family, (3, 3, 2, 2), prefix="cart", sparse=0.2, clamp=True), np.random.default_rng(7)
    wide, tables = design.observer.tables["float32"], {}
    n, x, u, y, parameters = *wide.G_hi.shape, wide.C.shape[1], 2

    def some(*shape, low=0.0):
        return rng.uniform(low, 1.0, shape) * (rng.random(shape) < 0.7)

    lo = np.array([[-1.5, 0.25]]) + (0 if same_bounds else np.arange(n)[:, None] / 8) * np.array([[0, 1]])
    arrays = {"theta_lo": np.broadcast_to(lo, (n, 2)), "theta_hi": np.broadcast_to(lo + 2, (n, 2)),
              "M": some(n, parameters, x, x, low=-1), "G": some(n, parameters, x, u, low=-1),
              "L": some(n, parameters, x, y, low=-1), "R": some(n, x, x), "S": some(n, x, u), "Ra": some(n, x, x),
              "Sa": some(n, x, u), "M_base": some(n, x, x, low=-1)}
    arrays["M"][:, :, 0] = 0.0  # row 0 is constant in all modes: its negative entries take the opposite bound
    arrays["E"] = some(n, x, y) * np.any(arrays["L"], axis=1)
    for real, t in design.observer.tables.items():
        a = {k: v.astype("float32").astype(real) for k, v in arrays.items()}
        M = a.pop("M_base")
        vary = Variation(columns=(0, 1), midpoint=same_bounds and family == "tnl", late=False, **a)
        tables[real] = replace(t, M_hi=M, M_lo=M, vary=vary)
        assert tables[real].signed
    return replace(design, observer=FAMILIES[family](tables, design.observer.supervision))


def between(design, real, rng):
    """Parameters within the bounds of each mode: (modes, parameters)."""
    vary = design.observer.tables[real].vary
    if vary is None:
        return np.zeros((len(design.plant.modes), 0), dtype=real)
    share = rng.random(vary.parameters).astype(real)
    return vary.theta_lo + share * (vary.theta_hi - vary.theta_lo)


def varying_values(text, t, theta, x_lo, x_hi, u):
    """Values of what only a script with parameters and radii reads: those that the numpy step has."""
    if t.vary is None:
        return {}
    values = {f"m_{j}": v for j, v in enumerate(np.maximum(-x_lo, x_hi))} | {f"a_{j}": abs(v) for j, v in enumerate(u)}
    values |= {f"th_{j}_mode_{q}": v for q, row in enumerate(theta) for j, v in enumerate(row)}
    for name, i, j, q in re.findall(r"(?m)^cart_(L_(\d+)_(\d+)_mode_(\d+)) r=$", text):
        at = np.array([int(q)])
        gain = scheduled(t.L_hi[at], t.vary.L[at], theta[at])[0, int(i), int(j)]
        assert evaluate(text, f"cart_{name}", values, np.dtype(t.real).type) == gain
        values |= {f"size_{name}": abs(gain), f"exact_size_{name}": abs(gain)}
    assert any(name.startswith("size_") for name in values)
    return values


CASES = {f"{f}-{v}": (f, {"prefix": "cart", **VARIANTS[v]}) for f in ("interval", "tnl") for v in VARIANTS}
CASES |= {f"{f}-varying{b}": (f, b) for f in ("interval", "tnl") for b in (True, False)}


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("case", CASES)
def test_script_is_about_the_sums_of_the_reference(case, real):
    """Rounded, the script's sums are those of the numpy step, with ==; exact, both have the same words."""
    family, options = CASES[case]
    design = stand_in(family, **options) if isinstance(options, dict) else varied(family, options)
    texts = [script_of(design, real, layout) for layout in ("literal", "table", "loop")]
    assert len({re.sub(r"(?m)^#.*", "", text) for text in texts}) == 1
    text, t, rng = texts[0], design.observer.tables[real], np.random.default_rng(1)
    x_lo, x_hi = np.sort(rng.uniform(-t.box, t.box, (2, 1, len(t.box))), axis=0).astype(real)
    u, y, y_next = (rng.uniform(-1, 1, (1, n)).astype(real) for n in (len(t.u_lo), len(t.y_lo), len(t.y_lo)))
    own, last = ("out", "in") if family == "interval" else ("s", "s")
    zero = y_next * 0 if family == "interval" else y_next
    values = {f"{s}_x_{side}_{j}": v for s in ("out", "s") for side, x in (("lo", x_lo), ("hi", x_hi))
              for j, v in enumerate(x[0])}
    values |= {f"{s}_u_{j}": v for s in ("in", "s") for j, v in enumerate(u[0])}
    values |= {f"in_y_{j}": v for j, v in enumerate(y_next[0])} | {f"{last}_y_{j}": v for j, v in enumerate(y[0])}
    theta = between(design, real, rng)
    values |= varying_values(text, t, theta, x_lo[0], x_hi[0], u[0])
    checked = 0
    uncut = type(t)(**{**vars(t), "clamp": False, "x_lo": t.x_lo * 0 - np.inf, "x_hi": t.x_lo * 0 + np.inf})
    for group in re.findall(r'(?m)^# .*, (lo|hi), mode (.*): margin .*\n(cart_(\w+?)_(?:lo|hi)_(\d+)_\w+) r=$', text):
        side, modes, name, which, i = group
        for q, mode in enumerate(design.plant.modes):
            if f'"{mode.name}"' not in modes:
                continue
            at = np.array([q])
            result = {"forward": propagate(uncut, at, x_lo, x_hi, u, y, zero, theta[at]),
                      "blind": open_loop(uncut, at, x_lo, x_hi, u),
                      "residual": residuals(uncut, at, x_lo, x_hi, u, y * 0)}[which]
            assert evaluate(text, name, values, np.dtype(real).type) == result[side == "hi"][0, int(i)], name
            rounded, exact = (evaluate(text, n, values, fraction) for n in (name, f"exact_{name}"))
            assert rounded == exact
            checked += 1
    n_modes, n_x, n_y = len(design.plant.modes), len(t.box), len(t.y_lo)
    assert checked == n_modes * 2 * (2 * n_x + n_y)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("folder", POINTS, ids=lambda f: f.name)
def test_script_of_points_is_about_the_sums_of_the_reference(folder, real):
    """The same of estimate and residual; the margin of each sum is what the set holds for it, rounded down."""
    design = read_design(folder)
    t, prefix, rng = design.observer.tables[real], design.plant.target.prefix, np.random.default_rng(2)
    text, uncut = script_of(design, real), replace(t, box=t.box * 0 + np.inf)
    x = rng.uniform(-t.box, t.box)[None].astype(real)
    u, y, y_next = (rng.uniform(-1, 1, (1, n)).astype(real) for n in (len(t.u_lo), len(t.y_lo), len(t.y_lo)))
    values = {f"{s}_{v}_{j}": a for s, v, row in (("s", "x_hat", x), ("out", "x_hat", x), ("s", "u", u), ("in", "u", u),
                                                 ("s", "y", y), ("in", "y", y_next)) for j, a in enumerate(row[0])}
    checked, demands = 0, SetDemands(design.plant.observed.modes, t)
    for row in re.finditer(rf'(?m)^# .*, mode (.*): margin .*\n({prefix}_(\w+?)_(\d+)_mode_\d+) r=$', text):
        modes, name, which, i = row.groups()
        margin = re.search(rf"exact_{name}\| <= (\S+)", text)[1]
        for q, mode in enumerate(design.plant.modes):
            if f'"{mode.name}"' not in modes:
                continue
            at_q = np.array([q])
            result = {"forward": lambda p: forward(uncut, p, x, u, y, y_next), "blind": lambda p: blind(uncut, p, x, u),
                      "residual": lambda p: residual(t, p, x, u, y_next)}[which](at_q)
            assert evaluate(text, name, values, np.dtype(real).type) == result[0, int(i)], name
            assert 0 <= Q(float.fromhex(margin)) <= demands.rounding(q, which)[int(i)]
            checked += 1
    assert checked == len(design.plant.modes) * (2 * len(t.box) + len(t.y_lo))


def test_the_mean_of_a_parameter_is_that_of_the_reference():
    text = script_of(varied("tnl", True), "float32")
    values = {"s_theta_1": 0.7, "in_theta_1": 1.1}
    assert evaluate(text, "cart_theta_1", values, np.float32) == (np.float32(0.7) + np.float32(1.1)) * np.float32(0.5)
    assert "s_theta_0 in" in text and "s_theta" not in script_of(varied("tnl", False), "float32")


def test_what_is_taken_for_granted_is_shown(tmp_path):
    """The magnitude of a coefficient may be no closer to the exact one than the coefficient is shown to be."""
    text = script_of(varied("tnl", True), "float32")
    slip = re.search(r"\|size_(\w+) - exact_size_\1\| <= (\S+) ->", text)
    wrong = text[:slip.start(2)] + scaled(slip[2], 0.5) + text[slip.end(2):]
    with pytest.raises(ToolError, match=f"takes for granted what it does not state of {slip[1]}"):
        prove_rounding(put(wrong, tmp_path))


def test_a_script_that_states_too_little_is_refused(tmp_path):
    folder = write(stand_in("tnl", prefix="cart"), tmp_path)
    script = folder / "rounding_cart.g"
    text = script.read_text()
    script.write_text(re.sub(r"(?m)^ +\|cart_forward_lo_0_mode_0 .*\n", "", text))
    with pytest.raises(ToolError, match="expected as many of each"):
        prove_rounding(folder)
    script.write_text("{ 0 <= 1 }\n")
    with pytest.raises(ToolError, match="states 0 rounded sums"):
        prove_rounding(folder)


def test_an_offset_smaller_than_what_it_must_hold_is_not_confirmed(tmp_path):
    """The offsets of a stand-in are random: some leave less than nothing for rounding."""
    need("gappa")
    folder = write(stand_in("tnl", prefix="cart"), tmp_path)
    assert "<= -0x" in (folder / "rounding_cart.g").read_text()
    assert not prove_rounding(folder).proved


def test_a_broken_script_is_an_error_of_the_tool(tmp_path):
    need("gappa")
    folder, script = copy(GENERATED[0], tmp_path)
    script.write_text(script.read_text().replace("@r = ", "@r "))
    with pytest.raises(ToolError, match="gappa: failed"):
        prove_rounding(folder)


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    with pytest.raises(ToolError, match="resources.json"):
        prove_rounding(tmp_path)
    folder = write(stand_in(prefix="cart"), tmp_path / "cart")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ToolError, match="gappa: not found. Install it"):
        prove_rounding(folder)
    (folder / "rounding_cart.g").unlink()
    with pytest.raises(ToolError, match=r"rounding_cart.g: not found"):
        prove_rounding(folder)
