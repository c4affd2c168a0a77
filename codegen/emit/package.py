"""The output folder: all its files from one design, written whole or not at all."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path

from ..errors import EmitError
from ..target import metrics
from . import VERSION, golden
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
    d = build(design, real, layout, VERSION)
    t = design.observer.tables[d.real]
    spare = tuple(f.name for f in d.in_fields if f.name == "spare")
    out = {f"{d.prefix}.h": render("observer.h.jinja", d=d),
           f"{d.prefix}.c": render(f"{d.family}.c.jinja", d=d),
           f"test_{d.prefix}.c": render("harness/test.c.jinja", d=d, vectors=golden.vectors(design, d.real),
                                        refusals=golden.refusals(t, d.macro), spare=spare),
           "CMakeLists.txt": render("package/CMakeLists.txt.jinja", d=d)}
    record = resources(d, design) | {"measured": metrics.measure(out, d.prefix) if measure else {}}
    return out | {"resources.json": json.dumps(record, indent=2) + "\n"}


def resources(d: DesignView, design) -> dict:
    """Return the machine-readable record of the C: how to call it, and what it costs on any target.

    Floats of ``ranges`` are exact: they are the numbers that the input check compares with.
    """
    t, s = design.observer.tables[d.real], design.observer.supervision
    ranges = {name: getattr(t, name).astype(float).tolist()
              for name in ("x_lo", "x_hi", "x0_lo", "x0_hi", "u_lo", "u_hi", "y_lo", "y_hi")}
    return {"generator": f"residua {d.version}", "prefix": d.prefix, "macro": d.macro, "real": d.real,
            "layout": d.layout, "family": d.family, "certificate": design.digest,
            "n_x": len(d.x), "n_u": len(d.u), "n_y": len(d.y), "n_modes": len(d.modes), "n_bits": len(d.bits),
            **{name: _members(d, fields) for name, fields in
               (("in", d.in_fields), ("out", d.out_fields), ("state", d.state_fields))},
            "state_bytes": d.state_bytes,
            "operations_per_step": asdict(d.operations), "supervision": s.to_dict(), "ranges": ranges}


def _members(d: DesignView, fields) -> list[list]:
    """Describe a struct as [name, "real" or "uint32", number of elements]."""
    sizes = {"NX": d.x, "NU": d.u, "NY": d.y, "BITS": d.bits}
    counts = {f"[{d.macro}_{name}]": len(channels) for name, channels in sizes.items()} | {"": 1}
    return [[f.name, "uint32" if f.type == "uint32_t" else "real", counts[f.size]] for f in fields]


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
    if folder.exists() and not (folder / MARK).is_file():
        raise EmitError(f"{folder}: exists and has no {MARK}, so residua did not make it. Choose another folder.")
    texts = files(design, real, layout)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".tmp", dir=folder.parent))
        try:
            for name, text in texts.items():
                (scratch / name).write_text(text, encoding="ascii", newline="\n")
            design.save(scratch / MARK)
            scratch.chmod(0o755)
            _publish(scratch, folder)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    except OSError as error:
        raise EmitError(f"{folder}: {error.strerror or error}. Choose a folder that can be written.") from error
    return folder


def _publish(scratch: Path, folder: Path) -> None:
    """Put ``scratch`` in the place of ``folder``; afterwards ``scratch`` is what may be deleted."""
    if not folder.exists():
        scratch.rename(folder)
        return
    if not _exchange(scratch, folder):  # a moment without folder, on systems that cannot exchange
        aside = scratch.with_suffix(".old")
        folder.rename(aside)
        try:
            scratch.rename(folder)
        except OSError:
            aside.rename(folder)
            raise
        aside.rename(scratch)
    ours = {p.name for p in folder.iterdir()} | {"report.html"}  # a report belongs to the old design
    for foreign in [p for p in scratch.iterdir() if p.name not in ours]:
        foreign.rename(folder / foreign.name)


def _exchange(a: Path, b: Path) -> bool:
    """Exchange two folders in one atomic step (Linux renameat2); False where that is not possible."""
    here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    renameat2 = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    return renameat2 is not None and renameat2(here, os.fsencode(a), here, os.fsencode(b), exchange) == 0
