"""What ``residua check`` prints about telling modes apart, before any design."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from .analysis.mode_distinguishability import MOST, distinguishability, inapplicable
from .plant.bounded import bounded
from .plant.model import Plant


def telling(p: Plant, out) -> None:
    """Print by when modes can be told apart from inputs and measurements alone.

    Parameters
    ----------
    p : Plant
    out : Console
    """
    if p.n_modes < 2:
        return
    if not p.switching.known and p.polytope is None and not any(set(m.theta_terms) - {"A", "B"} for m in p.modes):
        p = bounded(p)  # what the estimator sees of parameters
    reason = inapplicable(p)
    if reason is not None:
        out.print(f"\ntelling modes apart, if nobody tells the mode: not tested: {reason}")
        return
    s, horizon = p.switching, MOST
    if s.average_dwell is not None:
        horizon = max(1, min(MOST, int(s.average_dwell / p.sample_period + 1e-9)))
    rows = Table(title="\ntelling modes apart, if nobody tells the mode: by the sample after the switch",
                 show_edge=False, title_justify="left", pad_edge=False)
    for name in ("modes", "whatever the input", "best constant input", "seen in the first step"):
        rows.add_column(name, overflow="fold")
    pairs = distinguishability(p, horizon)
    for pair in pairs:
        names = " / ".join(p.modes[q].name for q in (pair.first, pair.second))
        rows.add_row(names, _by(pair.worst, horizon, p), _by(pair.best, horizon, p),
                     "yes" if pair.rate > 0 else "not surely")
    out.print(rows)
    alike = next((pair for pair in pairs if pair.best is None), None)
    if alike is not None:
        first, second = (p.modes[q].name for q in (alike.first, alike.second))
        states = " and ".join(np.array2string(x, precision=4, separator=", ") for x in alike.example["x"])
        out.print(f"  modes {first} and {second} give the same measurements for {horizon + 1} samples, e.g. from x = "
                  f"{states}: nothing that is declared tells them apart within that time. Measure more, bound closer, "
                  "or switch more slowly.", markup=False)
    elif any(pair.worst is None for pair in pairs):
        out.print("  some inputs hide a mode: nobody can be sure of it until the input moves")


def _by(samples: int | None, horizon: int, p: Plant) -> str:
    """By when, in samples and seconds."""
    if samples is None:
        return f"not within {horizon}"
    return f"{samples} ({samples * p.sample_period:.4g} s)"
