"""The output folder appears whole or not at all."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from helpers.designs import stand_in

from codegen.emit import files, generate, package
from codegen.errors import EmitError

ROOT = Path(__file__).resolve().parents[2]
NAMES = {"design.json", "cart.h", "cart.c", "test_cart.c", "prove_cart.c", "rounding_cart.g", "CMakeLists.txt",
         "resources.json"}


@pytest.fixture
def design():
    return stand_in(prefix="cart")


def contents(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_writes_everything_twice_the_same(design, tmp_path):
    first, second = generate(design, tmp_path / "a" / "b"), generate(design, tmp_path / "c")
    assert set(contents(first)) == NAMES and contents(first) == contents(second)
    printed = {name: text.encode() for name, text in files(design).items()}
    assert printed == {name: data for name, data in contents(first).items() if name != "design.json"}
    assert sorted(os.listdir(tmp_path)) == ["a", "c"]


@pytest.mark.parametrize("exchange", [True, False])
def test_replaces_its_own_folder_and_keeps_the_users_files(design, tmp_path, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr(package, "_exchange", lambda a, b: False)
    folder = generate(design, tmp_path / "cart")
    (folder / "notes.txt").write_text("mine")
    (folder / "report.html").write_text("of the old design")
    (folder / "cart.c").write_text("spoilt")
    generate(design, folder, "float64", "loop")
    assert set(contents(folder)) == NAMES | {"notes.txt"}
    generate(stand_in(prefix="van"), folder)
    assert {p for p in contents(folder) if p.endswith((".c", ".h", ".g"))} == {"van.h", "van.c", "test_van.c",
                                                                         "prove_van.c", "rounding_van.g"}
    generate(design, folder, "float64", "loop")
    assert "double" in (folder / "cart.h").read_text() and "cart_step" in (folder / "cart.c").read_text()
    assert os.listdir(tmp_path) == ["cart"]


def test_leaves_other_peoples_folders_alone(design, tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years")
    with pytest.raises(EmitError, match="did not make it. Choose another folder"):
        generate(design, tmp_path / "home")
    assert contents(tmp_path / "home") == {"thesis.tex": b"years"}
    (tmp_path / "file").write_text("x")
    with pytest.raises(EmitError):
        generate(design, tmp_path / "file")
    with pytest.raises(EmitError, match="can be written"):
        generate(design, tmp_path / "file" / "below")


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("where", ["save", "publish", "measure"])
def test_failure_in_the_middle(design, tmp_path, monkeypatch, old, where):
    before = contents(generate(design, tmp_path / "cart")) if old else None
    def fail(*_, **__):
        raise OSError(28, "No space left on device")
    owner = {"save": type(design), "publish": package, "measure": package.metrics}[where]
    monkeypatch.setattr(owner, where, fail)
    with pytest.raises((EmitError, OSError), match="No space"):
        generate(design, tmp_path / "cart", "float64")
    assert os.listdir(tmp_path) == (["cart"] if old else [])
    assert before is None or contents(tmp_path / "cart") == before


@pytest.mark.parametrize("old", [False, True])
def test_kill_in_the_middle(design, tmp_path, old):
    """kill -9 while files are being written: the folder is not there, or is the old one, whole."""
    before = contents(generate(design, tmp_path / "cart")) if old else None
    code = textwrap.dedent(f"""
        import sys, time
        from pathlib import Path
        sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / "tests")!r}]
        from helpers.designs import StandIn, stand_in
        from codegen.emit import generate
        def save(self, path):
            Path({str(tmp_path / "ready")!r}).touch()
            time.sleep(60)
        StandIn.save = save
        generate(stand_in(prefix="cart"), {str(tmp_path / "cart")!r}, "float64")
    """)
    child = subprocess.Popen([sys.executable, "-c", code])
    try:
        end = time.monotonic() + 30
        while not (tmp_path / "ready").exists() and time.monotonic() < end:
            assert child.poll() is None
            time.sleep(0.02)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    assert (tmp_path / "ready").exists()
    assert (tmp_path / "cart").exists() == old
    assert before is None or contents(tmp_path / "cart") == before
    assert set(contents(generate(design, tmp_path / "cart"))) == NAMES
