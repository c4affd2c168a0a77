"""Filters beside a mode estimator in words: their level, what their estimates may be, their constants."""

from __future__ import annotations

import numpy as np

from . import filter_words, mode_words, words
from .table import Fact, Folded, Table, table

WHY = "there is one design: the lowest level in modes that stay"
LIMITS = (
    "That out->mode is the true mode while a fault acts, and with it the estimate: what is excluded may be right then. "
    "After an alarm the mode is the one before it, and the estimates go on.",
    "That the estimate is the fault at every sample: the energy gain bounds the error over a run in one mode, started "
    "from rest.",
    "Which fault it is, where several can act: every fault may move every estimate. The alarm says that no mode "
    "explains the measurements.")


def facts(design, real: str) -> tuple[Fact, ...]:
    """What is said of the filters beside what is said of every design."""
    guided = design.observer.family == "guided_filter"
    beyond = "an alarm bit is set. In one mode" if guided else "a mode is excluded. In one mode"
    cert = design.certificate[real]["told"]
    reached = "" if not cert.get("reached") else (
        f"; a run was found that reaches {words.number(cert['reached'], 4)}: no proof could go below that")
    target = "the fault itself" if "target" not in design.options else "the fault, weighted by W_f (target)"
    return (Fact("Estimate", f"{target}, in the mode that is decided for"),
            Fact("Energy gain from all unknowns to the error of the estimate", "of the worst mode that stays, "
                 f"certified {words.at_most(cert['level'], 4)} on the constants of the C{reached}"),
            Fact("Threshold", "guaranteed" + " while the decision is right" * guided + f": beyond it {beyond} at a "
                 "time, " + "by size of the bounds from which a filter starts and " * (not guided)
                 + "by samples since" + " its start" * guided))


def bounds(design, real: str) -> tuple[Table, ...]:
    """Delays of the mode estimator, and what estimates may be without a fault by mode, at a start and in the end."""
    return *mode_words.delays(design, real), thresholds(design, real, "after an alarm")


def thresholds(design, real: str, when: str) -> Table:
    """What estimates may be without a fault by mode; ``when`` a filter goes on from anywhere."""
    t, plant = design.observer.tables[real].told, design.plant
    rows = [(mode.name, fault.name, *(words.quantity(words.at_most(float(h)), fault.unit) for h in (
        t.h[t.anywhere, 0, q, j], *t.h[:t.anywhere, 0, q, j][[0, -1][:t.anywhere]], t.h[:, -1, q, j].max())))
        for q, mode in enumerate(plant.modes) for j, fault in enumerate(plant.f)]
    starts = ("#at a start, largest bounds", "#smallest bounds") if t.anywhere > 1 else ("#at a start",)
    notes = ((f"A start from bounds of one of {t.anywhere} sizes; " if t.anywhere > 1 else
              "A start from the declared range; ") + f"the last column holds within {words.count(t.last, 'sample')}. "
             f"A filter goes on from anywhere {when} only.",)
    head = ("mode", "fault", "#from anywhere", *starts, "#in the end")
    return table("The largest estimates without a fault, proved", head, rows, notes)


def gains(design, real: str, matrix) -> tuple[Folded, ...]:
    """Tabulate the constants of the C: filters, their starts, the mode estimator; see ``filter_words.gains``."""
    return (*of_filters(design, real, matrix), *mode_words.gains(design, real, matrix, "The mode estimator: "))


def of_filters(design, real: str, matrix) -> tuple[Folded, ...]:
    """Tabulate the constants of filters and their starts."""
    t, x = design.observer.tables[real].told, [s.name for s in design.plant.x]
    xi = [f"xi[{i}]" for i in range(len(t.limit))]
    starts = [matrix(f"E of mode {q}, “{m.name}”: xi at a start, of x", xi, x, t.E[q])
              for q, m in enumerate(design.plant.modes)]
    starts.append(matrix("Half widths of the bounds, by size", [f"size {k}" for k in range(t.anywhere)], x,
                         np.asarray(t.sizes)))
    return (*filter_words.gains(design, real, matrix, t), Folded("Starts of the filters", tuple(starts)))
