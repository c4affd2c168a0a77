"""The independent checker on zonotopes boxed in other coordinates, and on boxes kept under a dwell time."""

from __future__ import annotations

import json
import shutil
from importlib import resources

import numpy as np
import pytest
from helpers.folders import write
from synthesis.set_plants import PRINTED62
from synthesis.test_independent import run
from synthesis.test_independent_sets import C, T, Z, spoilt

from codegen.designs import Design
from codegen.observers import Supervision, ZonotopeObserver
from codegen.plant.load import loads
from codegen.selection.point_sets import sized
from codegen.selection.points import certified

PLANT = (resources.files("codegen") / "gallery" / "zammali_zonotope.toml").read_text().partition("[[scenario]]")[0]
#: Two nilpotent parts whose product grows: in the coordinates of x, bounded only where a mode lasts.
SLOW = """format = 1
name = "slow"
title = "Two modes that must last"
source = "own example"
[time]
kind = "discrete"
sample_period = 1
[signals]
x = [{ name = "x0", range = [-40, 40] }, { name = "x1", range = [-40, 40] }]
y = [{ name = "y", range = [-90, 90] }]
w = [{ name = "w0", bounds = [-0.1, 0.1] }, { name = "w1", bounds = [-0.1, 0.2] }]
v = [{ name = "v", bounds = [-0.1, 0.1] }]
[initial]
x_lo = [-0.1, -0.1]
x_hi = [0.1, 0.2]
[common]
C = [[1, 0]]
Bw = [[1, 0], [0, 1]]
Dv = [[1]]
[[mode]]
name = "one"
A = [[0.3, 1.5], [0, 0.3]]
[[mode]]
name = "two"
A = [[0.3, 0], [1.5, 0.3]]
"""
DWELL = 6


def folder_of(text, L, order, folder):
    """A folder as generate makes it, its figures not measured."""
    plant = loads(text)
    gains = {"L": np.array(L), "N": np.zeros(np.shape(L)), "kind": "luenberger"}
    gains |= sized(plant, gains, {"order": order}, DWELL)
    made = {real: certified(plant, gains, {"kind": "none"}, real) for real in ("float32", "float64")}
    observer = ZonotopeObserver({real: t for real, (t, _) in made.items()}, Supervision())
    design = Design(plant, "zonotope", observer, {real: cert for real, (_, cert) in made.items()},
                    {real: ["own words"] for real in made}, {real: [] for real in made})
    write(design, folder).joinpath("design.json").write_text(design.to_json())
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    home = tmp_path_factory.mktemp("oblique")
    return {"oblique": folder_of(PLANT, PRINTED62, 5, home / "oblique"),
            "slow": folder_of(SLOW, np.zeros((2, 2, 1)), 4, home / "slow")}


@pytest.mark.parametrize("name", ["oblique", "slow"])
def test_proves_it(name, made):
    done = run(made[name])
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(f"boundedness while every mode lasts at least {DWELL} samples") == 2
    data = json.loads((made[name] / "design.json").read_text())
    assert all(bool(t["shape"]["B"]) == (name == "oblique") for t in data["tables"].values())


HALF = (*C, "boxes", "half")
#: What is changed, by which factor, and what the refusal says.
FALSE = {
    "B": ((*Z, "B"), 1.01, ""), "S": ((*Z, "S"), 1.0001, "e["), "Sb": ((*Z, "Sb"), 1.0001, "e["),
    "inside": ((*Z, "inside"), 0.95, "inside["), "e": ((*Z, "e"), 0.7, "e["), "F": ((*Z, "F"), 0.99, "e["),
    "Fb": ((*Z, "Fb"), 0.99, "e["), "V": ((*Z, "V"), 0.99, "rho["), "rho": ((*Z, "rho"), 0.95, "rho["),
    "spread": ((*Z, "spread"), 0.9, "spread["), "M": ((*T, "M"), 1.01, "e["), "limit": ((*T, "limit"), 0.4, "below"),
    "box of a stay": (HALF, 0.999, "box of mode"), "first box": ((*HALF, 0), 0.999, "box of mode"),
    "last box": ((*HALF, -1), 0.999, "box of mode"), "dwell time": ((*C, "boxes", "dwell"), 1.5, "dwell time"),
    "hull": ((*C, "steady_box", "half"), 0.99, "ultimate box"),
    "width": ((*C, "steady_box", "width"), 0.99, "ultimate width")}


@pytest.mark.parametrize("path,factor,words", FALSE.values(), ids=FALSE)
def test_refuses_false_claims(path, factor, words, made, tmp_path):
    done = run(spoilt(made["oblique"], path, factor, tmp_path))
    assert done.returncode == 1 and done.stderr.startswith("refused: ") and words in done.stderr, done.stderr


def without_the_last_stay(data):
    """Boxes of a shorter dwell time."""
    boxes = data["certificate"]["float32"]["boxes"]
    stays, boxes["dwell"] = boxes["dwell"] + 1, boxes["dwell"] - 1
    boxes["half"] = [half for i, half in enumerate(boxes["half"]) if i % stays < stays - 1]


def any_switching(data):
    """The last box of each mode for all its stays."""
    boxes = data["certificate"]["float32"]["boxes"]
    stays, boxes["dwell"] = boxes["dwell"] + 1, 1
    boxes["half"] = [half for last in boxes["half"][stays - 1::stays] for half in (last, last)]


def no_coordinates(data):
    data["tables"]["float32"]["shape"]["B"].pop()


def no_boxes(data):
    del data["certificate"]["float32"]["boxes"]


@pytest.mark.parametrize("name,change,words", [
    ("slow", without_the_last_stay, "box of mode"), ("slow", any_switching, "box of mode"),
    ("oblique", any_switching, "box of mode"), ("oblique", no_coordinates, "not given for every mode"),
    ("oblique", no_boxes, "no boxes"), ("slow", no_boxes, "ultimate box")])
def test_refuses_other_boxes(name, change, words, made, tmp_path):
    copy = shutil.copytree(made[name], tmp_path / "copy")
    data = json.loads((copy / "design.json").read_text())
    change(data)
    (copy / "design.json").write_text(json.dumps(data))
    done = run(copy)
    assert done.returncode == 1 and done.stderr.startswith("refused: ") and words in done.stderr, done.stderr
