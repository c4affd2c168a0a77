"""The independent checker on point observers: it agrees with the certificate, and refuses each constant made false."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil

import pytest
from helpers.checker import CHECKER
from helpers.kept import POINTS, family_of
from helpers.scripts import GENERATED, prefix_of
from synthesis.test_independent import run

FILES = sorted(CHECKER.parent.glob("independent*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_every_file_is_short(path):
    assert len(path.read_text().splitlines()) < 250


@pytest.mark.parametrize("folder", POINTS, ids=lambda f: f.name)
def test_proves_every_point_observer(folder):
    """Of a kind of set that it does not know it says so, by its exit status: nothing is proved."""
    done = run(folder)
    if family_of(folder) not in FALSE:
        assert done.returncode == 2 and "nothing is said" in done.stderr
        return
    assert done.returncode == 0, done.stderr
    assert "proved for float32" in done.stdout and "proved for float64" in done.stdout and "constants of" in done.stdout


def first(data, *path):
    """Lists and keys on the way to the entry of a table that is largest in magnitude."""
    for key in path:
        data = data[key]
    while isinstance(data[0], list):
        data = max(data, key=lambda part: max(map(abs, flat(part)), default=0))
    return data, max(range(len(data)), key=lambda i: abs(data[i]))


def flat(value):
    return [x for v in value for x in flat(v)] if isinstance(value, list) else [value]


T, Z, C = ("tables", "float32"), ("tables", "float32", "shape"), ("certificate", "float32")
ESTIMATE = {"M": (*T, "M"), "L": (*T, "L"), "d or G": (*T, "G"), "blind": (*T, "A"), "output": (*T, "C"),
            "box": (*T, "box"), "range": (*T, "x_hi")}
#: Per family: what is changed, by which factor, and what the refusal says.
FALSE = {
    "zonotope": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in ("box", "range")} | {
        "box": ((*T, "box"), 0.9, "box"), "range": ((*T, "x_hi"), 0.9, "box x"), "e": ((*Z, "e"), 0.95, "e["),
        "rho": ((*Z, "rho"), 0.95, "rho["), "spread": ((*Z, "spread"), 0.9, "spread["), "F": ((*Z, "F"), 0.99, "e["),
        "Fb": ((*Z, "Fb"), 0.99, "e["), "V": ((*Z, "V"), 0.99, "rho["),
        "limit": ((*T, "limit"), 0.9, "limit below"), "ultimate box": ((*C, "steady_box", "half"), 0.9, "ultimate"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
    "ellipsoid": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in ("box", "range")} | {
        "box": ((*T, "box"), 0.9, "box"), "range": ((*T, "x_hi"), 0.9, "box x"), "H": ((*Z, "H"), 0.9, "H of mode"),
        "Hb": ((*Z, "Hb"), 0.9, "Hb of mode"), "V": ((*Z, "V"), 0.9, "V of mode"), "k": ((*Z, "k"), 0.7, "k["),
        "g": ((*Z, "g"), 0.5, "H of mode"), "tangent": ((*Z, "a"), 0.999, "tangent a"),
        "tangent of the residual": ((*Z, "by"), 0.999, "tangent ay"), "spread": ((*Z, "spread"), 0.99, "spread["),
        "limit": ((*T, "limit"), 0.5, "limit below")},
    "thresholds": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in (
        "box", "range", "blind")} | {
        "box": ((*T, "box"), 0.1, "box of the estimate"), "range": ((*T, "x_hi"), 0.9, "box x"),
        "threshold": ((*Z, "h"), 0.99, "threshold"), "half width": ((*Z, "hx"), 0.99, "threshold"),
        "box of a stage": ((*C, "main", "boxes", -1), 0.99, "box of stage"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
    "box": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in ("box", "range")} | {
        "box": ((*T, "box"), 0.9, "box"), "range": ((*T, "x_hi"), 0.9, "box x"), "P": ((*Z, "P"), 1 - 1e-6, "P["),
        "Pb": ((*Z, "Pb"), 1 - 1e-6, "Pb["), "S": ((*Z, "S"), 1 - 1e-6, "S["), "g": ((*Z, "g"), 1 - 1e-5, "g["),
        "gb": ((*Z, "gb"), 1 - 1e-5, "gb["), "rho": ((*Z, "rho"), 1 - 1e-5, "rho["),
        "coordinates": ((*Z, "T"), 1.01, ""), "spread": ((*Z, "spread"), 0.4, "spread["),
        "limit": ((*T, "limit"), 0.5, "limit below"), "ultimate box": ((*C, "steady_box", "half"), 0.9, "ultimate"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
    "ellipsoid_trace": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in ("box", "range")} | {
        "box": ((*T, "box"), 0.9, "box"), "range": ((*T, "x_hi"), 0.9, "box x"), "H": ((*Z, "H"), 0.99, "H of mode"),
        "Hb": ((*Z, "Hb"), 0.99, "Hb of mode"), "V": ((*Z, "V"), 0.99, "V of mode"), "k": ((*Z, "k"), 0.7, "k["),
        "tangent": ((*Z, "a"), 0.999, "tangents"), "scale": ((*Z, "scale"), 1 - 1e-6, "scale of"),
        "weight": ((*Z, "weight"), 0.5, "no square"), "spread": ((*Z, "spread"), 0.9, "spread["),
        "limit": ((*T, "limit"), 0.5, ""), "trace": ((*C, "trace"), 0.99, "trace grows"),
        "shrinks": ((*C, "shrink"), 0.9, "does not shrink"), "half": ((*C, "steady_box", "half"), 0.99, "ultimate"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
    "schedule": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in (
        "box", "range", "blind")} | {
        "box": ((*T, "box"), 0.1, "box of the estimate"), "range": ((*T, "x_hi"), 0.9, "box x"),
        "threshold": ((*Z, "h"), 0.99, "threshold of"), "last threshold": ((*Z, "h", -1), 0.99, "threshold of phase"),
        "first threshold": ((*Z, "h", 0), 0.99, "sample 0"), "half width": ((*Z, "hx"), 0.99, "threshold of"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
    "blocks": {name: (path, 1.01, "") for name, path in ESTIMATE.items() if name not in ("box", "range", "blind")} | {
        "box": ((*T, "box"), 0.1, "box of the estimate"), "range": ((*T, "x_hi"), 0.9, "box x"),
        "rows": ((*Z, "rows"), 1.01, "scalars["), "scalars": ((*Z, "scalars"), 0.99, "scalars["),
        "scalars at the start": ((*Z, "scalars", 0, 1, 0), 0.5, "scalars[0][1][0]"),
        "noise": ((*Z, "noise"), 0.99, "noise["), "powers": ((*Z, "powers"), 1.001, "e["),
        "last power": ((*Z, "powers", 1, -1), 1.01, "e["), "pushed": ((*Z, "pushed"), 0.99, "e["),
        "last pushed": ((*Z, "pushed", 0, 2, -1), 0.99, "e["), "e": ((*Z, "e"), 0.5, "e["),
        "start": ((*Z, "start"), 0.99, "start["), "anywhere": ((*Z, "anywhere"), 0.99, "anywhere["),
        "limit": ((*Z, "most"), 0.5, "beyond the limit"), "higher limit": ((*Z, "most"), 1.1, ""),
        "wide": ((*Z, "wide"), 0.9, "wide["), "a direction": ((*Z, "directions", 2), 1.001, "noise["),
        "ultimate box": ((*C, "steady_box", "half"), 0.9, "ultimate box"),
        "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")},
}
LEVEL = {"level": ((*C, "level"), 1 - 1e-6, "level"), "P": ((*C, "P"), 1.5, ""), "g": ((*C, "g"), 0.9, "matrix")}


def spoilt(folder, path, factor, to):
    """A copy with one number of design.json changed."""
    copy = shutil.copytree(folder, to / "copy")
    data = json.loads((copy / "design.json").read_text())
    *way, last = path
    place = data
    for key in way:
        place = place[key]
    if isinstance(place[last], list):
        values, i = first(place, last)
        assert values[i]
        values[i] *= factor
    else:
        place[last] *= factor
    (copy / "design.json").write_text(json.dumps(data))
    return copy


def has_level(folder):
    """Whether the certificate of a committed design has a level of the gains."""
    return folder in GENERATED and json.loads((folder / "design.json").read_text())["certificate"]["float32"][
        "kind"] != "none"


CASES = [pytest.param(folder, *case, id=f"{folder.name}-{name}") for folder in POINTS
         for name, case in (FALSE.get(family_of(folder), {}) | (LEVEL if has_level(folder) else {})).items()]


@pytest.mark.parametrize("folder,path,factor,words", CASES)
def test_refuses_false_claims(folder, path, factor, words, tmp_path):
    done = run(spoilt(folder, path, factor, tmp_path))
    assert done.returncode == 1 and done.stderr.startswith("refused: ") and words in done.stderr, done.stderr


@pytest.fixture(scope="module")
def check_source():
    """The part that reads the C, alone: the proof does not depend on it."""
    spec = importlib.util.spec_from_file_location("independent_source", CHECKER.with_name("independent_source.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.check_source


CHANGES = {  # what of the C, and what instead
    "a number of a table": (r"(limit\[\w+\] = \{\s*)[\d.]+F", r"\g<1>0.123F"),
    "a number of the estimate": (r"(?<=[{ ])-?0\.\d{5,}F(?=,)", "0.123F"),
    "the set of every error": (r"(_set_anywhere\([^{]*\{\s*static[^{]*\{\s*)[\d.]+F", r"\g<1>9.0F"),
    "two numbers of a table": (r"(?s)(_set_initial\(.*?\{ )(-?[\d.e-]+F), (?!\2)(-?[\d.e-]+F)", r"\1\3, \2"),
    "where init starts": (r"(_init\([^{]*\{\s*s->x_hat\[0\] = )[^;]*", r"\g<1>50.0F"),
    "the set of init": (r"(_set_initial\([^{]*\{\s*static[^{]*\{\s*)[\d.]+F", r"\g<1>0.001F"),
}


@pytest.mark.parametrize("folder", POINTS, ids=lambda f: f.name)
def test_refuses_another_c(folder, check_source):
    prefix = prefix_of(folder)
    text = (folder / f"{prefix}.c").read_text()
    record, tables = (json.loads((folder / f"{n}.json").read_text()) for n in ("resources", "design"))
    t, changed = tables["tables"][record["real"]], 0
    check_source(text, t, prefix)
    for what, (pattern, new) in CHANGES.items():
        other, count = re.subn(pattern, new, text, count=1)
        changed += count
        if count:
            with pytest.raises(SystemExit, match="refused: "):
                check_source(other, t, prefix)
                pytest.fail(what)
    assert changed >= 4
