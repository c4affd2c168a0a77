"""Count the operations of every call of the committed designs: ``python c_tests/operations.py [FOLDER ...]``.

The C is compiled as C++ with a number that counts what is done with it. Each count is held to what the header states
("step, predict: at most ..."), over the golden self-test and over the runs that a test gives: measured samples, faults,
missing ones. Needs g++.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
STATED = ("multiply", "divide", "add", "compare")
SELECTION = (r"(key\[k\] > key\[best\])", r"(done.selections++, \1)")
EXCHANGE = (r"(\n +key\[best\] = (?:key\[j\]|held);)", r"\1 done.exchanges += (best != j) ? 1U : 0U;")


@dataclass(frozen=True)
class Call:
    """One call of step (or predict; of a law track, or coast): its answer and how many operations it took."""

    step: bool
    status: int
    raw: int
    multiply: int
    divide: int
    add: int
    compare: int
    selections: int
    exchanges: int
    law: bool = False

    @property
    def sums(self) -> tuple[int, int, int]:
        """What must not depend on data: multiplications, divisions, additions."""
        return self.multiply, self.divide, self.add


def build(folder: Path, out: Path, change=lambda text: text) -> Path:
    """Compile the counting program of a folder in ``out``; ``change`` may alter the C first."""
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    p, m, real = record["prefix"], record["macro"], {"float32": "float", "float64": "double"}[record["real"]]
    header, typedefs = re.subn(rf"typedef {real} ({p}_real);", rf"typedef counted<{real}> \1;",
                               (folder / f"{p}.h").read_text(encoding="ascii"))
    if typedefs != 1:
        raise ValueError(f"{folder}: no typedef of {p}_real in the header")
    (out / f"{p}.h").write_text(header, encoding="ascii")
    text = change((folder / f"{p}.c").read_text(encoding="ascii"))
    (out / f"{p}.c").write_text(re.sub(*EXCHANGE, re.sub(*SELECTION, text)), encoding="ascii")
    (out / f"test_{p}.c").write_bytes((folder / f"test_{p}.c").read_bytes())
    calls = ("step", "predict", *(("track", "coast") if "law" in record else ()))
    (out / "renames.h").write_text("".join(f"#define {p}_{call} counted_{call}\n" for call in calls), encoding="ascii")
    names = {"T(name)": f"{p}_##name", "M(name)": f"{m}_##name", "HEADER": f'"{p}.h"', "SOURCE": f'"{p}.c"',
             "TEST": f'"test_{p}.c"', "RENAMES": '"renames.h"', f"{m}_NO_MAIN": "1", "REAL": f"{p}_real", "RAW": real}
    names |= {"INPUTS": f"{m}_NU"} if record["n_u"] else {}
    names |= {"PARAMETERS": f"{m}_NTHETA"} if record["n_theta"] else {}
    names |= {"TOLD": "mode"} if any(name == "mode" for name, *_ in record["in"]) else {}
    names |= {"LAW": "1"} if "law" in record else {}
    command = ["g++", "-std=c++11", "-O0", "-w", "-ffp-contract=off", *(f"-D{k}={v}" for k, v in names.items()),
               f"-I{out}", f"-I{HERE}", str(HERE / "count.cpp"), "-o", str(out / "count")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ValueError(f"{folder}: {done.stderr[:2000]}")
    return out / "count"


def count(program: Path, runs=()) -> list[list[Call]]:
    """Run the counting program; return the calls of the self-test, then those of each run.

    Parameters
    ----------
    program : Path
        Of ``build``.
    runs : sequence of str
        Each the samples of one run, as count.cpp reads them.

    Returns
    -------
    calls : list of list of Call

    Raises
    ------
    ValueError
        The self-test fails: what was counted is another calculation.
    """
    text = "".join(f"2\n{run}\n" for run in runs)
    answer = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=True).stdout
    first, *others = re.split(r"self_test 0\n", answer)
    if len(others) != 1:
        raise ValueError(f"{program}: the self-test fails with counted numbers")
    parts = [first, *others[0].split("run\n")[1:]]
    rows = [[[int(n) for n in line.split()] for line in part.splitlines()] for part in parts]
    return [[Call(bool(row[0] & 1), *row[1:], law=row[0] > 1) for row in part] for part in rows]


def stated(folder: Path, law: bool = False) -> dict[str, int]:
    """What the header of a folder states of a step, or of a call of its law."""
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    header = re.sub(r"\n \* +", " ", (folder / f"{record['prefix']}.h").read_text(encoding="ascii"))
    words = rf"{record['prefix']}_coast take, the observer's step in them," if law else "step, predict:"
    found = re.search(rf"{words} at most (\d+) multiplications, (?:(\d+) divisions, )?(\d+) additions and "
                      r"(\d+) comparisons of real numbers", header)
    return dict(zip(STATED, (int(n or 0) for n in found.groups())))


def excess(folder: Path, calls: list[Call]) -> list[str]:
    """Return what is above what the header states, each as a sentence."""
    wrong = []
    for law in sorted({c.law for c in calls}):
        bound = stated(folder, law)
        most = {name: max(getattr(c, name) for c in calls if c.law == law) for name in STATED}
        wrong += [f"{folder.name}{', law' * law}: {name} {most[name]}, stated at most {bound[name]}" for name in STATED
                  if most[name] > bound[name]]
    return wrong


def main(arguments: list[str]) -> int:
    """Count and check; return the exit status."""
    committed = sorted(p.parent for p in (HERE.parent / "generated").glob("*/design.json"))
    folders = [Path(a) for a in arguments] or committed
    wrong = []
    for folder in folders:
        with tempfile.TemporaryDirectory() as scratch:
            calls = count(build(folder, Path(scratch)))[0]
        wrong += excess(folder, calls)
        most = {name: max(getattr(c, name) for c in calls) for name in (*STATED, "selections", "exchanges")}
        print(f"{folder.name}: at most {most}, stated {stated(folder)}")
    print("\n".join(wrong) or f"{len(folders)} designs: none takes more than its header states")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
