"""Point observers guided by sliding modes on small plants: gains as given, decisions that nobody measured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import codegen
from codegen.analysis import sliding_measure
from codegen.designs import Design
from codegen.observers import GuidedPointObserver, GuidedPointTables, Supervision
from codegen.plant.load import loads
from codegen.selection.points import certified, choice_of
from codegen.synthesis.guided_tables import guided

from . import small_sliding
from .small_modes import TEXT

#: A plant whose observer is chosen, with gains as given.
CHOSEN = TEXT.replace('method = "mode-set"', 'method = "zonotope"\nmodes = "sliding"\nset = "interval"\ngains = { '
                                             "L = [[[0.7], [0]], [[0.7], [0]]] }")

#: Plant, options of the set, parts of A C^+ that L takes and of C^+ that N takes, by name.
CASES = {"zonotope": ("no input, two outputs", {"order": 6}, (0.3, 0.5)),
         "box": ("one input", {"set": "interval"}, (0.8, 0.0)),
         "ellipsoid": ("no input, two outputs", {"set": "ellipsoid"}, (0.6, 0.0)),
         "trace": ("one input", {"set": "ellipsoid", "weights": "trace"}, (0.8, 0.0)),
         "table": ("no input, two outputs", {"tables": "dwell", "rows": 4}, (0.3, 0.5)),
         "parameters": ("parameters", {"set": "interval"}, (0.3, 0.0))}


def plant(name: str):
    """The small plant of that case."""
    return small_sliding.plant(CASES[name][0])


@lru_cache
def told(name: str, real: str):
    """Tables and certificate of an observer that is told its mode."""
    p, (_, options, (from_L, from_N)) = plant(name).enclosed, CASES[name]
    A, back = np.array([m.A for m in p.modes]), np.linalg.pinv(p.modes[0].C)
    gains = {"L": from_L * A @ back, "N": np.tile(from_N * back, (len(A), 1, 1)), "kind": "tnl" if from_N else
             "luenberger"}
    gains |= choice_of(options, "zonotope")(p, gains, options, 8)
    return certified(p, gains, {"kind": "none"}, real)


@lru_cache
def tables(name: str, real: str) -> GuidedPointTables:
    own, cert = told(name, real)
    return guided(GuidedPointTables, small_sliding.tables(CASES[name][0], real), own, set=cert["set"])


def stand_in(name: str, real: str, supervision=None) -> Design:
    """A design of one number type whose certificate has nothing in it."""
    p, made = plant(name), {real: tables(name, real)}
    p = replace(p, target=replace(p.target, real=real))
    return Design(p, "zonotope", GuidedPointObserver(made, replace(supervision or Supervision(), assures=False)),
                  {real: {"kind": "sliding", "told": {}} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})


@lru_cache
def designed(which: str = 'set = "interval"') -> Design:
    """The whole way from the plant file on, for options of the set; of what is measured little."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("PERIODS", (1.0,)), ("NOISES", (1.0,)), ("RUNS", 2), ("PACES", (1.0, 2.0))):
            patch.setattr(sliding_measure, name, value)
        return codegen.design(loads(CHOSEN.replace('set = "interval"', which)))
