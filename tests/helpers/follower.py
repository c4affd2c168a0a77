"""Point observers that follow a mode estimator on small plants: gains as given, delays that nobody certified."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from codegen.designs import Design
from codegen.observers import FollowerObserver, FollowerTables, ModeTables, Supervision
from codegen.plant.load import loads
from codegen.selection.points import certified, choice_of
from codegen.synthesis.follower_tables import following
from codegen.synthesis.mode_tables import tables_of

from .driven import DISCRETE, NOISY
from .small_modes import THREE

#: Two outputs, no input, three modes.
WIDE = THREE.replace('kind = "continuous"', 'kind = "discrete"').replace(
    "[[-2, 1, 0], [0, -3, 0], [0, 1, -1]]", "[[0.8, 0.2, 0], [0, 0.6, 0], [0, 0.2, 0.7]]").replace(
    "[[-1, 0, 0.5], [1, -4, 0], [0, 0, -2]]", "[[0.7, -0.1, 0.1], [0.3, 0.4, 0], [0, 0, 0.5]]").replace(
    "[[-0.5, -1, 0], [0, -1, 0.2], [0.1, 0, -3]]", "[[0.9, -0.3, 0], [0, 0.7, 0.1], [0.1, 0, 0.3]]")
PLANTS = {"hidden": DISCRETE.replace(*NOISY), "wide": WIDE, "between": THREE}
#: Plant, options of the set and whether there is a gain N, by name.
CASES = {"zonotope": ("wide", {}, True), "box": ("hidden", {"set": "interval"}, True),
         "ellipsoid": ("wide", {"set": "ellipsoid"}, False),
         "table": ("wide", {"tables": "dwell", "rows": 8}, True),
         "trace": ("hidden", {"set": "ellipsoid", "weights": "trace"}, False),
         "between": ("between", {}, True)}  # switches at any instant
AGES = 3


@lru_cache
def plant(name: str):
    return loads(PLANTS[CASES[name][0]])


@lru_cache
def gains(name: str) -> dict:
    """Gains as given, and the size of the set."""
    p, (_, options, tnl) = plant(name).enclosed, CASES[name]
    A, C = np.array([m.A for m in p.modes]), p.modes[0].C
    back = np.linalg.pinv(C)
    made = {"L": (0.3 if tnl else 0.6) * A @ back, "N": np.tile((0.5 if tnl else 0.0) * back, (len(A), 1, 1)),
             "kind": "tnl" if tnl else "luenberger"}
    return made | choice_of(options, "zonotope")(p, made, options, AGES + 1)


@lru_cache
def told(name: str, real: str):
    """Tables and certificate of an observer that is told its mode."""
    return certified(plant(name).enclosed, gains(name), {"kind": "none"}, real)


@lru_cache
def tables(name: str, real: str) -> FollowerTables:
    own, cert = told(name, real)
    return following(FollowerTables, tables_of(ModeTables, plant(name), AGES, real), own, cert["set"])


def stand_in(name: str, supervision=None, prefix: str = "") -> Design:
    """A design whose delays nobody certified; its constants hold the plant all the same."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "zonotope", FollowerObserver(made, supervision or Supervision()),
                  {real: {"kind": "mode"} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})
