"""The text of the libFuzzer harness of a folder, from its record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cprint import initialiser
from .render import render

RANGES = ("u_lo", "u_hi", "y_lo", "y_hi", "theta_lo", "theta_hi")


@dataclass(frozen=True)
class Range:
    """One end of the ranges of a vector (of the parameters: per mode): name and size of the array, its initialiser."""

    name: str
    size: str
    values: str


@dataclass(frozen=True)
class FuzzLaw:
    """Initialisers of a tracking law's largest references and of the limits of its integrals."""

    reference: str
    limit: str


@dataclass(frozen=True)
class FuzzView:
    """What the harness prints; ``inputs`` is the number of inputs, or nothing without; so ``parameters`` and
    ``told``, the mode.

    ``mode`` is the C of the mode that says which bounds parameters have.
    ``bounds`` is x where the answer has its bounds, ``finite`` are its other vectors of numbers; ``spoils`` has one
    entry where a fault spoils what is assured, ``laws`` one where there is a tracking law.
    """

    prefix: str
    macro: str
    ranges: tuple[Range, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    told: tuple[str, ...]
    mode: str
    bounds: tuple[str, ...]
    finite: tuple[str, ...]
    spoils: tuple[str, ...]
    laws: tuple[FuzzLaw, ...]


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
    answers = tuple(name for name, kind, _ in record["out"] if kind == "real")
    ranges = tuple(Range(name, f"[][{macro}_NTHETA]" if name.startswith("theta") else "[]",
                         initialiser(np.array(record["ranges"][name], dtype=real), real))
                   for name in RANGES if record["ranges"].get(name))
    told = tuple(name for name, *_ in record["in"] if name == "mode")
    framed = "x_lo" in answers
    numbers = tuple(name for name, kind, _ in record["out"] if kind == "real")
    return render("harness/fuzz.c.jinja", h=FuzzView(
        record["prefix"], macro, ranges, (f"{macro}_NU",) if record["n_u"] else (),
        (f"{macro}_NTHETA",) if record["n_theta"] else (), told, "in->mode" if told else "0U",
        ("x",) if framed else (), () if framed else numbers, () if record.get("faults") else ("",), _laws(record)))


def _laws(record: dict) -> tuple[FuzzLaw, ...]:
    """The law of a folder, where it has one."""
    return tuple(FuzzLaw(*(initialiser(np.array(law[name], dtype=record["real"]), record["real"])
                           for name in ("reference", "limit"))) for law in [record.get("law")] if law)
