"""Thresholds of filters that start at run time, each in one mode that stays: starts, sizes, sets, rows."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ..algebra.template_set import largest
from ..certify import loose_filter
from ..certify.filter_model import joint_mode
from ..certify.loose_filter import STAYS, alone, tabled
from ..certify.mode_widths import contracted
from ..errors import CertificateError, DesignError
from ..observers import LooseFilter, SlidingTables
from ..plant.model import Plant
from .filter_tables import ABOVE, LENGTH, ROWS, Chooser, above

Array = np.ndarray
SIZES = 4  # of a start, beside anywhere
WIDER = 2.0  # smallest size over half of the widest box of a mode that stays
CLOSE = 1.02  # the last row over what is left for ever, at most
NOTHING = 1e-6  # bounds of what nothing drives, over the largest
SETTLED = 20  # samples after which that is looked at


class StartChooser(Chooser):
    """As ``Chooser``, for filters that start from xi = E x; what is left of that is among the rows.

    Parameters
    ----------
    model : tuple of JointMode
    E : ndarray (n_s, n_x)
    """

    def __init__(self, model: tuple, E: Array):
        self.E = E.astype(float)
        super().__init__(model, STAYS, len(E))

    def seeds(self) -> Array:
        """The unit rows, what is estimated and what is uncertain, and xi - E x."""
        return np.concatenate([super().seeds(), np.hstack([-self.E, np.eye(len(self.E))])])


def follows(A: Array, C: Array, M: Array, L: Array, K: Array, Dy: Array) -> Array:
    """E for which xi = E x stays so, and estimates nothing, as nearly as can be: M E + L C = E A, K E + Dy C = 0.

    Parameters
    ----------
    A : ndarray (n_x, n_x), C : ndarray (n_y, n_x)
        Of the plant.
    M : ndarray (n_s, n_s), L : ndarray (n_s, n_y), K : ndarray (n_f, n_s), Dy : ndarray (n_f, n_y)
        Of the filter.

    Returns
    -------
    ndarray (n_s, n_x)
    """
    n_x, n_s = len(A), len(M)
    both = np.vstack([np.kron(M, np.eye(n_x)) - np.kron(np.eye(n_s), A.T), np.kron(K, np.eye(n_x))])
    return np.linalg.lstsq(both, -np.concatenate([(L @ C).ravel(), (Dy @ C).ravel()]), rcond=1e-9)[0].reshape(n_s, n_x)


def whole_of(x_lo: Array, x_hi: Array, real: str) -> Array:
    """Half widths of the declared range, rounded up (n_x,)."""
    kind = np.finfo(real)
    lo, hi = (b.astype(float) for b in (x_lo, x_hi))
    return (hi - lo) / 2 * (1 + 8 * kind.eps) + 8 * kind.eps * np.maximum(abs(lo), abs(hi)) + 64 * kind.tiny


def sizes_of(mode, x_lo: Array, x_hi: Array, real: str) -> Array:
    """Half widths of starts: the declared range, then by equal factors down to that of a mode that stays.

    Parameters
    ----------
    mode : ModeTables
    x_lo, x_hi : ndarray (n_x,)
    real : {"float32", "float64"}

    Returns
    -------
    ndarray (Z, n_x)
    """
    whole = whole_of(x_lo, x_hi, real)
    first = (mode.wide_hi - mode.wide_lo).astype(float)
    widths = np.max([contracted(mode, first, q, SETTLED) for q in range(len(mode.Phi))], axis=0)
    least = WIDER * (abs(mode.S_inverse).astype(float) @ widths / 2 + mode.x_room)
    share = np.linspace(0, 1, SIZES)[:, None]
    return above(whole * np.minimum(least / whole, 1.0) ** share, real)


def frozen(plant: Plant, constants: dict[str, Array], mode, real: str, most: int | None = None
           ) -> tuple[LooseFilter, list[dict]]:
    """Tables of the filters and the proofs of their thresholds, checked.

    Parameters
    ----------
    plant : Plant
    constants : dict
        M, L, G, K, Dy, Du, rounded.
    mode : ModeTables or SlidingTables
        Of the same number type; with the latter every start is from the declared range.
    real : {"float32", "float64"}
    most : int, optional
        Rows of the sets.

    Returns
    -------
    tables : LooseFilter
    certs : list of dict
        By mode.

    Raises
    ------
    DesignError
        No set is kept, or thresholds do not come down.
    CertificateError
        The exact check refuses the thresholds.
    """
    modes, kind = plant.enclosed.observed.modes, np.finfo(real)
    E = np.array([follows(m.A, m.C, *(constants[k][q].astype(float) for k in ("M", "L", "K", "Dy")))
                  for q, m in enumerate(modes)]).astype(real)
    ranges = {f"{v}_{side}": getattr(mode, f"{v}_{side}") for v in "xuy" for side in ("lo", "hi")}
    sizes = (above(whole_of(mode.x_lo, mode.x_hi, real)[None], real) if isinstance(mode, SlidingTables) else
             sizes_of(mode, mode.x_lo, mode.x_hi, real))
    t = SimpleNamespace(**constants, **ranges, real=real, E=E, limit=np.zeros(E.shape[1], real), sizes=sizes,
                        grow=np.array(1 + 4 * kind.eps, real),
                        floor=np.array(64 * kind.tiny, real))
    kept = [own_set(plant, joint_mode(m, alone(t, q), 0), E[q], most) for q, m in enumerate(modes)]
    t.limit = limits(t, [b for _, _, b in kept])
    bounds = []  # by mode and start: from each sample on the bound there, and the largest from there on
    for q, (cert, found, b) in enumerate(kept):
        try:
            starts = tabled(t, q, found, b, np.array(cert["rows"]))
        except CertificateError as error:
            raise DesignError(f"{plant.name}: {str(error).removeprefix('certificate: ')} Narrow the declared range of "
                              "x, or slow the sampling down.") from None
        final = found.estimate(STAYS, b)
        bounds.append([np.concatenate([np.reshape(rows, (-1, len(final[0]))), final]) for rows in starts])
    tails = [[np.maximum.accumulate(rows[::-1])[::-1] for rows in own] for own in bounds]
    longest, shift = max(int(np.argmax(np.all(rows <= CLOSE * rows[-1], axis=1))) for own in tails for rows in own), 0
    while longest > LENGTH << shift:
        shift += 1
    h = [[table(rows, tail, -(-longest >> shift), shift) for rows, tail in zip(*own)] for own in zip(bounds, tails)]
    out = LooseFilter(**vars(t), h=above(np.moveaxis(np.array(h), 0, 2), real), shift=shift)
    certs = [cert | {"bounds": b[0].tolist()} for cert, _, b in kept]
    for demand in loose_filter.demands(modes, out, certs):
        demand.require()
    return out, certs


def table(rows: Array, tail: Array, count: int, shift: int) -> Array:
    """Rows of a start, each for 2^shift samples, and one for ever: (count + 1, n_f).

    Parameters
    ----------
    rows : ndarray (K, n_f)
        Bounds by samples since the start, the last for ever.
    tail : ndarray (K, n_f)
        The largest from each of them on.
    count, shift : int
    """
    part = [rows[min(k << shift, len(rows) - 1):(k + 1) << shift].max(axis=0) if k << shift < len(rows) else rows[-1]
            for k in range(count)]
    return np.array([*part, tail[min(count << shift, len(tail) - 1)]])


def own_set(plant: Plant, model, E: Array, most: int | None) -> tuple:
    """A set of plant and filter in one mode that stays: its certificate, what follows from it, its bounds.

    Raises
    ------
    DesignError
    """
    chooser = StartChooser((model,), E)
    low = chooser.reached(np.concatenate(chooser.O))
    kept = chooser.kept(chooser.grown(most or ROWS, low))
    # What nothing drives comes down from a start, but never to zero.
    b = None if kept is None else chooser.settled(kept[1], np.where(
        kept[2] > 0, kept[2], NOTHING * np.max(kept[2])) * ABOVE)
    if b is None:
        raise DesignError(f"{plant.name}: no set of plant and filter is kept in a mode that stays, under this "
                          "uncertainty (found none), so there is no threshold. State narrower bounds, or raise "
                          "observer.set_rows.")
    return *kept[:2], b


def limits(t, bounds: list[Array]) -> Array:
    """Limits of xi, which no mode reaches without a fault, nor measurements and inputs within their ranges alone."""
    n_x, n_s, out = len(t.x_lo), t.M.shape[1], []
    for q, b in enumerate(bounds):
        pushed = [t.L[q] * np.maximum(abs(t.y_lo), abs(t.y_hi)), t.G[q] * np.maximum(abs(t.u_lo), abs(t.u_hi))]
        driven = largest([t.M[q].astype(float)], [np.concatenate(pushed, axis=1).astype(float)], np.eye(n_s),
                         np.zeros((121, 1), int)).max(axis=0)
        out.append(np.maximum(driven, b[0, n_x:n_x + n_s]))
    return above(1.5 * np.max(out, axis=0) + 1e-30, t.real)
