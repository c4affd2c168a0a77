"""How large a step of a sensor must be to leave no mode possible while the mode stays: ``mode-set`` finds it surely.

The stories are those of ``mode_delay`` with one variable more, the fault f, which acts on y from sample 0 on. Whatever
is alive then may have taken the fault for its own: the true mode itself, and every child of it that is alive at sample
-1 or is born later. The largest f with which one of them can live is a linear program, bounded surely by its dual; any
larger one, of either sign, kills them all. None of them comes of age meanwhile, so that there are no others. Framers
that cut the boxes further (``observers.driven``) only help.
"""

from __future__ import annotations

import numpy as np

from .mode_delay import Course, Story

Array = np.ndarray
#: Samples after the first one with the fault.
WITHIN = 1


class FaultCourse(Course):
    """Stories with a step of the outputs from sample 0 on.

    Parameters
    ----------
    claims : Claims
    widths : ndarray (n_x,)
    direction : ndarray (n_y,)
        What one unit of the fault does to y; with the sign of the fault.
    top : float
        Largest fault.
    name : str
        Of the fault, where multipliers are kept.
    """

    def __init__(self, claims, widths: Array, direction: Array, top: float, name: str = ""):
        super().__init__(claims.t, *claims.x, *claims.u, widths, claims.kept, name)
        self.direction, self.top, self.more = direction, top, np.abs(direction) * top

    def _measured(self, out, k: int, now: dict) -> None:
        if k < 0:
            super()._measured(out, k, now)
            return
        if k == 0:
            out.fault = out.variables([0.0], [self.top])
        one, d = np.eye(self.p), self.direction[:, None]
        out.below([(one, now["y"]), (-one, now["xi"][:self.p]), (-d, out.fault)], self.t.v_hi)
        out.below([(-one, now["y"]), (one, now["xi"][:self.p]), (d, out.fault)], -self.t.v_lo)


def largest_hidden(claims, widths: Array, quiet: int, direction: Array, top: float, name: str = "") -> float:
    """A sure upper bound of the step that some hypothesis survives; infinite where none can be given.

    Parameters
    ----------
    claims : Claims
    widths : ndarray (n_x,)
        Of the box of the established mode.
    quiet : int
        Age that a wrong child does not reach while the mode stays, without fault.
    direction : ndarray (n_y,)
    top : float
    name : str
        Of the fault, where multipliers are kept.

    Returns
    -------
    float
    """
    if quiet + WITHIN > claims.t.ages:  # a child might come of age
        return np.inf
    worst = 0.0
    for sign in (1, -1):
        course = FaultCourse(claims, widths, sign * direction, top, f"{name}{'+' if sign > 0 else '-'}")
        for true in claims.modes:
            stories = [Story(true, true, true)]
            stories += [Story(true, true, m, born) for m in claims.modes if m != true
                        for born in range(-1 - quiet, WITHIN)]
            for story in stories:
                program, _ = course.told(story, min(-1, -1 if story.born is None else story.born), WITHIN)
                worst = max(worst, program.most({int(program.fault[0]): 1.0}, "fault"))
                if worst >= top * (1 - 1e-6):
                    return np.inf
    return worst * (1 + 1e-9)


def surely_found(plant, claims, widths: Array, quiet: int) -> list[dict]:
    """State the faults of sensors that leave no mode possible.

    Parameters
    ----------
    plant : Plant
    claims : Claims
    widths : ndarray (n_x,)
    quiet : int

    Returns
    -------
    list of dict
        "channel", "size" from which on it is found, "within" samples after its first, "after": samples since power-up
        and the last switch. A channel that acts on the state, or of which no size is sure, is none of them.
    """
    out = []
    for j, f in enumerate(plant.f):
        columns = [m.Df[:, j] for m in plant.modes]
        top = max(abs(f.lo), abs(f.hi))
        if any(np.any(m.Bf[:, j]) for m in plant.modes) or not np.isfinite(top) or any(
                not np.array_equal(c, columns[0]) for c in columns) or not np.any(columns[0]):
            continue
        size = largest_hidden(claims, widths, quiet, columns[0], top, f"fault{j}")
        if np.isfinite(size):
            out.append({"channel": f.name, "size": float(size), "within": WITHIN, "after": claims.dwell + quiet})
        elif claims.kept is not None:
            for name in [n for n in claims.kept if n.startswith((f"fault{j}+ ", f"fault{j}- "))]:
                claims.kept.pop(name)
    return out
