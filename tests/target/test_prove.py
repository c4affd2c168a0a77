"""Frama-C proves every design that is kept, and every kind of C; what is wrong it does not prove."""

import re
import shutil
from pathlib import Path

import pytest
from helpers import driven, follower, small_banks, small_modes
from helpers.designs import GUARDED, stand_in
from helpers.folders import write
from helpers.kept import KEPT, OTHERS, POINTS, family_of, first_of_each
from helpers.scripts import prefix_of
from helpers.solved import stand_in as two_pivots
from helpers.tools import need

from codegen.designs import read_design
from codegen.emit.harness import harness
from codegen.emit.render import render
from codegen.emit.view import build
from codegen.errors import ToolError, ValidationError
from codegen.target.prove import judge, prove, require

SMALL = {"sizes": (2, 2, 1, 2), "supervision": GUARDED}
# Layouts and types take turns in both families; one with a clamp, one with a debounce of any window.
KINDS = [("tnl", layout, real, {}) for layout in ("literal", "table", "loop") for real in ("float32", "float64")]
KINDS += [("interval", "literal", "float64", {"clamp": True}), ("interval", "table", "float32", {"shared": False}),
          ("interval", "loop", "float64", {"sizes": (1, 2, 0, 2)})]


def rewrite(folder, name, pattern, text, count=1):
    source = (folder / name).read_text()
    changed, found = re.subn(pattern, text, source, count=count)
    assert found, f"{name}: the mutant changed nothing"
    (folder / name).write_text(changed)


#: One of each family, and the box that holds noise of its own sample.
ONES = [*first_of_each(KEPT), *(f for f in KEPT if f.name == "zammali_box_ellipsoid")]


@pytest.mark.parametrize("folder", ONES, ids=lambda f: f.name)
def test_every_kept_design_is_proved(folder, tmp_path):
    """The committed C is what is proved, with the harness as it is printed now."""
    need("frama-c")
    design = read_design(folder)
    prefix = design.plant.target.prefix
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    name = f"prove_{prefix}.c"
    view = build(design)
    (copy / name).write_text(render("harness/eva.c.jinja", d=view, e=harness(design, view)), encoding="ascii")
    result = prove(copy)
    assert result.proved, result.alarms
    # Of zammali_lpv_dt Eva proves that no framer can reach the ends of the ranges: the cut has nothing to do.
    # Of point observers it proves that no index of the set needs its guard against an upset of the memory.
    # So it does of the row of a filter's table, of the mode decided last, and of the guard of a division.
    known = folder in POINTS + OTHERS
    assert result.coverage >= (99 if "zammali_lpv_dt" in prefix or known else 100)
    assert result.seconds > 0 and result.version.startswith("2")
    assert result.properties["state_is_in_box"] >= (2 if folder in OTHERS else design.plant.n_x * (1 if known else 2))
    assert {f"{prefix}_{call}" for call in ("init", "step", "predict", "reset")} <= set(result.properties)


@pytest.mark.parametrize("family,layout,real,options", KINDS)
def test_every_kind_of_c_is_proved(family, layout, real, options, tmp_path):
    need("frama-c")
    result = prove(write(stand_in(family, prefix="cart", **(SMALL | options)), tmp_path, real, layout))
    assert result.proved, result.alarms


MUTANTS = {
    "box too small": ("prove_cart.c", r"1000\.0F", "1.5F", 0, "state_is_in_box"),
    "mode guard weakened": ("cart.c", r"in->mode >= CART_MODES", "in->mode > CART_MODES", 1, "initialized|refused"),
    "gain of 3e38": ("cart.c", r"\((?:\d\.\d+F|k\[\d+\]) \*", "(3e38F *", 1, "is_finite"),
    "range of y not looked at": ("cart.c", r"!cart_y_accepted\(in\)", "false", 1, "state_is_in_box|initialized"),
    "run has no end": ("cart.c", r"\(s->run \+ 1U\) < 4U", "true", 1, r"s->run"),
    "state written before the check": ("cart.c", r"(cart_status status = cart_check\(in\);)", r"\1 s->run = 0U;", 1,
                                       "initialized"),
    "a residual is forgotten": ("cart.c", r"out->r_hi\[0\] = [^;]*;", "", 0, "initialized"),
    "division by zero": ("cart.c", r"s->run\+\+;", "s->run = 1U / (s->run - s->run);", 1, "division_by_zero|≢ 0"),
}


