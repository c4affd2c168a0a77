"""Compile every candidate of a case, make sure that all answer the same, then count: instructions, flash, stack, time.

Instructions are the mean of the samples, the call and the return included: callgrind's on the host, the board's timer
in QEMU on Cortex-M4F (``codegen.target.boards``). Flash is what the linker keeps of a candidate's objects, code and
constants, without the compiler's library. Stack is painted (board only).
"""

from __future__ import annotations

import re
import struct
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from codegen.emit.cprint import C_TYPE, initialiser
from codegen.emit.render import template_root
from codegen.errors import ToolError
from codegen.target.boards import BOARDS
from codegen.target.metrics import run

from . import bound
from .cases import SAMPLES, Case, expected

HERE = Path(__file__).resolve().parent
START = template_root() / "harness" / "board"
BOARD = BOARDS["m4f"]
FLAGS = ("-ffp-contract=off", "-ffreestanding", "-ffunction-sections", "-fdata-sections",
         "-fno-asynchronous-unwind-tables", "-w", "-I.")
#: CasADi's C includes <math.h> and uses nothing of it; a bare cross compiler has none, then an empty one serves.
LANGUAGE = {".c": ("gcc", ("-std=c99", "-idirafter", "shim")),
            ".cpp": ("g++", ("-std=c++14", "-fno-exceptions", "-fno-rtti", "-fhosted", "-DEIGEN_NO_MALLOC", "-DNDEBUG",
                             "-isystem", "/usr/include/eigen3", "-fno-threadsafe-statics"))}
PROBES = ("probe_copy", "probe_multiply", "probe_add")
#: Largest difference from the answers expected, which are of the order of 1.
TOLERANCE = {"float32": 1e-5, "float64": 1e-13}


@dataclass(frozen=True)
class Target:
    """A machine: prefix of its tools, flags of its processor, emulation of its linker."""

    tools: str
    flags: tuple[str, ...]


TARGETS = {"host": Target("", ("-fcf-protection=none", "-fno-pie")),
           "m4f": Target(BOARD.tools, tuple(f for f in BOARD.flags if not f.startswith("-O")))}


@dataclass(frozen=True)
class Figures:
    """What one candidate needs; None where it is not measured."""

    instructions: int
    flash_bytes: int
    stack_bytes: int | None
    nanoseconds: float | None


@dataclass(frozen=True)
class Row:
    """The candidates on one target, and the lower bound there (``bound``)."""

    figures: dict[str, Figures]
    bound: float


class Disagreement(ToolError):
    """A candidate answers something else than expected: nothing is measured."""


@cache
def able(target: str, header: str) -> bool:
    """Return whether a target's C++ compiler finds a header."""
    t = TARGETS[target]
    command = [f"{t.tools}g++", *LANGUAGE[".cpp"][1], *t.flags, "-fsyntax-only", "-xc++", "-"]
    try:
        return subprocess.run(command, input=f"#include <{header}>\n", capture_output=True, text=True,
                              check=False).returncode == 0
    except FileNotFoundError:
        return False


def bench_h(case: Case) -> str:
    """Print the structs that all candidates share."""
    modes, n_x, n_u, n_y = case.sizes
    sizes = "".join(f"#define BENCH_{name} {n}U\n"
                    for name, n in (("MODES", modes), ("NX", n_x), ("NU", n_u), ("NY", n_y)))
    mode_macros = "".join(f"#define BENCH_MODE_{q} {q}U\n" for q in range(modes))
    out = " ".join(f"bench_real {name}[{n}];" for name, n in case.answers)
    state = " ".join(f"bench_real x{s}[{n_x}];" for s in case.sides)
    steps = "" .join(f"void {name}_step(bench_state *s, const bench_in *in, bench_out *out);\n"
                     for name in ("literal", "table", "loop"))
    return (f"#ifndef BENCH_H\n#define BENCH_H\n#include <stdint.h>\n{sizes}{mode_macros}"
            f"typedef {C_TYPE[case.real]} bench_real;\n"
            f"typedef struct {{ {state} }} bench_state;\n"
            f"typedef struct {{ bench_real u[{n_u}]; bench_real y[{n_y}]; uint32_t mode; }} bench_in;\n"
            f"typedef struct {{ {out} }} bench_out;\n"
            '#ifdef __cplusplus\nextern "C" {\n#endif\n'
            f"{steps}#ifdef __cplusplus\n}}\n#endif\n#endif\n")


