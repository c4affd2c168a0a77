"""The README tells the truth: its commands run, its Python runs, its C compiles."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from codegen.designs import read_design
from codegen.emit.package import files
from codegen.plant.load import load, loads, starter
from codegen.plant.properties import descriptor_properties
from codegen.synthesis import METHODS, known_options

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", README, re.S)


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^    make (\w+)", README, re.M):
        assert re.search(rf"^{target}:", makefile, re.M)


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Run the worked example of the README as it stands there."""
    folder = tmp_path_factory.mktemp("readme")
    for line in re.findall(r"^    residua ([^#\n]*)", README, re.M):
        done = subprocess.run([sys.executable, "-m", "codegen", *line.split()], cwd=folder, capture_output=True,
                              text=True)
        assert done.returncode == 0, (line, done.stderr)
    return folder


def test_worked_example_runs(home):
    assert (home / "build" / "cart" / "cart.c").is_file() and (home / "build" / "cart" / "report.html").is_file()


def test_python_example_runs(home):
    said = []
    for code in (text for kind, text in BLOCKS if kind == "python"):
        done = subprocess.run([sys.executable, "-c", code], cwd=home, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        said.append(done.stdout.split(maxsplit=1))
    parameters, switched = said
    assert parameters == ["False", "(1, 2, 2)\n"]  # no alarm, one measured parameter
    assert int(switched[0]) == 35  # the fault of the scenario starts there


def test_plant_file_with_parameters_is_one():
    """The snippet, with the rest of the starter file around it, is a plant; its parameters are as they say."""
    (snippet,) = [text for kind, text in BLOCKS if kind == "toml" and "theta" in text]
    time, signals = snippet.split("[signals]\n")
    text = re.sub(r"^# .*\n", "", starter("tank"), flags=re.M)
    text = re.sub(r"\[time\]\n.*?\n\n", time + "\n", text, flags=re.S).replace("[initial]", signals + "\n[initial]")
    plant = loads(text.replace("[0, 0.9]", '[0, "-1 - load"]'))
    load, wear = plant.theta
    assert plant.kind == "continuous" and (load.rate, load.error, wear.measured) == (2, 0.02, False)
    assert METHODS["lpv-interval"].module.inapplicable(plant) is None


def test_nonlinear_equations_are_those_of_the_disc():
    """The snippet in place of the gallery's equations: the same vertices, and the counterexample of the text."""
    (snippet,) = [text for kind, text in BLOCKS if kind == "toml" and "[nonlinear]" in text]
    text = load("disc").text
    edited = re.sub(r"\[nonlinear\].*?\n\n", snippet + "\n", text, flags=re.S)
    ours, theirs = (loads(t).polytope for t in (edited, text))
    assert ours.premises[0].term == theirs.premises[0].term and len(ours.vertices) == 2
    for a, b in zip(ours.vertices, theirs.vertices):
        assert np.allclose(a.A, b.A, atol=1e-12) and np.allclose(a.B, b.B)
    E, ends = np.diag([1.0, 0]), [np.diag([-1.0, -1]), np.diag([-1.0, 1])]
    good, bad, middle = (descriptor_properties("", E, A, np.eye(2), "continuous") for A in (*ends, sum(ends) / 2))
    assert good.stable and bad.stable and middle.regular is False


def test_every_method_is_in_the_table():
    for name in METHODS:
        assert f"`{name}`" in README


def test_every_option_of_sets_is_in_the_table():
    for name, method in METHODS.items():
        for option in known_options([name]) if not method.framers else ():
            assert f"`{option}`" in README or option in ("within", "evaluations"), option


def test_calling_example_compiles(home):
    (code,) = [text for kind, text in BLOCKS if kind == "c" and "#include" in text]
    (home / "call.c").write_text(code)
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-missing-braces", "-c", "call.c",
                    f"-I{home / 'build' / 'cart'}", "-o", "call.o"], cwd=home, check=True)


def test_snippet_is_what_comes_out():
    (snippet,) = [text for kind, text in BLOCKS if kind == "c" and "#include" not in text]
    design = read_design(ROOT / "generated" / "cart_tnl-interval")
    assert snippet in files(design, "float32", "literal", measure=False)["cart.c"]


def test_every_command_is_in_the_table():
    from codegen.cli import main

    for name in main.commands:
        assert f"residua {name}" in README or f"`{name}" in README, name
