"""The table of results: one line per row, its goals, and which of them it misses."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import groupby
from statistics import median

OURS = ("literal", "table", "loop")
KEYS = ("observer", "plant", "n", "modes", "real", "target", "optimise")
#: Rivals other than the printers of straight-line C without any interface (symforce_cpp, sympy_c).
NAMED = ("casadi_sx", "casadi_mx", "eigen", "loop_fixed", "loop_generic")


@dataclass(frozen=True)
class Line:
    """One row: its key, the ratios that the goals speak of, and what it misses."""

    key: tuple[str, ...]
    bound: int
    literal: int
    best: str
    to_best: float
    to_named: float
    to_bound: float
    table_to_best: float
    flash: int
    smallest: str
    loop_to_smallest: float
    stack: str
    time: str

    @property
    def misses(self) -> tuple[str, ...]:
        """The goals that the row misses."""
        goals = (("literal/rival", self.to_best <= 0.7), ("literal/bound", self.to_bound <= 1.3),
                 ("table/rival", self.table_to_best <= 1), ("flash", self.loop_to_smallest <= 1))
        return tuple(goal for goal, met in goals if not met)


def lines(records: list[dict]) -> list[Line]:
    """Judge every row.

    Parameters
    ----------
    records : list of dict
        Lines of results.csv, as text.

    Returns
    -------
    lines : list of Line
    """
    return [_line(key, list(group)) for key, group in groupby(records, lambda r: tuple(r[k] for k in KEYS))]


def _line(key: tuple[str, ...], group: list[dict]) -> Line:
    own = {r["candidate"]: r for r in group if r["candidate"] in OURS}
    rivals = [r for r in group if r["candidate"] not in OURS]
    best = min(rivals, key=lambda r: int(r["instructions"]))
    named = min(int(r["instructions"]) for r in rivals if r["candidate"] in NAMED)
    smallest = min(rivals, key=lambda r: int(r["flash_bytes"]))
    literal, bound = int(own["literal"]["instructions"]), int(group[0]["bound"])
    fewest = int(best["instructions"])
    return Line(key, bound, literal, best["candidate"], literal / fewest, literal / named, literal / bound,
                int(own["table"]["instructions"]) / fewest, int(own["loop"]["flash_bytes"]), smallest["candidate"],
                int(own["loop"]["flash_bytes"]) / int(smallest["flash_bytes"]),
                "/".join(own[name]["stack_bytes"] for name in OURS) if own["literal"]["stack_bytes"] else "",
                own["literal"]["time_ratio"])


def render(records: list[dict]) -> str:
    """Print the table with its summary as Markdown."""
    found = lines(records)
    text = ["# Results", "", "Written by `python -m benchmarks`; what each column is stands in README.md.", "",
            *_summary(found), "",
            "| observer | plant | n | modes | type | on | opt | bound | literal | best rival | lit/best | lit/named "
            "| lit/bound | tab/best | loop flash | smallest | loop/smallest | stack | time | misses |",
            "|---|---|--:|--:|---|---|---|--:|--:|---|--:|--:|--:|--:|--:|---|--:|---|--:|---|"]
    for f in found:
        cells = [*f.key, f.bound, f.literal, f.best, f"{f.to_best:.2f}", f"{f.to_named:.2f}", f"{f.to_bound:.2f}",
                 f"{f.table_to_best:.2f}", f.flash, f.smallest, f"{f.loop_to_smallest:.2f}", f.stack, f.time,
                 ", ".join(f.misses) or "none"]
        text.append(f"| {' | '.join(str(c) for c in cells)} |")
    return "\n".join(text) + "\n"


def _summary(found: list[Line]) -> list[str]:
    """Print how many rows meet each goal."""
    groups = {"all": found}
    for target, real in sorted({(f.key[5], f.key[4]) for f in found}):
        groups[f"{target} {real}"] = [f for f in found if (f.key[5], f.key[4]) == (target, real)]
    text = ["| rows | number | literal <= 0.7 best rival | literal <= 0.7 best named | literal <= best rival "
            "| literal <= 1.3 bound | table <= best rival | loop flash <= smallest | median literal/best "
            "| median literal/named |", "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|"]
    for name, rows in groups.items():
        counts = [sum(test) for test in zip(*((f.to_best <= 0.7, f.to_named <= 0.7, f.to_best <= 1, f.to_bound <= 1.3,
                                               f.table_to_best <= 1, f.loop_to_smallest <= 1) for f in rows))]
        cells = [name, len(rows), *counts, f"{median(f.to_best for f in rows):.2f}",
                 f"{median(f.to_named for f in rows):.2f}"]
        text.append(f"| {' | '.join(str(c) for c in cells)} |")
    best = Counter(f.best for f in found).most_common()
    return [*text, "", f"Best rival: {', '.join(f'{name} in {n} rows' for name, n in best)}."]
