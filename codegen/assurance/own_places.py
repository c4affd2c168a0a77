"""Where every constant stands in the C of filters, mode estimators and what they drive, polytopic observers and banks.

The maps of a filter, of driven framers and of a point observer that follows are executed with symbols, as those of
framers are (``places``); sums of polytopic observers and of banks are read one by one. All the rest, and mode
estimators whole, is the same text for all numbers: its tables are read number for number, and all that is no number
must be the tree of the C as it is printed anew, as with the sets of point observers (``point_places``). Directives of
the preprocessor are no part of the tree: they are compared line by line, and numbers that they define are read.
"""

from __future__ import annotations

import re
from dataclasses import fields
from fractions import Fraction

import numpy as np

from ..emit import driven_parts, filter_parts, follower_parts, guided_parts, point_parts, trailing_parts
from ..emit.maps import MapSpec, Names
from ..emit.render import render
from ..emit.varying import Varying
from ..errors import CertificateError
from .bank_places import read_bank, tables_of
from .c_reader import Source, read
from .follower_places import joint_of, read_told
from .point_places import UNPRINTED, read_tables, require_all, same_tree
from .polytopic_places import read_polytopic
from .symbolic import Coefficient, number

#: Fields of the tables that are no constants of the C: coordinates in which the boxes are stated.
OFFLINE = {"S", "S_rounded"}
#: What the maps of a filter hold.
READ_BY_MAPS = {"M", "G", "L", "K", "Du", "Dy"}
#: What starts, thresholds and limits of filters beside a mode estimator are made of.
OF_A_START = ("E", "sizes", "h", "limit", "grow", "floor")

#: Boxes that the C of a family holds as they are in the tables.
PRINTED = dict.fromkeys(("sliding", "guided", "guided_point", "guided_filter"), {"x_lo", "x_hi", "x0_lo", "x0_hi"})
#: A real number that is defined in the C: name and value.
DEFINED = r"#define (\w+) ((?=[\d.]*[.e])\d[\d.]*(?:e[+-]?\d+)?F?)(?=\s|$)"


def maps(family: str, t, names: Names, d) -> tuple[MapSpec | Varying, ...]:
    """The affine maps that can be executed with symbols, of filters and of what is driven, guided or follows."""
    if family in ("follower", "guided_point"):
        return point_parts.maps(t.told, follower_parts.inner_names(names), d.x, d.y)
    if family == "guided":
        return guided_parts.maps(t.told, guided_parts.inner_names(names), d.x, d.y)
    if family == "driven":
        return driven_parts.maps(t.told, names, d.x, d.y)
    if family in ("trailing", "guided_filter"):
        return trailing_parts.maps(t.told, names, next(z.faults for z in d.sets))
    return filter_parts.maps(t, names, next(z.faults for z in d.sets)) if family == "filter" else ()


def read_own(source: Source, design, d, t, read_apart: set[str], found) -> None:
    """Read everything of the C but the functions of ``read_apart``, which are read elsewhere.

    Parameters
    ----------
    source : Source
    design : Design
    d : DesignView
        Of the C as it must be.
    t : object
        Tables of the family.
    read_apart : set of str
    found : object
        ``add`` takes what is read.

    Raises
    ------
    CertificateError
        A number, a table or anything else differs from the tables or from the C as it is printed.
    """
    fresh = read(d.prefix, render(f"{d.family}.c.jinja", d=d), render(d.header, d=d))
    same_tree(source, fresh)
    same_directives(source, fresh)
    if design.observer.family in ("polytopic", "descriptor"):  # its sums are statements, read one by one
        read_apart |= read_polytopic(source, d.prefix, t, found)
        read_tables(source, d.real, {}, [], read_apart, set(), set(), found)
        return
    if design.observer.family == "bank":
        read_apart, known = read_apart | read_bank(source, d.prefix, t, found), tables_of(t)
        read_tables(source, d.real, known, [], read_apart, set(), seen := set(), found)
        require_all(source, known, seen)
        return
    every, boxes = {f.name: getattr(t, f.name) for f in fields(t)}, PRINTED.get(design.observer.family, set())
    known = {k: v for k, v in every.items() if isinstance(v, np.ndarray) and k not in (UNPRINTED - boxes) | OFFLINE}
    if design.observer.family == "follower":
        read_apart, known = read_apart | read_told(source, design, d, t, read_apart, found), known | joint_of(t)
        known = {k: v for k, v in known.items() if k != "square" or t.by_squares}
    elif design.observer.family == "guided_point":
        read_apart = read_apart | read_told(source, design, d, t, read_apart, found)
        known = known | ({"widest": t.widest} if t.by_table else {})
    elif design.observer.family == "driven":
        known |= {"frame_limit": t.told.box, "forth": t.S_rounded}  # as the C calls them
    elif design.observer.family == "guided_filter":
        known |= {"begun": t.begun, "told_h": t.told.h, "told_limit": t.told.limit}
    elif design.observer.family == "trailing":
        known |= {"x_lo": t.x_lo, "x_hi": t.x_hi} | {f"told_{name}": getattr(t.told, name) for name in OF_A_START}
    seen = set(READ_BY_MAPS) if design.observer.family == "filter" else set()
    defined = read_macros(source, d.macro, d.real, known, found)
    seen |= defined
    here = {k: v for k, v in known.items() if k not in defined}
    read_tables(source, d.real, here, [m.name for m in design.plant.modes], read_apart, set(), seen, found)
    require_all(source, known, seen)


def same_directives(source: Source, fresh: Source) -> None:
    """Compare what the preprocessor is told, comments apart.

    Raises
    ------
    CertificateError
        Naming the first line that differs.
    """
    given, expected = ([(n, re.sub(r"\s*/\*.*", "", line)) for n, line in enumerate(s.lines, 1) if "#" in line
                        and line.lstrip().startswith("#")] for s in (source, fresh))
    other = next((n for (n, a), (_, b) in zip(given, expected) if a != b), None)
    if other or len(given) != len(expected):
        raise CertificateError(f"{source.name}:{other or len(source.lines)}: what the preprocessor is told is not what "
                               "residua prints of this design. Print it again.")


def read_macros(source: Source, macro: str, real: str, known: dict, found) -> set[str]:
    """Read the real numbers that are defined, each the constant of its name; return these names.

    Raises
    ------
    CertificateError
        A number of another name, or another number.
    """
    names = set()
    for line, text in enumerate(source.lines, 1):
        defined = re.match(DEFINED, text)
        if defined is None:
            continue
        name = defined[1].removeprefix(f"{macro}_").lower()
        if name not in known:
            raise CertificateError(f"{source.name}:{line}: {defined[1]} is no number of the tables (expected none). "
                                   "Print it again.")
        c = Coefficient(Fraction(number(defined[2], real)), defined[2], line)
        found.add(name, "", defined[1], (), known[name], c)
        names.add(name)
    return names
