"""Filters beside a mode estimator on small plants: observers as filters, delays that nobody certified."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from codegen.designs import Design
from codegen.observers import ModeTables, Supervision, TrailingObserver, TrailingTables
from codegen.plant.bounded import bounded
from codegen.plant.load import load, loads
from codegen.selection.loose_filters import frozen
from codegen.synthesis.mode_tables import tables_of

from .driven import DISCRETE, NOISY
from .follower import WIDE
from .small_modes import TEXT


def replaced(text: str, *changes: tuple[str, str]) -> str:
    """A text with other words, each of which it has."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


#: The gallery plant with both states measured, the fault on one of them, and modes that take longer to tell apart.
PUSHED = replaced(
    load("pushed").text, ("Dv = [[1]]\nDf = [[1]]", "Dv = [[1, 0], [0, 1]]\nDf = [[1], [0]]"), (
        'y = [{ name = "a", range = [-5, 5] }]',
        'y = [{ name = "a", range = [-5, 5] }, { name = "b", range = [-5, 5] }]'), (
        'v = [{ name = "noise", bounds = [-0.01, 0.01] }]',
        'v = [{ name = "n1", bounds = [-0.01, 0.01] }, { name = "n2", bounds = [-0.01, 0.01] }]'), (
        "C  = [[1, 0]]", "C  = [[1, 0], [0, 1]]"),
    ("A = [[0.6, 0.1], [0, 0.5]]\nB = [[0.5], [0.2]]", "A = [[0.7, 0.1], [0, 0.6]]\nB = [[0.3], [0.2]]"),
    ("A = [[0.5, -0.1], [0.1, 0.6]]\nB = [[-0.5], [-0.2]]", "A = [[0.6, 0], [0.2, 0.7]]\nB = [[-0.3], [0.1]]"))
PLANTS = {"input": DISCRETE.replace(*NOISY), "no input": WIDE.replace(
    "[initial]", 'f = [{ name = "sensor", range = [-1, 1] }, { name = "pipe", range = [-1, 1] }]\n[initial]').replace(
    "Dv = ", "Df = [[1, 0], [0, 1]]\nDv = "), "parameter": DISCRETE.replace(*NOISY).replace(
    "f = [{", 'theta = [{ name = "wear", bounds = [-0.02, 0.03], measured = false }]\nf = [{').replace(
    "[[0.8, 0.2], [0.1, 0.5]]", '[["0.8 + wear", 0.2], [0.1, 0.5]]'), "pushed": PUSHED}
PLANTS["between"] = TEXT.replace(*NOISY)  # a continuous one: switches at any instant
AGES, ROWS = 3, 10


@lru_cache
def plant(name: str):
    return loads(PLANTS[name])


@lru_cache
def made(name: str, real: str):
    """Tables, and what proves the thresholds; what the measurement is beyond the observer's is the fault."""
    p = plant(name)
    mode = tables_of(ModeTables, bounded(p), AGES, real)
    C, n_f, modes = p.modes[0].C, p.n_f, p.enclosed.modes
    L = [0.5 * m.A @ np.linalg.pinv(C) * (np.arange(p.n_y) >= (name == "pushed")) for m in modes]
    parts = {"M": [m.A - g @ C for m, g in zip(modes, L)], "L": L,
             "G": [m.B - g @ m.D for m, g in zip(modes, L)], "K": [-C[:n_f]] * p.n_modes,
             "Dy": [np.eye(p.n_y)[:n_f]] * p.n_modes, "Du": [-m.D[:n_f] for m in modes]}
    own, certs = frozen(p, {k: np.array(v).astype(real) for k, v in parts.items()}, mode, real, ROWS)
    return TrailingTables(**vars(mode), told=own), certs


def tables(name: str, real: str) -> TrailingTables:
    return made(name, real)[0]


def stand_in(name: str, supervision=None, prefix: str = "") -> Design:
    """A design whose delays nobody certified; its constants hold the plant all the same."""
    p = plant(name)
    p = replace(p, target=replace(p.target, prefix=prefix or p.target.prefix))
    every = {real: tables(name, real) for real in ("float32", "float64")}
    return Design(p, "hinf-filter", TrailingObserver(every, supervision or Supervision()),
                  {real: {"kind": "mode"} for real in every}, {real: ["own words"] for real in every},
                  {real: [] for real in every})
