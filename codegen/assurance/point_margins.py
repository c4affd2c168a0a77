"""By how much the conditions of a point observer's error set hold; one entry of ``HELD`` per kind of set.

A new kind needs such an entry: a function (modes, tables, certificate) -> {"alarm": ..., "state": ..., "bounded": ...}
of margins that are decided in exact arithmetic on the constants of the C.
"""

from __future__ import annotations

import numpy as np

from ..certify import residual_gain, schedules, thresholds, trace_ellipsoids
from ..certify import starts as start_tables
from ..certify.blocks import BlockDemands, first_room
from ..certify.boxes import BoxDemands
from ..certify.ellipsoids import ROOM, EllipsoidDemands
from ..certify.exact import Q, inverse, product, rational
from ..certify.rounding import TINY, UNIT
from ..certify.sets import SetDemands, ZonotopeDemands, column
from ..certify.settled import Boxes
from .margins import Margin, _pivots, tightest

Array = np.ndarray


def entrywise(what: str, stored: Array, needed: Array, strict: bool = False) -> Margin:
    """The tightest of stored - needed, entry by entry."""
    left = rational(stored) - needed
    return tightest(what, [(x, f"{list(map(int, i))}") for i, x in np.ndenumerate(left)], strict)


def reach(t, share: Array | float = 1.0) -> list[Margin]:
    """The box of the estimate and the limits: what the induction rests on."""
    wide = np.maximum(rational(t.x_hi) - rational(t.x_lo), rational(t.x0_hi) - rational(t.x0_lo)) / 2
    most = np.max(np.abs([rational(getattr(t, n)) for n in ("x_lo", "x_hi", "x0_lo", "x0_hi")]), axis=0)
    return [entrywise("box beyond range plus limit", t.box, most + rational(t.limit)),
            entrywise("limit beyond the declared range", t.limit, Q(share) * wide + rational(t.shape.spread)[-1])]


