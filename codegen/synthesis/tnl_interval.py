r"""Method "tnl-interval": the interval observer that also corrects with the new measurement.

Plant ``x+ = A_q x + B_q u + Bw_q w + Bf_q f``, ``y = C x + Dv v + Df f``; with T + N C = I per mode q::

    x_hi(k+1) = (T A - L C) x_hi(k) + T B u(k) + L y(k) + N y(k+1) + d_hi
    d_hi      = sup(T Bw w) + sup(-L Dv v) + sup(-N Dv v+)

and x_lo alike with inf; T A - L C >= 0 elementwise. T, N, L, d are those of the mode of sample k.

Source: Zammali (2020), Theorems 15 (framer), 16 (common P), 18 (P per mode), (5.23). Differences from the print:

* Noise signs as in method "interval".
* (5.23) prints x_k = xi_k + N_q y_k with q the current mode; it must be the mode that produced xi_k
  (printed form: 19116 lost samples of 32400).
* v(k+1) belongs to the next mode, unknown when d is tabulated: its worst over the modes is taken.
* C must not switch (Remark 18 says it may): T + N C = I would need one N per pair of modes.
* Full rank of T is neither needed nor enforced.
"""

from __future__ import annotations

from functools import partial

from . import framers

FAMILY = "tnl"
candidates = partial(framers.candidates, tnl=True)
inapplicable = partial(framers.inapplicable, tnl=True)
