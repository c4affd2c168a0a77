"""Framers guided by sliding modes on small plants: gains as given, decisions that nobody measured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from codegen.designs import Design
from codegen.observers import GuidedObserver, GuidedTables, Supervision
from codegen.selection.select import certified
from codegen.synthesis.guided_tables import guided

from .small_sliding import plant
from .small_sliding import tables as estimator

#: Part of A C^+ that L takes, of C^+ that N takes.
GAINS = {"one input": (0.8, 0.0), "no input, two outputs": (0.3, 0.5), "parameters": (0.3, 0.5)}


@lru_cache
def told(name: str, real: str):
    """Tables and certificate of framers that are told their mode."""
    p, (from_L, from_N) = plant(name), GAINS[name]
    A, back = np.array([m.A for m in p.observed.modes]), np.linalg.pinv(p.modes[0].C)
    L, N = from_L * A @ back, np.tile(from_N * back, (len(A), 1, 1))
    measured = [j for j, s in enumerate(p.theta) if s.measured]
    gains = {"L_hi": L, "L_lo": L, "N_hi": N, "N_lo": N, "L_theta": np.zeros((len(A), len(measured), *back.shape)),
             "midpoint": p.reads_both_ends, "late": False, "columns": measured, "split": True}
    return certified(p, gains, {"kind": "none"}, real)


@lru_cache
def tables(name: str, real: str) -> GuidedTables:
    return guided(GuidedTables, estimator(name, real), told(name, real)[0])


def stand_in(name: str = "one input", supervision=None, prefix: str = "") -> Design:
    """A design whose certificate has nothing in it."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "tnl-interval-lpv", GuidedObserver(made, replace(supervision or Supervision(), assures=False)),
                  {real: {"kind": "sliding", "told": {}} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})
