"""The text of the libFuzzer harness of a folder, from its record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .render import render

RANGES = ("u_lo", "u_hi", "y_lo", "y_hi")


@dataclass(frozen=True)
class Range:
    """One end of the ranges of a vector: the name of the array and its initialiser."""

    name: str
    values: str


@dataclass(frozen=True)
class FuzzView:
    """What the harness prints; ``inputs`` is the number of inputs, or nothing if there are none."""

    prefix: str
    macro: str
    ranges: tuple[Range, ...]
    inputs: tuple[str, ...]


def fuzz_harness(record: dict) -> str:
    """Print the harness.

    Parameters
    ----------
    record : dict
        The folder's resources.json.

    Returns
    -------
    text : str
        C, for clang's libFuzzer.

    Raises
    ------
    EmitError
        The template is damaged.
    """
    macro, real = record["macro"], record["real"]
    ranges = tuple(Range(name, initialiser(np.array(record["ranges"][name], dtype=real), real))
                   for name in RANGES if record["ranges"][name])
    return render("harness/fuzz.c.jinja", h=FuzzView(record["prefix"], macro, ranges,
                                                     (f"{macro}_NU",) if record["n_u"] else ()))
