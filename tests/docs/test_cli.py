"""The command line as a user meets it: exit statuses, one line of error, nothing half written."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import time
from contextlib import chdir, redirect_stderr, redirect_stdout
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from codegen.cli import main
from codegen.plant.load import gallery_names, load, starter

HOPELESS = """
format = 1
name = "hopeless"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "a", range = [-1, 1] }, { name = "b", range = [-1, 1] }]
u = []
y = [{ name = "a", range = [-1, 1] }]
[initial]
x_lo = [0, 0]
x_hi = [0, 0]
[common]
A = [[0.5, -0.13], [0, 0.5]]
C = [[1, 0]]
[observer]
method = "interval"
"""


def residua(*args, cwd):
    """What the command does and says, without the seconds in which a process imports it."""
    out, err = io.StringIO(), io.StringIO()
    with chdir(cwd), redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as left:
        main([*map(str, args)], prog_name="residua")
    return subprocess.CompletedProcess(args, left.value.code, out.getvalue(), err.getvalue())


def process(*args, cwd):
    """The command as a process of its own."""
    return subprocess.run([sys.executable, "-m", "codegen", *map(str, args)], cwd=cwd, capture_output=True, text=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder that `residua run` made from the starter plant; the same plant with the gains that it found."""
    home = tmp_path_factory.mktemp("made")
    assert residua("init", "trolley", cwd=home).returncode == 0
    done = process("run", "trolley.toml", "-o", "out", cwd=home)
    assert done.returncode == 0, done.stderr
    assert "report.html" in done.stdout and "trolley.c" in done.stdout
    tables = json.loads((home / "out" / "design.json").read_text())["tables"]["float64"]
    gains = ", ".join(f"{key} = {tables[f'{key}_hi']}" for key in "LN")
    text = (home / "trolley.toml").read_text()
    (home / "given").mkdir()
    (home / "given" / "trolley.toml").write_text(text.replace("[observer]\n", f"[observer]\ngains = {{ {gains} }}\n"))
    return home


def one_line(done, code, *fragments):
    assert done.returncode == code, done.stderr
    lines = done.stderr.strip().splitlines()
    assert lines[-1].startswith("residua: ") and "Traceback" not in done.stderr
    for fragment in fragments:
        assert fragment in lines[-1]


def test_run_leaves_the_files_of_the_contract(made):
    names = {p.name for p in (made / "out").iterdir()}
    assert {"design.json", "trolley.h", "trolley.c", "resources.json", "test_trolley.c", "CMakeLists.txt",
            "report.html"} <= names
    assert not [p for p in made.iterdir() if p.name.startswith(".")]  # no staging folder stays behind


def test_run_defaults_to_a_folder_named_after_plant_and_method(made):
    (made / "default").mkdir()
    done = residua("run", "../given/trolley.toml", "--real", "float64", "--layout", "loop", cwd=made / "default")
    assert done.returncode == 0, done.stderr
    (folder,) = (made / "default").iterdir()
    assert folder.name == "trolley_tnl-interval"
    record = json.loads((folder / "resources.json").read_text())
    assert (record["real"], record["layout"]) == ("float64", "loop")
    assert "typedef double trolley_real;" in (folder / "trolley.h").read_text()


def test_listing_commands(made):
    for command, words in (("methods", ["interval", "tnl-interval"]), ("list", gallery_names())):
        done = residua(command, cwd=made)
        assert done.returncode == 0 and not [word for word in words if word not in done.stdout]
    done = residua("check", "trolley.toml", cwd=made)
    assert done.returncode == 0 and "detectable" in done.stdout and "interval" in done.stdout
    assert process("--version", cwd=made).stdout.startswith("residua")
    assert "residua" in residua("--help", cwd=made).stdout


def test_design_generate_certify_validate(made):
    assert residua("design", "given/trolley.toml", "-o", "d.json", cwd=made).returncode == 0
    for folder in ("one", "two"):
        assert residua("generate", "d.json", "-o", folder, cwd=made).returncode == 0
    for name in ("trolley.h", "trolley.c", "design.json"):
        assert (made / "one" / name).read_bytes() == (made / "two" / name).read_bytes()
    done = residua("certify", "d.json", cwd=made)
    assert done.returncode == 0 and "x_lo <= x <= x_hi" in done.stdout and "float64" in done.stdout
    done = residua("validate", "out", cwd=made)
    assert done.returncode == 0 and "encoder fault" in done.stdout


def test_usage_is_status_2(made):
    assert residua("run", cwd=made).returncode == 2
    assert residua("run", "cart", "--real", "float16", cwd=made).returncode == 2
    assert residua("nonsense", cwd=made).returncode == 2


