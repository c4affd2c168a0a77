"""The firmware in words: what it costs, its constants, where it comes from, what lies in its folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from .. import __version__
from ..observers import (
    BankTables,
    DrivenTables,
    FilterTables,
    FollowerTables,
    GuidedFilterTables,
    GuidedPointTables,
    GuidedTables,
    ModeTables,
    PointTables,
    PolytopicTables,
    SlidingTables,
    TrailingTables,
)
from . import (
    bank_words,
    filter_words,
    mode_words,
    point_words,
    polytopic_words,
    sliding_words,
    trailing_words,
    words,
)
from .parameter_words import of_a_step
from .table import Fact, Folded, Link, Table, table

FILES = {
    "design.json": "the frozen design: plant, constants, certificate",
    "resources.json": "sizes, operations, flash and stack, for machines",
    "assurance.json": "each claim: plant entries, condition, constants, lines of the C, checks and their results",
    "CMakeLists.txt": "builds the observer as a library, and its test",
}


def read_record(folder: Path) -> dict:
    """Return the contents of resources.json; empty where it is missing or no JSON object."""
    try:
        record = json.loads((Path(folder) / "resources.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def cost(record: dict) -> tuple[tuple[Fact, ...], tuple[Table, ...]]:
    """Say what the firmware costs, as far as the record tells.

    Parameters
    ----------
    record : dict
        Contents of resources.json.

    Returns
    -------
    facts : tuple of Fact
    tables : tuple of Table
        Per compiler that it was measured with.
    """
    facts = [Fact(term, str(record[key]) + unit) for term, key, unit in
             (("Numbers", "real", ""), ("Layout of the constants", "layout", ""),
              ("State (RAM per observer)", "state_bytes", f"{words.THIN}bytes")) if key in record]
    operations = record.get("operations_per_step")
    if isinstance(operations, dict):
        listed = words.listed(f"{n} {name}" for name, n in operations.items())
        facts.append(Fact("Operations of a call, at most", f"{listed} (floating point)"))
    rows = [_measured(target, m) for target, m in _targets(record).items()]
    head = ("target", "compiler", "flags", "#flash (bytes)", "#static RAM (bytes)", "#stack of a step (bytes)")
    return tuple(facts), (table("Measured with the compilers that were installed", head, rows),) if rows else ()


def _targets(record: dict) -> dict[str, dict]:
    """What was measured, per target."""
    measured = record.get("measured")
    return {k: m for k, m in measured.items() if isinstance(m, dict)} if isinstance(measured, dict) else {}


def _measured(target: str, m: dict) -> tuple[str, ...]:
    stack = m.get("stack_bytes")
    step = stack.get("step") if isinstance(stack, dict) else stack
    return (target, str(m.get("compiler", words.NONE)), str(m.get("flags", words.NONE)),
            *(words.NONE if n is None else str(n) for n in (m.get("flash_bytes"), m.get("ram_bytes"), step)))


def tiles(record: dict) -> tuple[Fact, ...]:
    """Two figures for the headline: RAM, and code size on the first target that is not the host, else on the host."""
    facts = []
    if isinstance(record.get("state_bytes"), int):
        facts.append(Fact("RAM per observer", f"{words.integer(record['state_bytes'])}{words.THIN}bytes"))
    for target, m in sorted(_targets(record).items(), key=lambda item: item[0] == "host"):
        if isinstance(m.get("flash_bytes"), int):
            facts.append(Fact(f"code and constants, {target}", f"{words.integer(m['flash_bytes'])}{words.THIN}bytes"))
            break
    return tuple(facts)


def gains(design, real: str) -> tuple[Folded, ...]:
    """Tabulate the constants that the C holds, exactly, one fold per mode.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    tuple of Folded
    """
    t = design.observer.tables[real]
    if isinstance(t, DrivenTables):
        return (*_framers(t.told, design.plant), *mode_words.gains(design, real, _matrix, "The mode estimator: "))
    if isinstance(t, FollowerTables):
        return (*point_words.gains(design, real, _matrix, t.told),
                *mode_words.gains(design, real, _matrix, "The mode estimator: "))
    if isinstance(t, TrailingTables):
        return trailing_words.gains(design, real, _matrix)
    if isinstance(t, ModeTables):
        return mode_words.gains(design, real, _matrix)
    if isinstance(t, GuidedTables):
        return (*_framers(t.told, design.plant),
                *sliding_words.gains(design, real, _matrix, "The mode estimator: "))
    if isinstance(t, GuidedPointTables):
        return (*point_words.gains(design, real, _matrix, t.told),
                *sliding_words.gains(design, real, _matrix, "The mode estimator: "))
    if isinstance(t, GuidedFilterTables):
        return (*trailing_words.of_filters(design, real, _matrix),
                *sliding_words.gains(design, real, _matrix, "The mode estimator: "))
    if isinstance(t, SlidingTables):
        return sliding_words.gains(design, real, _matrix)
    if isinstance(t, FilterTables):
        return filter_words.gains(design, real, _matrix)
    if isinstance(t, BankTables):
        return bank_words.gains(design, real, _matrix)
    if isinstance(t, PolytopicTables):
        return polytopic_words.gains(design, real, _matrix)
    if isinstance(t, PointTables):
        return point_words.gains(design, real, _matrix)
    return _framers(t, design.plant)


def _framers(t, plant) -> tuple[Folded, ...]:
    """The constants of a pair of framers."""
    x, u, y = ([s.name for s in getattr(plant, vector)] for vector in "xuy")
    sides = ("hi",) if t.shared else ("hi", "lo")
    rows = x if t.change is None else [f"z[{i}]" for i in range(len(x))]  # of the state of the recursion
    meanings = ("T A − L C", "T B − L D") if t.change is None else ("Z A X − L C X", "Z B − L D")
    folds, step = [], of_a_step(plant)
    for q, mode in enumerate(plant.modes):
        tables = []
        base = " at theta = 0" if t.vary is not None and t.vary.parameters else ""
        for side in sides:
            of = "" if t.shared else " of the upper framer" if side == "hi" else " of the lower framer"
            for name, meaning, columns in (("M", meanings[0], rows), ("G", meanings[1], u), ("L", "gain on y", y),
                                           ("N", "gain on the next y", y)):
                matrix = getattr(t, f"{name}_{side}")[q]
                if np.any(matrix):
                    tables.append(_matrix(f"{name} = {meaning}{of}{base if name != 'N' else ''}"
                                          f"{step if name in 'MG' else ''}", rows, columns,
                                          matrix))
        tables += _varying(t.vary, q, plant, rows, u, y)
        tables.append(_matrix("Offsets of the framers", rows, ["d_lo", "d_hi"],
                              np.stack([t.d_lo[q], t.d_hi[q]], axis=1)))
        tables += _coordinates(t.change, x, rows)
        tables.append(_matrix("C, and offsets of the residual", y, [*x, "c_lo", "c_hi"],
                              np.column_stack([t.C[q], t.c_lo[q], t.c_hi[q]])))
        folds.append(Folded(f"Mode {q}, “{mode.name}”", tuple(tables)))
    return tuple(folds)


def _coordinates(change, x: list[str], z: list[str]) -> list[Table]:
    """The maps from x to z and back; none without a change of coordinates."""
    if change is None:
        return []
    c = change
    return [_matrix("z = Z x, offsets of its bounds, and its range", z, [*x, "e_lo", "e_hi", "from", "to"],
                    np.column_stack([c.Z, c.e_lo, c.e_hi, c.z_lo, c.z_hi])),
            _matrix("x = X z, offsets of its bounds", x, [*z, "b_lo", "b_hi"], np.column_stack([c.X, c.b_lo, c.b_hi]))]


def _varying(vary, q: int, plant, rows: list[str], u: list[str], y: list[str]) -> list[Table]:
    """Slopes in the measured parameters, and the radii by which both bounds move apart."""
    if vary is None:
        return []
    x = [s.name for s in plant.x]
    measured = [plant.theta[j].name for j in vary.columns]
    tables = [_matrix(f"Slope of {name} in {theta}", rows, columns, getattr(vary, name)[q][j])
              for j, theta in enumerate(measured) for name, columns in (("M", x), ("G", u), ("L", y))
              if np.any(getattr(vary, name)[q][j])]
    for what, parts in (("Radii of a step: both bounds move apart by R max(−x_lo, x_hi) + S |u|"
                         + (" + |L(theta)| E" if np.any(vary.E) else ""), (("R", x), ("S", u), ("E", y))),
                        ("Radii of a prediction without measurement, as R and S", (("Ra", x), ("Sa", u)))):
        found = [(name, columns, getattr(vary, name)[q]) for name, columns in parts if np.any(getattr(vary, name)[q])]
        if found:
            head = [f"{name}, {column}" for name, columns, _ in found for column in columns]
            tables.append(_matrix(what, x if parts[0][0] == "Ra" else rows, head,
                                  np.hstack([values for *_, values in found])))
    return tables


def _matrix(caption: str, rows: list[str], columns: list[str], values) -> Table:
    """A matrix with named rows and columns; every entry reads back exactly."""
    body = [(name, *(str(v).replace("-", "−") for v in line)) for name, line in zip(rows, values)]
    return table(caption, ("", *("#" + c for c in columns)), body)


def provenance(design, real: str, layout: str, prefix: str) -> tuple[Fact, ...]:
    """Say what made the firmware and how to make it, and to check it, again.

    Parameters
    ----------
    design : Design
    real, layout, prefix : str

    Returns
    -------
    tuple of Fact
    """
    generate = f"residua generate design.json --real {real} --layout {layout} -o {prefix}"
    return (Fact("Tool", f"residua {__version__}"), Fact("Plant, sha256", design.plant_sha256, "mono"),
            Fact("Certificate, sha256", design.digest, "mono"),
            Fact("Make the C again, byte for byte", generate, "mono"),
            Fact("Check the certificate again", "residua certify design.json", "mono"),
            Fact("Check assurance.json against the C", "residua assurance .", "mono"),
            Fact("Run the scenarios again", "residua validate .", "mono"),
            Fact("Replay a recorded log", "residua replay . log.csv", "mono"))


def links(folder: Path, prefix: str) -> tuple[Link, ...]:
    """List the files of the folder, the report left out.

    Parameters
    ----------
    folder : Path
    prefix : str

    Returns
    -------
    tuple of Link
        Sorted by name.
    """
    known = FILES | {f"{prefix}.h": "the interface, and the manual", f"{prefix}.c": "the observer",
                     f"test_{prefix}.c": "unit test with vectors of the reference; runs on the target too",
                     f"prove_{prefix}.c": "harness for Frama-C: residua prove",
                     f"rounding_{prefix}.g": "rounding of every sum, for Gappa: residua prove"}
    names = sorted(p.name for p in Path(folder).iterdir() if p.is_file())
    return tuple(Link(name, known.get(name, "")) for name in names
                 if name != "report.html" and not name.startswith(".") and not name.endswith(".part"))
