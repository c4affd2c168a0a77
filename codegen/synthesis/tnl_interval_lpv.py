r"""Method "tnl-interval-lpv": T, N, L structure for parameters that are not measured, discrete or sampled.

Plant ``x+ = (A + dA) x + (B + dB) u + Bw w``, ``y = C x + Dv v + f`` with dA, dB anything that the bounds of the
parameters allow, at every sample anew; with T + N C = I::

    x_hi+ = (T A - L C) x_hi + T B u + L y + N y+ + d_hi + sum_l |T A_l| max(-x_lo, x_hi) + sum_l |T B_l| |u|

and x_lo mirrored. Parameters that *are* measured schedule A, B and L as in "lpv-interval".

Source: Chevet (2021), section 3. Differences from the print:

* Theirs is a continuous-time observer; here the plant is brought to its sampling period first (``plant.sampling``), so
  that the guarantee holds in firmware, and the discrete form is designed for.
* Their bound (16) lacks a factor 1/alpha and the constant beta, and the constants of the lower framer are those of
  the upper one; x' = -0.1 x + w is a counterexample. The width follows a positive linear recursion instead, which is
  what the criterion "width" minimises and the certificate checks.
* Their interval product (Lemma 2.1) is loose where matrix and vector both contain zero; a bounded unknown s with
  |s| <= 1 contributes exactly |T A_l| times the largest |x|.
* N is a variable of the design, not a given. C N = I would make the observer blind for faults: caps on N are tried
  where the plant has a fault.
* Their detection figures need an output without the fault, which no firmware has (tests/synthesis/test_chevet.py).
"""

from __future__ import annotations

from functools import partial

from . import framers

FAMILY = "tnl"
candidates = partial(framers.candidates_varying, tnl=True)
inapplicable = partial(framers.inapplicable_varying, tnl=True)