def samples_h(case: Case, names: tuple[str, ...]) -> str:
    """Print the samples, the answers expected, the first state and the list of candidates."""
    def braces(values):
        return initialiser(np.asarray(values).astype(case.real), case.real)

    rows = ",\n".join(f"    {{ {braces(u)}, {braces(y)}, {q}U }}" for u, y, q in zip(case.u, case.y, case.q))
    wanted = ",\n".join(f"    {braces(row)}" for row in expected(case))
    count = sum(n for _, n in case.answers)
    start = ", ".join(braces(v) for v in case.start.values())
    return (f"#define SAMPLES {SAMPLES}U\n#define ANSWERS {count}U\n#define START {{ {start} }}\n"
            f"#define CANDIDATES X(empty) {' '.join(f'X({n})' for n in names)}\n"
            f"static const bench_in samples[SAMPLES] = {{\n{rows}\n}};\n"
            f"static const bench_real expected[SAMPLES][ANSWERS] = {{\n{wanted}\n}};\n")


def measure(case: Case, candidates: dict[str, dict[str, str]], target: str, optimise: str, scratch: Path,
            time: bool = True) -> Row:
    """Build and measure the candidates of a case on one target.

    Parameters
    ----------
    case : Case
    candidates : dict
        Name -> file name -> text.
    target : {"host", "m4f"}
    optimise : {"-O2", "-Os"}
    scratch : Path
        Folder to work in; emptied by the caller.
    time : bool
        Measure nanoseconds too (host).

    Returns
    -------
    row : Row

    Raises
    ------
    Disagreement
        A candidate's answers differ from those expected by more than ``TOLERANCE``.
    ToolError
        A compiler or simulator fails.
    """
    t = TARGETS[target]
    texts = {"bench.h": bench_h(case), "samples.h": samples_h(case, (*PROBES, *candidates)),
             "probes.c": (HERE / "harness" / "probes.c").read_text(encoding="ascii")}
    (scratch / "shim").mkdir(exist_ok=True)
    (scratch / "shim" / "math.h").touch()
    for name, text in {**texts, **{f: s for files in candidates.values() for f, s in files.items()}}.items():
        (scratch / name).write_text(text, encoding="utf-8")
    objects = {name: [_compile(f, t, optimise, scratch) for f in files if not f.endswith(".h")]
               for name, files in candidates.items()}
    flash = {name: _flash(name, files, t, scratch) for name, files in objects.items()}
    everything = [_compile("probes.c", t, optimise, scratch), *(o for files in objects.values() for o in files)]
    if target == "host":
        instructions, stacks, times = _on_host(case, everything, scratch, time)
    else:
        instructions, stacks, times = _on_board(case, everything, scratch)
    figures = {name: Figures(round(instructions[name]), flash[name], stacks.get(name), times.get(name))
               for name in candidates}
    copy, multiply, add = (instructions[name] for name in PROBES)
    library = target == "m4f" and case.real == "float64"
    costs = (multiply - copy, add - copy) if library else (1.0, 1.0)
    fused = target == "m4f" and case.real == "float32" and optimise == "-Os"
    return Row(figures, bound.instructions(bound.work(case), fused, *costs))


def _compile(name: str, t: Target, optimise: str, scratch: Path) -> str:
    compiler, flags = LANGUAGE[Path(name).suffix]
    run([f"{t.tools}{compiler}", *flags, *FLAGS, *t.flags, optimise, "-c", name, "-o", f"{name}.o"], cwd=scratch)
    return f"{name}.o"


