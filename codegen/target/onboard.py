"""Cross-compile a generated folder, run its golden self-test on a simulated board, measure each call."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

from ..errors import ToolError, ValidationError
from .boards import BOARDS, COMMON, Board
from .metrics import run

#: Bytes that a program needs in RAM beside its data: what main.c paints of the stack, and the frames above.
STACK = 1024 + 256
KINDS = ("step", "ordinary", "predict", "refused")
WRAPPED = ("step", "predict", "reset")
#: Of a tracking law, both kind and function.
LAW = ("track", "coast")


@dataclass(frozen=True)
class Count:
    """Instructions (or cycles) of one kind of call: from its entry until it has returned."""

    calls: int
    least: int
    most: int


@dataclass(frozen=True)
class TargetRun:
    """What one run on one board gave.

    Parameters
    ----------
    board : str
    words : str
        What the board is.
    self_test : int
        Answer of ``<prefix>_self_test()``: 0, or the first sample that differs.
    same_as_host : bool
        Every byte of every answer is the host's.
    unit : {"instructions", "cycles"}
    counts : dict
        Kind of call -> Count, over the golden vectors. "step": every accepted step, alarms and restarts too.
        "ordinary": those with the guarantee in force, after two measured samples within bounds. "predict";
        "refused": calls of both that are refused. Of a tracking law also "track" and "coast".
    flash_bytes : int
        Code and constants of the observer's object, without the compiler's library.
    stack_bytes : int or None
        Deepest stack of a call, painted, the compiler's library included. None: deeper than what is painted.
    state_bytes : int
        ``sizeof(<prefix>_state)`` there.
    compiler, flags, simulator : str
    """

    board: str
    words: str
    self_test: int
    same_as_host: bool
    unit: str
    counts: dict[str, Count]
    flash_bytes: int
    stack_bytes: int | None
    state_bytes: int
    compiler: str
    flags: str
    simulator: str

    @property
    def passed(self) -> bool:
        """Whether the board calculates as the reference and as the host, bit for bit."""
        return self.self_test == 0 and self.same_as_host


def present(board: Board) -> bool:
    """Return whether the compiler and the simulator of a board are installed."""
    return all(shutil.which(tool) for tool in (f"{board.tools}gcc", board.simulator[0]))


def run_on(folder: str | Path, board: str, start: Path, extra: tuple[str, ...] = ()) -> TargetRun:
    """Run the golden self-test of a generated folder on a board.

    Parameters
    ----------
    folder : str or Path
    board : str
        Key of ``BOARDS``.
    start : Path
        Folder of the start-up files: ``harness/board`` of the templates.
    extra : tuple of str
        More flags for the board's compiler.

    Returns
    -------
    result : TargetRun

    Raises
    ------
    ToolError
        The folder is not one of residua's, a tool is missing, the compiler refuses the C, the board's memory is
        too small for it, or the program does not come to its end.
    """
    folder, b = Path(folder).resolve(), BOARDS[board]
    if not present(b):
        raise ToolError(f"{board}: {b.tools}gcc or {b.simulator[0]} not found. "
                        f"Install them (Debian: apt-get install {b.packages}).")
    record = _record(folder)
    prefix = record["prefix"]
    gcc, flags = f"{b.tools}gcc", (*COMMON, *b.flags, *extra)
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        here = Path(scratch)
        run([gcc, *flags, f"-I{folder}", "-c", str(folder / f"{prefix}.c"), "-o", "observer.o"], cwd=here)
        text, data = run([f"{b.tools}size", "observer.o"], cwd=here).splitlines()[1].split()[:2]
        link = [part.format(start=start) for part in b.link]
        run([gcc, *flags, *_harness(folder, record, start), str(start / b.source), "observer.o", *link,
             "-o", "board.elf"], cwd=here)
        _fits(b, board, here)
        said = _figures(_simulate([*b.simulator, "board.elf"], here), board)
    digest = _on_host(folder, start, tuple(p.read_bytes() for p in _sources(folder, prefix, start)))
    stack, painted = said["stack_bytes"]
    return TargetRun(board, b.words, said["self_test"][0], said["digest"] == digest, b.unit,
                     {kind: _count(b, said[kind], said["empty"][1]) for kind in (*KINDS, *_law(record))},
                     int(text) + int(data),
                     stack if stack < painted else None, said["state_bytes"][0],
                     run([gcc, "--version"]).splitlines()[0], " ".join(flags), _simulator(b))


def _sources(folder: Path, prefix: str, start: Path) -> tuple[Path, ...]:
    """Return what the answers of the host depend on."""
    return folder / f"{prefix}.c", folder / f"{prefix}.h", folder / f"test_{prefix}.c", start / "main.c"


@lru_cache(maxsize=4)
def _on_host(folder: Path, start: Path, sources: tuple[bytes, ...]) -> list[int]:
    """Return the host's digest of all answers; asked again for the next board with the same ``sources``: known."""
    record = _record(folder)
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        program = Path(scratch) / "host"
        run(["gcc", *COMMON, "-O2", "-DON_HOST", *_harness(folder, record, start),
             str(folder / f"{record['prefix']}.c"), "-o", str(program)], cwd=Path(scratch))
        return _figures(run([str(program)]), "host")["digest"]


