"""Where every constant of a filter, a mode estimator, framers that it drives or a polytopic observer stands in its C.

The maps of a filter and of driven framers are executed with symbols, as those of framers are (``places``). All the
rest, and a mode estimator whole, is the same text for all numbers: its tables are read number for number, and all that
is no number must be the tree of the C as it is printed anew, as with the sets of point observers (``point_places``).
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ..emit import driven_parts, filter_parts
from ..emit.maps import MapSpec, Names
from ..emit.render import render
from ..emit.varying import Varying
from .c_reader import Source, read
from .point_places import UNPRINTED, read_tables, require_all, same_tree
from .polytopic_places import read_polytopic

#: Fields of the tables that are no constants of the C: coordinates in which the boxes are stated.
OFFLINE = {"S", "S_rounded"}
#: What the maps of a filter hold.
READ_BY_MAPS = {"M", "G", "L", "K", "Du", "Dy"}


def maps(family: str, t, names: Names, d) -> tuple[MapSpec | Varying, ...]:
    """The affine maps that can be executed with symbols, of filters and driven framers."""
    if family == "driven":
        return driven_parts.maps(t.told, names, d.x, d.y)
    return filter_parts.maps(t, names, next(z.faults for z in d.sets)) if family == "filter" else ()


def read_own(source: Source, design, d, t, read_apart: set[str], found) -> None:
    """Read everything of the C but the functions of ``read_apart``, which are read elsewhere.

    Parameters
    ----------
    source : Source
    design : Design
    d : DesignView
        Of the C as it must be.
    t : FilterTables, ModeTables or DrivenTables
    read_apart : set of str
    found : object
        ``add`` takes what is read.

    Raises
    ------
    CertificateError
        A number, a table or anything else differs from the tables or from the C as it is printed.
    """
    same_tree(source, read(d.prefix, render(f"{d.family}.c.jinja", d=d), render(d.header, d=d)))
    if design.observer.family == "polytopic":  # its sums are statements, read one by one
        read_apart |= read_polytopic(source, d.prefix, t, found)
        read_tables(source, d.real, {}, [], read_apart, set(), set(), found)
        return
    every = {f.name: getattr(t, f.name) for f in fields(t)}
    known = {k: v for k, v in every.items() if isinstance(v, np.ndarray) and k not in UNPRINTED | OFFLINE}
    known |= {"frame_limit": t.told.box, "forth": t.S_rounded} if "told" in every else {}  # as the C calls them
    seen = set(READ_BY_MAPS) if design.observer.family == "filter" else set()
    read_tables(source, d.real, known, [m.name for m in design.plant.modes], read_apart, set(), seen, found)
    require_all(source, known, seen)