def zonotope(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a zonotope: boxes of rounding, room of the membership test, bounds of x, what is kept for ever."""
    z = t.shape
    exact = ZonotopeDemands(SetDemands(modes, t), z)
    out = {"alarm": [entrywise("e beyond what rounding and left over constants add", z.e, exact.error_box()),
                     entrywise("rho beyond what they add to a residual", z.rho, exact.residual_box()),
                     *[entrywise("inside beyond rounding in the coordinates of boxes", z.inside, exact.inside())
                       for _ in range(int(z.oblique))],
                     Margin("slack of the membership test", Q(z.slack) - exact.slack()),
                     Margin("floor of the membership test", Q(z.floor) - exact.floor())],
           "state": [entrywise("spread beyond the noise in the estimate and rounding", z.spread, exact.spread())],
           "bounded": reach(t)}
    if cert.get("boxes"):
        every, half = Boxes(t, exact, cert["boxes"]["dwell"]), rational(np.array(cert["steady_box"]["half"]))
        box, width = rational(np.array(cert["boxes"]["half"])), rational(np.array(cert["steady_box"]["width"]))
        moved = [(s, e, (every.maps[every.mode[s], every.mode[e]] @ column(box[s])).ravel())
                 for s, e in zip(every.steps.source, every.steps.target)]
        stay = [(box[e][i] - x - every.added[every.mode[s], every.mode[e]][i], f"state {i}, steps {s} to {e}")
                for s, e, new in moved for i, x in enumerate(new)]
        shrink = [(box[e][i] - x, f"state {i}, steps {s} to {e}") for s, e, new in moved for i, x in enumerate(new)]
        out["ultimate"] = [tightest("box beyond the hull one step later", stay),
                           tightest("box beyond what M makes of it", shrink, strict=True),
                           entrywise("half widths of x beyond those of the boxes", half,
                                     rational(every.in_x(np.array(cert["boxes"]["half"])))),
                           entrywise("width beyond twice box and spread", width,
                                     2 * (half + np.max(rational(z.spread), axis=0)))]
    elif cert.get("steady_box"):
        half, stay, shrink = rational(np.array(cert["steady_box"]["half"])), [], []
        for q, M in enumerate(exact.of.M):
            moved = (abs(M) @ column(half)).ravel()
            pushed = (abs(M) @ column(exact.e)).ravel() + exact.carry(M)
            for o in range(len(exact.of.gain)):
                new = moved + pushed + abs(rational(z.F[q, o])).sum(axis=1)
                stay += [(a - b, f'state {i}, mode "{modes[q].name}"') for i, (a, b) in enumerate(zip(half, new))]
            shrink += [(a - b, f'state {i}, mode "{modes[q].name}"') for i, (a, b) in enumerate(zip(half, moved))]
        width = rational(np.array(cert["steady_box"]["width"]))
        out["ultimate"] = [tightest("box beyond the hull one step later", stay),
                           tightest("box beyond what M makes of it", shrink, strict=True),
                           entrywise("width beyond twice box and spread", width,
                                     2 * (half + np.max(rational(z.spread), axis=0)))]
    return out


def ellipsoid(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of an ellipsoid: its noise shapes, factors, rounding, tangents of the root, room of the membership test."""
    z, demands, room = t.shape, EllipsoidDemands(modes, t), ROOM[t.real]
    pivots: dict[str, list] = {"alarm": [], "state": []}
    shares, rounded = [], []
    for name, noise, factor, k, matrix in (("H", "F", z.g, z.k, demands.of.M), ("Hb", "Fb", z.gb, z.kb, demands.of.A),
                                           ("V", "V", z.gr, z.kr, demands.of.C)):
        for q, mode in enumerate(modes):
            g, where = Q(factor[q]), f'{name}, mode "{mode.name}"'
            shares.append((g - 1, where))
            rounded += [(Q(a) - b, f"{where}, row {i}") for i, (a, b) in enumerate(zip(
                k[q], np.broadcast_to(demands.rounding(matrix[q], z.weight, g), len(k[q]))))]
            for o in range(len(demands.of.gain)):
                S = rational(getattr(z, name)[q, o])
                lack = S - g / (g - 1) * demands.noise(noise, q, o)
                for i in range(len(S)):
                    lack[i, i] = lack[i, i] - room * S[i, i] - demands.small(matrix[q], g)
                pivots["alarm" if name != "Hb" else "state"] += [
                    (p, f"{where}, noise of origin {o}, row {i}") for i, p in enumerate(_pivots(lack))]
    u, tiny, n_y = UNIT[t.real], TINY[t.real], t.C.shape[1]
    roots = [tightest(f"tangents {a}, {b} above the square root, as 4 a b - (1 + 4u)^2", [
        (4 * Q(x) * (Q(y) - 4 * tiny) - (1 + 4 * u) ** 2, f"{list(map(int, i))}")
        for (i, x), y in zip(np.ndenumerate(getattr(z, a)), getattr(z, b).ravel())])
        for a, b in (("a", "b"), ("ay", "by"))]
    own = 4 * u * (rational(t.box) + 2 * rational(t.limit)) + 8 * tiny
    spread = entrywise("spread beyond the noise in the estimate and rounding", z.spread,
                       demands.of.carried() * (1 + 4 * u) + own)
    what = "smallest pivot of shape minus noise, room and small"
    return {"alarm": [tightest(what, pivots["alarm"], strict=True), tightest("factor 1 + alpha beyond 1", shares, True),
                      tightest("rounding factor k beyond its demand", rounded), roots[1],
                      Margin("slack of the membership test", Q(z.slack) - 64 * n_y * u),
                      Margin("floor of the membership test", Q(z.floor) - 4096 * n_y**3 * tiny)],
            "state": [tightest(what, pivots["state"], strict=True), roots[0], spread],
            "bounded": reach(t, np.sqrt(len(t.box)))}


def least_trace(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of an ellipsoid of least trace: shapes of noise, rounding, scales of the roots, the trace that it comes below."""
    z, demands, room = t.shape, EllipsoidDemands(modes, t), ROOM[t.real]
    pivots: dict[str, list] = {"alarm": [], "state": []}
    rounded = []
    for noise, name, _, matrix, k in trace_ellipsoids.FORMS:
        for q, (mode, A) in enumerate(zip(modes, getattr(demands.of, matrix))):
            where = f'{name}, mode "{mode.name}"'
            rounded += [(Q(a) - b, f"{where}, row {i}") for i, (a, b) in enumerate(zip(
                getattr(z, k)[q], trace_ellipsoids.rounding(demands, A, z.weight)))]
            for o in range(len(demands.of.gain)):
                S = rational(getattr(z, name)[q, o])
                lack = S - demands.noise(noise, q, o)
                for i in range(len(S)):
                    lack[i, i] = lack[i, i] - room * S[i, i] - trace_ellipsoids.small(demands, A)
                pivots["alarm" if name != "Hb" else "state"] += [
                    (p, f"{where}, noise of origin {o}, row {i}") for i, p in enumerate(_pivots(lack))]
    u, tiny, n_y = UNIT[t.real], TINY[t.real], t.C.shape[1]
    scales = [entrywise(f"{name} beyond one over the root of its weight, and rounding", getattr(z, name),
                        np.array(trace_ellipsoids._scale(weight, t.real), dtype=object))
              for name, weight in (("scale", z.weight), ("scale_y", z.weight_y))]
    what = "smallest pivot of shape minus noise, room and small"
    out = {"alarm": [tightest(what, pivots["alarm"], strict=True),
                     tightest("rounding factor k beyond its demand", rounded), scales[1],
                     Margin("slack of the membership test", Q(z.slack) - 64 * n_y * u),
                     Margin("floor of the membership test", Q(z.floor) - 4096 * n_y**3 * tiny)],
           "state": [tightest(what, pivots["state"], strict=True), scales[0],
                     entrywise("spread beyond the noise in the estimate and rounding", z.spread,
                               trace_ellipsoids._spread(demands))], "bounded": reach(t, np.sqrt(len(t.box)))}
    if cert.get("steady_box"):
        half = np.array(cert["steady_box"]["half"])
        out["ultimate"] = [entrywise("width beyond that of the trace", rational(np.array(cert["steady_box"]["width"])),
                                     trace_ellipsoids._width(t, half)),
                           entrywise("square of a half width times its weight beyond the trace",
                                     rational(z.weight) * rational(half) ** 2, np.full(len(half), Q(cert["trace"])))]
    return out


def table(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a table of thresholds: the least room over the supports, and of the boxes of its stages."""
    rows, boxes = [], []
    for part, room in thresholds.proved(modes, t, cert).items():
        rows += [(Q(x), f"{part}, {where}") for x, where in room.thresholds]
        boxes += [(Q(x), f"{part}, {where}") for x, where in room.boxes]
    last = np.max(rational(t.shape.hx[[t.shape.anew - 1, -1]]).reshape(-1, len(t.box)), axis=0)
    return {"alarm": [tightest("threshold beyond the support of all that can be", rows)] + (
                [tightest("box of a stage beyond what may leave the one before", boxes)] if boxes else []),
            "state": [], "bounded": [_middle(t)],
            "ultimate": [entrywise("width beyond twice the last half widths",
                                   rational(np.array(cert["steady_box"]["width"])), 2 * last)]}


def interval(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a box: sizes and sums of a step and of the residual, what is kept for ever."""
    z, demands = t.shape, BoxDemands(modes, t)
    least = demands.least(z.T)

    def beyond(name: str, what: str) -> Margin:
        return entrywise(f"{name} beyond {what}", getattr(z, name), least[name])

    out = {"alarm": [beyond("P", "|M| and the rounding of its sums"), beyond("g", "what a step adds"),
                     beyond("S", "|C| and the rounding of its sums"), beyond("rho", "the noise in the residual")],
           "state": [beyond("Pb", "|A| and the rounding of its sums"), beyond("gb", "what a blind step adds"),
                     beyond("spread", "the noise in the estimate and rounding"),
                     *[beyond(name, f"{what} and the rounding of its sums") for name, what in
                       (("R", "|T|"), ("Z", "|T^-1|")) * z.turned]],
           "bounded": reach(t) + [entrywise("limit beyond the declared range in these coordinates", t.limit,
                                            demands.start())] * z.turned}
    if cert.get("steady_box"):
        half, stay, shrink = rational(np.array(cert["steady_box"]["half"])), [], []
        for q, mode in enumerate(modes):
            for i, (new, carried) in enumerate(zip(*demands.onward(half, q))):
                stay.append((half[i] - new, f'state {i}, mode "{mode.name}"'))
                shrink.append((half[i] - carried, f'state {i}, mode "{mode.name}"'))
        width = rational(np.array(cert["steady_box"]["width"]))
        out["ultimate"] = [tightest("box beyond itself one step later", stay),
                           tightest("box beyond what M makes of it", shrink, strict=True),
                           entrywise("width beyond twice box and spread", width, demands.width(half))]
    return out


def _middle(t) -> Margin:
    return entrywise("box beyond the middle of the declared range", t.box, abs(rational(t.x_lo) + rational(t.x_hi)) / 2,
                     True)


def turn(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a list along a schedule: the least room over the supports, from every start."""
    last = np.max(rational(t.shape.hx[-len(t.shape.cycle):]), axis=0)
    rows = [(Q(room), f"from {start}") for start, room in schedules.proved(modes, t).items()]
    return {"alarm": [tightest("threshold beyond the support of all that can be", rows)], "state": [],
            "bounded": [_middle(t)],
            "ultimate": [entrywise("width beyond twice the half widths of the rows that repeat",
                                   rational(np.array(cert["steady_box"]["width"])), 2 * last)]}


def from_starts(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a table from a start on: the least room over the supports, from every size in every mode."""
    last = np.max(rational(t.shape.hx[:, :, -1]).reshape(-1, len(t.box)), axis=0)
    rows = [(Q(x), where) for where, room in start_tables.proved(modes, t).items() for x, _ in room.thresholds]
    return {"alarm": [tightest("threshold beyond the support of all that can be", rows)], "state": [],
            "bounded": [_middle(t)],
            "ultimate": [entrywise("width beyond twice the last half widths",
                                   rational(np.array(cert["steady_box"]["width"])), 2 * last)]}


def carried(modes, t, cert: dict) -> dict[str, list[Margin]]:
    """Of a set carried from block to block: what scalars, noise and box have beyond their demands, the first boxes."""
    z, demands = t.shape, BlockDemands(modes, t, t.shape)
    out = {"alarm": [entrywise(f"{name} beyond what noise, rounded tables and sums add", getattr(z, name),
                               getattr(demands, name)()) for name in ("scalars", "noise", "e")],
           "state": [tightest(f"{name}: box beyond the first errors, and within the limit",
                              [(x, f"state {i}") for i, x in enumerate(left)]) for name, left in first_room(t).items()],
           "bounded": [_middle(t)]}
    if cert.get("steady_box"):
        half, width = (np.array(cert["steady_box"][k]) for k in ("half", "width"))
        out["ultimate"] = [tightest("box beyond the hull after a block", [(x, f"state {i}") for i, x in enumerate(
            demands.left(half))]), entrywise("width beyond twice the bounds that no set exceeds", rational(width),
                                             2 * demands.settled(half)[len(z.directions):])]
    return out


HELD = {"zonotope": zonotope, "ellipsoid": ellipsoid, "thresholds": table, "schedule": turn, "blocks": carried,
        "box": interval, "ellipsoid_trace": least_trace, "starts": from_starts}


def level(modes, t, cert: dict) -> list[Margin]:
    """The matrix inequality of the gains, its jumps, and the level that is claimed."""
    model = residual_gain.GainModel(modes, t.L, t.N)
    lam, g, P = Q(cert["lam"]), Q(cert["g"]), [rational(np.array(p)) for p in cert["P"]]
    pivots, names = [], model.names
    for q, r in residual_gain._pairs(P, lam):
        for H, Z in model.pushes[q]:
            outputs = model.outputs(q, Z, cert) if cert["kind"] == "hinf" else (None, None)
            S = residual_gain.block(model.M[q], H, *outputs, P[q], P[r], lam, g)
            pivots += [(p, f'mode "{names[q]}", then "{names[r]}", row {i}') for i, p in enumerate(_pivots(S))]
    out = [tightest("smallest pivot of the matrix inequality", pivots, strict=True)]
    if lam > 0:
        jumps = [(p, f'from "{names[r]}" to "{names[q]}", row {i}') for q in range(len(P)) for r in range(len(P))
                 if not np.array_equal(P[q], P[r]) for i, p in enumerate(_pivots(Q(cert["rho"]) * P[r] - P[q]))]
        out += [tightest("smallest pivot of rho P - P at a jump", jumps, strict=True)] if jumps else []
    if all(m.holds for m in out):  # the level rests on them
        out.append(Margin("square of the claimed level beyond the proved one",
                          Q(cert["level"]) ** 2 - residual_gain._level2(model, cert)))
    return out


def starts(limits: dict, t, runner) -> list[Margin]:
    """The sets of init and reset against the boxes that the plant file declares.

    Parameters
    ----------
    limits : dict
        "x", "x0" -> (lo, hi).
    t : PointTables
    runner : PointObserver
        Started anew here: its estimate and set are what the C stores.

    Returns
    -------
    list of Margin
    """
    out = []
    for name, (lo, hi) in limits.items():
        out.append(tightest(f"{name} box of the tables beyond the declared one", [
            case for i in range(len(t.box)) for case in (
                (Q(lo[i]) - Q(getattr(t, name + "_lo")[i]), f"state {i}, lo"),
                (Q(getattr(t, name + "_hi")[i]) - Q(hi[i]), f"state {i}, hi"))]))
        runner.start(t, 1)
        if name == "x":
            runner.reset(t, np.ones(1, dtype=bool))
        centre, whole = rational(runner.x_hat[0]), runner.set[0]
        half = np.maximum(rational(getattr(t, name + "_hi")) - centre, centre - rational(getattr(t, name + "_lo")))
        if whole.dtype != t.dtype or hasattr(t.shape, "anywhere"):  # a table: its first rows are proved for the box
            continue
        if getattr(t.shape, "turned", False):
            half = product(abs(inverse(rational(t.shape.T))), column(half)).ravel()
        if hasattr(t.shape, "kb"):
            square = [Q(x) for x in np.diagonal(whole)]
            left = 1 - sum((h * h / s for h, s in zip(half, square) if h), Q(0))
            out.append(Margin(f"1 - h' X^-1 h at the corners of the {name} box", left))
        else:
            held = np.abs(rational(whole)).reshape(len(half), -1).sum(axis=1)
            out.append(entrywise(f"hull of the first set beyond the {name} box", held, half))
    return out


