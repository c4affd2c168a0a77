"""Tables along a schedule and tables of blocks for a point observer: how large, in which directions, by simulation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..analysis.set_blocks import block_table
from ..analysis.set_schedule import PhaseTable, phase_table
from ..certify import blocks, schedules, thresholds
from ..certify.order import patterns
from ..errors import DesignError
from ..observers import BlockObserver, BlockTables, PointTables, ScheduleTables, Supervision
from ..plant.model import Plant
from . import point_sets, start_tables
from .point_sets import MOST_COLUMNS, ROWS, TABLE_MARGIN, compared, with_table
from .set_simulation import STEPS, estimate, settled

Array = np.ndarray
#: Samples of a block that are tried.
LENGTHS = (4, 6, 8, 12)


def scheduled(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose directions and rows of a list of thresholds along the plant's schedule.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "directions" (for two outputs: spread evenly, 8 unless told), "rows": after a start, else the fewest with which
        the thresholds of the schedule are within a tenth of those of no error at the start.
    dwell : int
        Not read: the schedule says more.

    Returns
    -------
    dict

    Raises
    ------
    DesignError
        There is no schedule, it cannot be told from its modes, or the errors grow along it.
    """
    cycle = plant.switching.schedule
    if not cycle:
        raise DesignError(f'{plant.name}: tables = "schedule" without a schedule (found), expected switching.schedule. '
                          'Give e.g. schedule = { every = 5, order = ["a", "b"] } there, or use tables = "dwell".')
    chosen = {"directions": compared(plant, gains, options), "limit": np.zeros(plant.n_x), "set": "schedule"}
    none = np.zeros((plant.n_x, 1))
    for rows in (int(options["rows"]),) if "rows" in options else ROWS:
        tried = chosen | {"rows": rows}
        t, m, table = computed(plant, gains | tried, "float64")
        directions = thresholds.directions_of(t, chosen["directions"])
        least = phase_table(m, cycle, none, none, directions, rows)
        if np.all(table.lap <= TABLE_MARGIN * least.lap):
            break
    lost = late(schedules.freeze_schedule(ScheduleTables, t, table, chosen["directions"]))
    if lost is not None:
        raise DesignError(f"{plant.name}: switching.schedule: firmware that starts at sample {lost} of the period "
                          'never finds its place (found), expected stays that tell it. Use tables = "dwell".')
    return tried


def computed(plant: Plant, gains: dict, real: str) -> tuple[SimpleNamespace, object, PhaseTable]:
    """Estimate, error recursion on its numbers, and the table in double precision.

    Raises
    ------
    DesignError
        The errors grow along the schedule.
    """
    t = estimate(plant, gains, real)
    m, (first, anywhere) = thresholds.recursion(plant.observed.modes, t), thresholds.starts(t)
    rows = thresholds.directions_of(t, gains["directions"].astype(real).astype(float))
    try:
        return t, m, phase_table(m, plant.switching.schedule, first, anywhere, rows, gains["rows"])
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from None


def with_schedule(plant: Plant, gains: dict, real: str) -> tuple[PointTables, tuple]:
    """Tables with a list of thresholds, before anything is certified.

    Raises
    ------
    DesignError
        The errors grow along the schedule.
    """
    t, _, table = computed(plant, gains, real)
    shape = schedules.freeze_schedule(ScheduleTables, t, table, gains["directions"].astype(real))
    return PointTables(**vars(t), shape=shape), ()


def late(z: ScheduleTables) -> int | None:
    """Sample of the period at which firmware that begins there still starts anew four periods later; None: nowhere."""
    P = len(z.cycle)
    for begin in range(P):
        at, found = P, False
        for k in range(begin, begin + 5 * P):
            q = z.cycle[k % P]
            found = at < P and z.cycle[at] == q
            again = not found
            at = z.entry[q] if again else at
            if again and k >= begin + 4 * P:
                return begin
            at = at + 1 if at + 1 < P else 0
    return None