@pytest.mark.parametrize("mutant,family", [*((m, "interval") for m in MUTANTS), ("box too small", "tnl")])
def test_what_is_wrong_is_not_proved(mutant, family, tmp_path):
    need("frama-c")
    folder = write(stand_in(family, prefix="cart", **SMALL), tmp_path, "float32", "literal")
    *change, count, words = MUTANTS[mutant]
    rewrite(folder, *change, count)
    result = prove(folder)
    assert not result.proved and any(re.search(words, alarm) for alarm in result.alarms), result.alarms
    with pytest.raises(ValidationError, match="not proved"):
        require(result)


POINT_MUTANTS = {  # family, what of the C, what instead, what Eva says
    "a sum starts anywhere": ("zonotope", r"key\[j\] = 0\.0F;", "", "initialized"),
    "a number of any size": ("ellipsoid", r"factor\[p\] \*", "3e38F *", "is_finite"),
    "a count without end": ("thresholds", r"else if \(s->since < \d+U\)", "else if (true)", "s->since"),
    "estimates go anywhere": ("thresholds", r"\w+_cut\(out->x_hat\);", "", "x_hat"),
}


@pytest.mark.parametrize("mutant", POINT_MUTANTS)
def test_what_is_wrong_of_a_set_is_not_proved(mutant, tmp_path):
    need("frama-c")
    family, pattern, text, words = POINT_MUTANTS[mutant]
    folder = shutil.copytree(next(f for f in POINTS if family_of(f) == family), tmp_path / "copy")
    rewrite(folder, f"{prefix_of(folder)}.c", pattern, text, 0)
    result = prove(folder)
    assert not result.proved and any(re.search(words, alarm) for alarm in result.alarms), result.alarms


OTHER_MUTANTS = {  # of a filter, a small mode estimator, driven framers: what of the C, what instead, what Eva says
    "a count beyond the table": ("filter", r"s->since >> 1U", "s->since >> 0U", "row <"),
    "a count without end": ("filter", r"&& \(s->since < \w+_LAST\)\)", ")", "s->since"),
    "a state of any size": ("filter", r"\(k\[1\] \* s->xi\[0\]\)", "(3e38F * s->xi[0])", "is_finite"),
    "no estimate": ("filter", r"(?m)^        farhat_estimate\(s, in, out\);\n", "", "initialized"),
    "ends of any size": ("mode", r"\(matrix\[i\]\[k\] \* lo\[k\]\)", "(3e38F * lo[k])", "is_finite"),
    "a decision that is no mode": ("mode", r"\(s->decided < VALVE_MODES\) \? s->decided : 0U", "VALVE_MODES", "q < 2"),
    "bounds without a beginning": ("mode", r"out->x_lo\[i\] = FLT_MAX;", "", "initialized"),
    "limits that are not looked at": ("bank", r"if \(!\w+_sound\(s\)\)", "if (false)", "z|a"),
    "a wait without end": ("bank", r"s->wait--;", "s->wait++;", "s->wait"),
    "a credit below nothing": ("bank", r"s->credit >= \w+_GAP", "s->credit >= 19U", "s->credit"),
    "a mean that grows": ("sliding", r"\(total - old\)", "(total + old)", "level"),
    "a bound that is not cut": ("sliding", r"result = limit;", "result = value;", "box_hi|is_finite"),
    "framers of any size": ("guided", r"\(k\[\d+\] \* s->x_lo", "(3e38F * s->x_lo", "is_finite"),
    "framers of nothing": ("guided", r"held\.y\[0\] = s->told_y\[0\];", "", "initialized"),
    "a measurement that was not": ("guided_point", r"(s->told_y\[0\] = )given", r"\1 2.0F * given", "told_y"),
    "a row that is none": ("guided_filter", r"s->told_since >> \d+U", "s->told_since >> 0U", "row <"),
    "a step that reads what is not held": ("driven", r"held\.y\[i\] = s->y\[i\];", "", "initialized"),
    "a mode that is none answers": ("trailing", r"decided = out->mode;", "decided = PUSHED_MODES;", "valid_read"),
    "a start without end": ("trailing", r"s->told_stage\[q\] = k;", "s->told_stage[q] = k + 2U;", "told_stage"),
    "S x without a beginning": ("driven", r"below\[i\] = 0\.0F;", "", "initialized"),
    "bits of modes that are none": ("driven", r"s->framed \|= \(uint32_t\)1U << q;", "s->framed |= 8U << q;",
                                    "s->framed")}


