"""The set of a point observer: order, weights or table, limit and directions of its test, chosen by simulation."""

from __future__ import annotations

import numpy as np

from ..algebra.bases import bases
from ..algebra.zonotope import KEYS, best_direction, fan
from ..analysis.set_tables import dwell_table
from ..certify import thresholds
from ..certify.ellipsoids import freeze_ellipsoid
from ..certify.order import patterns
from ..certify.reduction import box_certificate, every_sample
from ..certify.set_freeze import freeze_zonotope
from ..errors import DesignError
from ..observers import (
    EllipsoidObserver,
    EllipsoidTables,
    PointTables,
    Supervision,
    ThresholdTables,
    ZonotopeObserver,
    ZonotopeTables,
)
from ..observers.ellipsoid import sandwich
from ..observers.zonotope import set_work
from ..plant.model import Plant
from .box_sets import boxed
from .set_simulation import STEPS, estimate, half_widths, settled, simulated
from .trace_sets import traced

Array = np.ndarray
#: Set in the options where the plant file says nothing.
ORDER_MARGIN = 1.05  # widths over those of a large order
MOST_COLUMNS = 24  # generators of the largest order that is tried without being asked for
MOST_WORK = 8000  # multiplications per sample up to which membership of three residuals is exact without being asked
WEIGHTS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0, 10.0)  # 1 + alpha of an ellipsoid's step
SLOW = (0.02, 0.01, 0.005, 0.002)  # the same where errors decay by less than these in a sample
ROWS = (4, 8, 16, 32)  # of a table of thresholds
STAGES = (3, 5, 8, 12, 20, 32)
TABLE_MARGIN = 1.1  # last thresholds over those that no number of stages leads below


def draft(plant: Plant, gains: dict, order: int, limit: Array, real: str, directions: Array, pairs: bool = False,
          key: str = "squared", coordinates: Array | None = None) -> PointTables:
    """Tables with a sound set of that order, before anything is certified."""
    t = estimate(plant, gains, real, limit)
    return PointTables(**vars(t), shape=freeze_zonotope(
        ZonotopeTables, plant.observed.modes, vars(t), order, directions, pairs, key, coordinates))


