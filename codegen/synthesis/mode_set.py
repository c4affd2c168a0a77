"""Which mode is active when nobody tells: set-membership invalidation of hypotheses (mode, age).

Plant: switched, y = C x + D u + v with C, D and v common to the modes, with a dwell time; in continuous time, sampled,
where the mode changes at any instant, or in discrete time, where it changes at samples. Parameters are no inputs of the
estimator: what they do is bounded with the disturbance (``plant.bounded``).

The observer (``observers.mode_set``) has no gains to find: its tables are the sampled plant and bounds of what a switch
within a period adds (``mode_tables``), and the only choice is the oldest age that hypotheses are told apart by, the
least for which the certificate holds.

Source: own; the task is that of Zammali (2020), chapter 4.

Differences from the printed scheme: no derivative of y, so noise is allowed; sampled data; switches within
samples; nothing is assumed of the modes that is not checked (the thesis assumes that they can be told apart).
"""

from __future__ import annotations

from ..errors import DesignError
from .mode_tables import check

#: Options of ``[observer]``: oldest age, samples after which two modes count as not to be told apart, whether what
#: holds after an alarm or a reset is certified too, and samples within which faults are to be found at the latest.
OPTIONS = {"ages": (1, 31), "horizon": (4, 400), "restart": ("open", "certified"), "found_within": (0, 60)}
#: Where the plant file says nothing.
HORIZON = 60
FOUND_WITHIN = 10
OLDEST = 31


def inapplicable(plant) -> str | None:
    """Why a plant cannot have this estimator, with what to change; None if it can."""
    if plant.polytope is not None:
        return "the plant is polytopic (vertices and weights), expected [[mode]] tables."
    if plant.switching.known:
        return "the mode is known at run time, expected switching.known = false."
    if not 2 <= plant.n_modes <= 32:
        return f"the plant has {plant.n_modes} modes, expected 2 to 32."
    s = plant.switching
    if s.average_dwell is None or s.chatter != 1:
        return "no dwell time is declared, expected switching.minimum_dwell."
    if s.average_dwell < 2 * plant.sample_period:
        return (f"the dwell time of {s.average_dwell:.12g} s is less than two samples of {plant.sample_period:g} s. "
                "Sample faster.")
    try:
        check(plant)
    except DesignError as error:
        return str(error).removeprefix(f"{plant.name}: mode-set ")
    return None
