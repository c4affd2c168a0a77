"""By when a wrong mode is out of the set of a mode estimator: the delays that design.json states, checked again.

Standard library only, nothing of residua imported; exact fractions. Every story in which a wrong hypothesis lives
longer (``independent_story``) must be refuted, and every width of a box bounded, by multipliers that design.json brings
along: no program is solved here. What the delays are made of:

* the box of the true mode when a switch comes is no wider than ``widths``: after power-up, and a dwell time after a
  switch, at which the children of the right mode that were born in any period leave one hull together;
* the old mode, and the children of others, die in so many samples, from boxes of these widths;
* no wrong child grows as old as the oldest age, at which it would give birth itself;
* after an alarm or a reset every mode begins in its widest box: the wrong ones and their children die in so many
  samples, and once the true mode's box and its children's are as narrow as ``widths`` all of that holds again.
"""

import sys
import tomllib
from fractions import Fraction as F  # noqa: N817 - on every line
from math import floor
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
from independent import demand, exact  # noqa: E402 - stands beside this file
from independent_hidden import check_faults  # noqa: E402
from independent_sets import magnitudes, times  # noqa: E402
from independent_story import Stories, total, up  # noqa: E402

LASTING = 100000


def read(words):
    """Multipliers (row, value) of "e gap y gap y ...": whole numbers times 2^-e."""
    e, *rest = map(int, words.split())
    row, out = -1, []
    for gap, value in zip(rest[::2], rest[1::2], strict=True):
        demand(gap >= 0, "a row that comes twice")
        row += gap + 1
        out.append((row, F(value) / F(2)**e))
    return out