def sized(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose order, limit and directions of the membership test.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "order", else the smallest whose bounds are within 5 % of those of many generators.
    dwell : int
        Samples that every mode lasts at least.

    Returns
    -------
    dict
        "order", "limit", "directions", "dwell", and of the reduction "pairs", "key", "coordinates".

    Raises
    ------
    DesignError
        The set grows without bound at this order, or at every order tried.
    """
    half = half_widths(plant)
    paths = np.array(patterns(plant.n_modes, dwell, STEPS))
    none = np.zeros((0, plant.n_y))

    def tried(order: int, key: str = "squared", T: Array | None = None) -> tuple[PointTables, Array]:
        t = draft(plant, gains, order, 1e3 * half, "float64", none, False, key, T)
        return t, simulated(t, half, paths, ZonotopeObserver)

    orders = [int(options["order"])] if "order" in options else range(plant.n_x + 1, MOST_COLUMNS + 1)
    if orders[0] <= plant.n_x:
        raise DesignError(f"{plant.name}: observer.order is {orders[0]} (found), expected at least {plant.n_x + 1}: "
                          "one more than the states, for the box and a generator that is kept.")
    t, widths = tried(2 * MOST_COLUMNS)
    best, M = settled(widths), t.M
    ways = reductions(M, dwell)
    # A proof that nothing grows comes first, whatever the order; then what settles in simulation, in x alone.
    for key, T in [way for way, proved in ways if proved] + [w for w, proved in ways if not proved and w[1] is None]:
        for order in orders if best is not None else ():
            t, widths = tried(order, key, T)
            steady = settled(widths)
            if steady is not None and ("order" in options or np.all(steady <= ORDER_MARGIN * best + 1e-12 * half)):
                return chosen(plant, gains, options, dwell, t, widths, {"key": key, "coordinates": T})
    radii = [max(abs(np.linalg.eigvals(np.abs(A)))) for A in M]
    worst = int(np.argmax(radii))
    raise DesignError(f"{plant.name}: the set of order {orders[-1]} grows without bound or by more than 5 % beyond "
                      f'that of many generators, expected it to settle (mode "{plant.modes[worst].name}" has spectral '
                      f"radius {radii[worst]:.3g} of |A - L C|; in {len(ways)} coordinates and keys no set is proved "
                      "to settle). Raise observer.order, declare a dwell time, or take gains that decay faster.")


def reductions(M: Array, dwell: int) -> list[tuple[tuple[str, Array | None], bool]]:
    """Keys and coordinates of the reduction, and whether no order grows in them: those of x first."""
    out = []
    for _, T in bases(M):
        proved = box_certificate(M, every_sample(len(M), dwell), T) is not None
        out += [((key, T), proved) for key in KEYS]
        if T is None and proved:
            break
    return out


def chosen(plant: Plant, gains: dict, options: dict, dwell: int, t: PointTables, widths: Array,
           reduction: dict) -> dict:
    """What ``sized`` returns, once order and coordinates are known."""
    pairs = by_pairs(plant, t, options)
    return {"set": "zonotope", "order": t.shape.order, "limit": 1.25 * np.max(widths, axis=(0, 1)), "dwell": dwell,
            "reduction": {"pairs": pairs, **reduction},
            "directions": np.zeros((0, plant.n_y)) if pairs else directions(plant, t, gains)}


def by_pairs(plant: Plant, t: PointTables, options: dict) -> bool:
    """Whether membership goes by the normals of all pairs of generators: asked for, or cheap enough for three outputs.

    Raises
    ------
    DesignError
        Asked for with more than three outputs.
    """
    asked = options.get("membership", "auto")
    if asked == "exact" and plant.n_y > 3:
        raise DesignError(f'{plant.name}: observer.membership is "exact" with {plant.n_y} outputs (found), expected at '
                          'most 3: the faces of the set are too many. Use membership = "directions".')
    if plant.n_y != 3 or asked == "directions":
        return False
    z = t.shape
    work = set_work(plant.n_x, 3, z.order, z.F.shape[3], z.V.shape[3], 0, True)
    return asked == "exact" or work.multiply <= MOST_WORK


def tabulated(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose directions, rows and stages of a table of thresholds.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "directions" (for two outputs: spread evenly, 8 unless told), "rows", "stages".
    dwell : int

    Returns
    -------
    dict

    Raises
    ------
    DesignError
        No table holds for this dwell time.
    """
    chosen = {"directions": compared(plant, gains, options), "dwell": dwell, "limit": np.zeros(plant.n_x),
              "set": "thresholds"}
    sizes = [(int(options["rows"]), int(options.get("stages", STAGES[0])))] if "rows" in options else sorted(
        ((r, s) for r in ROWS for s in ((int(options["stages"]),) if "stages" in options else STAGES)),
        key=lambda pair: pair[0] * pair[1])
    best, least = np.inf, None
    for count, stages in sizes:  # the smallest first
        tried = chosen | {"rows": count, "stages": stages}
        t, (main, _) = with_table(plant, gains | tried, "float64")
        least = lowest(plant, t, dwell, chosen["directions"]) if least is None else least
        above = np.max(ends(main) / least)
        if above < 0.9 * best:
            best, found = above, tried
        if above <= TABLE_MARGIN:
            return tried
    return found


def compared(plant: Plant, gains: dict, options: dict) -> Array:
    """Directions in which residuals are compared with a table: the coordinates, then others."""
    rows = np.eye(plant.n_y)
    if plant.n_y == 2:
        spread = fan(2 * (int(options.get("directions", 8)) // 2))
        return np.concatenate([rows, [d for d in spread if np.count_nonzero(d) > 1]])
    if plant.n_y == 1:
        return rows
    t = draft(plant, gains, 2 * plant.n_x + plant.n_w + plant.n_v, 1e3 * np.ones(plant.n_x), "float64", rows[:0])
    return np.concatenate([rows, directions(plant, t, gains)])


def ends(table) -> Array:
    """Thresholds of the last stage on entering a mode and long after, (2, N, m)."""
    return np.stack([table.h[-1, :, 0], table.h[-1, :, -1]])


def lowest(plant: Plant, t: PointTables, dwell: int, rows: Array) -> Array:
    """``ends`` of a table that starts from no error at all: no number of stages leads below them."""
    m = thresholds.recursion(plant.observed.modes, t)
    return ends(dwell_table(m, dwell, np.zeros((plant.n_x, 1)), thresholds.directions_of(t, rows), 8, 3))


def with_table(plant: Plant, gains: dict, real: str) -> tuple[PointTables, tuple]:
    """Tables with thresholds, and where they come from, before anything is certified.

    Raises
    ------
    DesignError
        The errors grow without bound under this dwell time.
    """
    modes = plant.observed.modes
    t = estimate(plant, gains, real)
    m, (first, anywhere) = thresholds.recursion(modes, t), thresholds.starts(t)
    emitted = gains["directions"].astype(real)
    rows = thresholds.directions_of(t, emitted.astype(float))
    try:
        main = dwell_table(m, gains["dwell"], anywhere, rows, gains["rows"], gains["stages"])
        begin = dwell_table(m, gains["dwell"], first, rows, gains["rows"], 3)
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from None
    shape = thresholds.freeze_thresholds(ThresholdTables, t, main, begin, emitted)
    return PointTables(**vars(t), shape=shape), (main, begin)


def weighted(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose the weights of an ellipsoid: those with the smallest set along mode sequences, by simulation.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "weights": "trace" for those that the firmware chooses.
    dwell : int

    Returns
    -------
    dict

    Raises
    ------
    DesignError
        The set grows without bound for every weight.
    """
    if options.get("weights") == "trace":
        return aimed(plant, gains, traced(plant, gains, dwell))
    half = half_widths(plant)
    paths, found = np.array(patterns(plant.n_modes, dwell, STEPS)), None
    base = {"set": "ellipsoid", "limit": 8 * np.sqrt(plant.n_x) * half, "directions": np.zeros((0, plant.n_y)),
            "steady": {"x": half, "x_most": half, "y": np.ones(plant.n_y), "y_most": np.ones(plant.n_y)}}
    for share in (*WEIGHTS, *SLOW):
        if share < WEIGHTS[0] and found is not None:
            break
        tried = base | {"alpha": np.full((2, plant.n_modes), share), "beta": np.full(plant.n_modes, share)}
        X, R = followed(with_ellipsoid(plant, gains | tried, "float64"), half, paths)
        third = len(X) // 3
        middle, last = X[third:2 * third].max(axis=(0, 1)), X[2 * third:].max(axis=(0, 1))
        size = float(np.sum(np.sqrt(last) / half))
        if np.all(last <= 1.02 * middle) and (found is None or size < found[0]):
            found = size, tried, X, R
    if found is None:
        raise DesignError(f"{plant.name}: the ellipsoid grows without bound for every weight tried, expected it to "
                          "settle. Declare a longer dwell time, or take gains that decay faster.")
    _, tried, X, R = found
    late = slice(2 * len(X) // 3, None)
    steady = {"x": np.sqrt(X[late].min(axis=(0, 1))), "x_most": np.sqrt(X.max(axis=(0, 1))),
              "y": np.sqrt(R[late].min(axis=(0, 1))), "y_most": np.sqrt(R.max(axis=(0, 1)))}
    tried |= {"steady": steady, "limit": np.maximum(1.25 * steady["x_most"], 1.25 * np.sqrt(plant.n_x) * half)}
    return aimed(plant, gains, tried)


def aimed(plant: Plant, gains: dict, chosen: dict) -> dict:
    """The same choice with directions of the membership test, where it needs any."""
    if plant.n_y <= 2:
        return chosen
    most = 1e3 * np.maximum(plant.limits("x")[1] - plant.limits("x")[0], plant.x0_hi - plant.x0_lo)
    t = draft(plant, gains, 2 * plant.n_x + plant.n_w + plant.n_v, most, "float64", np.zeros((0, plant.n_y)))
    return chosen | {"directions": directions(plant, t, gains)}


def followed(t: PointTables, half: Array, paths: Array) -> tuple[Array, Array]:
    """Diagonals of error (K, S, n_x) and residual shapes (K, S, n_y) along mode sequences from the set of a box."""
    run = EllipsoidObserver({t.real: t}, Supervision())
    X = run.whole(t, np.broadcast_to(half, (len(paths), len(half))))
    i, j = np.arange(len(half)), np.arange(t.C.shape[1])
    origin, out = np.full(len(paths), t.origins - 1), []
    with np.errstate(over="ignore", invalid="ignore"):
        for q in paths.T:
            R = sandwich(t.shape.gr[q], t.C[q], X, t.shape.V[q, origin], t.shape.kr[q], run.trace(t, X))
            out.append((X[:, i, i], R[:, j, j]))
            X = run.moved(t, q, q, origin, X, True)
            origin = q if t.kind == "tnl" else np.zeros_like(q)
    return np.array([x for x, _ in out]), np.array([r for _, r in out])


def with_ellipsoid(plant: Plant, gains: dict, real: str) -> PointTables:
    """Tables with an ellipsoid, before anything is certified."""
    t = estimate(plant, gains, real)
    return PointTables(**vars(t), shape=freeze_ellipsoid(
        EllipsoidTables, plant.observed.modes, vars(t), gains["alpha"], gains["beta"], gains["steady"],
        gains["directions"]))


def directions(plant: Plant, t: PointTables, gains: dict) -> Array:
    """Directions of the membership test for more than two outputs: per fault and mode the best one for its first and
    its lasting effect.
    """
    if plant.n_y <= 2:
        return np.zeros((0, plant.n_y))
    rows: list[Array] = []
    run = ZonotopeObserver({t.real: t}, Supervision())
    H = run.whole(t, np.zeros((plant.n_modes, plant.n_x), dtype=t.dtype))
    for _ in range(STEPS):
        q = np.arange(plant.n_modes)
        H = run.moved(t, q, q, q if t.kind == "tnl" else 0 * q, H, True)
    for q, mode in enumerate(plant.observed.modes):
        N, L, M = (np.asarray(a[q], float) for a in (t.N, t.L, t.M))
        R = np.concatenate([mode.C @ H[q], t.shape.V[q, q if t.kind == "tnl" else 0]], axis=1)
        for j in range(plant.n_f):
            onset = mode.Df[:, j] - mode.C @ N @ mode.Df[:, j]
            push = (np.eye(len(M)) - N @ mode.C) @ mode.Bf[:, j] - (L + N) @ mode.Df[:, j]
            for effect in (onset, mode.C @ push, mode.C @ np.linalg.pinv(np.eye(len(M)) - M) @ push + mode.Df[:, j]):
                if np.linalg.norm(effect) > 1e-9:
                    found = best_direction(R, effect)
                    if all(np.linalg.norm(found - s) > 1e-6 for s in rows):
                        rows.append(found)
    return np.array(rows).reshape(-1, plant.n_y)


#: How the set of each kind is sized.
CHOICES = {"zonotope": sized, "dwell": tabulated, "ellipsoid": weighted, "interval": boxed}
