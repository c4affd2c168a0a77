"""What the Frama-C harness prints: any state of the box, any input, any refusal, as C text.

The box is the one behind the rounding margins (``tables.box``); everything else of the state is within what
the supervisor's settings allow. That no state beyond it ever arises is what Eva proves with the harness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import set_ranges
from .cprint import initialiser, literal
from .view import DesignView

Array = np.ndarray
INTERVAL = {"float32": "Frama_C_float_interval", "float64": "Frama_C_double_interval"}
WIDE = 10.0  # so many times beyond their ranges inputs and measurements go


@dataclass(frozen=True)
class Number:
    """A number of the input struct: its member, the values that it is given, a comment."""

    place: str
    least: str
    most: str
    note: str = ""


@dataclass(frozen=True)
class Parted:
    """A word of the state that is given one value after the other, and how many it has."""

    name: str
    count: str


@dataclass(frozen=True)
class LawHarness:
    """A tracking law beside the observer: its integrals within their limits; references, beyond their ranges too."""

    integrals: tuple[Number, ...]
    wide: tuple[Number, ...]
    good: tuple[Number, ...]
    beyond: tuple[Number, ...]


@dataclass(frozen=True)
class HarnessView:
    """Everything that ``prove_<prefix>.c`` has and the observer's own view has not.

    ``least`` and ``most`` are initialisers of the state struct, one per member; ``numbers`` and ``words`` are
    its elements by type. ``given`` are numbers of an error set, which start between their ends but are not shown to
    stay there (``set_ranges``); ``about`` are the lines of the comment that says what does. ``told`` is the member of
    the input that is the mode, where it has one. ``by_predict`` is zero where predict refuses anything, else nothing.
    ``laws`` is a tracking law, where there is one.
    """

    interval: str
    least: tuple[str, ...]
    most: tuple[str, ...]
    numbers: tuple[str, ...]
    words: tuple[str, ...]
    given: tuple[str, ...]
    about: tuple[str, ...]
    parted: tuple[Parted, ...]
    answers: tuple[str, ...]
    wide: tuple[Number, ...]
    good: tuple[Number, ...]
    beyond_u: tuple[Number, ...]
    beyond_y: tuple[Number, ...]
    beyond_theta: tuple[Number, ...]
    told: tuple[str, ...]
    by_predict: tuple[str, ...]
    laws: tuple[LawHarness, ...] = ()


def harness(design, d: DesignView) -> HarnessView:
    """Decide everything about the Frama-C harness of a design.

    Parameters
    ----------
    design : Design
    d : DesignView

    Returns
    -------
    view : HarnessView
    """
    t, s = design.observer.tables[d.real], design.observer.supervision
    vectors = (("u", t.u_lo, t.u_hi), ("y", t.y_lo, t.y_hi))
    if d.theta:
        vectors = (*vectors, ("theta", t.vary.theta_lo.min(axis=0), t.vary.theta_hi.max(axis=0)))
    # Zero is what init and reset store as u and y, until the first sample.
    numbers = {"x_lo": (-t.box, t.box), "x_hi": (-t.box, t.box),
               **{name: (np.minimum(lo, 0), np.maximum(hi, 0)) for name, lo, hi in vectors}}
    if t.change is not None:
        numbers |= {"z_lo": (-t.change.box, t.change.box), "z_hi": (-t.change.box, t.change.box)}
    words = {"mode": len(d.modes), "phase": 2, "bucket": s.dwell_limit, "too_fast": 1, "run": max(s.recover, 1) - 1,
             "hold": s.hold, "history": 2 ** s.debounce[1] - 1, "latched": 2 ** len(d.bits) - 1, "spare": 0}
    own = set_ranges.NONE
    if d.sets:
        numbers["x_hat"] = (-t.box, t.box)
        own = set_ranges.of(design.observer.family, t, {f.name: f.type for f in d.state_fields
                                                        if f.name not in numbers and f.name not in words})
        numbers, words = numbers | own.kept | own.numbers, words | own.words
    counts = _counts(d)
    least = tuple(initialiser(numbers[f.name][0], d.real) if f.name in numbers else _words(0, counts.get(f.size))
                  for f in d.state_fields)
    most = tuple(initialiser(numbers[f.name][1], d.real) if f.name in numbers else
                 _words(words[f.name], counts.get(f.size)) for f in d.state_fields)
    apart = [f.name for f in d.state_fields if f.name in ("mode", "phase") and not (d.sets and f.name == "mode")]
    return HarnessView(
        interval=INTERVAL[d.real], least=least, most=most,
        numbers=_places(d, [f for f in d.state_fields if f.name in numbers and f.name not in own.numbers]),
        words=_places(d, [f for f in d.state_fields if f.name in words]),
        given=_places(d, [f for f in d.state_fields if f.name in own.numbers]), about=own.about,
        parted=tuple(Parted(name, f"{words[name] + 1}U") for name in apart), answers=_places(d, d.out_fields),
        wide=tuple(n for v, lo, hi in vectors for n in _numbers(v, -_reach(lo, hi), _reach(lo, hi), d.real)),
        good=tuple(n for v, lo, hi in _accepted(vectors, t) for n in _numbers(v, lo, hi, d.real)),
        beyond_u=_beyond("u", t.u_lo, t.u_hi, d.real), beyond_y=_beyond("y", t.y_lo, t.y_hi, d.real),
        beyond_theta=_beyond(*vectors[2], d.real) if d.theta else (),
        told=tuple(f.name for f in d.in_fields if f.name == "mode"),
        by_predict=("0U",) * any(f.name in ("mode", "u", "theta") for f in d.in_fields),
        laws=_laws(getattr(t, "law", None), d.real))


def _laws(law, real: str) -> tuple[LawHarness, ...]:
    """What the harness of a tracking law has; nothing without one."""
    if law is None:
        return ()
    most = law.reference
    return (LawHarness(tuple(_numbers("s", -law.limit, law.limit, real)),
                       tuple(_numbers("ref", -_reach(-most, most), _reach(-most, most), real)),
                       tuple(_numbers("ref", -most, most, real)), _beyond("ref", -most, most, real)),)


def _accepted(vectors, t):
    """Ranges that every mode accepts: of the parameters what all boxes share, or else their hull."""
    for vector, lo, hi in vectors:
        if vector == "theta":
            inner = t.vary.theta_lo.max(axis=0), t.vary.theta_hi.min(axis=0)
            lo, hi = inner if np.all(inner[0] <= inner[1]) else (lo, hi)
        yield vector, lo, hi


def _words(value: int, count: int | None) -> str:
    """Print the initialiser of a word, or of an array of them."""
    return "{ " + ", ".join([f"{value}U"] * count) + " }" if count else f"{value}U"


def _counts(d: DesignView) -> dict[str, int]:
    """Elements of the arrays of a struct, by their size as it is printed."""
    counts = {f"[{d.macro}_{name}]": len(of) for name, of in (
        ("NX", d.x), ("NU", d.u), ("NY", d.y), ("NTHETA", d.theta), ("BITS", d.bits), ("MODES", d.modes))}
    return counts | {f"[{d.macro}_{name}]": n for name, n in d.lengths}


def _places(d: DesignView, fields) -> tuple[str, ...]:
    """List every element of some members of a struct."""
    counts = _counts(d)
    return tuple(place for f in fields for place in
                 ([f"{f.name}[{i}]" for i in range(counts[f.size])] if f.size else [f.name]))


def _numbers(vector: str, lo: Array, hi: Array, real: str) -> list[Number]:
    return [Number(f"{vector}[{i}]", literal(a, real), literal(b, real)) for i, (a, b) in enumerate(zip(lo, hi))]


def _reach(lo: Array, hi: Array) -> Array:
    """Return a magnitude far beyond both ends that is still a number of their type."""
    with np.errstate(over="ignore"):
        reach = np.maximum(np.maximum(np.abs(lo), np.abs(hi)), lo.dtype.type(1)) * lo.dtype.type(WIDE)
    return np.minimum(reach, np.finfo(lo.dtype).max)


def _beyond(vector: str, lo: Array, hi: Array, real: str) -> tuple[Number, ...]:
    """List what lies on either side of each range, from the next number on up to ``_reach``."""
    found = []
    with np.errstate(over="ignore"):
        above, below = np.nextafter(hi, lo.dtype.type(np.inf)), np.nextafter(lo, lo.dtype.type(-np.inf))
    for i, reach in enumerate(_reach(lo, hi)):
        place = f"{vector}[{i}]"
        if np.isfinite(above[i]):
            found.append(Number(place, literal(above[i], real), literal(reach, real), "above its range"))
        if np.isfinite(below[i]):
            found.append(Number(place, literal(-reach, real), literal(below[i], real), "below its range"))
    return tuple(found)
