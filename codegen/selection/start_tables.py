"""Tables by size of the start for a mode that nobody tells: which sizes, how many rows, in which directions."""

from __future__ import annotations

import numpy as np

from ..analysis.set_tables import dwell_table
from ..certify import starts, thresholds
from ..observers import PointTables, StartTables
from ..observers.point import centred, outward_up
from ..plant.model import Plant
from .point_sets import ROWS, TABLE_MARGIN, compared
from .set_simulation import estimate

Array = np.ndarray
SIZES = 4  # of a start, beside every error that is possible
WIDER = 2.0  # smallest size over what is left of an error for ever


def chosen(plant: Plant, gains: dict, options: dict, dwell: int) -> dict:
    """Choose directions and rows.

    Parameters
    ----------
    plant : Plant
    gains : dict
        "L", "N", "kind".
    options : dict
        "directions" (for two outputs: spread evenly, 8 unless told); "stages", sizes of a start and one more, else
        ``SIZES``, of sliding modes one; "rows", else the fewest after which all thresholds are within a tenth of those
        of no error at the start.
    dwell : int
        Not read: the table is for one mode at a time.

    Returns
    -------
    dict

    Raises
    ------
    DesignError
        The errors of some mode grow.
    """
    sizes = 1 if options.get("modes") == "sliding" else SIZES  # there every start is from the declared range
    tried = {"directions": compared(plant, gains, options), "limit": np.zeros(plant.n_x), "set": "starts",
             "sizes": int(options.get("stages", sizes + 1)) - 1}
    for rows in (int(options["rows"]),) if "rows" in options else ROWS:
        tried |= {"rows": rows}
        t, least = with_starts(plant, gains | tried, "float64")
        h = np.concatenate([t.shape.h, t.shape.hx], axis=3)[:, :, -1]
        if np.all(h <= TABLE_MARGIN * least[0]):
            break
    return tried


def with_starts(plant: Plant, gains: dict, real: str) -> tuple[PointTables, tuple]:
    """Tables, and what is left for ever with no error at the start, before anything is certified.

    Raises
    ------
    DesignError
        The errors of some mode grow.
    """
    modes, t = plant.observed.modes, estimate(plant, gains, real)
    emitted, n = gains["directions"].astype(real), plant.n_x
    along = thresholds.directions_of(t, emitted.astype(float))
    alone = [thresholds.recursion([mode], starts.alone(t, q)) for q, mode in enumerate(modes)]
    least = np.array([dwell_table(m, 1, np.zeros((n, 1)), along, gains["rows"]).h[0, 0, -1] for m in alone])
    sizes = sizes_of(t, least[:, -n:].max(axis=0), gains["sizes"])
    tables = [[dwell_table(m, 1, H0, along, gains["rows"]) for H0 in starts.errors(t, sizes)] for m in alone]
    return PointTables(**vars(t), shape=starts.freeze_starts(StartTables, t, sizes, tables, emitted)), (least,)


def sizes_of(t, least: Array, count: int) -> Array:
    """Half widths of starts: the declared range, then by equal factors down to little more than what is left for ever.

    Parameters
    ----------
    t : PointTables or its fields
    least : ndarray (n_x,)
        Half widths of bounds of x, with no error at the start.
    count : int

    Returns
    -------
    ndarray (count, n_x)
    """
    whole = centred(t.x_lo, t.x_hi, t.box.dtype)[1].astype(float)
    share = np.linspace(0, 1, count)[:, None] if count > 1 else np.zeros((1, 1))
    return outward_up(whole * np.minimum(WIDER * least / whole, 1.0) ** share, t.box.dtype)