def test_plant_errors_are_status_3(made):
    for run in (process, residua):
        one_line(run("run", "absent.toml", cwd=made), 3, "absent.toml")
    (made / "bad.toml").write_text(starter("bad").replace("sample_period", "sample_perod"))
    one_line(residua("run", "bad.toml", cwd=made), 3, "bad.toml", "sample_perod")
    one_line(residua("init", "trolley", cwd=made), 3, "exists already")
    one_line(residua("init", "9lives", cwd=made), 3)
    one_line(residua("certify", "absent.json", cwd=made), 3, "absent.json")


def test_a_plant_file_starts_from_any_plant_of_the_gallery(made):
    """What is written is that plant under another name, its records are found; a name of the gallery holds the cart."""
    for like in gallery_names():
        assert "wrote mine.toml" in residua("init", "mine", "--from", like, cwd=made).stdout
        mine, there = load(made / "mine.toml"), load(like)
        assert mine.name == "mine" and (mine.x, mine.scenarios) == (there.x, there.scenarios)
        (made / "mine.toml").unlink()
    assert "it holds the cart" in residua("init", "fan", cwd=made).stdout
    one_line(residua("init", "mine", "--from", "fann", cwd=made), 3, "fann", 'Did you mean "fan"?')


def test_no_design_is_status_4(made):
    (made / "hopeless.toml").write_text(HOPELESS)
    one_line(residua("run", "hopeless.toml", cwd=made), 4, "no L give A - L C >= 0", "(a, b) is -0.13", "measure b")
    assert not (made / "hopeless_interval").exists()
    one_line(residua("run", "trolley.toml", "--method", "kalman", cwd=made), 4, "kalman", "tnl-interval")


def test_tampered_certificate_is_status_5(made):
    data = json.loads((made / "out" / "design.json").read_text())
    data["tables"]["float32"]["d_hi"][0][0] *= 0.5
    (made / "tampered.json").write_text(json.dumps(data))
    for command in (("certify", "tampered.json"), ("generate", "tampered.json", "-o", "never")):
        one_line(residua(*command, cwd=made), 5, "digest")
    assert not (made / "never").exists()


def test_foreign_folder_is_status_6(made):
    (made / "mine").mkdir()
    (made / "mine" / "thesis.txt").write_text("years of work")
    one_line(residua("generate", made / "out" / "design.json", "-o", "mine", cwd=made), 6, "mine")
    one_line(residua("run", "trolley.toml", "-o", "mine", cwd=made), 6, "mine")
    assert [p.name for p in (made / "mine").iterdir()] == ["thesis.txt"]


def test_missing_gcc_is_status_6(made, monkeypatch):
    monkeypatch.setenv("PATH", str(made))
    one_line(residua("validate", "out", cwd=made), 6, "gcc")


def test_changed_c_is_status_7(made):
    copy = made / "changed"
    subprocess.run(["cp", "-r", made / "out", copy], check=True)
    source = (copy / "trolley.c").read_text()
    changed = source.replace("out->x_hi[0]", "out->x_lo[0]")
    assert changed != source
    (copy / "trolley.c").write_text(changed)
    one_line(residua("validate", "changed", cwd=made), 7, "differ")


def start_run(made, out):
    return subprocess.Popen([sys.executable, "-m", "codegen", "run", "zammali_fd", "-o", str(out)], cwd=made,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            # A background shell lets its children ignore Ctrl-C; here it must count.
                            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_killed_in_the_middle_leaves_nothing_or_the_old(made, kill):
    out = made / f"killed_{kill.name}"
    subprocess.run(["cp", "-r", made / "out", out], check=True)
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    process = start_run(made, out)
    time.sleep(4.0)  # in the middle of the search over gains
    process.send_signal(kill)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode != 0 and "Traceback" not in stderr
    assert {p.name: p.read_bytes() for p in out.iterdir()} == before
    if kill != signal.SIGKILL:
        # Interrupted in the exec of an import (a dataclass), Python ends itself by SIGINT: 130 as well in a shell.
        assert "nothing was written" in stderr and process.returncode in (130, -signal.SIGINT)
        assert not list(made.glob(f".{out.name}*"))


@pytest.mark.parametrize("seconds", [0, 3])
def test_progress_is_shown_for_long_work(made, seconds, monkeypatch):
    """A line at most every two seconds: by a clock that goes on by so many whenever it is read."""
    monkeypatch.setattr("codegen.cli.time", SimpleNamespace(monotonic=count(0, seconds).__next__))
    done = residua("run", "given/trolley.toml", "-o", "slow", cwd=made)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("... ")]
    assert len(lines) >= 5 and "... printing C" in lines if seconds else not lines


def test_unwritable_place_is_status_6(made):
    target = Path("/proc/residua/out")
    done = residua("run", "trolley.toml", "-o", target, cwd=made)
    assert done.returncode == 6 and "Traceback" not in done.stderr
