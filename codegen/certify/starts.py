"""Tables by size of the start and samples since, for one mode at a time: freeze and proof on the numbers of the C.

Each mode is a plant of its own that never switches, each size a table of one stage that begins with it
(``thresholds``, ``set_bounds``). The last of the sizes is every error that is possible while |x_hat| <= box and x is in
its range. So the proof says nothing of switching: who starts the table sees to it that the mode is the same since.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from ..errors import CertificateError
from .exact import rational
from .set_bounds import Room, prove_dwell
from .thresholds import check_middle, claimed_rows, directions_of, emitted_rows, recursion, starts

Array = np.ndarray
OF_A_MODE = ("M", "G", "L", "N", "d", "A", "B", "a", "C", "D", "c")


def alone(t, q: int):
    """The tables of one mode.

    Parameters
    ----------
    t : PointTables or its fields
    q : int
    """
    own = {name: getattr(t, name)[q:q + 1] for name in OF_A_MODE}
    return SimpleNamespace(**vars(t) | own) if isinstance(t, SimpleNamespace) else replace(t, **own)


def errors(t, sizes: Array) -> list[Array]:
    """Generators of the first errors: of each size, and of all that are possible."""
    return [*(np.diag(size.astype(float)) for size in sizes), starts(t)[1]]


def freeze_starts(shape_class, t, sizes: Array, tables: list, directions: Array):
    """Round tables outward.

    Parameters
    ----------
    shape_class : type
        ``StartTables``.
    t : PointTables
    sizes : ndarray (K, n_x)
        As emitted.
    tables : list of list of DwellTable
        By mode and size.
    directions : ndarray (m, n_y)
        As emitted.

    Returns
    -------
    StartTables
    """
    h = np.array([[table.h[0, 0] for table in row] for row in tables]).swapaxes(0, 1)
    h, hx = emitted_rows(t, h, directions)
    return shape_class(sizes=sizes, directions=directions, h=h, hx=hx)


def certificate(t, proof: dict) -> dict:
    """What ``check`` needs beside the tables: the largest width once a mode has lasted for long."""
    last = 2 * (1 + 1e-9) * t.shape.hx[:, :, -1].astype(float).max(axis=(0, 1))
    return {**proof, "set": "starts", "steady_box": {"width": last.tolist(), "hi": (last / 2).tolist(),
                                                     "lo": (last / 2).tolist()}}


def proved(modes, t) -> dict[str, Room]:
    """Prove a table; return by how much it holds.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables

    Returns
    -------
    dict
        "start k in mode q" -> Room.

    Raises
    ------
    CertificateError
        Naming size, mode, row and direction.
    """
    z, h = t.shape, claimed_rows(t)
    if len(z.h) != len(z.sizes) + 1:
        raise CertificateError(f"certificate: {len(z.h)} parts of the table (found) for {len(z.sizes)} sizes of a "
                               "start, expected one more.")
    n, directions, out = len(t.box), directions_of(t, z.directions.astype(float)), {}
    for q, mode in enumerate(modes):
        m = recursion([mode], alone(t, q))
        for k, H0 in enumerate(errors(t, z.sizes)):
            claim = SimpleNamespace(directions=directions, h=h[k:k + 1, q:q + 1], boxes=np.zeros((1, 1, n)), dwell=1,
                                    back=0, coordinates=np.eye(n)[None])
            try:
                out[f"start {k} in mode {q}"] = prove_dwell(m, H0, claim)
            except CertificateError as error:
                raise CertificateError(f"certificate: start {k} in mode {q}: {error}") from None
    return out


def check(modes, t, cert: dict) -> list[str]:
    """Re-check a table; return what is proved, one sentence per claim.

    Parameters
    ----------
    modes : sequence
        The plant's modes.
    t : PointTables
    cert : dict

    Returns
    -------
    list of str

    Raises
    ------
    CertificateError
        Naming size, mode, row and direction.
    """
    z, n = t.shape, len(t.box)
    proved(modes, t)
    check_middle(t)
    width = np.array(cert["steady_box"]["width"])
    if np.any(rational(width) < 2 * np.max(rational(z.hx[:, :, -1]).reshape(-1, n), axis=0)):
        raise CertificateError("certificate: the ultimate width is less than in the table's last rows.")
    return ["the residual lies within its thresholds from a start on while the mode is the same and no fault acts, "
            f"rounding included ({t.real}, with or without fused multiply-add)",
            "x_lo <= x <= x_hi from a start on while the mode is the same and no fault acts", f"the set is {words(z)}",
            f"Ultimate width of each state at most [{', '.join(f'{x:.4g}' for x in width)}], in one mode"]


def words(z) -> str:
    """A table, with what it takes of the flash."""
    count = z.sizes.size + z.directions.size + z.h.size + z.hx.size
    return (f"a table of {count} numbers ({count * z.h.itemsize} bytes of flash), by the size of the start, the mode "
            f"and the samples since: {len(z.sizes)} sizes, and every error that is possible")
