"""Zammali (2020), section 5.6: the plant, the printed gains (tests/data/zammali_section_5_6.toml), the LMI."""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

from codegen.plant.load import load
from codegen.selection.select import choose
from codegen.synthesis.linf import LinfProblem
from codegen.synthesis.problem import Problem

PLANT = load("zammali_fd")
PRINTED = tomllib.loads((Path(__file__).parents[1] / "data" / "zammali_section_5_6.toml").read_text())
PRINTED = {name: {k: np.array(v) for k, v in d.items()} for name, d in PRINTED.items()}
A, C = np.stack([m.A for m in PLANT.modes]), PLANT.modes[0].C
SIDES, TNL = ("hi", "lo"), ("th16", "th18")


def method(name):
    return "tnl-interval" if name in TNL else "interval"


def per_mode(P):
    return np.broadcast_to(P, (3, 3))


def closed_loop(name, side):
    """L, N, M = T A - L C of a printed design, T := I - N C."""
    d = PRINTED[name]
    L, N = d["L_" + side], d.get("N_" + side, np.zeros((3, 3, 2)))
    return L, N, (np.eye(3) - N @ C) @ A - L @ C


def printed_design(name, **options):
    """The printed gains through the front door: ``[observer] gains``."""
    gains = {k: v.tolist() for k, v in PRINTED[name].items() if k[0] in "LN"}
    if "lambda" in options:
        gains |= {"P_" + s: per_mode(PRINTED[name]["P_" + s]).tolist() for s in SIDES}
    return choose(PLANT, method(name), {"gains": gains, **options}, lambda text: None)


@cache
def lmi(tnl, multiple=False):
    """The LMI of ``synthesis.linf``, built once."""
    return LinfProblem(Problem.of(PLANT, tnl), multiple)
