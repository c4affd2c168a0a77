r"""Method "lpv-interval": an interval observer scheduled by measured parameters, discrete or sampled.

Plant ``x+ = A_q(theta) x + B_q(theta) u + w``, ``y = C x + v``, all affine in theta; gains ``L_q(theta) = L_q0 + sum_j
theta_j L_qj``::

    x_hi+ = (A(theta) - L(theta) C) x_hi + B(theta) u + L(theta) y + |L(theta)| v_max + w_hi
    x_lo+ = (A(theta) - L(theta) C) x_lo + B(theta) u + L(theta) y - |L(theta)| v_max + w_lo

with A(theta) - L(theta) C >= 0 at every corner of the box of theta, hence in all of it; |L(theta)| is taken at the
measured theta. A continuous plant is first brought to its sampling period (``plant.sampling``): its discrete form is
again affine in theta, with radii for the rest, and gains are designed for that form.

Source: Zammali (2020), Theorems 6 to 10. Differences from the print:

* (3.7), (3.14) leave out "for every corner"; Theorem 7 and Theorem 10 leave out the rows that make A - L C
  nonnegative, and Theorem 10 needs a diagonal P for them.
* Theorems 6 to 8 are run in continuous time there. Explicit Euler of them loses the state (206 of 400 samples at 5 ms
  in the first example); the continuous design has no counterpart here, the sampled plant is designed for directly.
* gamma of Theorems 8 and 10 is blind to |L| v_max; ``criterion = "width"`` is not.
* The bounds of Theorems 8 and 10 lack a square root and the switching factor (``certify.dwell``).
"""

from __future__ import annotations

from functools import partial

from . import framers

FAMILY = "interval"
candidates = partial(framers.candidates_varying, tnl=False)
inapplicable = partial(framers.inapplicable_varying, tnl=False)


def family_for(plant) -> str:
    """Where a step needs the parameters at both its ends it is taken when the second is there: family "tnl"."""
    return "tnl" if plant.reads_both_ends else FAMILY
