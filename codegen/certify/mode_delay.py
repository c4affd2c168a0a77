"""How long a wrong mode can survive in ``mode-set``: a linear program that is exact about the estimator itself.

A *story* is a true course (mode i, perhaps a switch to j within the period after sample 0) and one hypothesis: the old
mode, or a child of it born in some period. Unknown are the true states, inputs, measurements and the hypothesis's
box at every sample. A box that is at least as small as cut and prediction allow and not empty satisfies

    lo[k+1] >= (lower end of the prediction from lo[k], hi[k]),  lo[k] >= y[k] - v_hi,  lo[k] <= hi[k],

and the mirrored lines; by monotonicity such a box exists exactly where the box of the estimator is not empty. All of
it is linear, so "dead at sample p" is infeasibility, with a witness (``mode_program``). Two things are enclosed instead
of met exactly: what a switch within a period adds (between 0 and a box: its convex hull in the state), and disturbances
(a box per period).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..algebra.interval import neg, pos
from .mode_program import Program, outward

Array = np.ndarray


@dataclass(frozen=True)
class Story:
    """True course and hypothesis.

    Parameters
    ----------
    old, new : int
        True mode up to sample 0, and after the switch within the period that follows; equal: no switch.
    wrong : int
        Mode of the hypothesis; ``old`` itself, or that of a child.
    born : int or None
        The child is born in the period after this sample; None: the hypothesis is the old mode.
    parent : int or None
        Mode of the established hypothesis that survives or gives birth; None: ``old``.
    begin : {"settled", "start", "wide"}
        Its box at the first sample: around the truth, of the widths of the course; or that of power-up; or that after
        an alarm.
    """

    old: int
    new: int
    wrong: int
    born: int | None = None
    parent: int | None = None
    begin: str = "settled"

    @property
    def name(self) -> str:
        """Its fields in a row."""
        return " ".join("-" if x is None else str(x) for x in (self.old, self.new, self.wrong, self.born, self.parent,
                                                               self.begin))

    @property
    def source(self) -> int:
        """Mode of the established hypothesis."""
        return self.old if self.parent is None else self.parent


class Course:
    """Builds the program of a story.

    Parameters
    ----------
    t : ModeTables
    x_lo, x_hi : ndarray (n_x,)
        Declared ranges of the state.
    u_lo, u_hi : ndarray (n_u,)
    widths : ndarray (n_x,)
        Largest width of the box of an established true mode when the story begins.
    kept : dict or None
        As of ``mode_program.Program``.
    name : str
        Of these widths.
    """

    def __init__(self, t, x_lo, x_hi, u_lo, u_hi, widths, kept: dict | None = None, name: str = ""):
        self.t, self.widths, self.kept, self.name = t, widths, kept, name
        self.x, self.u = (x_lo, x_hi), (u_lo, u_hi)
        self.n, self.p = t.Phi.shape[1], len(t.v_lo)
        self.more = np.zeros(self.p)  # of a fault
        self.u_most = np.maximum(np.abs(u_lo), np.abs(u_hi))
        # The estimator rounds; here its boxes are exact. So they may be larger there by this share of their terms.
        self.rounding = (4 * self.n + 2 * len(u_lo) + 16) * float(np.finfo(t.real).eps)

    def reach_of_boxes(self, samples: int) -> tuple[Array, Array]:
        """Bounds on |lo|, |hi| of any hypothesis over so many samples: before its birth, and at all."""
        t, p = self.t, self.p
        seen = np.maximum(np.abs(t.wide_lo), np.abs(t.wide_hi))
        noise = np.maximum(np.abs(t.v_lo), np.abs(t.v_hi))
        plain = seen + self.widths
        once = plain
        for _ in range(samples + 1):
            pairs = [self._grown(q, plain, once) for q in range(len(t.Phi))]
            plain = np.max([plain, *(a for a, _ in pairs)], axis=0)
            once = np.max([once, plain, *(b for _, b in pairs)], axis=0)
            for size in (plain, once):
                size[:p] = seen[:p] + 3 * noise + self.more
        return 1.001 * plain, 1.001 * once

    def _grown(self, q: int, plain: Array, once: Array) -> tuple[Array, Array]:
        """One period in mode q, of boxes without and with a birth behind them."""
        t, A = self.t, np.abs(self.t.Phi[q])
        move = np.abs(t.Gamma[q]) @ self.u_most + np.abs(t.shift[q]) + np.max(t.birth[:, q], axis=0) + t.reach[q]
        jumps = [(np.abs(t.J[i, q]) + t.J_radius[i, q]) @ plain + t.J_reach[i, q] + np.abs(t.J_shift[i, q])
                 + (np.abs(t.J_u[i, q]) + t.J_u_radius[i, q]) @ self.u_most for i in range(len(t.Phi))]
        return A @ plain + move, np.maximum(A @ once, A @ plain + np.max(jumps, axis=0)) + move

    def program(self, story: Story, last: int) -> Program:
        """The story up to sample ``last``, the hypothesis alive at all of them."""
        return self.told(story, min(0, 0 if story.born is None else story.born), last)[0]

    def told(self, story: Story, first: int, last: int) -> tuple[Program, dict]:
        """The story from sample ``first`` on, and the variables of the last sample.

        Among them "c", a point that any two stories of one run share: the middle of the first box, carried on by the
        true modes and the measurements.
        """
        t, n, p = self.t, self.n, self.p
        out = Program(self.kept, f"{self.name} {story.name} {first} {last}")
        lost = np.abs(t.S_inverse.astype(float) @ t.S - np.eye(n)) @ np.max(np.abs(self.x), axis=0)
        plain, most = self.reach_of_boxes(last - first)
        now: dict[str, Array] = {}
        for k in range(first, last + 1):
            before, now = now, {}
            now["xi"] = out.variables(t.wide_lo, t.wide_hi)
            now["u"] = out.variables(*self.u)
            now["y"] = out.variables(t.wide_lo[:p] - 2 * neg(t.v_lo) - self.more,  # noise may be of one sign
                                     t.wide_hi[:p] + 2 * pos(t.v_hi) + self.more)
            now["lo"], now["hi"] = out.variables(-most, most), out.variables(-most, most)
            now["c"] = out.variables(-2 * most, 2 * most)
            self._reference(out, story, k - 1, before if k > first else None, now)
            room = lost + 1e-9 * (1 + np.abs(self.x[0]) + np.abs(self.x[1]))  # S_inverse is rounded
            out.below([(t.S_inverse, now["xi"])], self.x[1] + room)
            out.below([(-t.S_inverse, now["xi"])], -self.x[0] + room)
            unit = np.eye(n)
            self._measured(out, k, now)
            seen = np.maximum(np.abs(t.wide_lo), np.abs(t.wide_hi))[:p] + 2 * np.abs(t.D) @ self.u_most + self.more
            cut = self.rounding * (seen + np.abs(t.v_lo) + np.abs(t.v_hi))
            out.below([(np.eye(p), now["y"]), (-np.eye(p), now["lo"][:p])], t.v_hi + cut)
            out.below([(-np.eye(p), now["y"]), (np.eye(p), now["hi"][:p])], -t.v_lo + cut)
            out.below([(unit, now["lo"]), (-unit, now["hi"])], np.zeros(n))
            if k == first and story.begin != "settled":
                lo, hi = (t.start_lo, t.start_hi) if story.begin == "start" else (t.wide_lo, t.wide_hi)
                for name in ("lo", "hi", "xi"):
                    out.below([(unit, now[name])], hi)
                    out.below([(-unit, now[name])], -lo)
                continue
            if k == first:  # the old mode was the true one: its box holds the truth
                out.below([(unit, now["lo"]), (-unit, now["xi"])], np.zeros(n))
                out.below([(unit, now["xi"]), (-unit, now["hi"])], np.zeros(n))
                out.below([(unit, now["hi"]), (-unit, now["lo"])], outward(self.widths))
                continue
            self._truth(out, story, k - 1, before, now)
            self._hypothesis(out, story, k - 1, before, now, plain)
        return out, now

    def _measured(self, out: Program, k: int, now: dict) -> None:
        one, xi = np.eye(self.p), now["xi"][:self.p]
        out.below([(one, now["y"]), (-one, xi)], self.t.v_hi)
        out.below([(-one, now["y"]), (one, xi)], -self.t.v_lo)

    def _reference(self, out: Program, story: Story, k: int, a: dict | None, b: dict) -> None:
        t, p, unit = self.t, self.p, np.eye(self.n)
        both = [(unit[:p], b["c"]), (-np.eye(p), b["y"])]
        out.below(both, np.zeros(p))
        out.below([(-M, idx) for M, idx in both], np.zeros(p))
        if a is None:
            middle = [(unit[p:], b["c"]), (-unit[p:] / 2, b["lo"]), (-unit[p:] / 2, b["hi"])]
            right = np.zeros(self.n - p)
        else:
            q = story.old if k < 0 else story.new
            middle = [(unit[p:], b["c"]), (-t.Phi[q][p:], a["c"]), (-t.Gamma[q][p:], a["u"])]
            right = t.shift[q][p:]
        out.below(middle, outward(right))
        out.below([(-M, idx) for M, idx in middle], outward(-right))

    def _truth(self, out: Program, story: Story, k: int, a: dict, b: dict) -> None:
        t, unit = self.t, np.eye(self.n)
        switch = k == 0 and story.new != story.old
        q = story.old if k < 0 else story.new
        A, B, c = t.Phi[q], t.Gamma[q], t.shift[q]
        reach = t.birth[story.old, q] if switch else t.reach[q]
        upper = [(unit, b["xi"]), (-A, a["xi"]), (-B, a["u"])]
        lower = [(-unit, b["xi"]), (A, a["xi"]), (B, a["u"])]
        if not switch:
            out.below(upper, outward(c + reach))
            out.below(lower, outward(-c + reach))
            return
        i = story.old
        radius = self._radius(i, q, np.maximum(np.abs(t.wide_lo), np.abs(t.wide_hi)))
        z_lo, z_hi = self._values(i, q, t.wide_lo, t.wide_hi)
        J, Ju, Jc = t.J[i, q], t.J_u[i, q], t.J_shift[i, q]
        slope, level = chord(z_lo + radius, z_hi + radius)  # added: between 0 and z +- radius
        out.below([*upper, (-slope[:, None] * J, a["xi"]), (-slope[:, None] * Ju, a["u"])],
                  outward(c + reach + slope * (Jc + radius) + level))
        slope, level = chord(-z_hi + radius, -z_lo + radius)
        out.below([*lower, (slope[:, None] * J, a["xi"]), (slope[:, None] * Ju, a["u"])],
                  outward(-c + reach + slope * (-Jc + radius) + level))

    def _radius(self, i: int, j: int, size: Array) -> Array:
        t = self.t
        return outward(t.J_radius[i, j] @ size + t.J_u_radius[i, j] @ self.u_most + t.J_reach[i, j])

    def _values(self, i: int, j: int, lo: Array, hi: Array) -> tuple[Array, Array]:
        """Range of what a switch can add per unit of its share, the radius left out."""
        t = self.t
        M, c = np.hstack([t.J[i, j], t.J_u[i, j]]), t.J_shift[i, j]
        low, high = np.concatenate([lo, self.u[0]]), np.concatenate([hi, self.u[1]])
        return pos(M) @ low - neg(M) @ high + c, pos(M) @ high - neg(M) @ low + c

    def _hypothesis(self, out: Program, story: Story, k: int, a: dict, b: dict, most: Array) -> None:
        t, unit = self.t, np.eye(self.n)
        birth = story.born is not None and k == story.born
        q = story.wrong if story.born is not None and k >= story.born else story.source
        P, N, B, c = pos(t.Phi[q]), neg(t.Phi[q]), t.Gamma[q], t.shift[q]
        reach = t.birth[story.source, q] if birth else t.reach[q]
        terms = np.abs(t.Phi[q]) @ most + np.abs(B) @ self.u_most + np.abs(c) + reach
        if birth:
            source = story.source
            terms = terms + (np.abs(t.J[source, q]) + t.J_radius[source, q]) @ most + np.abs(t.J_shift[source, q])
            terms = terms + (np.abs(t.J_u[source, q]) + t.J_u_radius[source, q]) @ self.u_most
            terms = terms + t.J_reach[source, q]
        reach = reach + self.rounding * terms
        lower = [(-unit, b["lo"]), (P, a["lo"]), (-N, a["hi"]), (B, a["u"])]
        upper = [(unit, b["hi"]), (-P, a["hi"]), (N, a["lo"]), (-B, a["u"])]
        if not birth:
            out.below(lower, outward(-c + reach))
            out.below(upper, outward(c + reach))
            return
        i = story.source
        radius = self._radius(i, q, most)
        z_lo, z_hi = self._values(i, q, -most, most)
        J, Ju, Jc = t.J[i, q], t.J_u[i, q], t.J_shift[i, q]
        slope, level = chord(z_lo + radius, z_hi + radius)
        out.below([*upper, (-slope[:, None] * pos(J), a["hi"]), (slope[:, None] * neg(J), a["lo"]),
                   (-slope[:, None] * Ju, a["u"])], outward(c + reach + slope * (Jc + radius) + level))
        slope, level = chord(-z_hi + radius, -z_lo + radius)
        out.below([*lower, (slope[:, None] * pos(J), a["lo"]), (-slope[:, None] * neg(J), a["hi"]),
                   (slope[:, None] * Ju, a["u"])], outward(-c + reach + slope * (-Jc + radius) + level))


def chord(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Least line above max(0, z) on [lo, hi]: max(0, z) <= slope z + level."""
    slope = np.where(lo >= 0, 1.0, np.where(hi <= 0, 0.0, hi / np.maximum(hi - lo, 1e-300)))
    level = np.where((lo >= 0) | (hi <= 0), 0.0, -slope * lo * (1 + 1e-12))
    return slope, level


def survival(course: Course, story: Story, most: int, guess: int | None = None) -> int:
    """Last sample at which the hypothesis may be alive; ``most`` where it may be alive there too.

    Parameters
    ----------
    course : Course
    story : Story
    most : int
        Horizon.
    guess : int or None
        Where to begin, such as the answer of a similar story.

    Returns
    -------
    int
    """
    low = max(0 if story.born is None else story.born, 0)
    step, high = 1, max(low + 1, min(most, low + 1 if guess is None else guess + 1))
    least = low

    def dead(sample: int) -> bool:
        return course.program(story, sample).infeasible()

    while not dead(high):
        if high >= most:
            return most
        low, high, step = high, min(high + step, most), 2 * step
    step = 1
    while low == least and high - low > step and guess is not None:  # downwards from the guess
        if not dead(high - step):
            low = high - step
            break
        high, step = high - step, 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        if dead(middle):
            high = middle
        else:
            low = middle
    return low
