"""Compare every committed design with its budgets on simulated boards: ``python c_tests/budgets.py``.

``--update`` measures anew and writes budgets.csv: the measured figures, 5 % and (stack) 8 bytes more, because the
next version of a compiler may need a little more. Needs the package and the tools of the boards.

Framers are held to their budgets on Cortex-M3, M4F and M7; point observers, whose sets cost more, on Cortex-M0, RISC-V
without FPU and AVR too. On AVR ``instructions`` are clock cycles. There constants lie in the 8 KiB of RAM: three point
observers whose tables, or whose golden vectors beside them, do not fit are left out (``TOO_LARGE``).
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

from codegen.target.onboard import TargetRun, run_on

HERE = Path(__file__).resolve().parent
TABLE = HERE / "budgets.csv"
START = HERE.parent / "templates" / "harness" / "board"
BOARDS = ("m3", "m4f", "m7")
OF_SETS = ("m0", "rv32", "avr")
TOO_LARGE = {("zammali_blocks_zonotope", "avr"), ("zammali_dwell_zonotope", "avr"),
             ("zammali_ellipsoid_ellipsoid", "avr")}
FIGURES = ("instructions", "flash_bytes", "stack_bytes")
HOW = "If this is meant, run python c_tests/budgets.py --update and review the diff of budgets.csv."


def folders() -> list[Path]:
    """The committed designs."""
    return sorted(p.parent for p in (HERE.parent / "generated").glob("*/resources.json"))


def boards(folder: Path) -> tuple[str, ...]:
    """The boards on which a design has budgets."""
    point = any(name == "x_hat" for name, _, _ in json.loads((folder / "resources.json").read_text())["state"])
    return (*BOARDS, *(b for b in OF_SETS if point and (folder.name, b) not in TOO_LARGE))


def budgets() -> dict[tuple[str, str], dict[str, int]]:
    """Read budgets.csv: (design, board) -> figure -> most that is allowed."""
    with TABLE.open(newline="", encoding="ascii") as file:
        return {(row["design"], row["board"]): {name: int(row[name]) for name in FIGURES}
                for row in csv.DictReader(file)}


def figures(result: TargetRun) -> dict[str, int]:
    """What is held to a budget: the dearest call, code with constants, deepest stack."""
    return {"instructions": max(count.most for count in result.counts.values()),
            "flash_bytes": result.flash_bytes, "stack_bytes": result.stack_bytes}


def excess(design: str, result: TargetRun, allowed: dict | None) -> list[str]:
    """Return what is above its budget, each as a sentence."""
    if allowed is None:
        return [f"{design} on {result.board}: no budget in budgets.csv. {HOW}"]
    return [f"{design} on {result.board}: {name} {found}, budget {allowed[name]}. {HOW}"
            for name, found in figures(result).items() if found is None or found > allowed[name]]


def update() -> None:
    """Write budgets.csv."""
    with TABLE.open("w", newline="", encoding="ascii") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["design", "board", *FIGURES])
        for folder in folders():
            for board in boards(folder):
                found = figures(run_on(folder, board, START))
                found["stack_bytes"] += 8
                writer.writerow([folder.name, board, *(-(-n * 105 // 100) for n in found.values())])


def main(arguments: list[str]) -> int:
    """Check, or update; return the exit status."""
    if "--update" in arguments:
        update()
        return 0
    allowed = budgets()
    wrong = []
    for folder in folders():
        for board in boards(folder):
            result = run_on(folder, board, START)
            wrong += excess(folder.name, result, allowed.get((folder.name, board)))
            wrong += [] if result.passed else [f"{folder.name} on {board}: differs from the host"]
    print("\n".join(wrong) or f"{len(folders())} designs on {', '.join((*BOARDS, *OF_SETS))}: all within their budgets")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
