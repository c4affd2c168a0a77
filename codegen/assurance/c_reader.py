"""The generated C as a syntax tree: comments and directives blanked, so that every line keeps its number."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from pycparser import c_ast, c_parser

from ..errors import CertificateError

Node = c_ast.Node
# What the tree needs to know of the header: which names are types.
TYPES = ("typedef int {p}_real; typedef int {p}_status; typedef int bool; typedef unsigned int uint32_t; "
         "typedef int int32_t; typedef struct {{ int a; }} {p}_in, {p}_out, {p}_state, {p}_law;")


@dataclass(frozen=True)
class Source:
    """A C file read: its functions, and the integer macros of it and its header.

    ``lines`` are the text's, from 0; ``others`` is all that is no function: types.
    """

    name: str
    lines: tuple[str, ...]
    functions: dict[str, c_ast.FuncDef]
    macros: dict[str, int]
    others: tuple[Node, ...] = ()

    def function(self, name: str) -> c_ast.FuncDef:
        """Return a function's definition.

        Raises
        ------
        CertificateError
            There is none.
        """
        if name not in self.functions:
            raise CertificateError(f"{self.name}: no function {name} (expected one). Print the C again.")
        return self.functions[name]


@lru_cache(maxsize=4)  # a C is read beside the same one printed anew, often more than once
def read(prefix: str, text: str, header: str) -> Source:
    """Parse ``<prefix>.c``.

    Parameters
    ----------
    prefix : str
    text, header : str
        Of the ``.c`` and the ``.h``.

    Returns
    -------
    source : Source

    Raises
    ------
    CertificateError
        It is no C.
    """
    name = f"{prefix}.c"
    try:
        tree = c_parser.CParser().parse(TYPES.format(p=prefix) + f'\n# 1 "{name}"\n' + blank(text), name)
    except Exception as error:  # pycparser's own class has moved between its versions
        raise CertificateError(f"{name}: cannot be read as C ({error}). Print it again.") from error
    functions = {n.decl.name: n for n in tree.ext if isinstance(n, c_ast.FuncDef)}
    macros = {m[1]: int(m[2], 0) for m in re.finditer(r"(?m)^#define (\w+) (0x[0-9A-F]+|\d+)U\b", header + "\n" + text)}
    macros |= {m[1]: macros[m[2]] for m in re.finditer(r"(?m)^#define (\w+) (\w+)(?= |$)", text) if m[2] in macros}
    others = tuple(n for n in tree.ext if not isinstance(n, c_ast.FuncDef))
    return Source(name, tuple(text.splitlines()), functions, macros | {"true": 1, "false": 0}, others)


def apart(prefix: str) -> frozenset[str]:
    """Functions that maps call at their end, each of which is read by itself.

    Parameters
    ----------
    prefix : str

    Returns
    -------
    frozenset of str
    """
    return frozenset(f"{prefix}_{name}" for name in ("cut", "cut_x", "cut_z", "to_x", "to_z"))


def blank(text: str) -> str:
    """Replace comments by spaces and directives by empty lines; no line moves."""
    text = re.sub(r"/\*.*?\*/", lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.S)
    return re.sub(r"(?m)^#.*$", "", text)


def walk(node: Node) -> Iterator[Node]:
    """Yield a node and everything below it."""
    yield node
    for _, child in node.children():
        yield from walk(child)
