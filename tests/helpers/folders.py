"""Write the C of stand-ins quickly: without measuring it and without design.json."""

import shutil
import subprocess

from codegen.emit import files, firmware
from codegen.host.build import build

GCC = ["-std=c99", "-ffp-contract=off", "-ffreestanding", "-Werror", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion",
       "-Wsign-conversion", "-Wdouble-promotion", "-Wfloat-equal", "-Wfloat-conversion", "-Wvla", "-Walloca",
       "-Wshadow", "-Wundef", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-align=strict", "-Wcast-qual",
       "-Wswitch-enum", "-Wswitch-default", "-Wnull-dereference", "-Wduplicated-cond", "-Wduplicated-branches",
       "-Wlogical-op"]
CLANG = ["-std=c99", "-ffp-contract=off", "-ffreestanding", "-Weverything", "-Wno-declaration-after-statement",
         "-Werror"]
CXX = ["-x", "c++", "-std=c++11", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]


def write(design, folder, real="float32", layout="table"):
    """Write everything but design.json and the measured figures; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files(design, real, layout, measure=False).items():
        (folder / name).write_text(text, encoding="ascii")
    return folder


def built(design, folder, real="float32", layout="table"):
    """Write the C alone and compile it; return its driver."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in firmware(design, real, layout).items():
        (folder / name).write_text(text, encoding="ascii")
    return build(folder)


def mutant(good, folder, change):
    """Compile a copy of a folder of the plant "valve" with one change, (old, new), of its C; return its driver."""
    folder, (old, new) = shutil.copytree(good, folder), change
    text = (folder / "valve.c").read_text()
    assert text.count(old) >= 1
    (folder / "valve.c").write_text(text.replace(old, new))
    return build(folder)


def compile_(command, folder):
    """Run a compiler and fail with what it said."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stderr[:3000]}"
    return done.stdout
