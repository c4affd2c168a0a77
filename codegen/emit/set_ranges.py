"""What the members of the state that hold an error set may be, for the Frama-C harness; one entry per family.

A new family whose state has words of its own, or numbers that its limits do not bound, adds a function to ``RANGES``:
tables -> ``Ranges``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import EmitError
from ..observers.sliding import OLDEST

Array = np.ndarray


@dataclass(frozen=True)
class Ranges:
    """Ranges of the members of a set.

    Parameters
    ----------
    numbers : dict
        Member -> (least, most), arrays in the member's order. Eva starts from them and does not show that they stay.
    words : dict
        Member -> largest value, which Eva shows to stay.
    about : tuple of str
        Lines that say what keeps the numbers there.
    kept : dict
        Member -> (least, most) of numbers that the C cuts to these ends, which Eva shows to stay.
    """

    numbers: dict
    words: dict
    about: tuple[str, ...]
    kept: dict = field(default_factory=dict)


NONE = Ranges({}, {}, ())
#: What keeps the state of a filter.
COMPARED = ("Each number of the filter's state has been compared with its limit when a call ends. From there",
            "Eva shows that all stays finite.")


def of(family: str, t, members: dict[str, str]) -> Ranges:
    """Return the ranges of a family's own members.

    Parameters
    ----------
    family : str
    t : PointTables
    members : dict
        Name -> C type of each member of the state that not every observer has.

    Returns
    -------
    Ranges
        Of a family that is not listed: every vector of one number per state within its limits.

    Raises
    ------
    EmitError
        A member has no range.
    """
    made = RANGES.get(family, within_limits)(t, members)
    unknown = [name for name in members if name not in made.numbers | made.words | made.kept]
    if unknown:
        raise EmitError(f"{family}: members {', '.join(unknown)} of the state have no range for Frama-C (expected one "
                        "each). Add the family to codegen/emit/set_ranges.py.")
    return made


def within_limits(t, members: dict[str, str]) -> Ranges:
    """Half widths, each compared with its limit."""
    numbers = {name: (-t.limit, t.limit) for name, kind in members.items() if kind != "uint32_t"}
    return Ranges(numbers, _origin(t), ("Each half width of the set has been compared with its limit when a call ends. "
                                        "From there", "Eva shows that all stays finite."))


def zonotope(t, members: dict[str, str]) -> Ranges:
    """Each number of a generator is at most what the sum of its row may be."""
    most = np.tile(t.limit, t.shape.columns)
    return Ranges({"shape": (-most, most)}, _origin(t),
                  ("The generators' sum of magnitudes in a row has been compared with its limit when a call ends,",
                   "and sums of magnitudes, rounded to nearest, are no smaller than any of their terms: that keeps",
                   "each number of a generator there. From there Eva shows that all stays finite."))


def ellipsoid(t, members: dict[str, str]) -> Ranges:
    """Each diagonal is at most what a tangent of its root lets pass, the others at most their geometric mean."""
    z = t.shape
    limit, slope, offset = (np.asarray(a, dtype=float) for a in (t.limit, z.a, z.b))
    square = np.max(np.maximum(limit * (1 + 1e-6) - offset, 0) / slope, axis=0) * (1 + 1e-6)
    return _shapes(t, np.sqrt(square))


def ellipsoid_trace(t, members: dict[str, str]) -> Ranges:
    """The same; a root is no smaller than that of its number."""
    return _shapes(t, np.asarray(t.limit, dtype=float) * (1 + 1e-6))


def _shapes(t, root: Array) -> Ranges:
    """Of a shape whose diagonal has these roots at most."""
    most = (root[:, None] * root * (1 + 1e-6)).astype(t.dtype)
    least = -most
    np.fill_diagonal(least, 0.0)
    return Ranges({"shape": (least.ravel(), most.ravel())}, _origin(t),
                  ("The shape stays positive semidefinite (residua certify proves that what a step adds holds its",
                   "rounding) and its diagonal has been compared with the limits when a call ends: that keeps its",
                   "numbers there. From there Eva shows that all stays finite."))


def thresholds(t, members: dict[str, str]) -> Ranges:
    """Stage and count."""
    return Ranges({}, {"stage": len(t.shape.h) - 1, "since": t.shape.cap}, ())


def schedule(t, members: dict[str, str]) -> Ranges:
    """Place in the schedule, and count."""
    return Ranges({}, {"phase_at": len(t.shape.cycle), "since": t.shape.settled}, ())


def blocks(t, members: dict[str, str]) -> Ranges:
    """Each number of a generator is at most what the sum of its row may be."""
    most, words = np.tile(t.shape.most, t.shape.order), {"since": t.shape.longest, "block": len(t.A) - 1}
    return Ranges({"shape": (-most, most)}, words | dict.fromkeys(("origin", "before"), t.origins - 1),
                  ("The generators' sum of magnitudes in a row has been compared with its limit when a call ends,",
                   "which keeps each number of a generator there. From there Eva shows that all stays finite."))


def filtered(t, members: dict[str, str]) -> Ranges:
    """The state of a filter, each number compared with its limit, and the count of the table of thresholds."""
    return Ranges({"xi": (-t.limit, t.limit)}, {"since": t.last << t.shift}, COMPARED)


def modes(t, members: dict[str, str]) -> Ranges:
    """Boxes of hypotheses a period after they were cut, or as a measurement cut one that is dead; masks of ages."""
    most, pairs = carried(t), len(t.Phi) * (t.ages + 1)
    return Ranges({f"box_{side}": (-np.tile(most, pairs), np.tile(most, pairs)) for side in ("lo", "hi")},
                  {"alive": 2 ** (t.ages + 1) - 1, "decided": len(t.Phi) - 1},
                  ("When a call ends each box has been cut to its limits and carried over one period, or is one of the",
                   "boxes to start from, or has been found empty. From there Eva shows that all stays finite."))


def pairs(t, members: dict[str, str]) -> Ranges:
    """Bounds, sliding variables and rates, each cut to its limit; means of rates, with room."""
    count, rates = len(t.M_hi), float(np.sum(t.rate_limit))
    limits = {"box": np.tile(t.limit, count), "shown": t.limit, "twist": np.tile(t.z_limit, count),
              "rate": np.tile(t.rate_limit, count)}
    kept = {f"{k}_{side}": (-most, most) for k, most in limits.items() for side in ("lo", "hi")}
    kept["level"] = np.zeros(count, t.dtype), np.full(count, 4 * rates).astype(t.dtype)
    words = {"decided": count - 1, "best": count - 1, "age": OLDEST, "since": t.dwell - 1, "last": t.dwell - 1}
    return Ranges({}, words | dict.fromkeys(("fresh", "armed", "refuted"), 2 ** count - 1), (), kept)


def guided(t, members: dict[str, str]) -> Ranges:
    """The same, and bounds that are those of framers within the range of x, or else the estimator's; last sample.

    Zero is what init and reset store of that.
    """
    own, most = pairs(t, members), np.maximum(t.limit, t.told.box)
    last = [("u", t.u_lo, t.u_hi), ("y", t.y_lo, t.y_hi)]
    last += [("theta", t.vary.theta_lo[0], t.vary.theta_hi[0])] if t.vary else []
    kept = own.kept | dict.fromkeys(("told_lo", "told_hi"), (-most, most))
    kept |= {f"told_{name}": (np.minimum(lo, 0), np.maximum(hi, 0)) for name, lo, hi in last}
    if t.told.change is not None:
        kept |= dict.fromkeys(("told_z_lo", "told_z_hi"), (-t.told.change.box, t.told.change.box))
    return Ranges(own.numbers, own.words, own.about, kept)


def guided_point(t, members: dict[str, str]) -> Ranges:
    """Pairs alike; of the observer a set as where its mode is told, an estimate that is cut to its box; last sample."""
    own, told = pairs(t, members), t.told
    inner = RANGES.get(t.set, within_limits)(told, {"shape": "real"})
    kept = own.kept | {"told_x_hat": (-told.box, told.box)}
    kept |= {f"told_{name}": (np.minimum(lo, 0), np.maximum(hi, 0)) for name, lo, hi in (  # zero is what init stores
        ("u", t.u_lo, t.u_hi), ("y", t.y_lo, t.y_hi))}
    return Ranges({f"told_{name}": ends for name, ends in inner.numbers.items()},
                  own.words | {f"told_{name}": most for name, most in inner.words.items()}, inner.about, kept)


def guided_filter(t, members: dict[str, str]) -> Ranges:
    """Pairs alike; the state of the filter, each number compared with its limit; how it started, and since when."""
    own, told = pairs(t, members), t.told
    return Ranges({"told_xi": (-told.limit, told.limit)},
                  own.words | {"told_stage": told.anywhere, "told_since": told.last}, COMPARED, own.kept)


def bank(t, members: dict[str, str]) -> Ranges:
    """States and averages, with which all observers start anew beyond their limits; the last measurement; counts."""
    return Ranges({}, {"left": t.keep, "wait": max(t.settle, t.begin), "credit": t.credit}, (),
                  {"z": (-t.limit, t.limit), "a": (-t.most, t.most),
                   "y": (np.minimum(t.y_lo, 0), np.maximum(t.y_hi, 0))})  # zero at a start


def driven(t, members: dict[str, str]) -> Ranges:
    """The same, where framers may have cut a box that is dead; framers of a mode that is possible; a bit per mode."""
    boxes, n_modes = modes(t, members), len(t.Phi)
    frames = np.tile(t.told.box, n_modes)
    numbers = narrowed(t) | {f"frame_{side}": (-frames, frames) for side in ("lo", "hi")}
    if t.told.change is not None:
        turned = np.tile(t.told.change.box, n_modes)
        numbers |= {f"frame_z_{side}": (-turned, turned) for side in ("lo", "hi")}
    return Ranges(numbers, boxes.words | {"framed": 2**n_modes - 1, "measured": 1},
                  ("When a call ends each box has been cut to its limits and carried over one period, or is one of the",
                   "boxes to start from, or has been found empty. Bounds of a mode whose bit of framed is set are in",
                   "order and have been cut at both ends; others are not read. From there Eva shows that all stays",
                   "finite."))


def follower(t, members: dict[str, str]) -> Ranges:
    """Boxes alike; of the observer a set as where its mode is told, estimate and bounds that are cut to its box."""
    boxes, told = modes(t, members), t.told
    inner = RANGES.get(t.set, within_limits)(told, {"shape": "real"})
    kept = dict.fromkeys(("told_x_hat", "told_lo", "told_hi"), (-told.box, told.box))
    kept |= {f"told_{name}": (np.minimum(lo, 0), np.maximum(hi, 0)) for name, lo, hi in (  # zero is what init stores
        ("u", t.u_lo, t.u_hi), ("y", t.y_lo, t.y_hi))}
    words = boxes.words | {"followed": len(t.Phi), "measured": 1}
    numbers = narrowed(t) | {f"told_{name}": ends for name, ends in inner.numbers.items()}
    return Ranges(numbers, words | {f"told_{name}": most for name, most in inner.words.items()}, (
        "When a call ends each box has been cut to its limits and carried over one period, or is one of the",
        "boxes to start from, or has been found empty. From there Eva shows that all stays finite.",
        *inner.about), kept)


def trailing(t, members: dict[str, str]) -> Ranges:
    """Boxes alike; states of the filters, each compared with its limit; how they started, since when, which run."""
    boxes, told, count = modes(t, members), t.told, len(t.Phi)
    most = np.tile(told.limit, count)
    words = {"told_stage": told.anywhere, "told_since": told.last, "settled": count - 1, "running": 2**count - 1}
    return Ranges(boxes.numbers | {"told_xi": (-most, most)}, boxes.words | words, (
        "When a call ends each box has been cut to its limits and carried over one period, or is one of the",
        "boxes to start from, or has been found empty; each number of a filter's state has been compared with its",
        "limit. From there Eva shows that all stays finite."))


def narrowed(t) -> dict:
    """Ends of boxes that are cut to S x of bounds within the box of framers or of an observer, too."""
    image = np.abs(t.S_rounded.astype(float)) @ t.told.box.astype(float) + 2 * t.xi_room.astype(float)
    most = np.tile(np.maximum(carried(t), (1.001 * image).astype(t.dtype)), len(t.Phi) * (t.ages + 1))
    return {f"box_{side}": (-most, most) for side in ("lo", "hi")}


def carried(t) -> Array:
    """Magnitudes that no number of a box exceeds when a call ends, in the type of the tables."""
    f = {k: np.abs(getattr(t, k).astype(float)) for k in (
        "Phi", "Gamma", "shift", "reach", "J", "J_u", "J_shift", "J_radius", "J_u_radius", "J_reach", "birth", "limit",
        "D", "wide_lo", "wide_hi", "start_lo", "start_hi")}
    u, y = (np.maximum(*(np.abs(getattr(t, f"{v}_{s}").astype(float)) for s in ("lo", "hi"))) for v in "uy")
    moved = f["Phi"] @ f["limit"] + f["Gamma"] @ u + f["shift"]
    jump = (f["J"] + f["J_radius"]) @ f["limit"] + (f["J_u"] + f["J_u_radius"]) @ u + f["J_shift"] + f["J_reach"]
    out = np.max([f["limit"], *(f[k] for k in ("wide_lo", "wide_hi", "start_lo", "start_hi")),
                  *(moved + f["reach"]), *(moved + jump + f["birth"]).reshape(-1, len(f["limit"]))], axis=0)
    seen = y + f["D"] @ u + np.maximum(*(np.abs(v.astype(float)) for v in (t.v_lo, t.v_hi)))
    out[:len(seen)] = np.maximum(out[:len(seen)], seen)
    return (1.001 * out).astype(t.dtype)


def polytopic(t, members: dict[str, str]) -> Ranges:
    """The state of a polytopic observer, cut to its limits in every call, and the count of the table of thresholds."""
    return Ranges({}, {"since": t.last << t.shift}, (
        "The state of the observer is cut to its limits, which Eva shows to hold; weights are what it finds for the",
        "program of the C over all estimates that are possible from there."), {"z": (t.z_lo, t.z_hi)})


def _origin(t) -> dict:
    return {"origin": t.origins - 1} if t.kind == "tnl" else {}


RANGES = {"zonotope": zonotope, "ellipsoid": ellipsoid, "thresholds": thresholds, "schedule": schedule,
          "starts": thresholds, "blocks": blocks, "ellipsoid_trace": ellipsoid_trace, "filter": filtered,
          "mode": modes, "driven": driven, "follower": follower, "polytopic": polytopic, "descriptor": polytopic,
          "sliding": pairs, "guided": guided, "guided_point": guided_point, "guided_filter": guided_filter,
          "bank": bank, "trailing": trailing}
