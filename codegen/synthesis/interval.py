r"""Method "interval": the classical switched fault-detection interval observer.

Plant ``x+ = A_q x + B_q u + Bw_q w + Bf_q f``, ``y = C_q x + D_q u + Dv_q v + Df_q f``; observer::

    x_hi+ = (A - L C) x_hi + (B - L D) u + L y + d_hi,     d_hi = sup(Bw w) + sup(-L Dv v)
    x_lo+ = (A - L C) x_lo + (B - L D) u + L y + d_lo,     d_lo = inf(Bw w) + inf(-L Dv v)

with A_q - L_q C >= 0 elementwise. A fault is proved when y leaves [C x + D u + Dv v] over the box.

Source: Zammali (2020), Theorems 13 (framer), 14 (common P), 17 (P per mode), (5.2). Differences from the print:

* (5.2) has ``pos(L Dv) v_hi - neg(L Dv) v_lo`` in d_hi; the error equation needs the largest -L Dv v, which
  is another number unless v_lo = -v_hi (measured: 18473 lost samples of 32400 with v in [0, 3]).
* Theorem 13 cites Lemma 3; the discrete-time Lemma 5 is meant.
* A feedthrough D and faults on the state are ours, as is a C that switches (Remark 18).
"""

from __future__ import annotations

from functools import partial

from . import framers

FAMILY = "interval"
candidates = partial(framers.candidates, tnl=False)
inapplicable = partial(framers.inapplicable, tnl=False)