@pytest.mark.parametrize("mutant", OTHER_MUTANTS)
def test_what_is_wrong_of_filters_and_boxes_is_not_proved(mutant, tmp_path):
    need("frama-c")
    family, pattern, text, words = OTHER_MUTANTS[mutant]
    folder = tmp_path / "copy"
    if family != "mode":
        shutil.copytree(next(f for f in OTHERS if family_of(f) == family and "vehicle" not in f.name), folder)
    else:
        write(driven.stand_in("parameters") if family == "driven" else small_modes.stand_in("one input", 1), folder)
    rewrite(folder, f"{prefix_of(folder)}.c", pattern, text, 0)
    result = prove(folder)
    assert not result.proved and any(re.search(words, alarm) for alarm in result.alarms), result.alarms


POLYTOPIC_MUTANTS = {  # of a law beside an observer, of one that divides: what of the C, what instead, Eva's words
    "as it is": ("quadrotor", "", "", ""),
    "a weight of any size": ("disc", r"\? t0 : 0\.0F", "? (3e38F * x_hat[3]) : 0.0F", "is_finite"),
    "division by anything": ("digester", r"4\.62468F - x_hat\[3\]", "2.0F - x_hat[3]", "is_finite"),
    "an integral without end": ("quadrotor", r"law->s\[i\] = limit\[i\];", "law->s[i] = next[i];", "law->s")}


@pytest.mark.parametrize("mutant", POLYTOPIC_MUTANTS)
def test_what_is_wrong_of_a_polytopic_observer_is_not_proved(mutant, tmp_path):
    need("frama-c")
    plant, pattern, text, words = POLYTOPIC_MUTANTS[mutant]
    folder = shutil.copytree(next(f for f in OTHERS if f.name.startswith(f"{plant}_")), tmp_path / "copy")
    rewrite(folder, f"{prefix_of(folder)}.c", pattern, text)
    result = prove(folder)
    if not pattern:
        assert result.proved and result.coverage == 100 and result.properties["law_is_in_box"] == 4
        return
    assert not result.proved and any(re.search(words, alarm) for alarm in result.alarms), result.alarms


@pytest.mark.parametrize("pattern,words", [("", ""), (r"!\w+_theta_accepted\(in\)", "refused|initialized")])
def test_a_bank_that_reads_a_parameter_is_proved_with_its_check_alone(pattern, words, tmp_path):
    need("frama-c")
    folder = write(small_banks.frozen(), tmp_path)
    if pattern:
        rewrite(folder, "tanks.c", pattern, "false")
    result = prove(folder)
    assert result.proved == (not pattern), result.alarms
    assert not pattern or any(re.search(words, alarm) for alarm in result.alarms), result.alarms


FOLLOWER_MUTANTS = {  # set, number type, layout, what of the C, what instead, what Eva says
    "as it is": ("ellipsoid", "float32", "table", "", "", ""),
    "bounds that are not cut": ("box", "float64", "loop", r"(told_hi\[i\] = )valve_told_clip(\(own\.x_hi\[i\]),[^;]*;",
                                r"\1\2);", "told_hi"),
    "a mode that is none": ("box", "float64", "loop", r"\(q < VALVE_MODES\) && ", "", "valid_read|q <")}


@pytest.mark.parametrize("mutant", FOLLOWER_MUTANTS)
def test_what_is_wrong_of_an_observer_that_follows_is_not_proved(mutant, tmp_path):
    """The set of a committed design is another; of these Eva shows as much."""
    need("frama-c")
    name, real, layout, pattern, text, words = FOLLOWER_MUTANTS[mutant]
    folder = write(follower.stand_in(name), tmp_path, real, layout)
    if pattern:
        rewrite(folder, "valve.c", pattern, text)
    result = prove(folder)
    assert result.proved == (not pattern), result.alarms
    assert not pattern or any(re.search(words, alarm) for alarm in result.alarms), result.alarms


