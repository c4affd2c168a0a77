"""The assurance file of families with claims of their own: every kind of C is read, what was changed is found."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import banks, driven, follower, guided, small_sliding, solved, trailing
from helpers.kept import OTHERS, family_of
from helpers.small_modes import stand_in
from helpers.table_numbers import every_number_of_the_family

from codegen.assurance import follower_claims
from codegen.assurance.c_reader import blank
from codegen.assurance.claims import OWN, claims
from codegen.assurance.driven_claims import joined
from codegen.assurance.places import constants
from codegen.designs import read_design
from codegen.emit.package import firmware
from codegen.errors import CertificateError
from codegen.observers import FAMILIES

CASES = [(f.name, layout) for f in OTHERS if family_of(f) == "filter" for layout in ("literal", "table", "loop")]
CASES += [(f.name, "table") for f in OTHERS if f.name.startswith("quadrotor")]
CASES += [("one input", "table"), ("no input, two outputs", "literal"), ("parameters", "table"), ("discrete", "loop")]
CASES += [("disc_sensors_bank", "table"), ("dlpv bank", "loop"), ("two pivots", "loop")]
CASES += [(f"sliding: {name}", layout) for name, layout in (("one input", "loop"), ("no input, two outputs", "table"))]
KINDS = [(*case, real) for case in CASES for real in ("float32", "float64")]
KINDS += [("follower: box", "loop", "float64"),  # other sets: guided ones
          ("guided: parameters", "table", "float32"), ("guided: no input, two outputs", "loop", "float64"),
          ("guided: turned", "literal", "float32"), ("turned", "table", "float32"),
          ("pushed_hinf-filter", "literal", "float32"), ("trailing: no input", "loop", "float64")]
folders = pytest.mark.parametrize("folder", OTHERS, ids=lambda f: f.name)


@cache
def design_of(name):
    if name == "dlpv bank":
        return banks.design()
    if name.startswith("sliding: "):
        return small_sliding.stand_in(name.removeprefix("sliding: "))
    if name.startswith("guided: "):
        return guided.stand_in(name.removeprefix("guided: "))
    if name.startswith("trailing: "):
        return trailing.stand_in(name.removeprefix("trailing: "))
    if name.startswith("follower: "):
        return follower.stand_in(name.removeprefix("follower: "))
    if name == "two pivots":
        return solved.stand_in(True, "float32", "float64")
    if "_" in name:
        return read_design(next(f for f in OTHERS if f.name == name))
    return driven.stand_in(name) if name in driven.PLANTS else stand_in(name, 3)


@cache
def printed(name, layout, real="float32"):
    """C that is accepted as it is, with its constants."""
    design = design_of(name)
    p, texts = design.plant.target.prefix, firmware(design, real, layout)
    return texts[f"{p}.c"], texts[f"{p}.h"], constants(design, real, layout, texts[f"{p}.c"], texts[f"{p}.h"])


def test_every_family_of_its_own_is_walked():
    assert {family_of(f) for f in OTHERS} == set(OWN) and set(OWN) <= set(FAMILIES)


@pytest.mark.parametrize("name, layout, real", KINDS)
def test_constants_are_found_in_every_kind_of_c(name, layout, real):
    text, _, found = printed(name, layout, real)
    lines = text.splitlines()
    assert sum(len(c.entries) for c in found) > 40
    for c in found:
        assert all(e.literal in lines[n - 1] for e in c.entries for n in e.lines)


#: What the C says, what instead.
CHANGED = {
    "farhat_hinf-filter": (
        ("s->since++;", "s->since = 0U;"), ("s->since >> 1U", "s->since >> 2U"), ("<= limit[i]", "< limit[i]"),
        ("!= FARHAT_LOST)", "!= FARHAT_LAST)"), ("s->since = 36U;", "s->since = 56U;"), ("s->xi[i] = next[i];", ""),
        ("threshold[row][in->mode]", "threshold[row][0]"), ("const bool known = (", "const bool known = !("),
        ("raw |= (uint32_t)1U << i", "raw |= (uint32_t)0U << i"), ("out->f_hat[0] = common_0 +", "out->f_hat[0] = "),
        ("(k[1] * s->xi[0])", "(k[1] * s->xi[1])"), ("(k[3] * in->y[0])", "(k[4] * in->y[0])")),
    "digester_descriptor-fault-estimation": (
        ("dig_estimate(s, s->y", "dig_estimate(s, in->y"), ("+ (h[1] * v[1])", "+ (h[0] * v[1])"),
        ("v[3] = (0.99935F", "v[2] = (0.99935F"), ("(864.0F * h[4])", "(864.0F * h[5])"),
        ("t13 ? x_hat[3] : 1.05F", "t13 ? 1.05F : x_hat[3]"), ("t11 && t12", "t11 && t5"),
        ("r[1] = y[1] - x_hat[1]", "r[1] = y[1] - x_hat[2]"),
        ("s->z[i] = least[i];", "s->z[i] = most[i];"), ("x_hat[3] = s->z[3] + y[3]", "x_hat[3] = s->z[3] - y[3]")),
    "quadrotor_tracking": (
        ("ref[1] - in->y[1]", "ref[1] - in->y[2]"), ("law->s[0] + (0.01F", "law->s[0] - (0.01F"),
        ("ref[2] <= 0.15F", "ref[2] < 0.15F"), ("(0.32269752F * law->s[2])", "(0.32269752F * law->s[1])"),
        ("law->limited |= ", "law->limited = "), ("next[i] >= -limit[i]", "next[i] >= limit[i]"),
        ("quadrotor_coast(quadrotor_state *s, quadrotor_law *law, quadrotor_in *in, quadrotor_out *out)\n{",
         "quadrotor_coast(quadrotor_state *s, quadrotor_law *law, quadrotor_in *in, quadrotor_out *out)\n{\n    ;"),
        ("in->u[i] = most[i];", "in->u[i] = least[i];")),
    "disc_contact_descriptor-direct": (
        ("x_hat[2] = (2.5F * s->z[1])", "x_hat[2] = (2.5F * s->z[0])"), ("(h[0] * v[0])", "(h[1] * v[0])"),
        ("(1.6666666F * in->u[0])", "(1.6666667F * in->u[0])"), ("weights(s->z, h)", "weights(s->y, h)")),
    "two pivots": (
        ("h[1] * 0.3F", "h[1] * 0.2F"), ("0.15F) ? pivot", "0.1F) ? pivot"), (": 0.15F", ": 0.3F"),
        ("g[0] = h[0];", "g[0] = h[1];"), ("(0.25F * s->z[0]) +", "(0.25F * s->z[1]) +"),
        ("pivot = g[0] + g[1]", "pivot = g[0] - g[1]"), ("+ (g[1] * v[1])", "+ (h[1] * v[1])")),
    "one input": (
        ("J_radius[pair][i][k]", "J_radius[pair][k][i]"), ("above[i] += reach[q][i];", "above[i] -= reach[q][i];"),
        ("birth[pair][i];", "birth[0U][i];"), ("least = seen - v_hi[i];", "least = seen - v_lo[i];"),
        ("(n == 1U) && (", "(n == 9U) && ("), ("below[i] -= room[i];", ""), ("-limit[i]", "limit[i]"),
        ("matrix[i][k] >= 0.0F", "matrix[i][k] < 0.0F"), ("out->x_lo[i] = FLT_MAX", "out->x_lo[i] = FLT_MIN"),
        ("value -= (D[i][j]", "value += (D[i][j]"), ("* valve_size(in->u[j])", "* in->u[j]")),
    "disc_sensors_bank": (
        ("(0.017495178F * r[0])", "(0.017495178F * r[1])"), ("- x_hat[1] - x_hat[3]", "- x_hat[1] + x_hat[3]"),
        ("s->z[2] + s->y[1]", "s->z[2] + s->y[0]"), ("0.04F * (e", "0.05F * (e"),
        ("left[i] = 100U", "left[i] = 1U"), ("sound && (i", "(i"), ("s->credit -= ", "s->credit += "),
        ("s->y[i] = in->y[i];", ""), ("raised == pattern[i]", "raised != pattern[i]"),
        ("(-7.476807e-08F)", "7.476807e-08F")),
    "zammali_modes_mode-sliding": (
        ("_SHARE 0.8F", "_SHARE 0.7F"), ("#define ZAMMALI_MODES_SMOOTH 0.5F", ""), ("_TURN 51.3125F", "_TURN 51.3125"),
        ("#define ZAMMALI_MODES_PULL", "#define else\n#define ZAMMALI_MODES_PULL"), ("root = 0.5F *", "root = 0.25F *"),
        ("(most + v_hi[i])", "(most - v_hi[i])"), ("s->age == ZAMMALI_MODES_BLANK", "s->age != ZAMMALI_MODES_BLANK")),
    "guided: parameters": (
        ("held.mode = out->mode;", "held.mode = 0U;"), ("kept && (own.x_lo[i] > out", "(own.x_lo[i] > out"),
        ("+ (M_1_1 * s->x_lo[1]) - apart_1", "+ (M_1_1 * s->x_hi[1]) - apart_1"),
        ("= s->told_theta[0];", "= in->theta[0];"), ("(uint32_t)2U << i", "(uint32_t)1U << i"),
        ("valve_told_clip(x_lo[1], -", "valve_told_clip(x_lo[1], "), ("if (value < least)", "if (value > least)"),
        ("typedef valve_real valve_told_real;", "typedef double valve_told_real;")),
    "guided: turned": (
        ("told_to_z(&held);", "told_to_x(&held);"), ("valve_told_cut_z(s->z_lo, s->z_hi);", ""),
        ("(!kept) || (s->told_z_lo", "(kept) || (s->told_z_lo")),
    "follower: box": (
        ("held->mode = q;", "held->mode = 0U;"), ("typedef valve_real valve_told_real;",
                                                            "typedef double valve_told_real;"),
        ("x_lo[i], -told_limit", "x_lo[i], told_limit"), ("s->alive[q] &= 1U;", ""), ("x_hat[i] - lo[i]", "x_hat[i]"),
        ("(half[i] > widest[i])", "(half[i] < widest[i])"), ("above[i] + xi_room[i]", "above[i]"),
        ("* 1.0000005F)", "* 1.0000004F)"), ("(0.5F * lo[i])", "(0.25F * lo[i])"), ("(age == 0U) && (q ==", "(q =="),
        ("s->followed = VALVE_MODES;", "s->followed = 0U;"), ("valve_told_cut(out->x_hat);", "")),
    "pushed_hinf-filter": (
        ("in, q, f_hat);", "in, 0U, f_hat);"), ("s->alive[q] &= 1U;", "s->alive[q] = 0U;"),
        ("* 1.0000005F)", "* 1.0000004F)"), ("told_since[q] >> 1U", "told_since[q] >> 2U"),
        ("<= largest[k]", "< largest[k]"), ("(E[q][j][i] * lo[i])", "(E[q][i][j] * lo[i])"),
        ("(0.5F * last)", "(0.25F * last)"), ("s->decided = s->settled;", ""),
        ("(k[1] * xi[0])", "(k[2] * xi[0])"), ("threshold[stage][row][q]", "threshold[0U][row][q]")),
    "parameters": (
        ("(M_0_1 * s->x_lo[1]) - apart_0", "(M_0_1 * s->x_hi[1]) - apart_0"), ("th_0 = s->theta[0]", "th_0 = s->u[0]"),
        ("+ (k[10] * a_0)", "+ (k[11] * a_0)"), ("valve_cut_x(out->x_lo, out->x_hi);\n}", "}"),
        ("held.mode = q;", "held.mode = 0U;"), ("below[i] - xi_room[i]", "below[i] + xi_room[i]"),
        ("x_hi[0] = valve_clip(x_hi[0]", "x_hi[0] = valve_clip(x_lo[0]"), ("in->theta[0] >= -", "in->theta[0] > -")),
    "turned": (
        ("(k[5] * s->z_lo[1])", "(k[5] * s->z_hi[1])"), ("valve_to_x(s);", "valve_to_z(s);"),
        ("(0.65F * s->x_lo[0])", "(0.66F * s->x_lo[0])"), ("moved = kept && (!", "moved = kept && ("),
        ("z_lo[0] = valve_clip(z_lo[0]", "z_lo[0] = valve_clip(z_hi[0]")),
}


@pytest.mark.parametrize("name", CHANGED)
def test_a_changed_c_is_refused(name):
    """A statement, an index, an operator: nothing of the C may differ from what is printed of the design."""
    text, header, _ = printed(name, "table")
    for old, new in CHANGED[name]:
        assert old in text, old
        with pytest.raises(CertificateError, match="rint it again|Print the C again"):
            constants(design_of(name), "float32", "table", text.replace(old, new, 1), header)
    with pytest.raises(CertificateError, match="macros"):
        constants(design_of(name), "float32", "table", text, re.sub(
            r"(#define \w+_(?:LOST|AGES|LAST|DWELL|NF) )(\d+)U", r"\g<1>77U", header, count=1))


#: With many numbers in tables.
TABLED = [n for n in CHANGED if not re.search("bank|contact|pivot|turned|guided|pushed", n)]


@pytest.mark.parametrize("name", TABLED)
def test_two_numbers_of_a_table_may_not_change_places(name):
    text, header, _ = printed(name, "table")
    code = blank(text)
    places = [m for m in re.finditer(r"([\d.e-]+F)( \} *,\s*\{ |, )(?!\1)([\d.e-]+F)", code)
              if float(m[1][:-1]) != float(m[3][:-1])]
    assert len(places) > 10
    for m in places[:: len(places) // 8]:
        with pytest.raises(CertificateError):
            constants(design_of(name), "float32", "table", f"{code[:m.start()]}{m[3]}{m[2]}{m[1]}{code[m.end():]}",
                      header)


def spoilt(design, where, key, change):
    """A design with one field of its tables, or entry of its certificate, changed."""
    t, cert = design.observer.tables["float32"], design.certificate["float32"]
    if where == "tables":
        new = change(getattr(t, key))
        t = replace(t, **{key: new if key == "law" else np.asarray(new, getattr(t, key).dtype)})
    elif where == "told":
        new = change(getattr(t.told, key))
        t = replace(t, told=replace(t.told, **{key: new.astype(t.dtype) if isinstance(new, np.ndarray) else new}))
    elif where == "set":
        own = t.told.shape
        t = replace(t, told=replace(t.told, shape=replace(own, **{key: change(getattr(own, key)).astype(t.dtype)})))
    elif where == "start":
        t = replace(t, start=change(t.start))
    else:
        part = cert if where == "certificate" else cert[where]
        cert = cert | ({key: change(part[key])} if part is cert else {where: part | {key: change(part[key])}})
    return replace(design, observer=type(design.observer)({"float32": t}, design.observer.supervision),
                   certificate={"float32": cert})


FALSE = {
    "bank": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("bound", 0.5, "after 431 samples|threshold beyond"), ("limit", 0.5, "to its limits"),
            ("most", 0.4, "to its limits"), ("x_lo", 0.9, "ranges: x box"))),
        ("calibration", "confidence", lambda c: 1.001 * c, "confidence of the order statistics"),
        ("calibration", "probability", lambda p: 0.9 * p, "confidence of the order statistics"),
        ("calibration", "runs", lambda n: n - 1, "confidence of the order statistics"),
        ("calibration", "levels", lambda v: [2 * x for x in v], "threshold beyond the largest level"),
        ("certificate", "members", lambda m: [m[1], m[0]], "fails|not those that are proved|T1|shrink|another")),
    "sliding": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("d_hi", 0.98, "not far enough"), ("d_lo", 0.98, "not far enough"), ("v_lo", 0.98, "test could fail"),
            ("limit", 0.1, "below the range of x"), ("G", 1.01, "not far enough"), ("L_hi", 1.001, "not the gain"),
            ("x_hi", 0.9, "ranges: x box"), ("x0_lo", 0.9, "ranges: x0 box"))),
        ("certificate", "gamma", lambda g: [0.9 * x for x in g], "level gamma"),
        ("certificate", "P", lambda P: [[0.9 * x for x in p] for p in P], "no entry below 1"),
        ("certificate", "target", lambda J: 0.4, "level beta|entries of J|J"),
        ("certificate", "errors", lambda e: [[[0.99 * x for x in s] for s in m] for m in e], "does not settle"),
        ("certificate", "dwell", lambda k: k - 1, "dwell time")),
    "guided": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("d_hi", 0.98, "not far enough"), ("v_lo", 0.98, "test could fail"), ("L_hi", 1.001, "not the gain"),
            ("x_hi", 0.9, "ranges of x"), ("x0_hi", 0.9, "ranges: x0 box"))),
        *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("d_hi", 0.99, "framers: offset d"), ("a_lo", 0.99, "framers: offset a"), ("M_lo", 1.01, "framers: off"),
            ("c_hi", 0.99, "framers: offset c"), ("x_lo", 0.9, "ranges of x"), ("y_hi", 0.99, "y_hi"))),
        ("certificate", "target", lambda J: 0.4, "level beta|entries of J|J"),
        ("certificate", "dwell", lambda k: k - 1, "dwell time")),
    "filter": (
        ("tables", "h", lambda h: 0.99 * h, "estimate of fault 0"), ("tables", "limit", lambda x: 1e-3 * x, "limit|xi"),
        ("tables", "K", lambda K: 1.02 * K, "energy: smallest pivot|estimate of fault"),
        ("tables", "M", lambda M: 1.05 * M, "energy: smallest pivot|not kept"),
        ("tables", "x0_hi", lambda x: 0.9 * x, "ranges: x0 box"),
        ("tables", "x_lo", lambda x: 0.9 * x, "ranges: x box"),
        ("start", "", lambda k: 0 * k + 99, "starts at 99"),
        ("certificate", "level", lambda g: 0.999 * g, "energy: square of the claimed level"),
        ("energy", "level2", lambda g: 0.99 * g, "energy: smallest pivot of the matrix"),
        ("energy", "P", lambda P: [[[-x for x in row] for row in p] for p in P], "energy: smallest pivot of a Lyap"),
        ("set_of_both", "bounds", lambda b: [[0.98 * x for x in row] for row in b], "not kept")),
    "polytopic": (
        ("tables", "h", lambda h: 0.99 * h, "residual 0 reaches|estimate: .*threshold"),
        ("tables", "K", lambda K: 1.0001 * K, "not kept|entries"), ("tables", "T2", lambda M: 1.01 * M, "reads an"),
        ("tables", "known", lambda g: 1.001 * g, "not kept|entries"), ("start", "", lambda k: k + 99, "starts at"),
        ("tables", "z_lo", lambda z: z + 0.5, "does not start within its limits"),
        ("thresholds", "level", lambda v: 0.9 * v, "last level"),
        ("thresholds", "P", lambda P: [[-x for x in row] for row in P], "positive definite"),
        ("thresholds", "share", lambda x: 0.99 * x, "not kept")),
    "disc_descriptor-uncertain": (
        ("tables", "h", lambda h: 0.999 * h, "residual [0-9] reaches"),
        ("tables", "F", lambda F: 1.01 * F, "energy: smallest pivot"),
        ("certificate", "level", lambda g: 0.999 * g, "energy: square of the claimed level"),
        ("energy", "level2", lambda g: 0.0 * g, "energy: smallest pivot of minus the matrix of a pair"),
        ("energy", "contraction", lambda f: 0.99 * f, "decay: smallest pivot"),
        ("certificate", "limit", lambda T: T / 100, "steps: limit of the period"),
        ("energy", "P1", lambda P: [[-x for x in row] for row in P], "P1 is not a symmetric, positive definite"),
        ("thresholds", "bounds", lambda b: [[0.98 * x for x in row] for row in b], "not kept"),
        ("start", "", lambda k: k - 1, "starts at")),
    "descriptor": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("h", 0.99, "residual [0-9] reaches"), ("P", 1.01, "energy: smallest pivot"),
            ("z_hi", 4, "residual [0-9] reaches|not kept"),
            ("pivot", 0.0, "energy: smallest pivot|least pivot"))),
        ("certificate", "level", lambda g: 0.999 * g, "energy: square of the claimed level"),
        ("energy", "Re", lambda R: (0 * np.array(R)).tolist(), "energy: smallest pivot of minus the matrix of a pair"),
        ("energy", "Rc", lambda R: (0 * np.array(R)).tolist(), "decay: smallest pivot"),
        ("thresholds", "bounds", lambda b: [[0.6 * x for x in row] for row in b], "not kept")),
    "quadrotor_tracking": (
        ("loop", "decay", lambda d: d | {"factor": 0.99 * d["factor"]}, "loop-decay: smallest pivot"),
        ("loop", "level", lambda d: d | {"level2": 0.9 * d["level2"]}, "loop-energy: smallest pivot"),
        ("certificate", "reached", lambda r: r | {"u": [0.99 * u for u in r["u"]]}, "said to be reached"),
        ("tables", "law", lambda law: replace(law, limit=law.limit / 2), "no-saturation: range beyond"),
        ("tables", "law", lambda law: replace(law, Kx=law.Kx * np.float32(1.5)), "loop-decay: smallest pivot")),
    "mode": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("reach", 0.5, "reach of mode"), ("birth", 0.5, "birth from"), ("J_radius", 0.7, "jump from"),
            ("J", 1.01, "jump from"), ("v_hi", 0.999, "does not hold"), ("x_room", 0.1, "x_room"),
            ("start_hi", 0.999, "start"), ("wide_lo", 0.999, "wide"), ("limit", 0.2, "limit"))),
        ("certificate", "worst", lambda k: k - 1, "identified: worst delay"),
        ("certificate", "identified", lambda d: [[k - 1 for k in row] for row in d], "delays: delay of the decision"),
        ("certificate", "start", lambda k: k - 1, "start: delay from power-up"),
        ("certificate", "quiet", lambda k: k - 1, "quiet: age beyond"),
        ("certificate", "widths", lambda w: [0.5 * x for x in w], "may grow beyond")),
    "driven": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("reach", 0.5, "reach of mode"), ("birth", 0.5, "birth from"), ("xi_room", 0.3, "xi_room"),
            ("S_rounded", 1.0001, "xi_room"), ("start_hi", 0.999, "start"))),
        *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("d_hi", 0.99, "framers: offset d"), ("a_lo", 0.99, "framers: offset a"), ("M_lo", 1.01, "framers: off"),
            ("box", 0.99, "ranges of x|state box"), ("y_hi", 0.99, "y_hi"))),
        ("certificate", "worst", lambda k: k - 1, "identified: worst delay")),
    "trailing": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("reach", 0.5, "reach of mode"), ("birth", 0.5, "birth from"), ("x_room", 0.1, "x_room"),
            ("start_hi", 0.999, "start"))),
        *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("h", 0.99, "estimate of fault 0"), ("K", 1.02, "estimate of fault 0"), ("M", 1.05, "not kept"),
            ("E", 1.2, "start of size"), ("sizes", 0.99, "declared range"), ("limit", 0.01, "limit"),
            ("grow", 0.9999, "grow"), ("floor", 0.01, "floor"), ("y_hi", 0.99, "ranges of inputs"),
            ("x_lo", 0.9, "ranges of the filters"))),
        ("certificate", "told", lambda c: c | {"level": 0.999 * c["level"]}, "energy: square of the claimed level"),
        ("certificate", "told", lambda c: c | {"energy": c["energy"] | {"level2": 0.99 * c["energy"]["level2"]}},
         "energy: smallest pivot of the matrix"),
        ("certificate", "told", lambda c: c | {"sets": [s | {"bounds": [0.98 * b for b in s["bounds"]]}
                                                       for s in c["sets"]]}, "not kept"),
        ("certificate", "worst", lambda k: k - 1, "identified: worst delay")),
    "follower": (
        *(("tables", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("grow", 0.9999, "followed: factor of a half width"), ("square", 0.99, "followed: factor of its square"),
            ("floor", 0.1, "followed: least half width"), ("reach", 0.5, "reach of mode"), ("xi_room", 0.05, "xi_room"),
            ("start_hi", 0.999, "start"))),
        *(("told", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("L", 1.01, "followed: e beyond"), ("limit", 0.4, "limit beyond|e beyond"), ("x_hi", 0.9, "ranges of x"),
            ("box", 0.6, "box beyond|e beyond"), ("y_hi", 0.99, "y_hi"))),
        *(("set", key, lambda x, f=factor: f * x, words) for key, factor, words in (
            ("e", 0.5, "followed: e beyond|followed: inside"), ("rho", 0.9, "followed: rho beyond"),
            ("F", 1.1, "followed: e beyond"), ("spread", 0.9, "followed: spread"))),
        ("certificate", "worst", lambda k: k - 1, "identified: worst delay")),
}


@pytest.mark.parametrize("family", FALSE)
def test_margins_refuse_what_does_not_hold(family):
    design = design_of(next(f.name for f in OTHERS if family in (family_of(f), f.name)))
    assert all(m.holds for c in claims(design, "float32") for m in c.margins)
    for where, key, change, words in FALSE[family]:
        with pytest.raises(CertificateError, match=words):
            claims(spoilt(design, where, key, change), "float32")


def test_margins_of_other_coordinates():
    design = driven.turned_design()
    found = {c.id: c for c in claims(design, "float32")}["framers"]
    assert {"Z", "X", "e", "b", "z"} <= set(found.constants)
    assert {"range of z beyond what Z makes of the range of x", "offset e beyond its demand",
            "offset b beyond its demand"} <= {m.what for m in found.margins}
    own = design.observer.tables["float32"].told.change
    for key, words in (("e_hi", "framers: offset e"), ("X", "framers: offset b"), ("z_lo", "framers: range of z")):
        wrong = replace(own, **{key: getattr(own, key) * np.float32(0.9)})
        with pytest.raises(CertificateError, match=words):
            claims(spoilt(design, "told", "change", lambda c, new=wrong: new), "float32")


#: A field of the set that is told its mode, made less, by case; what its margin is called.
LESS = {"box": ("g", "alarm", "g beyond"), "ellipsoid": ("H", "alarm", "smallest pivot"),
        "table": ("h", "alarm", ""), "trace": ("scale", "state", "scale beyond"),
        "zonotope": ("e", "alarm", "e beyond")}


@pytest.mark.parametrize("name", LESS)
def test_every_set_that_follows_has_its_margins(name):
    design, real = follower.stand_in(name), "float32"
    (key, part, words), cert = LESS[name], follower.told(name, real)[1]
    t, wrong = design.observer.tables[real], spoilt(design, "set", key, lambda x: x * np.float32(0.9))
    held = follower_claims.held_by_set(design.plant, t, cert)
    every = [*follower_claims.starts(t), *joined(t, "observer"), *(m for ms in held.values() for m in ms)]
    assert len(every) > 7 and all(m.holds for m in every)
    if name == "table":  # proved row by row, the first that does not hold is named
        with pytest.raises(CertificateError, match="start 0 in mode 0"):
            follower_claims.held_by_set(design.plant, wrong.observer.tables[real], cert)
        return
    less = follower_claims.held_by_set(design.plant, wrong.observer.tables[real], cert)[part]
    assert any(not m.holds and words in m.what for m in less)


def test_every_number_of_two_pivots_is_read():
    _, _, found = printed("two pivots", "loop")
    values = {(c.name, c.mode, *e.index): e.value for c in found for e in c.entries}
    every_number_of_the_family(design_of("two pivots").observer.tables["float32"], values, [])


@folders
def test_no_claim_is_called_independent_that_the_checker_does_not_look_at(folder):
    """Delays rest on linear programs, of which the independent checker sees the multipliers that are kept."""
    design = design_of(folder.name)
    cert = design.certificate["float32"]
    bare = {k: v for k, v in cert.items() if k != "witnesses"}
    for c in claims(replace(design, certificate={"float32": bare}), "float32"):
        about = c.id in ("identified", "delays", "start", "quiet") or c.id.startswith(("detection", "found-"))
        assert not (about and "independent" in c.checks), c.id
    stated = claims(design, "float32")
    for c in stated:
        if c.id in ("identified", "delays", "start", "quiet") or c.id.startswith("found-"):
            assert "independent" in c.checks and cert["witnesses"]
    if family_of(folder) in ("polytopic", "descriptor"):
        assert any("independent" in c.checks for c in stated)
