"""Numbers, sums, names and comments as C text: the only place that knows the syntax of a C expression.

A number is printed with the fewest digits that read back as the same bits. A sum is printed in the order
in which it is evaluated, products in parentheses, so that C's left-to-right rule gives exactly the
operations of the numpy reference. Nothing that comes from a plant file reaches the C unsanitised.
"""

from __future__ import annotations

import math
import re
import textwrap
import unicodedata
from collections.abc import Iterable

import numpy as np

from ..errors import EmitError

SUFFIX = {"float32": "F", "float64": ""}
C_TYPE = {"float32": "float", "float64": "double"}
REAL_BYTES = {"float32": 4, "float64": 8}
LINE = 108  # columns of generated comments

# Units are often written with these; everything else outside ASCII loses its accent or becomes "?".
_SPELLED = str.maketrans({"°": "deg", "²": "^2", "³": "^3", "µ": "u", "μ": "u", "Ω": "Ohm", "·": "*", "×": "x",
                          "–": "-", "—": "-", "’": "'", "“": '"', "”": '"', "≤": "<=", "≥": ">=", "±": "+-"})

Term = tuple[str, str]  # sign "+" or "-", and what follows it


def literal(value: float, real: str) -> str:
    """Return the shortest C literal that reads back as exactly ``value``.

    Parameters
    ----------
    value : float
        Must be a number of type ``real``: rounding is the certificate's business, not the printer's.
    real : {"float32", "float64"}

    Returns
    -------
    text : str
        ``0.1F``, ``-0.0F``, ``1e-45F``; without suffix for float64.

    Raises
    ------
    EmitError
        NaN or infinite, or not exactly representable in ``real``.
    """
    value = float(value)
    if not math.isfinite(value):
        raise EmitError(f"C literal: {value} has none. Give the signal a finite range in the plant file.")
    if real == "float64":
        return repr(value)
    with np.errstate(over="ignore"):
        single = np.float32(value)
    if float(single) != value:
        raise EmitError(f"C literal: {value!r} is no {real}. Round the table before it is certified.")
    return f"{single!s}F"


def product(coefficient: float, operand: str, real: str) -> list[Term]:
    """Return the term ``coefficient * operand``: none for 0, no multiplication for 1 and -1.

    ``a + (-c) x`` is printed as ``a - c x``; in IEEE 754 arithmetic both are the same number.
    """
    if coefficient == 0.0:
        return []
    size = abs(coefficient)
    text = operand if size == 1.0 else f"({literal(size, real)} * {operand})"
    return [("-" if coefficient < 0 else "+", text)]


def constant(value: float, real: str) -> list[Term]:
    """Return the term of a number alone; none for 0."""
    return [] if value == 0.0 else [("-" if value < 0 else "+", literal(abs(value), real))]


def sum_lines(terms: Iterable[Term], real: str, width: int = 76) -> tuple[str, ...]:
    """Print a sum in evaluation order: one line if it fits, else one term per line.

    Parameters
    ----------
    terms : iterable of Term
    real : {"float32", "float64"}
    width : int
        Longest sum that stays on one line.

    Returns
    -------
    lines : tuple of str
        The empty sum is zero.
    """
    terms = list(terms)
    if not terms:
        return (literal(0.0, real),)
    first = terms[0][1] if terms[0][0] == "+" else f"-{terms[0][1]}"
    lines = [first, *(f"{sign} {text}" for sign, text in terms[1:])]
    whole = " ".join(lines)
    return (whole,) if len(whole) <= width else tuple(lines)


def count_operations(terms: Iterable[Term]) -> tuple[int, int]:
    """Return (multiplications, additions) of a sum; the sign of its first term is free."""
    texts = [text for _, text in terms]
    return sum(text.startswith("(") for text in texts), max(len(texts) - 1, 0)


def initialiser(values: np.ndarray, real: str) -> str:
    """Print an array as a braced initialiser on one line, nested as deep as it has axes."""
    if values.ndim == 0:
        return literal(float(values) + 0.0, real)  # + 0.0: no table needs a negative zero
    return "{ " + ", ".join(initialiser(v, real) for v in values) + " }"


def comment(text: str) -> str:
    """Return user text as one line that is safe inside ``/* */``: ASCII, no comment marks, no trigraphs."""
    text = unicodedata.normalize("NFKD", str(text).translate(_SPELLED))
    text = "".join(c for c in text if not unicodedata.combining(c))
    text = "".join(c if " " <= c <= "~" else " " if c.isspace() else "?" for c in text)
    text = re.sub(r"\?{2,}", "?", text.replace("\\", "/"))
    while "*/" in text or "/*" in text:
        text = text.replace("*/", "* /").replace("/*", "/ *")

    text = re.sub(r"(?<!:)/(?=/)", "/ ", text)  # MISRA 3.1: no // in a comment, except in an address
    return " ".join(text.split())


def paragraph(text: str, first: str = "", rest: str | None = None) -> tuple[str, ...]:
    """Sanitise and wrap user or generated text to comment lines, ``first`` and ``rest`` being indents."""
    rest = " " * len(first) if rest is None else rest
    return tuple(textwrap.wrap(comment(text), LINE - 3, initial_indent=first, subsequent_indent=rest,
                               break_long_words=False, break_on_hyphens=False)) or (first.rstrip(),)


def macro_names(names: Iterable[str], reserved: Iterable[str] = ()) -> tuple[str, ...]:
    """Return one macro stem per name: upper case, C characters only, unique.

    Parameters
    ----------
    names : iterable of str
        From the plant file.
    reserved : iterable of str
        Stems already taken.

    Returns
    -------
    stems : tuple of str
    """
    taken, stems = set(reserved), []
    for name in names:
        stem = re.sub(r"[^A-Z0-9]+", "_", comment(name).upper()).strip("_") or "UNNAMED"
        candidate, count = stem, 2
        while candidate in taken:
            candidate, count = f"{stem}_{count}", count + 1
        taken.add(candidate)
        stems.append(candidate)
    return tuple(stems)


def check_prefix(prefix: str) -> str:
    """Return ``prefix`` if it can start every C name and name the files.

    Raises
    ------
    EmitError
        No C identifier, begins with an underscore (reserved), or too long for the names made of it to
        differ within the 31 characters that C99 guarantees.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,27}", prefix, re.ASCII):
        raise EmitError(f"target.prefix: {prefix!r} cannot start C names (expected a letter, then at most 27 "
                        "letters, digits or underscores). Set [target] prefix in the plant file.")
    return prefix
