"""Compilers accept the C without a word, and its objects need nothing: no library, no static memory."""

import json
import subprocess

import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import CLANG, CXX, GCC, compile_, write
from helpers.tools import need

from codegen.emit import files
from codegen.errors import ToolError
from codegen.target import metrics

# Every variant in each family; layouts and types take turns so that each pair occurs.
CASES = [(family, variant, layout, real) for f, family in enumerate(("interval", "tnl"))
         for i, variant in enumerate(VARIANTS)
         for layout, real in [(("literal", "table", "loop")[(i + f) % 3], ("float32", "float64")[(i // 3 + f) % 2])]
         if (variant, layout) != ("big", "literal")]
COMPILERS = {"gcc": GCC, "clang": CLANG}


def flags(compiler, real):
    return COMPILERS[compiler] + (["-Wunsuffixed-float-constants"] if (compiler, real) == ("gcc", "float32") else [])


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("family,variant,layout,real", CASES)
def test_compilers_and_symbols(family, variant, layout, real, compiler, tmp_path):
    need(compiler)
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, layout)
    for level in ("-O2", "-Os"):
        compile_([compiler, *flags(compiler, real), level, "-c", "cart.c", "-o", "cart.o"], folder)
        assert compile_(["nm", "-u", "cart.o"], folder) == ""
        assert compile_(["size", "cart.o"], folder).splitlines()[1].split()[1:3] == ["0", "0"]
    compile_([compiler, *flags(compiler, real), "-O1", "-c", "test_cart.c"], folder)


@pytest.mark.parametrize("family,variant,layout,real", CASES)
def test_compiles_as_cpp(family, variant, layout, real, tmp_path):
    need("g++")
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path, real, layout)
    compile_(["g++", *CXX, "-c", "cart.c", "-o", "cart.oo"], folder)


@pytest.mark.parametrize("family,layout,real", [("interval", "literal", "float64"), ("tnl", "table", "float32"),
                                                ("tnl", "loop", "float64")])
def test_analyzer_and_stack(family, layout, real, tmp_path):
    folder = write(stand_in(family, prefix="cart", **VARIANTS["guarded"]), tmp_path, real, layout)
    compile_(["gcc", *flags("gcc", real), "-O2", "-fanalyzer", "-Wstack-usage=256", "-c", "cart.c"], folder)


@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only", "-mfpmath=387"])
def test_guards_refuse_other_arithmetic(option, tmp_path):
    folder = write(stand_in(prefix="cart"), tmp_path)
    done = subprocess.run(["gcc", "-std=c99", option, "-c", "cart.c"], cwd=folder, capture_output=True, text=True,
                          check=False)
    assert done.returncode != 0 and "#error" in done.stderr and "cart: " in done.stderr


def test_gates_notice(tmp_path):
    """Mutant: one constant without its F is a double."""
    folder = write(stand_in(prefix="cart"), tmp_path, layout="literal")
    text = (folder / "cart.c").read_text().replace("F * out->", " * out->", 1)
    (folder / "cart.c").write_text(text)
    with pytest.raises(AssertionError, match="double"):
        compile_(["gcc", *GCC, "-Wunsuffixed-float-constants", "-c", "cart.c"], folder)


def test_cmake(tmp_path):
    need("cmake")
    folder = write(stand_in(prefix="cart"), tmp_path / "cart")
    compile_(["cmake", "-S", folder, "-B", tmp_path / "b"], tmp_path)
    compile_(["cmake", "--build", tmp_path / "b"], tmp_path)
    compile_(["ctest", "--test-dir", tmp_path / "b"], tmp_path)


def test_measure():
    texts = files(stand_in("tnl", prefix="cart"))
    measured = json.loads(texts["resources.json"])["measured"]["host"]
    assert 500 < measured["flash_bytes"] < 20000 and measured["ram_bytes"] == 0 and "gcc" in measured["compiler"]
    assert 0 < measured["stack_bytes"]["reset"] <= measured["stack_bytes"]["step"] < 1000


def test_missing_compiler(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ToolError, match="gcc: not found. Install it"):
        files(stand_in())


def test_deepest_stack_follows_the_calls():
    graph = "\n".join(['node: { title: "a.c:leaf" label: "leaf\\na.c:1:1\\n16 bytes (static)" }',
                       'node: { title: "top" label: "top\\na.c:2:1\\n8 bytes (static)" }',
                       'node: { title: "far" label: "far\\na.c:3:1\\n8 bytes (static)" }',
                       'node: { title: "__lib" label: "__lib\\n" shape : ellipse }',
                       'edge: { sourcename: "top" targetname: "a.c:leaf" label: "x" }',
                       'edge: { sourcename: "far" targetname: "__lib" label: "x" }'])
    assert metrics.deepest_stacks(graph) == {"leaf": 16, "top": 24, "far": None, "__lib": None}
