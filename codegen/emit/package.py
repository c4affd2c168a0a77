"""The output folder: all its files from one design, written whole or not at all."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import tempfile
from pathlib import Path

from .. import __version__
from ..errors import EmitError
from ..observers import ModeTables
from ..target import metrics
from ..target.gappa import WITHOUT
from . import golden
from .gappa import rounding
from .golden_law import golden_laws
from .harness import harness
from .render import render
from .view import DesignView, build

MARK = "design.json"  # what makes a folder one of ours


def files(design, real: str | None = None, layout: str | None = None, measure: bool = True) -> dict[str, str]:
    """Print every file of the output folder but design.json; the same design gives the same bytes.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}, optional
        Default: the plant file's.
    layout : {"literal", "table", "loop"}, optional
        Default: the plant file's.
    measure : bool
        Compile for flash and stack (resources.json, "measured"), which depend on the compiler installed.

    Returns
    -------
    files : dict
        Name -> text.

    Raises
    ------
    EmitError
        The design cannot be printed.
    ToolError
        gcc is missing or refuses the C.
    """
    d = build(design, real, layout, __version__)
    t = design.observer.tables[d.real]
    spare = tuple(f.name for f in d.in_fields if f.name == "spare")
    out = {**_sources(d),
           f"test_{d.prefix}.c": render(d.self_test, d=d, vectors=golden.vectors(design, d.real),
                                        refusals=golden.refusals(t, d.macro), spare=spare,
                                        laws=golden_laws(design, d.real)),
           **_proofs(design, d), "CMakeLists.txt": render("package/CMakeLists.txt.jinja", d=d)}
    return out | _record(d, design, metrics.measure(out, d.prefix) if measure else {})


def firmware(design, real: str | None = None, layout: str | None = None) -> dict[str, str]:
    """Print what a host needs to drive the C: its two files, and resources.json without measured figures.

    Parameters
    ----------
    design, real, layout
        See ``files``.

    Returns
    -------
    files : dict
        Name -> text, as in ``files``.

    Raises
    ------
    EmitError
        The design cannot be printed.
    """
    d = build(design, real, layout, __version__)
    return _sources(d) | _record(d, design, {})


def _sources(d: DesignView) -> dict[str, str]:
    """Print the header and the C."""
    return {f"{d.prefix}.h": render(d.header, d=d), f"{d.prefix}.c": render(f"{d.family}.c.jinja", d=d)}


def _record(d: DesignView, design, measured: dict) -> dict[str, str]:
    """Print resources.json."""
    return {"resources.json": json.dumps(resources(d, design) | {"measured": measured}, indent=2) + "\n"}


def _proofs(design, d: DesignView) -> dict[str, str]:
    """Print what Frama-C and Gappa read."""
    out = {f"prove_{d.prefix}.c": render("harness/eva.c.jinja", d=d, e=harness(design, d))}
    if d.family in WITHOUT:  # no margin for rounding, so no script
        return out
    return out | {f"rounding_{d.prefix}.g": render("harness/rounding.g.jinja", d=d, g=rounding(design, d))}


def resources(d: DesignView, design) -> dict:
    """Return the machine-readable record of the C: how to call it, and what it costs on any target.

    Floats of ``ranges`` are exact: they are the numbers that the input check compares with.
    """
    t, s = design.observer.tables[d.real], design.observer.supervision
    ranges = {name: getattr(t, name).astype(float).tolist()
              for name in ("x_lo", "x_hi", "x0_lo", "x0_hi", "u_lo", "u_hi", "y_lo", "y_hi")}
    if t.change is not None:
        ranges |= {name: getattr(t.change, name).astype(float).tolist() for name in ("z_lo", "z_hi")}
    if getattr(getattr(t, "shape", None), "turned", False):
        ranges["box_start"] = t.shape.Z.astype(float).tolist()
    theta = {} if not d.theta else {name: getattr(t.vary, name).astype(float).tolist()
                                    for name in ("theta_lo", "theta_hi")}
    own = {"mode": {"S": t.S.tolist(), "ages": t.ages}} if isinstance(t, ModeTables) else {}
    law = getattr(t, "law", None)
    if law is not None:
        own["law"] = {k: getattr(law, k).astype(float).tolist() for k in ("reference", "limit")}
    own |= {"faults": t.faults} if getattr(t, "faults", 0) else {}  # of x_hat, the last entries
    own |= {"algebraic": list(t.algebraic)} if hasattr(t, "algebraic") else {}
    return {"generator": f"residua {d.version}", "prefix": d.prefix, "macro": d.macro, "real": d.real,
            "layout": d.layout, "family": d.family, "certificate": design.digest,
            "n_x": len(d.x), "n_u": len(d.u), "n_y": len(d.y), "n_theta": len(d.theta),
            "theta_columns": list(t.vary.columns) if d.theta else [], "n_modes": len(d.modes), "n_bits": len(d.bits),
            **{name: _members(d, fields) for name, fields in
               (("in", d.in_fields), ("out", d.out_fields), ("state", d.state_fields))},
            "state_bytes": d.state_bytes,
            "operations_per_step": d.operations.counts(), **_law_cost(d), "supervision": s.to_dict(),
            "ranges": ranges | theta, **own, **({} if t.change is None else {"change": t.change.to_dict()})}


def _law_cost(d: DesignView) -> dict:
    """Operations of a call of the law, where there is one."""
    laws = [law for z in d.sets for law in getattr(z, "laws", ())]
    return {"operations_per_track": laws[0].operations.counts()} if laws else {}


def _members(d: DesignView, fields) -> list[list]:
    """Describe a struct as [name, "real" or "uint32", number of elements]."""
    sizes = {"NX": d.x, "MODES": d.modes, "NU": d.u, "NY": d.y, "NTHETA": d.theta, "BITS": d.bits}
    counts = {f"[{d.macro}_{name}]": len(channels) for name, channels in sizes.items()} | {"": 1}
    counts |= {f"[{d.macro}_{name}]": n for name, n in d.lengths}
    return [[f.name, "real" if f.type not in ("uint32_t", "int32_t") else "uint32", counts[f.size]] for f in fields]


def generate(design, out: str | Path, real: str | None = None, layout: str | None = None) -> Path:
    """Write the output folder of a design.

    Parameters
    ----------
    design : Design
        With ``save(path)`` besides what ``files`` needs.
    out : str or Path
        Folder; appears whole or not at all. One that residua made is replaced, any other is refused. Files
        of others in it are kept.
    real, layout : str, optional
        See ``files``.

    Returns
    -------
    folder : Path

    Raises
    ------
    EmitError
        The folder exists and is not ours, or cannot be written.
    ToolError
        gcc is missing or refuses the C.
    """
    folder = Path(out)
    check_place(folder)
    texts = files(design, real, layout)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".tmp", dir=folder.parent))
        try:
            made = scratch / folder.name
            made.mkdir()
            for name, text in texts.items():
                (made / name).write_text(text, encoding="ascii", newline="\n")
            design.save(made / MARK)
            publish(made, folder)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        raise EmitError(f"{folder}: {error.strerror or error}. Choose a folder that can be written.") from error
    return folder


def check_place(folder: Path) -> None:
    """Refuse a place that holds something else than a folder of residua's.

    Raises
    ------
    EmitError
    """
    if folder.exists() and not (folder / MARK).is_file():
        raise EmitError(f"{folder}: exists and has no {MARK}, so residua did not make it. Choose another folder.")


def publish(made: str | Path, folder: str | Path) -> Path:
    """Put a finished folder in its place, in one step.

    Parameters
    ----------
    made : str or Path
        Finished folder on the same file system. Afterwards it is gone, or holds what is to be deleted.
    folder : str or Path
        An older folder of residua's there is replaced; files in it that residua did not make are kept.

    Returns
    -------
    folder : Path

    Raises
    ------
    EmitError
        Something else is in that place.
    """
    made, folder = Path(made), Path(folder)
    check_place(folder)
    if not folder.exists():
        made.rename(folder)
        return folder
    if not _exchange(made, folder):  # a moment without folder, on systems that cannot exchange
        aside = made.with_suffix(".old")
        folder.rename(aside)
        try:
            made.rename(folder)
        except OSError:
            aside.rename(folder)
            raise
        aside.rename(made)
    # Of the same name as a new file, or a report: belongs to the old design.
    replaced = {p.name for p in folder.iterdir()} | {"report.html", "assurance.json"} | _own_files(made)
    for foreign in [p for p in made.iterdir() if p.name not in replaced]:
        foreign.rename(folder / foreign.name)
    return folder


def _own_files(made: Path) -> set[str]:
    """Return the names that an older design's C has; its prefix may have been another."""
    try:
        prefix = json.loads((made / "resources.json").read_text(encoding="ascii"))["prefix"]
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {f"{prefix}.c", f"{prefix}.h", f"test_{prefix}.c", f"prove_{prefix}.c", f"rounding_{prefix}.g"}


def _exchange(a: Path, b: Path) -> bool:
    """Exchange two folders in one atomic step (Linux renameat2); False where that is not possible."""
    here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    renameat2 = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    return renameat2 is not None and renameat2(here, os.fsencode(a), here, os.fsencode(b), exchange) == 0