class Delays:
    """The delays of the tables of one number type."""

    def __init__(self, t, cert, ranges):
        self.t, self.cert, self.ranges, self.n, self.p = t, cert, ranges, len(t["S"]), len(t["v_lo"])
        self.modes = range(len(t["Phi"]))
        self.pairs = [(i, j) for i in self.modes for j in self.modes if i != j]
        self.words, self.courses, self.programs, self.moves, self.oldest = {}, {}, {}, {}, 0
        for name, words in cert["witnesses"].items():
            course, *fields = name.split()
            story = tuple(None if f == "-" else int(f) for f in fields[:5]) + (fields[5],)
            when, of = (int(fields[6]), int(fields[7])), tuple(fields[8:])
            self.words.setdefault((course, story), []).append((*when, of, words))
        self.v = [F(b) - F(a) + 2 * c for a, b, c in zip(
            t["v_lo"], t["v_hi"], self.course("settled", exact(cert["widths"])).cut)]
        self.course("begun", [F(b) - F(a) for a, b in zip(t["start_lo"], t["start_hi"])])

    read = staticmethod(read)

    def course(self, name, widths):
        """Stories that begin with boxes of these widths."""
        self.courses[name] = Stories(self.t, self.ranges, widths)
        return self.courses[name]

    def program(self, course, story, first, last):
        """The rows of a story, once."""
        key = course, story, first, last
        if key not in self.programs:
            self.programs.clear()  # that of the last one is asked for again, no other
            self.programs[key] = self.courses[course].program(story, first, last)
        return self.programs[key]

    def alive(self, course, *story):
        """The last sample at which a hypothesis may live, -1 for none; refuted at the next one."""
        begin = min(0, story[3] or 0)
        for first, last, of, words in self.words.get((course, story), ()):
            if not of and first == begin:
                left = self.courses[course].bound(self.program(course, story, first, last), read(words))
                demand(left < 0, f"the hypothesis {story} of {course} boxes may live at sample {last}")
                return last - 1
        return demand(False, f"nothing refutes the hypothesis {story} of {course} boxes")

    def child(self, *story, course="settled"):
        """The same of a child, whose age counts."""
        last = self.alive(course, *story)
        self.oldest = max(self.oldest, last - story[3])
        return last

    def first(self, q, m, begin, course="settled"):
        """The last sample at which mode m, or a wrong child of it, may live where all modes began in one box."""
        k = self.alive(course, q, q, m, None, m, begin)
        return max([k, *(self.child(q, q, other, born, m, begin, course=course) for other in self.modes
                         if other not in (q, m) for born in range(k + 1))])

    def together(self, course, begin):
        """Per mode that stays: the hull of its box and of its children's, and from which sample on it is that."""
        out = {}
        for q in self.modes:
            lives = {m: self.alive(course, q, q, m, None, m, begin) for m in self.modes if m != q}
            at = max(lives.values()) + 1
            stories = [(q, q, q, None, q, begin)]
            stories += [(q, q, q, born, m, begin) for m, k in lives.items() for born in range(k + 1)]
            out[q] = self.hull(course, stories, 0, at), at
        return out

    def hull(self, course, stories, first, at):
        """Widths at a sample of one box around those of all these stories of one run."""
        ends = {(side, r): [] for side in ("hi", "lo") for r in range(self.p, self.n)}
        for story in stories:
            given = {of: words for a, b, of, words in self.words.get((course, story), ()) if (a, b) == (first, at)}
            program = self.program(course, story, first, at)
            if () in given:  # nothing lives that could be wide
                demand(self.courses[course].bound(program, read(given[()])) < 0, f"{story} may live at sample {at}")
                continue
            for (side, r), found in ends.items():
                demand((side, str(r)) in given, f"nothing bounds the box of {story} at sample {at}")
                sign, end = (1 if side == "hi" else -1), program[3]
                found.append(self.courses[course].bound(program, read(given[side, str(r)]), {
                    end[side] + r: F(sign), end["c"] + r: F(-sign)}))
        return self.v + [max(ends["hi", r]) + max(ends["lo", r]) for r in range(self.p, self.n)]

    def narrowed(self, widths, q):
        """Widths of a box of mode q a period later; each end may be rounded."""
        if q not in self.moves:
            s = self.courses["settled"]
            A, B, reach = magnitudes(s.t["Phi"][q]), magnitudes(s.t["Gamma"][q]), s.t["reach"][q]
            terms = total(times(A, exact(self.t["limit"])), times(B, s.umax), map(abs, s.t["shift"][q]), reach)
            self.moves[q] = A, up([2 * a + 2 * s.share * b for a, b in zip(reach, terms)])
        out = total(times(self.moves[q][0], widths), self.moves[q][1])
        return up([min(a, b) for a, b in zip(out, self.v)] + out[self.p:])

    def contracted(self, widths, q, samples):
        """Widths after so many periods in mode q and ever after."""
        for _ in range(samples):
            before, widths = widths, self.narrowed(widths, q)
            if before == widths:
                break
        for _ in range(LASTING):
            later = self.narrowed(widths, q)
            if all(a <= b for a, b in zip(later, widths)):
                return widths
            widths = up([max(a, b * F(1000001, 1000000)) for a, b in zip(widths, later)])
        return demand(False, f"the box of mode {q} grows while the mode stays")

    def within(self, widths, what):
        """Refuse widths beyond those that the stories begin with."""
        for r, (a, b) in enumerate(zip(widths, self.courses["settled"].widths)):
            demand(a <= b, f"the box {what} may be {float(a):.6g} wide in row {r}, {float(b):.6g} is stated")

    def begun(self):
        """After power-up: hull of the true mode's box and its children's, and from which sample on."""
        out = self.together("begun", "start")
        for q, (box, at) in out.items():
            self.within(self.contracted(box, q, max(self.cert["dwell"] - at, 0)), "after power-up")
        return out

    def switched(self):
        """After a switch: how long old modes and children live, hulls of the right mode's children, from when on."""
        old = {(i, j): self.alive("settled", i, j, i, None, None, "settled") for i, j in self.pairs}
        quiet = {(i, m): self.alive("settled", i, i, m, 0, None, "settled") for i, m in self.pairs}
        hulls = {}
        for i, j in self.pairs:
            at, early = old[i, j] + 1, -quiet[i, j]
            demand(at <= min(self.cert["dwell"], self.cert["old"][i][j]), f"delay of the old mode, {i} to {j}")
            stories = [(i, j, j, born, None, "settled") for born in range(early, at)]
            hulls[i, j] = self.hull("settled", stories, early, at), at
            self.within(self.contracted(hulls[i, j][0], j, self.cert["dwell"] - at), f"after {i} became {j}")
        return old, quiet, hulls

    def grown_up(self, begun, quiet, hulls):
        """A child that comes of age gives birth itself: none of the wrong ones does, from the widest box there is."""
        ages, dwell, t = self.cert["ages"], self.cert["dwell"], self.t
        first = ages - max(quiet.values())
        demand(first >= max(at for _, at in hulls.values()), "a child may come of age while the old mode lives")
        whole = self.courses["begun"].widths
        found = [self.contracted(whole, q, 0) for q in self.modes]
        found += [self.contracted(box, q, max(ages - at, 0)) for q, (box, at) in begun.items()]
        found += [self.contracted(box, j, first - at) for (_, j), (box, at) in hulls.items()]
        self.course("early", [max(column) for column in zip(*found)])
        young = max(self.alive("early", i, i, m, 0, None, "settled") for i, m in self.pairs)
        demand(t["ages"] == ages and young + 1 <= min(ages, self.cert["quiet"]), "a wrong child may grow as old")
        demand(dwell >= max(first + young, ages + 1), "the dwell time is shorter than a child may live")

    def check(self):
        """All of it."""
        cert, begun = self.cert, self.begun()
        old, quiet, hulls = self.switched()
        self.grown_up(begun, quiet, hulls)
        for i, j in self.pairs:
            last = old[i, j]
            for m in (m for m in self.modes if m not in (i, j)):
                last = max([last, *(self.child(i, j, m, born, None, "settled")
                                    for born in range(-quiet[i, m], old[i, j] + 1))])
            demand(last + 1 <= min(cert["identified"][i][j], cert["worst"]), f"delay of the decision, {i} to {j}")
        demand(cert["worst"] <= cert["dwell"], "a switch that is identified after the next one")
        for q, m in self.pairs:
            demand(self.first(q, m, "start") + 1 <= cert["start"], f"delay from power-up in mode {q}")
        demand(cert["ages"] >= self.oldest + 1, "a wrong child may come of age")
        if "restart" in cert:
            self.restarted()

    def restarted(self):
        """After an alarm or a reset: from when on the decision is right, and all else holds again."""
        cert, whole = self.cert, [b - a for a, b in zip(exact(self.t["wide_lo"]), exact(self.t["wide_hi"]))]
        self.course("restart", exact(cert["widths"]))
        boxes, widest, calm = self.together("restart", "wide"), [], 0
        for q, (box, at) in boxes.items():
            demand(at <= cert["ages"], "a wrong mode may live as long as a child does until it gives birth")
            widest += [self.contracted(whole, q, 0), self.contracted(box, q, cert["ages"] - at)]
            left = cert["calm"] - at
            demand(left >= 0, f"delay until all holds again in mode {q}")
            calm = max(calm, at + self.narrow(box, q, left))
        self.course("calm", [max(column) for column in zip(*widest)])
        young = max(self.alive("calm", i, i, m, 0, None, "settled") for i, m in self.pairs)
        right = max(self.first(q, m, "wide", course="restart") for q, m in self.pairs) + 1
        demand(cert["ages"] >= max(young, self.oldest) + 1, "a wrong child may come of age after an alarm")
        demand(right <= cert["restart"], "delay of the decision after an alarm")
        demand(max(right, calm + young + 1) <= cert["calm"], "delay until all holds again")

    def narrow(self, widths, q, most):
        """Periods after which a box of a mode that stays is as narrow as stories begin with, for good."""
        final = self.courses["settled"].widths
        for count in range(most + 1):
            if all(a <= b for a, b in zip(widths, final)) and all(
                    a <= b for a, b in zip(self.contracted(widths, q, 0), final)):
                return count
            widths = self.narrowed(widths, q)
        return demand(False, f"after an alarm the box of mode {q} is not narrow again in time")


def check(design, real, ranges):
    """Check the delays of a design; says what of them was."""
    t, cert = design["tables"][real], design["certificate"][real]
    if "witnesses" not in cert:
        return "delays are not checked here"
    plant = tomllib.loads(design["plant"]["toml"])
    s, period = plant["switching"], plant["time"].get("sample_period", 1)
    demand("minimum_dwell" in s or s.get("chatter") == 1, "a dwell time between any two switches")
    dwell, period = (F(repr(float(x))) for x in (s.get("minimum_dwell", s.get("average_dwell")), period))  # as written
    demand(cert["dwell"] <= floor(dwell / period), "dwell time")
    delays = Delays(t, cert, ranges)
    delays.check()
    said = "delays hold" + (", those after an alarm too" if "restart" in cert else "")
    if not cert.get("faults"):
        return said
    if not any(name.startswith("fault") for name in cert["witnesses"]):
        return said + "; sizes of faults are not checked here"
    known = check_faults(delays, plant)
    return said + (", faults of the sizes told are found" if known else "; sizes of faults are not checked here")
