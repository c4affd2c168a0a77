r"""Method "component-interval": an interval observer for bounded changes of the plant, without a sign condition.

Plant ``x+ = (A + dA) x + (B + dB) u``, ``y = C x + v``; dA and dB collect component faults and parameters that are
only known by their bounds. With M = A - L C of either sign::

    x_hi+ = pos(M) x_hi - neg(M) x_lo + B u + L y + |L| v_max + (what dA and dB can do over the box)

an inclusion for every L. Gains by policy iteration (``policy``): no constant L has a smaller steady width.

Source: Lamouchi (2016). Differences from the print:

* The printed observer (10) needs A - L C >= 0; its example has no such L, and the coordinates given for it do not make
  R (A - L C) S nonnegative either (entry -0.5). Taking the bounds by sign needs no coordinates and is narrower than
  every change of coordinates that was found.
* Condition (19) is replaced by the positive recursion of the widths, exact and invariant to scaling.
* The observer is robust against the component faults inside its bounds, so it does not detect them; a copy of the
  plant with these bounds at zero gives a detector.
"""

from __future__ import annotations

from functools import partial

from . import framers

FAMILY = "interval"
SPLIT = True
candidates = partial(framers.candidates_varying, tnl=False, split=True)
inapplicable = partial(framers.inapplicable_varying, tnl=False, split=True)
