"""Fuzzing of a folder's C: libFuzzer with the address and undefined-behaviour sanitizers, on the host."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ..errors import ToolError, ValidationError

SANITIZERS = "-fsanitize=fuzzer,address,undefined,float-divide-by-zero,float-cast-overflow"
FLAGS = ("-std=c99", "-O1", "-g", "-ffp-contract=off", SANITIZERS, "-fno-sanitize-recover=all")
COMPILERS = ("clang-19", "clang")
LONGEST = 2048  # bytes of one sequence of calls


@dataclass(frozen=True)
class Fuzzed:
    """What fuzzing a folder found: sequences run, code edges reached; ``crash`` is the bytes of a failure."""

    folder: Path
    runs: int
    edges: int
    crash: bytes
    message: str


def read_record(folder: Path) -> dict:
    """Read resources.json of a folder that residua made.

    Raises
    ------
    ToolError
        There is none, or it is not ours.
    """
    path = Path(folder) / "resources.json"
    try:
        record = json.loads(path.read_text(encoding="ascii"))
        if not {"prefix", "macro", "real", "ranges", "n_u"} <= record.keys():
            raise KeyError("prefix")
    except (OSError, ValueError, KeyError, AttributeError):
        raise ToolError(f"{path}: cannot be read. Make the folder with residua generate.") from None
    return record


def fuzz(folder: Path, harness: str, runs: int | None = 50000, seconds: int | None = None, seed: int = 1) -> Fuzzed:
    """Compile the observer with the harness and let libFuzzer look for a failure.

    Parameters
    ----------
    folder : Path
        Output folder of residua.
    harness : str
        Text of the harness (``emit.fuzzing.fuzz_harness``).
    runs : int, optional
        So many sequences; None: until the time is over.
    seconds : int, optional
        So long at most.
    seed : int
        The same seed and runs give the same sequences.

    Returns
    -------
    fuzzed : Fuzzed

    Raises
    ------
    ToolError
        No clang, no libFuzzer, or the C does not compile.
    """
    folder = Path(folder).resolve()
    prefix = read_record(folder)["prefix"]
    clang = next((c for c in COMPILERS if shutil.which(c)), None)
    if clang is None:
        raise ToolError("clang: not found. Install it (Debian: apt-get install clang-19 libclang-rt-19-dev).")
    limits = [f"-{name}={value}" for name, value in (("runs", runs), ("max_total_time", seconds)) if value is not None]
    with tempfile.TemporaryDirectory(prefix="residua-") as name:
        scratch = Path(name)
        (scratch / "fuzz.c").write_text(harness, encoding="ascii")
        built = subprocess.run([clang, *FLAGS, f"-I{folder}", str(folder / f"{prefix}.c"), "fuzz.c", "-o", "fuzz"],
                               cwd=scratch, capture_output=True, text=True, check=False, timeout=300)
        if built.returncode:
            said = [line for line in built.stderr.splitlines() if "error" in line] or ["?"]
            raise ToolError(f"{clang}: cannot compile the fuzz harness: {said[0]}. Install libclang-rt of its version.")
        done = subprocess.run(["./fuzz", f"-seed={seed}", f"-max_len={LONGEST}", "-len_control=0",
                               "-print_final_stats=1", *limits], cwd=scratch, capture_output=True, text=True,
                              errors="replace", check=False)
        crash = b"".join(p.read_bytes() for p in sorted(scratch.glob("crash-*"))[:1])
    return _result(folder, done, crash)


def _result(folder: Path, done: subprocess.CompletedProcess, crash: bytes) -> Fuzzed:
    """Read what libFuzzer printed."""
    executed = re.findall(r"stat::number_of_executed_units: *(\d+)", done.stderr)
    edges = re.findall(r"cov: (\d+)", done.stderr)
    failures = re.findall(r"(?m)^(?:.*runtime error: .*|==\d+==ERROR: .*|SUMMARY: .*)$", done.stderr)
    message = "" if not done.returncode else failures[0] if failures else f"status {done.returncode}"
    return Fuzzed(folder, int(executed[-1]) if executed else 0, int(edges[-1]) if edges else 0, crash, message)


def require(fuzzed: Fuzzed) -> None:
    """Stop where fuzzing found a failure.

    Raises
    ------
    ValidationError
        With the bytes of the shortest way there that libFuzzer kept.
    """
    if fuzzed.message:
        raise ValidationError(f"{fuzzed.folder}: fuzzing failed: {fuzzed.message}. Sequence: {fuzzed.crash.hex()}.")
