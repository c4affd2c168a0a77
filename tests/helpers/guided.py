"""Framers guided by sliding modes on small plants: gains as given, decisions that nobody measured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from codegen.designs import Design
from codegen.observers import GuidedObserver, GuidedTables, Supervision
from codegen.selection.trials import certified
from codegen.synthesis.guided_tables import guided

from . import small_sliding

#: Part of A C^+ that L takes, of C^+ that N takes.
GAINS = {"one input": (0.8, 0.0), "no input, two outputs": (0.3, 0.5), "parameters": (0.3, 0.5),
         "turned": (0.0, 0.0)}
#: Of the first plant in other coordinates.
TURN = {"R": [[1.6, -0.1], [-0.2, 1.5]], "L": [[[0.742], [0.0913]], [[0.767], [0.132]]]}


def plant(name: str):
    """The small plant of that name; in other coordinates it is the first one."""
    return small_sliding.plant("one input" if name == "turned" else name)


@lru_cache
def told(name: str, real: str):
    """Tables and certificate of framers that are told their mode."""
    p, (from_L, from_N) = plant(name), GAINS[name]
    A, back = np.array([m.A for m in p.observed.modes]), np.linalg.pinv(p.modes[0].C)
    L, N = from_L * A @ back, np.tile(from_N * back, (len(A), 1, 1))
    measured = [j for j, s in enumerate(p.theta) if s.measured]
    gains = {"L_hi": L, "L_lo": L, "N_hi": N, "N_lo": N, "L_theta": np.zeros((len(A), len(measured), *back.shape)),
             "midpoint": p.reads_both_ends, "late": False, "columns": measured, "split": True}
    if name == "turned":
        gains |= {key: np.array(TURN[key[0]]) for key in ("R", "L_hi", "L_lo")}
    return certified(p, gains, {"kind": "none"}, real)


@lru_cache
def tables(name: str, real: str) -> GuidedTables:
    own = small_sliding.tables("one input" if name == "turned" else name, real)
    return guided(GuidedTables, own, told(name, real)[0])


def stand_in(name: str = "one input", supervision=None, prefix: str = "") -> Design:
    """A design whose certificate has nothing in it."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "tnl-interval-lpv", GuidedObserver(made, replace(supervision or Supervision(), assures=False)),
                  {real: {"kind": "sliding", "told": {}} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})
