"""How large a step of a sensor must be to leave no mode of a mode estimator possible, checked again.

Standard library only, nothing of residua imported; exact fractions. The stories are those of ``independent_delays.py``
with a fault f on y from sample 0 on. What is alive a sample later must have taken it for its own: the true mode, or a
wrong child that was alive at sample -1 or is born since; none of them comes of age meanwhile. Of each, multipliers of
design.json bound the largest f with which it can live, of either sign.
"""

import sys
from fractions import Fraction as F  # noqa: N817 - on every line
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, number  # noqa: E402 - stands beside this file
from independent_story import Stories, minus  # noqa: E402


class FaultStories(Stories):
    """Stories with a step of y from sample 0 on, of f times a direction, 0 <= f <= top."""

    def __init__(self, t, ranges, widths, direction, top):
        super().__init__(t, ranges, widths, [abs(d) * top for d in direction])
        self.direction, self.top, self.at = [[d] for d in direction], top, None

    def measured(self, k, now, lo, hi):
        """Rows of y less the truth and the fault."""
        above, below = super().measured(k, now, lo, hi)
        if k < 0:
            return [above, below]
        if k == 0:
            self.at = len(lo)
            lo.append(F(0))
            hi.append(self.top)
        return [(above[0] + [(minus(self.direction), self.at)], above[1]),
                (below[0] + [(self.direction, self.at)], below[1])]


def column(plant, f):
    """What one unit of a fault does to y, in every mode alike; it does nothing to x."""
    names = {k: F(repr(float(v))) for k, v in plant.get("constants", {}).items()}
    j, common = [s["name"] for s in plant["signals"]["f"]].index(f["channel"]), plant.get("common", {})
    modes = plant.get("mode", [{}])
    acts = [[row[j] for row in m.get("Bf", common.get("Bf", []))] for m in modes]
    seen = [[number(row[j], names) for row in m.get("Df", common.get("Df", []))] for m in modes]
    demand(not any(number(e, names) for some in acts for e in some), f"{f['channel']} acts on the state")
    demand(seen[0] and all(c == seen[0] for c in seen), f"{f['channel']} acts on y alike in all modes")
    return j, seen[0], max(abs(F(float(b))) for b in plant["signals"]["f"][j]["range"])


def check_faults(delays, plant):
    """All sizes that the certificate tells; how many."""
    cert, t = delays.cert, delays.t
    for f in cert["faults"]:
        j, direction, top = column(plant, f)
        demand(f["within"] == 1 and f["after"] >= cert["dwell"] + cert["quiet"], f"when {f['channel']} is found")
        demand(cert["quiet"] + 1 <= cert["ages"], "a child may come of age while a fault acts")
        for sign, name in ((1, f"fault{j}+"), (-1, f"fault{j}-")):
            delays.courses[name] = FaultStories(t, delays.ranges, delays.courses["settled"].widths,
                                                [sign * d for d in direction], top)
            for q in delays.modes:
                stories = [(q, q, q, None, None, "settled")] + [
                    (q, q, m, born, None, "settled") for m in delays.modes if m != q
                    for born in range(-1 - cert["quiet"], 1)]
                for story in stories:
                    check_story(delays, name, story, F(f["size"]), f["channel"])
    return len(cert["faults"])


def check_story(delays, name, story, size, channel):
    """One hypothesis: dead with any fault, or with those of a size."""
    first = -1 if story[3] is None else min(-1, story[3])
    given = {of: words for a, b, of, words in delays.words.get((name, story), ()) if (a, b) == (first, 1)}
    demand(given, f"nothing bounds the fault of {channel} that {story} may take for its own")
    stories, program = delays.courses[name], delays.program(name, story, first, 1)
    for of, words in given.items():
        cost = {stories.at: F(1)} if of else {}
        bound = stories.bound(program, delays.read(words), cost)
        demand(bound <= size if of else bound < 0, f"{story} may live with a fault of {channel} of {float(bound):.6g}")
