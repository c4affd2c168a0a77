"""Multipliers that prove the delays of ``mode-set``, in whole numbers: kept in design.json for who checks them anew.

A hypothesis is dead where a sum of the rows of its story, with multipliers y >= 0, cannot be met by any point of the
box; a width is bounded by weak duality. Any y >= 0 will do for either, so a solver's y is rounded to as few digits as
prove the same. The names say which story (``mode_delay.Story``), over which samples, of which widths; the rows stand in
the order in which ``mode_delay.Course`` states them.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Binary digits of the largest multiplier that are tried, and what of a width may be lost by rounding.
DIGITS = (6, 9, 12, 16, 22, 30, 53)
LOSS = 1e-4


def stated(kept: dict, widths: Array, sizes: dict[str, float] | None = None) -> dict[str, str]:
    """Print multipliers.

    Parameters
    ----------
    kept : dict
        Name -> (program, multipliers, cost), of ``mode_program.Program``.
    widths : ndarray (n_x,)
        Certified; a bound may lose ``LOSS`` of them.
    sizes : dict, optional
        Of faults, certified, by the name of their course: a bound may lose what it is below that.

    Returns
    -------
    dict
        Name -> "e gap y gap y ...": each whole number y, times 2^-e, after so many rows without any. Of a story that is
        dead at several samples the first one alone.
    """
    out, first = {}, {}
    for name, (_, _, cost) in kept.items():
        if cost is None:
            story, last = name.rsplit(" ", 1)
            first[story] = min(first.get(story, int(last)), int(last))
    for name, (program, y, cost) in kept.items():
        if cost is None and first[name.rsplit(" ", 1)[0]] != int(name.rsplit(" ", 1)[1]):
            continue
        loss, (course, *_, last) = 0.0, name.split()
        if last == "fault":
            loss = sizes[course[:-1]] - float(program.exactly(y, cost))
        elif cost is not None:
            loss = LOSS * float(widths[int(last)])
        out[name] = _shortest(program, y, cost, loss)
    return out


def _shortest(program, y: Array, cost: dict | None, loss: float) -> str:
    """The fewest digits that prove the same, or a bound that is less sharp by so much at most."""
    _, largest = np.frexp(max(float(np.max(y)), 1e-300))
    bound = None if cost is None else program.exactly(y, cost)
    for digits in DIGITS:
        e = digits - int(largest)
        whole = np.rint(np.ldexp(y, e)).astype(np.int64)
        left = program.exactly(np.ldexp(whole.astype(float), -e), cost or {})
        if left < 0 if cost is None else float(left - bound) <= loss:
            break
    words, gap = [str(e)], 0
    for value in whole:
        gap += 1
        if value:
            words += [str(gap - 1), str(int(value))]
            gap = 0
    return " ".join(words)
