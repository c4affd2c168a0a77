"""Stand-ins of mode estimators by sliding modes: small plants, gains found, nothing measured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from codegen.designs import Design
from codegen.observers import SlidingObserver, SlidingTables, Supervision
from codegen.plant.bounded import bounded
from codegen.synthesis.mode_sliding import settings, theorem12
from codegen.synthesis.sliding_tables import tables_of

from . import driven, small_modes

#: What no method may say that sliding modes guide: of the plant file what, what instead, words.
REFUSED = (
    ("known = false", "known = true", "observer.modes says how the mode is found"),
    ("minimum_dwell = 1", "", "cannot be found there: no dwell time is declared"),
    ('modes = "sliding"', 'modes = "sliding"\nages = 3', 'ages is given, which modes = "set" alone'),
    ('modes = "sliding"', 'blank = 0.2', 'blank is given, which modes = "sliding" alone'))


def plant(name: str):
    """One of the small plants, or one with parameters."""
    return driven.plant(name) if name in driven.PLANTS else small_modes.plant(name)


@lru_cache
def tables(name: str, real: str) -> SlidingTables:
    """Tables of one of the small plants."""
    p = bounded(plant(name))
    chosen = settings(p, {})
    found = theorem12([m.A for m in p.modes], p.modes[0].C, chosen["limit"], second=False)
    return tables_of(SlidingTables, p, found, chosen, real)


def stand_in(name: str = "one input", supervision=None, prefix: str = "") -> Design:
    """A design whose certificate has nothing in it."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "mode-sliding", SlidingObserver(made, replace(supervision or Supervision(), assures=False)),
                  {real: {"kind": "sliding"} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})
