"""What a tracking law is asked for: outputs that follow, how far, how fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DesignError
from ..plant.model import Plant
from ..synthesis.tracking import Speed


@dataclass(frozen=True)
class Task:
    """What is to be tracked, and how fast.

    Parameters
    ----------
    rows : tuple of int
        Outputs that follow the reference.
    reference : tuple of float
        Largest magnitude of each reference.
    observer, feedback : Speed
        Of the modes, in 1/s.
    effort : float
        Price of an input at the end of its range against a tracking error as large as the reference.
    """

    rows: tuple[int, ...]
    reference: tuple[float, ...]
    observer: Speed
    feedback: Speed
    effort: float


def task_of(plant: Plant, options: dict) -> Task:
    """The task of a plant file; speeds that suit the period where none are given.

    Parameters
    ----------
    plant : Plant
    options : dict
        Of ``[observer]``.

    Raises
    ------
    DesignError
        A name is no output, a reference is not above 0, or there are more references than inputs.
    """
    names, track = [s.name for s in plant.y], options.get("track", {})
    for name, most in track.items():
        if name not in names:
            raise DesignError(f'{plant.name}: observer.track.{name} is no output (found), expected one of '
                              f"{', '.join(names)}.")
        if isinstance(most, bool) or not isinstance(most, int | float) or not 0 < most < np.inf:
            raise DesignError(f"{plant.name}: observer.track.{name} is {most!r} (found), expected a number above 0: "
                              "the largest magnitude of its reference.")
    if not 0 < len(track) <= plant.n_u:
        raise DesignError(f"{plant.name}: observer.track names {len(track)} outputs (found), expected 1 to "
                          f"{plant.n_u}, as many as there are inputs at most: {{ output = largest reference }}.")
    fast = 1 / plant.sample_period
    seen = Speed(float(options.get("observer_decay", 0.03 * fast)), float(options.get("observer_fastest", 0.2 * fast)))
    feedback = Speed(float(options.get("decay", 0.01 * fast)), float(options.get("fastest", 0.05 * fast)))
    for speed, prefix in ((seen, "observer_"), (feedback, "")):
        if not speed.decay < speed.fastest:
            raise DesignError(f"{plant.name}: observer.{prefix}decay is {speed.decay:.4g} 1/s (found), expected less "
                              f"than observer.{prefix}fastest, {speed.fastest:.4g} 1/s.")
    return Task(tuple(names.index(name) for name in track), tuple(map(float, track.values())), seen, feedback,
                float(options.get("effort", 0.3)))
