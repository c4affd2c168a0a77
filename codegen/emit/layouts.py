"""The layouts: how an affine map (``maps.MapSpec``) becomes C.

    literal   the fewest instructions: straight-line code; rows that would need more operations to serve all modes
              at once (other zeros, ones or signs) are written per mode with their constants, behind a switch;
    table     straight-line code over a row of coefficients that the mode selects: no branch;
    loop      the least flash: loops over matrices, or straight-line code where that is shorter.

All do the additions in the order of ``codegen.observers.framer``, so their results are ``==``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .loops import LoopPrinter
from .maps import Case, MapSpec, MapView, Switch
from .pieces import arguments
from .straight import straight

Array = np.ndarray
LAYOUTS = ("literal", "table", "loop")
#: Floating-point operations that take as long as selecting a mode's code by a switch.
SWITCH = {"float32": 4, "float64": 1}


def lay_out(spec: MapSpec, layout: str) -> MapView:
    """Print the map in the layout "literal", "table" or "loop"."""
    everything = np.arange(len(spec.names.modes))
    rows = np.arange(len(spec.rows))
    if layout == "literal":
        apart = rows_apart(spec, everything, rows)
        if len(apart):
            return _by_mode(spec, everything, rows, apart)
    whole = straight(spec, everything, spec.name, rows)
    if layout == "loop":
        loops = LoopPrinter(spec).loops()
        if loops.flash < 1.05 * whole.flash:  # at -O2 straight-line code grows more
            return MapView(loops=(loops,))
    return MapView(straights=(whole,))


def rows_apart(spec: MapSpec, everything: Array, rows: Array) -> Array:
    """Return the rows that are worth a switch.

    Code that serves all modes multiplies by a coefficient that is 0 or 1 in some of them. Counted per row: its
    operations above the mean of what each mode needs alone.
    """
    def operations(modes, i):
        found = straight(spec, modes, spec.name, [i])
        return found.multiply + found.add

    extra = np.array([operations(everything, i) - np.mean([operations(everything[[q]], i) for q in everything])
                      for i in rows])
    return rows[extra > 0] if extra.sum() > SWITCH[spec.names.real] else rows[:0]


def _by_mode(spec: MapSpec, everything: Array, rows: Array, apart: Array) -> MapView:
    """Print the rows ``apart`` per mode, behind a switch, and the others before it."""
    bodies = [straight(spec, everything[[q]], f"{spec.name}_{q}", apart) for q in everything]
    groups: dict[tuple, list[int]] = {}  # modes with the same code share it
    for q, body in enumerate(bodies):
        groups.setdefault(body.rows, []).append(q)
    given = ", ".join(arguments(spec))
    cases = [Case(tuple(spec.names.mode_macros[q] for q in group), f"{bodies[group[0]].name}({given})")
             for group in groups.values()]
    titles = [" and ".join(f'Mode "{spec.names.modes[q]}"' for q in group) for group in groups.values()]
    straights = [replace(bodies[group[0]], equation=(f"{title}.",)) for title, group in zip(titles, groups.values())]
    first: tuple[str, ...] = ()
    together = np.setdiff1d(rows, apart)
    if len(together):
        body = straight(replace(spec, tail=()), everything, f"{spec.name}_alike", together)
        straights.insert(0, replace(body, equation=("Rows that all modes calculate alike.",)))
        first = (f"{body.name}({given});",)
    # A mode out of range (a state upset in memory) takes the first mode, in the switch as in every table.
    switch = Switch(spec.name, spec.equation, spec.parameters, spec.selector, first, tuple(cases[1:]), cases[0])
    return MapView(straights=tuple(straights), switches=(switch,))
