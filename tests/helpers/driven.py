"""Framers driven by a mode estimator on small plants: gains as given, delays that nobody certified."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

import codegen
from codegen.designs import Design
from codegen.observers import DrivenObserver, DrivenTables, ModeTables, Supervision
from codegen.plant.bounded import bounded
from codegen.plant.load import loads
from codegen.selection.trials import certified
from codegen.synthesis.driven_tables import joined
from codegen.synthesis.mode_tables import tables_of

from .small_modes import TEXT

Array = np.ndarray
NO_FEED = TEXT.replace("D  = [[0.1]]\n", "")
#: One parameter measured, one not at all, both of which jump as they like.
LPV = NO_FEED.replace("f = [{", """theta = [{ name = "wear", bounds = [-0.1, 0.1] },
  { name = "dirt", bounds = [0, 0.02], measured = false }]
f = [{""").replace("[[-2, 1], [0, -3]]", '[["-2 - dirt", 1], [0, "-3 - wear"]]').replace(
    "B = [[-2], [2]]", 'B = [[-2], ["2 + wear"]]')
DISCRETE = NO_FEED.replace('kind = "continuous"', 'kind = "discrete"').replace(
    "[[-2, 1], [0, -3]]", "[[0.8, 0.2], [-0.1, 0.6]]").replace(
    "[[-2, 1], [1, -4]]", "[[0.8, 0.2], [0.1, 0.5]]").replace(
    "B = [[1], [1]]", "B = [[0.1], [0.05]]").replace("B = [[-2], [2]]", "B = [[0.1], [0.1]]").replace(
    '[30.25, "shut"], [60.5, "open"]', '[30, "shut"], [60, "open"]')
#: Noise that hides wrong modes for some samples: what they do to the right one matters.
NOISY = ("[-0.001, 0.002]", "[-0.02, 0.03]")
#: Coordinates z = R x in which A - L C >= 0 in both modes; its second column has a negative entry, whatever L is.
TURN = {"R": [[0.65, 1], [-1, -0.05]], "L": [[[0.829], [-0.516]], [[0.659], [-0.384]]]}
TURNED = DISCRETE.replace("f = [{", """theta = [{ name = "dirt", bounds = [0, 0.01], measured = false }]
f = [{""").replace(
    "[[0.8, 0.2], [-0.1, 0.6]]", '[["0.5 + dirt", -0.5], [0.1, 0.95]]').replace(
    "[[0.8, 0.2], [0.1, 0.5]]", "[[0.4, -0.4], [0.2, 0.9]]").replace(
    "B = [[0.1], [0.05]]", "B = [[0.35], [-0.02]]").replace("B = [[0.1], [0.1]]", "B = [[0.25], [0.1]]").replace(
    "[-0.002, 0.004]", "[-0.02, 0.04]")
PLANTS = {"constant": TEXT, "parameters": LPV, "hidden": LPV.replace("B = [[-2]", "B = [[1]").replace(*NOISY),
          "discrete": DISCRETE.replace(*NOISY), "turned": TURNED.replace(NOISY[0], "[-0.05, 0.06]")}
#: Part of the first column of A that L and N take: with N the framers see the newest measurement.
GAINS = {"constant": (0.8, 0.0), "parameters": (0.3, 0.5), "hidden": (0.3, 0.5), "discrete": (0.3, 0.5),
         "turned": (0.0, 0.0)}
AGES = 3
#: The last one with modes that can be told apart, as a user states it.
STATED = TURNED.replace("B = [[0.25], [0.1]]", "B = [[-0.4], [0.3]]").replace("[0.5, 2]", "[1, 2]").replace(
    "1 + 0.5*sin(t)", "1.5 + 0.5*sin(t)").replace("[-0.02, 0.04]", "[-0.002, 0.004]").replace(
    'method = "mode-set"', f'''method = "component-interval"
coordinates = "change"
modes = "set"
gains = {{ R = {TURN["R"]}, L = {TURN["L"]} }}''')


@lru_cache
def turned_design() -> Design:
    """Framers in other coordinates, certified."""
    return codegen.design(loads(STATED))


@lru_cache
def plant(name: str):
    return loads(PLANTS[name])


@lru_cache
def told(name: str, real: str):
    """Tables of framers that are told their mode."""
    p, (from_L, from_N) = plant(name), GAINS[name]
    A = np.array([m.A for m in p.observed.modes])
    N = np.tile([[from_N], [0.0]], (len(A), 1, 1))
    L = from_L * A[:, :, :1]
    gains = {"L_hi": L, "L_lo": L, "N_hi": N, "N_lo": N}
    if name != "discrete":
        measured = [j for j, s in enumerate(p.theta) if s.measured]
        gains |= {"L_theta": np.zeros((len(A), len(measured), 2, 1)), "midpoint": p.reads_both_ends, "late": False,
                  "columns": measured, "split": True}
        if name == "turned":
            gains |= {key: np.array(TURN[key[0]]) for key in ("R", "L_hi", "L_lo")}
    elif np.any(A[0] < 0):  # nonnegative after T A - L C: the second row loses its negative entry to L
        L = L.copy()
        L[:, 1, 0] = np.minimum(A[:, 1, 0], 0)
        gains |= {"L_hi": L, "L_lo": L}
    return certified(p, gains, {"kind": "none"}, real)


@lru_cache
def tables(name: str, real: str) -> DrivenTables:
    return joined(DrivenTables, tables_of(ModeTables, bounded(plant(name)), AGES, real), told(name, real)[0])


def stand_in(name: str, supervision=None, prefix: str = "") -> Design:
    """A design whose delays nobody certified; its constants hold the plant all the same."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    made = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "tnl-interval", DrivenObserver(made, supervision or Supervision()),
                  {real: {"kind": "mode"} for real in made}, {real: ["own words"] for real in made},
                  {real: [] for real in made})
