"""The wheel works in another venv, from any folder: templates and gallery are inside."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_wheel_works_from_any_folder(tmp_path):
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(tmp_path), str(ROOT)]
    subprocess.run(command, check=True)
    (wheel,) = tmp_path.glob("residua-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "codegen/_templates/observer.c.jinja" in names and "codegen/gallery/data/emps_train.csv" in names
    home = tmp_path / "venv"
    venv.create(home, with_pip=False)
    # The dependencies of this environment, but not its checkout: a path in a .pth file does not run the
    # editable install's own .pth.
    site = next((home / "lib").glob("python*")) / "site-packages"
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    (tmp_path / "elsewhere").mkdir()
    python = home / "bin" / "python"
    where = subprocess.run([python, "-c", "import codegen; print(codegen.__file__)"], cwd=tmp_path / "elsewhere",
                           capture_output=True, text=True, check=True).stdout
    assert str(site) in where
    done = subprocess.run([python, "-m", "codegen", "run", "cart", "-o", "out"], cwd=tmp_path / "elsewhere",
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "elsewhere" / "out" / "cart.c").is_file()