def arbitrary(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose directions, samples of a block and columns of its matrix.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "directions", "rows" (samples of a block) and "order" (columns), else the fewest numbers with which the bounds
        are within a tenth of those of many columns.
    dwell : int
        Not read: any switching will do.

    Returns
    -------
    dict

    Raises
    ------
    DesignError
        C differs between modes, too few columns are asked for, or the set grows whatever their number.
    """
    n, C = plant.n_x, [mode.C for mode in plant.observed.modes]
    if any(not np.array_equal(c, C[0]) for c in C):
        raise DesignError(f'{plant.name}: tables = "arbitrary" with a C that differs between modes (found), '
                          'expected the same in all: the sample that ends a block is read with C of the next. '
                          'Use tables = "none".')
    least = int(options.get("order", n + 1))
    if least <= n:
        raise DesignError(f"{plant.name}: observer.order is {least} (found), expected at least {n + 1}: one more than "
                          "the states, for the box and a generator that is kept.")
    chosen = {"directions": compared(plant, gains, options), "limit": np.zeros(n), "set": "blocks"}
    orders = [least] if "order" in options else [least, least + 1, least + 2, least + 4, least + 8]
    sizes = [(o, j) for j in ([int(options["rows"])] if "rows" in options else LENGTHS) for o in orders]
    best, found = settled(followed(plant, gains | chosen, MOST_COLUMNS, LENGTHS[-1])[0]), None
    for order, longest in sizes:
        widths, hulls = followed(plant, gains | chosen, order, longest)
        steady = settled(widths)
        if steady is None:
            continue
        above = np.max(steady / best) if best is not None else np.inf
        if found is None or above < 0.98 * found[0]:
            found = above, {"order": order, "rows": longest, "most": 1.25 * hulls.max(axis=(0, 1))}
        if above <= TABLE_MARGIN:
            break
    if found is None:
        raise DesignError(f'{plant.name}: tables = "arbitrary": the set grows without bound with {orders[-1]} columns '
                          "(found), expected it to settle. Raise observer.order, or take gains that decay faster.")
    return chosen | found[1]


def followed(plant: Plant, gains: dict, order: int, longest: int) -> tuple[Array, Array]:
    """Half widths of the bounds of x and row sums of the set along any sequences, from every error on: (K, S, n_x)."""
    t, _, table = blocks_of(plant, gains, order, longest, "float64")
    n, origins = len(t.box), plant.n_modes + 1 if t.kind == "tnl" else 1
    near = {k: getattr(table, k) for k in ("rows", "scalars", "noise", "powers", "pushed")}
    near |= {k: np.broadcast_to(near[k], (origins, *near[k].shape[1:])) for k in ("scalars", "noise", "pushed")}
    half = np.diag(thresholds.starts(t)[1])
    shape = BlockTables(order=order, weight=half ** -2.0, directions=gains["directions"], e=np.zeros(n), start=half,
                        anywhere=half, most=np.full(n, np.inf), wide=np.full(n, np.inf), **near)
    t = PointTables(**vars(t), shape=shape)
    run, paths = BlockObserver({t.real: t}, Supervision()), np.array(patterns(plant.n_modes, 1, STEPS))
    at = run.whole(t, np.zeros((len(paths), n)))
    origin, widths, hulls = np.full(len(paths), t.origins - 1), [], []
    for p, q in zip(paths.T, paths.T[1:]):
        at = run.moved(t, p, q, origin, at, True)
        origin = p if t.kind == "tnl" else np.zeros_like(p)
        widths.append(run.radius(t, q, origin, at))
        hulls.append(np.abs(run.parts(t, at)[0]).sum(axis=2))
    return np.array(widths), np.array(hulls)


def blocks_of(plant: Plant, gains: dict, order: int, longest: int, real: str):
    """Estimate, error recursion on its numbers, and the tables of blocks in double precision."""
    t = estimate(plant, gains, real)
    m, rows = thresholds.recursion(plant.observed.modes, t), thresholds.directions_of(
        t, gains["directions"].astype(real).astype(float))
    return t, m, block_table(m, rows, longest, order)


def with_blocks(plant: Plant, gains: dict, real: str) -> tuple[PointTables, tuple]:
    """Tables of blocks, before anything is certified."""
    t, _, table = blocks_of(plant, gains, gains["order"], gains["rows"], real)
    shape = blocks.freeze_blocks(BlockTables, plant.observed.modes, t, table, gains["order"], gains["most"])
    return PointTables(**vars(t), shape=shape), (plant.observed.modes,)


def by_time(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Thresholds by time since the switch, or since the start where nobody tells the mode."""
    make = point_sets.tabulated if plant.switching.known else start_tables.chosen
    return make(plant, gains, options, dwell)


#: How the set of each kind is sized.
CHOICES = point_sets.CHOICES | {"dwell": by_time, "schedule": scheduled, "arbitrary": arbitrary}
#: How tables are made that stand for a set.
TABLES = {"thresholds": with_table, "schedule": with_schedule, "blocks": with_blocks,
          "starts": start_tables.with_starts}
