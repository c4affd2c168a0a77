"""Tables of a point observer's set that follow a schedule: how many rows, which directions, chosen by computation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from . import point_sets
from .analysis.set_schedule import PhaseTable, phase_table
from .certify import schedules, thresholds
from .certify.set_freeze import freeze_estimate
from .errors import DesignError
from .observers import PointTables, ScheduleTables
from .plant.model import Plant
from .point_sets import ROWS, TABLE_MARGIN, compared, with_table

Array = np.ndarray


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
    lost = late(schedules.freeze_schedule(ScheduleTables, t, table, chosen["directions"]), plant.n_modes)
    if lost is not None:
        raise DesignError(f"{plant.name}: switching.schedule: firmware that starts at sample {lost} of the period never "
                          "finds its place again (found), expected stays that tell it. Use tables = \"dwell\".")
    return tried


def computed(plant: Plant, gains: dict, real: str) -> tuple[SimpleNamespace, object, PhaseTable]:
    """Estimate, error recursion on its numbers, and the table in double precision.

    Raises
    ------
    DesignError
        The errors grow along the schedule.
    """
    modes = plant.observed.modes
    limits = {k: plant.limits(k) for k in ("x", "u", "y")} | {"x0": (plant.x0_lo, plant.x0_hi)}
    t = SimpleNamespace(**freeze_estimate(modes, limits, gains, gains["limit"], real))
    m, (first, anywhere) = thresholds.recursion(modes, t), thresholds.starts(t)
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


def late(z: ScheduleTables, modes: int) -> int | None:
    """Sample of the period from which firmware that starts there still starts anew four periods later; None: nowhere."""
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


#: How the set of each kind is sized.
CHOICES = point_sets.CHOICES | {"schedule": scheduled}
#: How tables are made that stand for a set.
TABLES = {"thresholds": with_table, "schedule": with_schedule}
