"""Compile a generated folder into a shared library and hand it to cffi.

cffi's ABI mode is used: it needs gcc but no Python headers. The declarations come from the sizes in
``resources.json``; no C is parsed.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cffi

from ..emit.cprint import C_TYPE
from ..emit.render import render
from ..errors import ToolError
from ..target.metrics import run
from .drive import Driver

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")


@dataclass(frozen=True)
class HostView:
    """What the batch glue's template prints; ``inputs`` is the macro of n_u, or nothing without; so ``parameters``.

    ``boxes`` are the vectors of which the state holds bounds.
    """

    prefix: str
    macro: str
    c_type: str
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    boxes: tuple[str, ...]


def build(folder: str | Path) -> Driver:
    """Compile the C of a folder that ``generate`` wrote.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    driver : Driver

    Raises
    ------
    ToolError
        The folder is not one of residua's, or gcc is missing or refuses the C.
    """
    folder = Path(folder).resolve()
    try:
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        prefix, macro, c_type = record["prefix"], record["macro"], C_TYPE[record["real"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ToolError(f"{folder / 'resources.json'}: cannot be read ({type(error).__name__}: {error}). "
                        "Make the folder with residua generate.") from error
    view = HostView(prefix, macro, c_type, (f"{macro}_NU",) if record["n_u"] else (),
                    (f"{macro}_NTHETA",) if record["n_theta"] else (),
                    boxes(record))
    ffi = cffi.FFI()
    ffi.cdef(declarations(record))
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        glue, library = Path(scratch) / "run.c", Path(scratch) / f"{prefix}.so"
        glue.write_text(render("harness/run.c.jinja", h=view), encoding="ascii")
        run(["gcc", *FLAGS, f"-I{folder}", str(folder / f"{prefix}.c"), str(glue), "-o", str(library)])
        # Once it is loaded the file is not needed: the system keeps it until the driver is gone.
        return Driver(folder, record, ffi, ffi.dlopen(str(library)))


def declarations(record: dict) -> str:
    """Return the C declarations of the structs, the four calls and the batch glue, from the record's sizes.

    Parameters
    ----------
    record : dict
        Contents of ``resources.json``.

    Returns
    -------
    cdef : str
    """
    p, real = record["prefix"], C_TYPE[record["real"]]
    types = {"real": real, "uint32": "uint32_t"}
    structs = ""
    for struct in ("in", "out", "state"):
        # Scalars are C scalars; vectors are arrays even with one element, as in the header.
        members = "".join(f" {types[kind]} {name}{f'[{count}]' if name in VECTORS else ''};"
                          for name, kind, count in record[struct])
        structs += f"typedef struct {{{members} }} {p}_{struct};\n"
    step = f"({p}_state *s, const {p}_in *in, {p}_out *out);\n"
    first = " ".join(f"{x}0_lo {x}0_hi" for x in boxes(record))
    arrays = (("const " + real, "u y theta"), ("const uint32_t", "q"), ("const " + real, first),
              (real, "x_lo x_hi r_lo r_hi"), ("unsigned char", "any_alarm"), ("uint32_t", "alarm latched raw"),
              ("unsigned char", "assured"), ("int64_t", "status"))
    arguments = ", ".join(f"{kind} *{name}" for kind, names in arrays for name in names.split())
    return (f"{structs}void {p}_init({p}_state *s);\nvoid {p}_reset({p}_state *s);\n"
            f"int {p}_step{step}int {p}_predict{step}"
            f"void residua_run(size_t runs, size_t steps, {arguments});\n")


def boxes(record: dict) -> tuple[str, ...]:
    """Name the vectors of which the state holds bounds.

    Parameters
    ----------
    record : dict
        Contents of ``resources.json``.

    Returns
    -------
    tuple of str
    """
    return ("x", "z") if "change" in record else ("x",)


VECTORS = frozenset({"x_lo", "x_hi", "z_lo", "z_hi", "r_lo", "r_hi", "u", "y", "theta", "history"})