@pytest.mark.parametrize("guard", [True, False])
def test_a_mean_of_pivots_is_divided_by_behind_its_guard(guard, tmp_path):
    """Of weights that may all vanish, which no sound ones do: intervals cannot tell."""
    need("frama-c")
    folder = write(two_pivots(True), tmp_path)
    rewrite(folder, "obs.c", r"h\[0\] = t7;", "h[0] = t6;")
    if not guard:
        rewrite(folder, "obs.c", r"pivot = \(pivot > 0\.15F\) \? pivot : 0\.15F;", "")
    alarms = prove(folder).alarms
    assert bool(alarms) is not guard and (guard or "obs_estimate" in alarms[0] and "is_finite" in alarms[0]), alarms


def test_a_mode_estimator_without_inputs_is_proved(tmp_path):
    """Nothing that it is told can be wrong but the measurements: predict refuses nothing."""
    need("frama-c")
    result = prove(write(small_modes.stand_in("no input, two outputs", 1), tmp_path, "float64", "literal"))
    assert result.proved, result.alarms


def test_weak_mode_guard_reads_beyond_a_table(tmp_path):
    need("frama-c")
    folder = write(stand_in("interval", prefix="cart", **SMALL), tmp_path, layout="table")
    rewrite(folder, "cart.c", r"in->mode >= CART_MODES", "in->mode > CART_MODES")
    assert any(re.search(r"cart_\w+: \w[^:]*: .valid_read\(k \+ \d+\)", alarm) for alarm in prove(folder).alarms)


def test_a_harness_that_shows_nothing_is_no_proof(tmp_path):
    need("frama-c")
    folder = write(stand_in("tnl", prefix="cart", **SMALL), tmp_path)
    rewrite(folder, "prove_cart.c", r"(?m)^    (calls|refusals)\(\);\n", "", 0)
    result = prove(folder)
    assert not result.proved and any("state_is_in_box: Dead" in a or "one_step: Dead" in a for a in result.alarms)
    assert result.coverage < 100


def test_broken_c_is_an_error_of_the_tool(tmp_path):
    need("frama-c")
    folder = write(stand_in("tnl", prefix="cart", **SMALL), tmp_path)
    rewrite(folder, "cart.c", r"uint32_t raw = 0U;", "uint32_t raw = nonsense;")
    with pytest.raises(ToolError, match="nonsense"):
        prove(folder)


def test_the_gate_reads_statuses():
    """Valid is the only status that counts; Frama-C's own contracts may be taken for granted."""
    def row(kind, status, directory=".", function="cart_step"):
        return dict(zip(("directory", "file", "line", "function", "property kind", "status", "property"),
                        (directory, "cart.c", "1", function, kind, status, "p")))

    rows = [row(f"precondition of cart_{call}", "Valid") for call in ("init", "step", "predict", "reset")]
    rows += [row("user assertion", "Valid", function=f) for f in
             ("state_is_in_box", "answer_is_whole", "nothing_is_written", "refused", "prove_cart")]
    rows.append(row("postcondition", "Considered valid", "FRAMAC_SHARE/libc"))
    assert judge(rows, "", "cart")[0] == ()
    for status in ("Unknown", "Invalid", "Valid but dead", "Valid under hyp.", "Never tried", "Considered valid"):
        assert judge([*rows, row("user assertion", status)], "", "cart")[0]
    assert judge([*rows, row("postcondition", "Unknown", "FRAMAC_SHARE/libc")], "", "cart")[0]
    assert judge(rows, "    by the Eva analyzer:      0 errors    1 warning", "cart")[0]
    assert len(judge([], "", "cart")[0]) == 9


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    with pytest.raises(ToolError, match="resources.json"):
        prove(tmp_path)
    folder = write(stand_in(prefix="cart"), tmp_path / "cart")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ToolError, match="frama-c: not found. Install it"):
        prove(folder)
    (folder / "prove_cart.c").unlink()
    with pytest.raises(ToolError, match="prove_cart.c: not found"):
        prove(folder)
