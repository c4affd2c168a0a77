"""What a tracking law did in the loop, beside what is certified of it."""

from __future__ import annotations

from ..analysis.validate import Outcome
from . import words
from .table import Table, table, verdict


def tables(outcomes: list[Outcome]) -> tuple[Table, ...]:
    """One row per figure of every run in which a law steered; nothing where none did.

    Parameters
    ----------
    outcomes : list of Outcome
    """
    rows = [(o.scenario.name, what, words.number(found, 4), words.at_most(most, 4),
             words.share(round(1000 * found / most), 1000), verdict(found <= most, "kept", "BROKEN"))
            for o in outcomes if o.steering is not None for what, found, most in o.steering.figures]
    if not rows:
        return ()
    notes = ("The compiled C in the loop with the true plant, without a fault and with no sample missing: what came "
             "nearest to its certified bound. Nothing was cut there unless the run failed. “Towards the largest”: "
             "references, disturbances and noises at whichever ends drive that input furthest at the middle of all "
             "weights. “The largest energy”: they swing as the tracking error answers most.",)
    head = ("run", "what", "#found", "#certified", "#share", "result")
    return (table("Tracking, held against the certificate", head, rows, notes),)
