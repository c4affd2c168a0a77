"""Filters guided by sliding modes on small plants: observers as filters, decisions that nobody measured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import codegen
from codegen.analysis import sliding_measure
from codegen.designs import Design
from codegen.observers import GuidedFilterObserver, GuidedFilterTables, Supervision
from codegen.plant.load import loads
from codegen.selection.loose_filters import frozen
from codegen.synthesis.guided_tables import guided

from . import small_sliding
from .small_modes import TEXT

ROWS = 10
#: A plant whose filter is found.
CHOSEN = TEXT.replace('method = "mode-set"', 'method = "hinf-filter"\nmodes = "sliding"\nset_rows = 12')


@lru_cache
def made(name: str, real: str):
    """Tables, and what proves the thresholds; what the measurement is beyond the observer's is the fault."""
    p, own = small_sliding.plant(name), small_sliding.tables(name, real)
    modes, n_f = p.enclosed.modes, p.n_f
    C = modes[0].C
    L = [0.5 * m.A @ np.linalg.pinv(C) for m in modes]
    parts = {"M": [m.A - g @ C for m, g in zip(modes, L)], "L": L,
             "G": [m.B - g @ m.D for m, g in zip(modes, L)], "K": [-C[:n_f]] * p.n_modes,
             "Dy": [np.eye(p.n_y)[:n_f]] * p.n_modes, "Du": [-m.D[:n_f] for m in modes]}
    told, certs = frozen(p, {k: np.array(v).astype(real) for k, v in parts.items()}, own, real, ROWS)
    return guided(GuidedFilterTables, own, told), certs


def tables(name: str, real: str) -> GuidedFilterTables:
    return made(name, real)[0]


def stand_in(name: str, supervision=None, prefix: str = "", share: float = 1.0) -> Design:
    """A design whose certificate has nothing in it; ``share`` of the limits, which nothing accepted reaches else."""
    p = small_sliding.plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    every = {real: tables(name, real) for real in ("float32", "float64")}
    every = {real: replace(t, told=replace(t.told, limit=(share * t.told.limit).astype(real)))
             for real, t in every.items()}
    return Design(p, "hinf-filter", GuidedFilterObserver(every, replace(supervision or Supervision(), assures=False)),
                  {real: {"kind": "sliding", "told": {}} for real in every}, {real: ["own words"] for real in every},
                  {real: [] for real in every})


@lru_cache
def designed() -> Design:
    """The whole way from the plant file on; of what is measured little."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("PERIODS", (1.0,)), ("NOISES", (1.0,)), ("RUNS", 2), ("PACES", (1.0,))):
            patch.setattr(sliding_measure, name, value)
        return codegen.design(loads(CHOSEN))
