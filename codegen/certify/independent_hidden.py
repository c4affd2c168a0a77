"""How large a step of a fault must be to leave no mode of a mode estimator possible, checked again.

Standard library only, nothing of residua imported; exact fractions. The stories are those of ``independent_delays.py``
with a constant fault f from sample 0 on, which acts on y there and on the state over every period that follows. What is
alive some samples later must have taken it for its own: the true mode, or a wrong child that it gave birth to while it
lived, since a fault-free child could be alive at the fault's first sample. No child lives until it has the oldest age.
Of each, multipliers of design.json bound the largest f with which it can live, of either sign.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact, number  # noqa: E402 - stands beside this file
from independent_period import LOSS, exponential  # noqa: E402
from independent_sets import times  # noqa: E402
from independent_story import Stories, minus, total  # noqa: E402


class FaultStories(Stories):
    """Stories of one true mode with a fault f from sample 0 on, 0 <= f <= top: f ``seen`` on y, f ``pushed`` on xi."""

    def __init__(self, t, ranges, widths, seen, pushed, room, top):
        super().__init__(t, ranges, widths, [abs(d) * top for d in seen])
        self.seen, self.pushed, self.room = [[d] for d in seen], [[d] for d in pushed], [room * top] * len(pushed)
        self.top, self.at = top, None

    def measured(self, k, now, lo, hi):
        """Rows of y less the truth and the fault."""
        above, below = super().measured(k, now, lo, hi)
        if k < 0:
            return [above, below]
        if k == 0:
            self.at = len(lo)
            lo.append(F(0))
            hi.append(self.top)
        return [(above[0] + [(minus(self.seen), self.at)], above[1]),
                (below[0] + [(self.seen, self.at)], below[1])]

    def truth(self, story, k, a, b):
        """Rows of the true state, which the fault pushes."""
        above, below = super().truth(story, k, a, b)
        if k < 0 or not any(map(any, self.pushed)):
            return [above, below]
        return [(above[0] + [(minus(self.pushed), self.at)], total(above[1], self.room)),
                (below[0] + [(self.pushed, self.at)], total(below[1], self.room))]


def columns(plant, j, S):
    """What one unit of a fault does in every mode to y and to xi, the latter within a room; None: that is not known."""
    names, common = {k: F(repr(float(v))) for k, v in plant.get("constants", {}).items()}, plant.get("common", {})
    out = []
    for m in plant.get("mode", [{}]):
        acts, seen = ([number(row[j], names) for row in m.get(k, common.get(k, []))] for k in ("Bf", "Df"))
        acts, seen, room = acts or [F(0)] * len(S), seen or [F(0)] * len(plant["signals"]["y"]), F(0)
        if any(acts) and plant["time"]["kind"] == "continuous":
            if "theta" in plant["signals"]:
                return None
            A = [[number(e, names) for e in row] for row in m.get("A", common.get("A"))]
            whole = exponential([[*row, b] for row, b in zip(A, acts)] + [[F(0)] * (len(S) + 1)],
                                F(float(plant["time"]["sample_period"])))
            acts, room = [row[-1] for row in whole[:-1]], LOSS
        out.append((seen, times(S, acts), room))
    return out


def check_faults(delays, plant):
    """All sizes that the certificate tells; whether that is known here."""
    cert, t, names = delays.cert, delays.t, [s["name"] for s in plant["signals"]["f"]]
    demand(cert["quiet"] <= cert["ages"], "a child may come of age while a fault begins")
    for f in cert["faults"]:
        j, of = names.index(f["channel"]), f["channel"]
        acts, ends = columns(plant, j, exact(t["S"])), plant["signals"]["f"][j]["range"]
        if acts is None:
            return False
        demand(f["within"] >= 1 and f["after"] >= cert["dwell"] + cert["quiet"], f"when {of} is found")
        name = f"fault{j}" if f["within"] == 1 else f"fault{j}@{f['within']}"
        for sign, end in ((1, F(float(ends[1]))), (-1, -F(float(ends[0])))):
            top = min(end, F(f["upto"])) if "upto" in f else end
            for q, (seen, pushed, room) in enumerate(acts if top > 0 else ()):
                course = name + ("+" if sign > 0 else "-")
                delays.courses[course] = FaultStories(t, delays.ranges, delays.courses["settled"].widths, [
                    sign * d for d in seen], [sign * d for d in pushed], room, top)
                check_mode(delays, course, q, f)
    return True


def check_mode(delays, course, q, f):
    """Every hypothesis that may be alive at the end while mode q stays."""
    size, within, of = F(f["size"]), f["within"], f["channel"]
    own = [(last, dies(delays, course, (q, q, q, None, None, "settled"), last, size)) for last in range(within + 1)]
    demand(any(found is not None for _, found in own), f"nothing bounds the fault of {of} that mode {q} may take")
    dead = next((last for last, found in own if found), None)
    demand(dead is not None, f"mode {q} may live with a fault of {of} of {f['size']:.6g}")
    for born in range(-delays.cert["quiet"], dead):
        last = min(within, born + 1 + delays.cert["ages"])
        for m in (m for m in delays.modes if m != q):
            story = q, q, m, born, None, "settled"
            found = dies(delays, course, story, last, size)
            demand(found is not None, f"nothing bounds the fault of {of} that {story} may take for its own")
            demand(found, f"{story} may live with a fault of {of} of {f['size']:.6g}")


def dies(delays, course, story, last, size):
    """Whether multipliers show that a hypothesis is dead, with any fault or with larger ones; None: there are none."""
    first = -1 if story[3] is None else min(-1, story[3])
    found = None
    for a, b, of, words in delays.words.get((course, story), ()):
        if (a, b) == (first, last):
            stories, program = delays.courses[course], delays.program(course, story, first, last)
            bound = stories.bound(program, delays.read(words), {stories.at: F(1)} if of else {})
            found = (bound <= size if of else bound < 0) or bool(found)
    return found
