"""Golden vectors of a tracking law: a run of it with its observer on the numpy reference, for the user's self-test.

First references and measurements that grow from a hundredth of their ranges, with samples missing: every gain counts
and hardly anything is cut. Then measurements at the upper ends of their ranges, then at the lower ones, for so long
that inputs and integrals reach both of theirs. As with the observer's own vectors it need not be a run of the plant.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from random import Random

import numpy as np

from ..observers.feedback import Tracker
from .cprint import initialiser, literal

Array = np.ndarray
GROWING, MISSING = 22, (6, 15, 16)
#: Most samples at one end of the ranges.
LONGEST = 24


@dataclass(frozen=True)
class LawVector:
    """One sample, printed: what comes in, 1 for track or 0 for coast, and what the reference answered."""

    ref: str
    y: str
    call: int
    limited: int
    u: str
    s: str
    x_hat: str


@dataclass(frozen=True)
class LawRefusal:
    """A call that must be refused: statements that spoil and mend its input, the status, the error number."""

    breaks: str
    mends: str
    status: str
    code: int


@dataclass(frozen=True)
class GoldenLaw:
    """What the self-test does with a law."""

    vectors: tuple[LawVector, ...]
    refusals: tuple[LawRefusal, ...]


def golden_laws(design, real: str) -> tuple[GoldenLaw, ...]:
    """Run the reference and print what it answers; nothing for a design without a law.

    Parameters
    ----------
    design : Design
    real : {"float32", "float64"}

    Returns
    -------
    laws : tuple of GoldenLaw
    """
    t = design.observer.tables[real]
    law = getattr(t, "law", None)
    if law is None:
        return ()
    unit, vectors = Tracker(copy(design.observer), real), []
    for k, (ref, y) in enumerate(zip(*stimulus(t))):
        measured = k not in MISSING
        command, answer = unit.step(ref[None], (y if measured else np.full_like(y, np.nan))[None])
        vectors.append(LawVector(initialiser(ref, real), initialiser(y, real), int(measured), int(command.limited[0]),
                                 *(initialiser(a[0], real) for a in (command.u, unit.law.s, answer.x_hat))))
    refused = [LawRefusal(f"{name}[{i}] = {_beyond(hi, i, real)};", f"{name}[{i}] = {literal(float(held[i]), real)};",
                          status, code) for name, hi, held, status, code in (
        ("ref", law.reference, ref, "BAD_INPUT", 1005), ("in.y", t.y_hi, y, "BAD_OUTPUT", 1006))
        for i in (len(hi) - 1,)]
    return (GoldenLaw(tuple(vectors), tuple(refused)),)


def stimulus(t) -> tuple[Array, Array]:
    """References (K, k) and measurements (K, p); ``random.Random`` draws the same numbers everywhere.

    Parameters
    ----------
    t : PolytopicTables
        With a law.
    """
    draw, law = Random(2), t.law

    def drawn(lo: Array, hi: Array) -> Array:
        return np.array([a + (b - a) * draw.random() for a, b in zip(lo.astype(float), hi.astype(float))])

    # How long the slowest integral takes from 0 to its limit with its measurement at the nearer end.
    ends = np.minimum(-t.y_lo, t.y_hi)[list(law.rows)].astype(float)
    along = int(np.clip(np.ceil(np.max(law.limit / (law.period * ends))) + 2, 4, LONGEST))
    shares = np.concatenate([np.geomspace(0.01, 0.3, GROWING), np.ones(3 * along)])
    ref, y = [], []
    for k, share in enumerate(shares):
        ref.append(drawn(-law.reference, law.reference))
        end = t.y_lo if k >= GROWING + along else t.y_hi
        y.append(share * drawn(t.y_lo, t.y_hi) if k < GROWING else end.astype(float))
    ref, y = np.array(ref).astype(t.dtype), np.array(y).astype(t.dtype)
    return np.clip(ref, -law.reference, law.reference), np.clip(y, t.y_lo, t.y_hi)


def _beyond(hi: Array, i: int, real: str) -> str:
    """The next number above an end."""
    return literal(float(np.nextafter(hi[i], np.array(np.inf, dtype=hi.dtype))), real)
