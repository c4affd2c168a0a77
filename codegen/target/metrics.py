"""What the generated C costs: flash, RAM and stack by compiler.

The compiler's own figures at ``-Os``: ``size`` for flash and static RAM, the call graph with stack frames
(``-fcallgraph-info=su``) for the deepest stack of each public function. Operations per step and the state's
bytes need no compiler; they are in the view.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from ..errors import ToolError

COMMON = ("-std=c99", "-Os", "-ffp-contract=off", "-ffreestanding", "-fno-asynchronous-unwind-tables")
#: Functions whose stack is told; those of a law where there is one.
LAW = ("track", "coast")
PUBLIC = ("init", "step", "predict", "reset", *LAW)
TARGETS = {
    "host": ("gcc", "size", ("-fcf-protection=none",)),
    "cortex-m4f": ("arm-none-eabi-gcc", "arm-none-eabi-size",
                   ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")),
}


def run(command: list[str], cwd: Path | None = None) -> str:
    """Run a tool and return what it printed.

    Raises
    ------
    ToolError
        It is not installed, or it failed: then with its first line of error.
    """
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False)
    except FileNotFoundError:
        raise ToolError(f"{command[0]}: not found. Install it (Debian: apt-get install {command[0]}).") from None
    except subprocess.TimeoutExpired:
        raise ToolError(f"{command[0]}: no answer within 300 s. Stopped.") from None
    if done.returncode:
        lines = done.stderr.splitlines()
        said = [line for why in ("not within region", "error") for line in lines if why in line] or lines or ["?"]
        raise ToolError(f"{command[0]}: failed with status {done.returncode}: {said[0]}.")
    return done.stdout


def measure(sources: dict[str, str], prefix: str) -> dict[str, dict]:
    """Compile the observer and measure it, for the host and for Cortex-M4F if its compiler is installed.

    Parameters
    ----------
    sources : dict
        File name -> text; the ``.c`` and ``.h`` of the observer.
    prefix : str

    Returns
    -------
    measured : dict
        Target -> ``compiler``, ``flags``, ``flash_bytes``, ``ram_bytes`` (static), ``stack_bytes`` (public
        function -> deepest stack, None if a call into an unmeasured library is on the way).

    Raises
    ------
    ToolError
        gcc is missing or refuses the C.
    """
    present = {name: tools for name, tools in TARGETS.items() if name == "host" or shutil.which(tools[0])}
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        folder = Path(scratch)
        for name in (f"{prefix}.c", f"{prefix}.h"):
            (folder / name).write_text(sources[name], encoding="ascii")
        return {name: _measure_one(folder, prefix, *tools) for name, tools in present.items()}


def _measure_one(folder: Path, prefix: str, gcc: str, size: str, flags: tuple[str, ...]) -> dict:
    version = run([gcc, "--version"]).splitlines()[0]
    run([gcc, *COMMON, *flags, "-fcallgraph-info=su", "-c", f"{prefix}.c", "-o", "observer.o"], cwd=folder)
    text, data, bss = (int(n) for n in run([size, "observer.o"], cwd=folder).splitlines()[1].split()[:3])
    graph = next(folder.glob("*.ci"))
    stack = deepest_stacks(graph.read_text())
    graph.unlink()
    return {"compiler": version, "flags": " ".join([*COMMON, *flags]), "flash_bytes": text + data,
            "ram_bytes": data + bss, "stack_bytes": {f: stack.get(f"{prefix}_{f}") for f in PUBLIC
                                                     if f not in LAW or f"{prefix}_{f}" in stack}}


def deepest_stacks(graph: str) -> dict[str, int | None]:
    """Add up the frames along the deepest path from each function of gcc's call graph (VCG text).

    Parameters
    ----------
    graph : str

    Returns
    -------
    stacks : dict
        Function -> bytes; None where the path leaves the file, or a frame is not fixed.
    """
    frames: dict[str, int | None] = {}
    for title, label in re.findall(r'node: \{ title: "([^"]*)" label: "([^"]*)"', graph):
        known = re.search(r"(\d+) bytes \((?:static|dynamic,bounded)\)", label)
        frames[title] = int(known.group(1)) if known else None
    calls: dict[str, list[str]] = {}
    for source, target in re.findall(r'edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', graph):
        calls.setdefault(source, []).append(target)

    def depth(name: str) -> int | None:
        below = [depth(callee) for callee in calls.get(name, ())]  # generated C has no recursion
        own = frames.get(name)
        return None if own is None or None in below else own + max(below, default=0)

    # A static function's title begins with its file: keep the name alone.
    return {name.split(":")[-1]: depth(name) for name in frames}
