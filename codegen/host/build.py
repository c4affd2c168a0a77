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
class Vector:
    """An array member of a struct, and how many numbers it has, as C."""

    name: str
    count: str


@dataclass(frozen=True)
class HostView:
    """What the batch glue's template prints; ``inputs`` is the macro of n_u, or nothing without; so ``parameters``.

    ``starts`` are the members of the state that another initial box sets; ``answers`` the numbers of the output struct:
    those that every sample gives, ``always``, then those of a measured one; ``words`` are the words of it that only a
    mode estimator has, ``told`` the mode where it is an input.
    """

    prefix: str
    macro: str
    c_type: str
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    starts: tuple[Vector, ...]
    always: tuple[Vector, ...]
    measured: tuple[Vector, ...]
    words: tuple[str, ...]
    told: tuple[str, ...]

    @property
    def answers(self) -> tuple[Vector, ...]:
        """All of them."""
        return (*self.always, *self.measured)


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
                    (f"{macro}_NTHETA",) if record["n_theta"] else (), vectors(record, "state", START),
                    vectors(record, "out", ALWAYS), vectors(record, "out", MEASURED), own_words(record),
                    tuple(name for name, *_ in record["in"] if name == "mode"))
    ffi = cffi.FFI()
    ffi.cdef(declarations(record))
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        glue, library = Path(scratch) / "run.c", Path(scratch) / f"{prefix}.so"
        glue.write_text(render("harness/run.c.jinja", h=view), encoding="ascii")
        run(["gcc", *FLAGS, f"-I{folder}", str(folder / f"{prefix}.c"), str(glue), "-o", str(library), "-lm"])
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
    structs += _law(record, types)
    step = f"({p}_state *s, const {p}_in *in, {p}_out *out);\n"
    names = {of: " ".join(v.name for v in vectors(record, struct, among))
             for of, struct, among in (("start", "state", START), ("answer", "out", ALWAYS + MEASURED))}
    arrays = (("const " + real, "u y theta"), ("const uint32_t", "q"), ("const " + real, names["start"]),
              (real, names["answer"]), ("unsigned char", "any_alarm"), ("uint32_t", "alarm latched raw"),
              ("unsigned char", "assured"), ("uint32_t", " ".join(own_words(record))), ("int64_t", "status"))
    arguments = ", ".join(f"{kind} *{name}" for kind, names in arrays for name in names.split())
    return (f"{structs}void {p}_init({p}_state *s);\nvoid {p}_reset({p}_state *s);\n"
            f"int {p}_step{step}int {p}_predict{step}"
            f"void residua_run(size_t runs, size_t steps, {arguments});\n")


def _law(record: dict, types: dict) -> str:
    """Declare struct and functions of a tracking law, where there is one; nothing reads its spare word."""
    if "law" not in record:
        return ""
    p, real = record["prefix"], types["real"]
    spare = " uint32_t spare;" * (record["real"] == "float64")
    return (f"typedef struct {{ {real} s[{len(record['law']['limit'])}]; uint32_t limited;{spare} }} {p}_law;\n"
            f"void {p}_law_init({p}_law *law);\n"
            f"int {p}_track({p}_state *s, {p}_law *law, const {real} *ref, {p}_in *in, {p}_out *out);\n"
            f"int {p}_coast({p}_state *s, {p}_law *law, {p}_in *in, {p}_out *out);\n")


def vectors(record: dict, struct: str, among: tuple[str, ...]) -> tuple[Vector, ...]:
    """The members of a struct that are ``among`` some names, in the order of these.

    Parameters
    ----------
    record : dict
        Contents of ``resources.json``.
    struct : {"in", "out", "state"}
    among : tuple of str

    Returns
    -------
    tuple of Vector
    """
    counts = {name: count for name, _, count in record[struct]}
    return tuple(Vector(name, f"{counts[name]}U") for name in among if name in counts)


def own_words(record: dict) -> tuple[str, ...]:
    """Words of the output struct that only a mode estimator has."""
    return tuple(name for name, *_ in record["out"] if name in WORDS)


START = ("x_lo", "x_hi", "z_lo", "z_hi", "x_hat", "shape", "box_lo", "box_hi")
ALWAYS = ("x_hat", "x_lo", "x_hi")
MEASURED = ("r_lo", "r_hi", "r", "r_bound", "f_hat", "f_bound")
WORDS = ("mode", "mode_set", "settled_set", "candidate", "age", "inside", "settled", "isolated", "ready", "raised")
VECTORS = frozenset({*START, *ALWAYS, *MEASURED, "u", "y", "theta", "history", "xi", "alive", "z", "shown_lo",
                     "shown_hi", "frame_lo", "frame_hi", "twist_lo", "twist_hi", "rate_lo", "rate_hi", "level", "a",
                     "left", "told_x_hat", "told_u", "told_y", "told_shape", "told_lo", "told_hi", "told_xi",
                     "told_stage", "told_since"})
