"""Observers of states and faults whose weights are at the estimate, checked again: bounds, energy gain, the C.

Standard library only, nothing of residua imported; exact fractions. The faults f are states: rows 0 = -f + f beside the
plant's say that they move as they like. Of x_hat = (I - R) (x, f) - eb + T2 Dd d of ``independent_pairs.py`` they drive
nothing but what rounding leaves, so that weights at it are as near to the plant's as eb says, fault or not, and the set
of ``independent_polytopic.py`` is one of eb for every course of them. What is judged is r less what the faults do to y.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand  # noqa: E402 - stands beside this file
from independent_drift import Drift  # noqa: E402
from independent_faults import with_faults  # noqa: E402
from independent_formula import unknown  # noqa: E402
from independent_pairs import Errors, Plant, scaled  # noqa: E402
from independent_polytopic import check_energy, check_form, check_ranges, check_thresholds, read_c  # noqa: E402
from independent_sector import read_plant  # noqa: E402
from independent_weights import check_weights  # noqa: E402


class Whole(Plant):
    """The plant of (x, f), with the rows of f."""

    def __init__(self, p, count):
        super().__init__(p)
        n, last = len(self.E) - count, len(p["w"]) + len(p["v"]) - count
        step = F(1) if self.T is None else self.T
        for k in range(count):
            for stack, at, value in ((self.A, n + k, F(-1)), (self.Bd, last + k, F(1))):
                for M in stack:
                    M[n + k][at] = value
        for some, base in ((0, self.A), (2, self.Bd)):
            for M, own in zip(self.flow[some], base):
                M[n:] = scaled(step, own[n:])


def main(folder, design, record):
    """Check a folder of such an observer."""
    p = read_plant(design["plant"]["toml"])
    unknown(design["family"] != "polytopic" or p["known"] or p["theta"] or not p["f"])
    whole, count = with_faults(p), len(p["f"])
    plant = Whole(whole, count)
    drift = Drift(plant) if plant.T is not None else None
    for real, t in design["tables"].items():
        cert = design["certificate"][real]
        unknown("waits" in cert["thresholds"] or "calibration" in cert or "energy" not in cert)
        demand(t["faults"] == count, "the number of faults")
        shares = check_weights(t, len(whole["x"]) + len(p["u"]))
        check_ranges(t, p)
        errors = Errors(plant, t, cert["energy"]["T1"], drift)
        errors.shown_x = [row[:-count] + [a - b for a, b in zip(row[-count:], own[-count:])]
                          for row, own in zip(errors.r_x, plant.C)]
        check_form(cert["energy"], "standard", plant)
        check_energy(errors, cert, "state", len(p["x"]))
        check_thresholds(errors, whole, cert["thresholds"], shares)
        print(f"proved for {real}: bounds of the residual around the faults, with rounding, energy gain, contraction")
    read_c(folder, design, record)