def _flash(name: str, objects: list[str], t: Target, scratch: Path) -> int:
    """Code and constants of what is reachable from the step."""
    run([f"{t.tools}ld", "-r", "--gc-sections", "-e", f"{name}_step", *objects, "-o", f"{name}.whole"], cwd=scratch)
    text, data, bss = run([f"{t.tools}size", f"{name}.whole"], cwd=scratch).splitlines()[1].split()[:3]
    return int(text) + int(data) + int(bss)


def _agree(case: Case, deviations: dict[str, float]) -> None:
    wrong = [f"{name} by {d:g}" for name, d in deviations.items()
             if name not in ("empty", *PROBES) and not d <= TOLERANCE[case.real]]
    if wrong:
        raise Disagreement(f"{case.observer}, {case.sizes}, {case.real}: {', '.join(wrong)} from the answers expected "
                           f"(accepted: {TOLERANCE[case.real]:g}). Nothing is measured. Correct the candidate.")


def _on_host(case, everything, scratch, time) -> tuple[dict, dict, dict]:
    """Check, then count; return instructions, stacks (none) and nanoseconds by name."""
    run(["gcc", "-std=gnu99", "-O2", "-w", "-fno-pie", "-no-pie", "-DON_HOST", "-I.",
         str(HERE / "harness" / "driver.c"), *everything, "-o", "host"], cwd=scratch)
    program = str(scratch / "host")
    _agree(case, {name: float(d) for name, d in (line.split() for line in run([program]).splitlines())})
    for old in scratch.glob("counted.*"):
        old.unlink()
    run(["valgrind", "-q", "--tool=callgrind", "--collect-atstart=no", "--callgrind-out-file=counted", program,
         "count"], cwd=scratch)
    counts = {}
    for path in scratch.glob("counted.*"):
        text = path.read_text()
        found = re.search(r"^desc: Trigger: Client Request: (\w+)$", text, re.M)
        if found:
            counts[found[1]] = int(re.search(r"^(?:totals|summary): (\d+)$", text, re.M)[1])
    times = {}
    if time:
        times = {name: float(ns) for name, ns in (line.split() for line in run([program, "time"]).splitlines())}
    return {name: (count - counts["empty"]) / SAMPLES + 1 for name, count in counts.items()}, {}, times


def _on_board(case, everything, scratch) -> tuple[dict, dict, dict]:
    """Check, and count in the same run; return instructions, stacks and nanoseconds (none) by name."""
    script = (START / "cortex_m.ld").read_text().replace("256K", "4M").replace("16K", "64K")
    (scratch / "board.ld").write_text(script)
    link = ["-nostdlib", "-Wl,-T,board.ld", "-Wl,--gc-sections", "-lgcc"]
    flags = TARGETS["m4f"].flags
    run([f"{BOARD.tools}gcc", "-std=gnu99", "-O2", "-w", "-ffreestanding", "-fno-tree-loop-distribute-patterns", *flags,
         "-I.", f"-I{START}", str(HERE / "harness" / "driver.c"), str(START / BOARD.source), *everything, *link,
         "-o", "board.elf"], cwd=scratch)
    output = run([*BOARD.simulator, "board.elf"], cwd=scratch)
    lines = {name: [int(n, 16) for n in numbers.split()]
             for name, numbers in re.findall(r"^(\w+)((?: [0-9a-f]{8}){3})$", output, re.M)}
    if not {"empty", *PROBES} < set(lines):
        raise ToolError(f"{BOARD.words}: the program did not come to its end; it printed {output[-200:]!r}.")
    _agree(case, {name: struct.unpack("f", struct.pack("I", bits))[0] for name, (bits, _, _) in lines.items()})
    idle = lines["empty"][1]
    return ({name: float((ticks - idle) / BOARD.tick / SAMPLES) + 1 for name, (_, ticks, _) in lines.items()},
            {name: stack for name, (_, _, stack) in lines.items()}, {})


def present(rival) -> bool:
    """Return whether a rival's Python module is installed."""
    import importlib.util

    return not rival.NEEDS or rival.NEEDS in sys.modules or importlib.util.find_spec(rival.NEEDS) is not None