def _fits(b: Board, board: str, here: Path) -> None:
    """Require that data and stack do not meet where constants lie in RAM: the program would overwrite them."""
    data, bss = map(int, run([f"{b.tools}size", "board.elf"], cwd=here).splitlines()[1].split()[1:3])
    if b.memory and data + bss + STACK > b.memory:
        raise ToolError(f"{board}: constants, golden vectors and stack take {data + bss + STACK} bytes of RAM (found), "
                        f"expected at most {b.memory}. Take a board that leaves constants in flash.")


def _record(folder: Path) -> dict:
    """Read resources.json."""
    try:
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        record["prefix"], record["macro"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ToolError(f"{folder / 'resources.json'}: cannot be read ({type(error).__name__}: {error}). "
                        "Make the folder with residua generate.") from error
    return record


def _harness(folder: Path, record: dict, start: Path) -> list[str]:
    """Return what gcc needs to compile the measuring program around the golden self-test."""
    prefix, macro = record["prefix"], record["macro"]
    names = {"T": f"{prefix}_##name", "M": f"{macro}_##name", "WRAP": f"__wrap_{prefix}_##name",
             "CALL": f"__real_{prefix}_##name"}
    return [f"-I{folder}", *(f"-D{name}(name)={text}" for name, text in names.items()), f"-D{macro}_NO_MAIN",
            "-include", f"{prefix}.h", str(start / "main.c"), str(folder / f"test_{prefix}.c"),
            *(f"-Wl,--wrap={prefix}_{call}" for call in (*WRAPPED, *_law(record))), *["-DLAW"] * ("law" in record)]


def _law(record: dict) -> tuple[str, ...]:
    """The calls of a tracking law, where there is one."""
    return LAW if "law" in record else ()


def _simulate(command: list[str], here: Path) -> str:
    """Run the simulator; return what the board printed, which simavr shows on its standard error."""
    try:
        done = subprocess.run(command, cwd=here, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", timeout=60, check=False)
    except subprocess.TimeoutExpired:
        raise ToolError(f"{command[0]}: the board did not finish within 60 s. Stopped.") from None
    return done.stdout


def _figures(output: str, board: str) -> dict[str, list[int]]:
    """Read the lines "name hex ..." of the measuring program, without the colours of a terminal."""
    found = {name: [int(n, 16) for n in numbers.split()]
             for name, numbers in re.findall(r"([a-z_]+)((?: [0-9a-f]{8})+)", re.sub(r"\x1b\[\d*m", "", output))}
    if "refused" not in found:
        raise ToolError(f"{board}: the program did not come to its end; it printed {output[-200:]!r}.")
    return found


def _count(board: Board, figures: list[int], empty: int) -> Count:
    """Turn ticks, with what reading them costs, into instructions."""
    calls, *ticks = figures
    least, most = (round((t - empty) / board.tick) + board.empty if calls else 0 for t in ticks)
    return Count(calls, least, most)


def _simulator(board: Board) -> str:
    """Return the simulator and its version, where it tells one."""
    name = board.simulator[0]
    return run([name, "--version"]).splitlines()[0] if name.startswith("qemu") else name


def run_all(folder: str | Path, boards: tuple[str, ...], start: Path, progress=lambda text: None) -> list[TargetRun]:
    """Run on several boards and keep the figures in the folder's resources.json, under "target".

    Parameters
    ----------
    folder : str or Path
    boards : tuple of str
        Empty: every board whose tools are installed.
    start : Path
        See ``run_on``.
    progress : callable
        Told what is being done.

    Returns
    -------
    runs : list of TargetRun

    Raises
    ------
    ToolError
        See ``run_on``; or no board's tools are installed; or resources.json cannot be written.
    """
    folder = Path(folder)
    record = _record(folder)
    chosen = boards or [name for name, board in BOARDS.items() if present(board) and not _refuses(name, record)]
    if not chosen:
        raise ToolError("target: no cross compiler with its simulator is installed, expected one of "
                        f"{', '.join(BOARDS)}. Install one (Debian: apt-get install {BOARDS['m4f'].packages}).")
    runs = []
    for name in chosen:
        progress(f"running on {BOARDS[name].words}")
        runs.append(run_on(folder, name, start))
    figures = {r.board: asdict(r) | {"passed": r.passed} for r in runs}
    _keep(folder / "resources.json", record | {"target": record.get("target", {}) | figures})
    return runs


def _keep(path: Path, record: dict) -> None:
    """Write resources.json, whole or not at all."""
    fresh = path.with_name(f".{path.name}.tmp")
    try:
        fresh.write_text(json.dumps(record, indent=2) + "\n", encoding="ascii")
        os.replace(fresh, path)
    except OSError as error:
        raise ToolError(f"{path}: cannot be written ({error.strerror or error}). Make its folder writable.") from error


def _refuses(name: str, record: dict) -> bool:
    """Return whether the C refuses to compile for a board: double has 32 bits on AVR."""
    return name == "avr" and record.get("real") == "float64"


def require(runs: list[TargetRun]) -> None:
    """Require that every run passed.

    Parameters
    ----------
    runs : list of TargetRun

    Raises
    ------
    ValidationError
        A board calculates differently.
    """
    for r in runs:
        if not r.passed:
            what = f"self-test answers {r.self_test}" if r.self_test else "bytes differ from the host's"
            raise ValidationError(f"{r.board}: {what} (found with {r.flags}), expected the reference bit for bit. "
                                  "Check that the .c is as generated and the compiler's options.")
