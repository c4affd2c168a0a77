r"""Method "component-interval": an interval observer for bounded changes of the plant, without a sign condition.

Plant ``x+ = (A + dA) x + (B + dB) u``, ``y = C x + v``; dA and dB collect component faults and parameters that are
only known by their bounds. With M = A - L C of either sign::

    x_hi+ = pos(M) x_hi - neg(M) x_lo + B u + L y + |L| v_max + (what dA and dB can do over the box)

an inclusion for every L. Gains by policy iteration (``policy``): no constant L has a smaller steady width.

Source: Lamouchi (2016). Differences from the print:

* The printed observer (10) needs A - L C >= 0; its example has no such L, and the coordinates given for it do not make
  R (A - L C) S nonnegative either (entry -0.5). Taking the bounds by sign needs no coordinates and is narrower
  for the example than every change of coordinates that was found. ``coordinates = "change"`` asks for one, see
  ``coordinates``: for other plants it may be narrower.
* Condition (19) is replaced by the positive recursion of the widths, exact and invariant to scaling.
* The observer is robust against the component faults inside its bounds, so it does not detect them; a copy of the
  plant with these bounds at zero gives a detector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from ..errors import DesignError
from . import coordinates, framers
from .problem import Candidate, Problem

FAMILY = "interval"
SPLIT = True
inapplicable = partial(framers.inapplicable_varying, tnl=False, split=True)


def candidates(plant, options: dict, judge, settled, progress: Callable[[str], None]) -> Iterator[Candidate]:
    """Designs without coordinates, or the one of ``coordinates = "change"``; arguments as ``framers.candidates``.

    Raises
    ------
    DesignError
        Nothing was found; says why.
    """
    if options.get("coordinates") != "change":
        yield from framers.candidates_varying(plant, False, options, judge, settled, progress, split=True)
        return
    if options.get("criterion", "width") != "width":
        raise DesignError(f'{plant.name}: criterion "{options["criterion"]}" is not to be had with coordinates = '
                          '"change", expected "width".')
    try:
        yield from coordinates.candidates(Problem.of(plant, False, split=True), options, progress)
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from error


def check_gains(plant, R, L) -> None:
    """Refuse a change of coordinates of the plant file under which the observer is not positive.

    Parameters
    ----------
    plant : Plant
    R : ndarray (n_x, n_x), L : ndarray (N, n_x, n_y)

    Raises
    ------
    DesignError
    """
    try:
        coordinates.check_given(Problem.of(plant, False, split=True), R, L)
    except DesignError as error:
        raise DesignError(f"{plant.name}: {error}") from error
