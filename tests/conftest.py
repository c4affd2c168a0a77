"""Designs and compiled observers of the gallery, made once per session and shared by all xdist workers."""

import fcntl
import os
from pathlib import Path

import pytest
from helpers.folders import built

from codegen import read_design
from codegen.plant.load import load, loads
from codegen.selection.select import choose

ROOT = Path(__file__).resolve().parents[1]
#: Few long tests that share little: each goes to the worker that is free. Of other files one worker has all tests, and
#: makes what they share once.
APART = {"test_c_tests", "test_continuous", "test_boards", "test_analyse", "test_coverage", "test_prove", "test_fuzz"}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """``--dist loadfile``, but for what is APART: by the names of tests alone, as marks of groups are not read by all
    versions of pytest and xdist."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return nodeid if Path(file).stem in APART else file

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


class Workshop:
    """Makes a design once, keeps it as design.json, and compiles it once per process."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.designs, self.drivers = {}, {}

    def once(self, key: str, make):
        """The design of a key; ``make`` runs in one process only, the others wait and read its file."""
        if key not in self.designs:
            path = self.folder / f"{key}.json"
            with open(self.folder / f"{key}.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                if not path.exists():
                    make().save(path)
            self.designs[key] = read_design(path)
        return self.designs[key]

    def gallery(self, plant: str, method: str):
        """Design of a gallery plant: the committed one where there is one."""
        committed = ROOT / "generated" / f"{plant}_{method}" / "design.json"
        if committed.exists():
            if (plant, method) not in self.designs:
                self.designs[plant, method] = read_design(committed)
            return self.designs[plant, method]

        def make():
            p = load(plant)
            return choose(p, method, p.options, lambda text: None)

        return self.once(f"{plant}_{method}", make)

    def text(self, key: str, toml: str, method: str, **options):
        """Design of a plant given as TOML text."""
        def make():
            p = loads(toml, key)
            return choose(p, method, {**p.options, **options}, lambda text: None)

        return self.once(f"{key}_{method}", make)

    def driver(self, design, real: str = "float32"):
        """The compiled C of a design."""
        if (design.digest, real) not in self.drivers:
            name = f"{design.digest[:16]}_{real}_{os.getpid()}"
            self.drivers[design.digest, real] = built(design, self.folder / name, real, design.plant.target.layout)
        return self.drivers[design.digest, real]


@pytest.fixture(scope="session")
def workshop(tmp_path_factory) -> Workshop:
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "designs"
    folder.mkdir(exist_ok=True)
    return Workshop(folder)
