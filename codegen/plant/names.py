"""Which names a plant file may use: they end up in C identifiers and in C comments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from keyword import iskeyword

from codegen.errors import PlantError
from codegen.plant.expression import FUNCTION_NAMES, SAMPLE_NAMES
from codegen.plant.values import shown

MAX_PREFIX = 24
MAX_NAME = 48

# Of C and C++, and a few macros that embedded compilers add.
_WORDS_OF_C = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t
    char32_t class co_await co_return co_yield compl complex concept const const_cast consteval
    constexpr constinit continue decltype default delete do double dynamic_cast else enum explicit
    export extern false final float for friend goto if imaginary import inline int int8_t int16_t
    int32_t int64_t interrupt long main module mutable namespace new noexcept noreturn not not_eq
    nullptr operator or or_eq override private protected public register reinterpret_cast requires
    restrict return short signed sizeof size_t static static_assert static_cast struct switch template
    this thread_local throw true try typedef typeid typename typeof uint8_t uint16_t uint32_t uint64_t
    union unsigned using virtual void volatile wchar_t while xor xor_eq
"""
_STEM = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_C_WORDS = frozenset(_WORDS_OF_C.split())
_CHANNEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]*")


def check_plant_name(name: str) -> None:
    """Refuse a plant name that makes no file and C names.

    Parameters
    ----------
    name : str
        As in the plant file.

    Raises
    ------
    PlantError
        Not letters, digits, ``_`` and ``-`` after a letter, or too long.
    """
    if not _STEM.fullmatch(name) or len(name) > MAX_NAME:
        raise PlantError(
            f"name: is {shown(name)} (expected a letter, then letters, digits, _ or -, at most {MAX_NAME}). "
            'Rename it, e.g. "cart"; the title may be any text.'
        )


def prefix_of(name: str, prefix: str | None) -> str:
    """Return the C prefix: the one given, or the one made of the plant's name.

    Parameters
    ----------
    name : str
        A plant name that `check_plant_name` accepts.
    prefix : str or None
        ``[target] prefix``.

    Returns
    -------
    prefix : str

    Raises
    ------
    PlantError
        It is no C identifier, is reserved, a C or C++ keyword, or too long.
    """
    found = name.replace("-", "_") if prefix is None else prefix
    advice = "Give [target] prefix another name." if prefix is not None else "Add a [target] prefix."
    if not _IDENTIFIER.fullmatch(found):
        problem = "is no C identifier"
    elif found.startswith("_"):
        problem = "is reserved in C (it starts with an underscore)"
    elif found.lower() in _C_WORDS:
        problem = "is a word of C or C++"
    elif len(found) > MAX_PREFIX:
        problem = f"is too long (found {len(found)} characters, expected at most {MAX_PREFIX})"
    else:
        return found
    raise PlantError(f"target.prefix: {shown(found)} {problem}. {advice}")


def check_channels(place: str, names: Iterable[str]) -> None:
    """Refuse names of signals or modes that make no distinct C names.

    Parameters
    ----------
    place : str
        Where the names stand; messages start with it.
    names : iterable of str
        In the order of the file.

    Raises
    ------
    PlantError
        A name holds other characters than letters, digits, space, ``_``, ``.``, ``-``; or two names give the
        same C name.
    """
    seen: dict[str, str] = {}
    for name in names:
        if not _CHANNEL.fullmatch(name) or len(name) > MAX_NAME:
            raise PlantError(
                f"{place}: the name {shown(name)} makes no C name (expected letters, digits, space, _ . -, "
                f"at most {MAX_NAME} characters). Rename it."
            )
        key = re.sub(r"[ .-]", "_", name).upper()
        if key in seen:
            other = "twice" if seen[key] == name else f"beside {shown(seen[key])}: both become {key} in C"
            raise PlantError(f"{place}: the name {shown(name)} is used {other}. Rename one.")
        seen[key] = name


def check_symbols(constants: Mapping[str, float], thetas: Iterable[str],
                  others: Iterable[tuple[str, str]] = ()) -> None:
    """Refuse constants, thetas and other signals that an expression could not name.

    Parameters
    ----------
    constants : mapping
        Name -> value.
    thetas : iterable of str
        Names of the scheduling parameters.
    others : iterable of (str, str)
        Place and name of whatever else an expression names.

    Raises
    ------
    PlantError
        No identifier, a name with a meaning of its own (k, t, pi, sin ...), or the same name twice.
    """
    seen: set[str] = set()
    for place, name in [*(("constants", c) for c in constants), *(("signals.theta", t) for t in thetas), *others]:
        if not _IDENTIFIER.fullmatch(name) or name.startswith("_") or iskeyword(name):
            raise PlantError(
                f"{place}: the name {shown(name)} cannot stand in an expression (expected a letter, then "
                "letters, digits or _). Rename it."
            )
        if name in SAMPLE_NAMES or name in FUNCTION_NAMES:
            raise PlantError(f'{place}: the name "{name}" has a meaning in expressions. Rename it.')
        if name in seen:
            what = "a constant" if name in constants else "a signal"
            raise PlantError(f'{place}: the name "{name}" is {what} already. Rename one.')
        seen.add(name)


def check_text(place: str, text: str) -> None:
    """Refuse text that would leave the C comment it is printed in.

    Parameters
    ----------
    place : str
        Where the names stand; messages start with it.
    text : str
        A title, source or unit.

    Raises
    ------
    PlantError
        It holds a line break, another control character, a comment mark or a backslash.
    """
    if not text.isprintable() or "*/" in text or "/*" in text or "\\" in text:
        raise PlantError(
            f"{place}: {shown(text)} cannot stand in a C comment (expected one line, no comment marks, no "
            "backslash). Rewrite it."
        )
