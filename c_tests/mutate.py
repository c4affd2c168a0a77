"""Mutation test of generated folders: ``python c_tests/mutate.py [--sample N] [FOLDER ...]``.

Changes one place of the C at a time and runs the unit tests, the golden test and random calls (random_calls.c); a
mutant that they all pass has survived, unless the compiler warns of it as run.py asks. Survivors are accepted if the
compiler makes the same object code of them (at -O2), or if EQUIVALENT.md lists them with a reason. Default: every
mutant of every folder in generated/.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from run import COUNTS, UNIT_TESTS, WARNINGS, case, folders  # noqa: E402

EQUIVALENT = HERE / "EQUIVALENT.md"
FLAGS = ["-std=c99", "-w"]
RANDOM = "uint32_t random_calls(uint32_t part);"
# An uninitialised variable has a pattern in it: a mutant that leaves one behaves the same on every run.
TRAPS = ["-O0", "-ftrivial-auto-var-init=pattern", "-fsanitize=bounds,shift", "-fsanitize-undefined-trap-on-error"]
SWAPS = (("+", "-"), ("-", "+"), ("<", "<="), (">", ">="), ("<=", "<"), (">=", ">"), ("==", "!="), ("!=", "=="),
         ("&&", "||"), ("||", "&&"), ("+=", "-="), ("-=", "+="), ("|=", "="))
NAMES = (("x_lo", "x_hi"), ("x_hi", "x_lo"), ("r_lo", "r_hi"), ("r_hi", "r_lo"), ("[in->mode]", "[0U]"),
         ("switch (s->mode)", "switch (0U)"), ("switch (in->mode)", "switch (0U)"), ("(!", "("))
STATEMENT = re.compile(r"(?m)^ +(?!return|const|static|break|case|default)"
                       r"[\w>.\[\]()-]+(?: [-+|&]?= |\+\+|\()[^;{}]*;$")


@dataclass(frozen=True)
class Mutant:
    """One change: where in the text, what it says there, what instead."""

    start: int
    end: int
    old: str
    new: str

    def describe(self, text: str) -> str:
        """The line of the change with the change marked, and the function it is in."""
        begin, stop = text.rfind("\n", 0, self.start) + 1, text.find("\n", self.end)
        function = re.findall(r"(?m)^\w[\w ]*\b(\w+)\([^;]*\)$", text[:self.start])[-1]
        line = f"{text[begin:self.start]}[[{self.old}=>{self.new}]]{text[self.end:stop]}"
        return f"{function}: {' '.join(line.split())}"


def changed_number(text: str) -> list[str]:
    """A real by one in a thousand, or 1e-5 if that is more, and in its sign; a whole number by one."""
    if text.endswith("U"):
        return [f"{int(text[:-1], 0) + 1}U"]
    suffix = "F" if text.endswith("F") else ""
    value = float(text.rstrip("F"))
    return [f"({value + max(abs(value) * 1e-3, 1e-5)!r}{suffix})", f"(-{text})"] if value else [f"0.001{suffix}"]


def mutants(text: str) -> list[Mutant]:
    """List every mutant of a C text, in the order of their places; comments and preprocessor lines stay."""
    blank = re.sub(r"/\*.*?\*/|^#.*?$", lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.S | re.M)
    found = []
    for m in re.finditer(r"(?<![\w.])(?:\d+\.\d*(?:e[-+]?\d+)?F?|\d+e[-+]?\d+F?|0x[0-9A-F]+U|\d+U)(?!\w)", blank):
        found += [Mutant(*m.span(), m[0], new) for new in changed_number(m[0])]
    for old, new in SWAPS:
        found += [Mutant(m.start(1), m.end(1), old, new)
                  for m in re.finditer(rf"(?<=[\w\])]) ({re.escape(old)})(?= )|^ +({re.escape(old)})(?= )", blank, re.M)
                  if m[1]]
    found += [Mutant(m.start(1), m.end(1), m[1], {"+": "-", "-": "+", "&&": "||", "||": "&&"}[m[1]])
              for m in re.finditer(r"(?m)^ +(\+|-|&&|\|\|)(?= )", blank)]
    for old, new in NAMES:
        found += [Mutant(*m.span(), old, new) for m in re.finditer(re.escape(old) + r"(?!\w)", blank)]
    found += [Mutant(m.start(), m.end(), m[0], ";") for m in STATEMENT.finditer(blank)]
    return sorted(found, key=lambda m: (m.start, m.end, m.new))


def equivalents(path: Path = EQUIVALENT) -> list[str]:
    """Parse the list of accepted survivors: expressions that the description of a mutant must match."""
    rows = re.findall(r"(?m)^\| `([^`]+)` \| ([^|]{20,}) \|$", path.read_text(encoding="ascii"))
    return [pattern.replace(r"\|", "|") for pattern, _ in rows]


class Bench:
    """A folder whose tests are compiled, ready to run them on mutants."""

    def __init__(self, folder: Path, scratch: Path):
        self.folder, self.scratch = folder.resolve(), scratch
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        self.prefix = record["prefix"]
        self.text = (folder / f"{self.prefix}.c").read_text(encoding="ascii")
        (scratch / "case.h").write_text(case(record), encoding="ascii")
        members = {name for name, _, _ in record["state"]}
        tables = members & set(COUNTS) and "x_hat" in members  # many, found by counts
        self.parts = (64 if "shape" in members else 256) if tables else 8
        tests = [*UNIT_TESTS, folder.resolve() / f"test_{self.prefix}.c"]
        for i, test in enumerate(tests):
            self.gcc(["-O1", "-c", f"-Dmain=test_{i}", f"-I{scratch}", f"-I{HERE}", test, "-o", scratch / f"{i}.o"])
        self.gcc(["-O1", "-c", f"-I{scratch}", f"-I{HERE}", HERE / "random_calls.c", "-o", scratch / "random.o"])
        calls = [*(f"test_{i}() != 0" for i in reversed(range(len(tests)))),
                 *(f"random_calls({i}U) != {digest}U" for i, digest in enumerate(self.digests()))]
        declarations = f"{RANDOM}\n" + "".join(f"int test_{i}(void);\n" for i in range(len(tests)))
        (scratch / "main.c").write_text(f"#include <stdint.h>\n{declarations}"
                                        f"int main(void) {{ return ({' || '.join(calls)}) ? 1 : 0; }}\n")
        self.gcc(["-c", scratch / "main.c", "-o", scratch / "main.o"])
        self.objects = [scratch / "main.o", scratch / "random.o", *(scratch / f"{i}.o" for i in range(len(tests)))]
        self.original = self.object_code(self.text, scratch / "original")
        if self.killed(self.text, scratch / "itself") is not False:
            raise RuntimeError(f"{folder}: the tests fail on the C as it is, or do not compile")

    def digests(self) -> list[int]:
        """What each part of the random calls answers on the C as it is."""
        place = self.scratch / "digest"
        place.with_suffix(".c").write_text(
            f"#include <stdint.h>\n#include <stdio.h>\n{RANDOM}\nint main(void) {{ "
            f"for (uint32_t i = 0U; i < {self.parts}U; "
            'i++) { printf("%lu\\n", (unsigned long)random_calls(i)); } }\n', encoding="ascii")
        sources = [place.with_suffix(".c"), self.scratch / "random.o", self.folder / f"{self.prefix}.c"]
        self.gcc([*TRAPS, *sources, "-o", place])
        return [int(n) for n in subprocess.run([place], capture_output=True, text=True, check=True,
                                               timeout=60).stdout.split()]

    def gcc(self, arguments: list, flags: list = FLAGS) -> bool:
        """Compile; whether the compiler accepts it."""
        command = ["gcc", "-ffp-contract=off", *flags, f"-I{self.folder}", *arguments]
        return subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 0

    def killed(self, text: str, place: Path) -> bool | None:
        """Whether a test notices this C; None if it is not C."""
        place.mkdir(exist_ok=True)
        (place / "m.c").write_text(text, encoding="ascii")
        if not self.gcc([*TRAPS, place / "m.c", *self.objects, "-o", place / "m"]):
            return None
        try:
            return subprocess.run([place / "m"], check=False, timeout=20, capture_output=True).returncode != 0
        except subprocess.TimeoutExpired:
            return True

    def object_code(self, text: str, place: Path) -> bytes | None:
        """Compile as run.py does, every warning an error; the machine code and constants, or None if refused."""
        place.mkdir(exist_ok=True)
        (place / "m.c").write_text(text, encoding="ascii")
        accepted = self.gcc(["-O2", *WARNINGS, "-c", place / "m.c", "-o", place / "o.o"], ["-std=c99"])
        return (place / "o.o").read_bytes() if accepted else None

    def try_one(self, numbered: tuple[int, Mutant]) -> bool | None:
        """Apply a mutant and run the tests: True killed, warned of or the same code; False survived; None not C."""
        number, mutant = numbered
        text = self.text[:mutant.start] + mutant.new + self.text[mutant.end:]
        with tempfile.TemporaryDirectory(dir=self.scratch) as name:
            verdict = self.killed(text, Path(name))
            if verdict is False and self.object_code(text, Path(name)) in (None, self.original):
                verdict = True
        return verdict


def survivors(folder: Path, sample: int | None = None, seed: int = 0) -> tuple[int, list[str]]:
    """Run the mutants of a folder.

    Parameters
    ----------
    folder : Path
    sample : int, optional
        So many of them, drawn; default: all.
    seed : int

    Returns
    -------
    tried : int
    survived : list of str
        Those that are neither noticed nor accepted as equivalent.
    """
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(folder, Path(scratch))
        every = mutants(bench.text)
        chosen = every if sample is None else random.Random(seed).sample(every, min(sample, len(every)))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            verdicts = list(pool.map(bench.try_one, enumerate(chosen)))
    accepted = equivalents()
    named = [m.describe(bench.text) for m, verdict in zip(chosen, verdicts) if verdict is False]
    return (sum(v is not None for v in verdicts),
            [n for n in named if not any(re.search(pattern, n) for pattern in accepted)])


def main(arguments: list[str]) -> int:
    """Mutate the folders, print the survivors, return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, help="so many mutants of each folder [all]")
    parser.add_argument("folders", nargs="*", type=Path)
    chosen = parser.parse_args(arguments)
    status = 0
    for folder in chosen.folders or folders():
        tried, survived = survivors(folder, chosen.sample)
        print("\n    ".join([f"{folder.name}: {tried} mutants, {len(survived)} survive", *survived]), flush=True)
        status |= bool(survived)
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
