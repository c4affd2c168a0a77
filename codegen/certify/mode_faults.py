"""How large a step of a fault must be to leave no mode possible while the mode stays: ``mode-set`` finds it surely.

The stories are those of ``mode_delay`` with one variable more, the fault f, which is constant from sample 0 on: it acts
on y there, and on the state over every period that follows, held as inputs are. Whatever is alive N samples later has
taken the fault for its own:

* the hypothesis of the true mode, which is not dead by then;
* or a child of it, born while it lived: not before the samples that a wrong child may live without a fault. It is told
  apart from what was established until it has reached the oldest age; where it is dead by that age, or after N samples,
  it never gives birth, and there are no others than these.

The largest f with which one of them can live is a linear program, bounded surely by its dual; any larger one kills it,
as what it can live with is an interval. A child may explain a large fault as the switch that it looks like, and no
smaller one: then what is promised is bounded from above, by the least f with which it can live. What cuts the boxes
further or rules out more modes (``observers.driven``, ``follower``, ``trailing``) only helps: the rows of a story hold
for every box that is no larger than cut and prediction allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, ctx

from .mode_delay import Course, Story
from .mode_enclosure import PRECISION, ball, exponential
from .mode_program import outward

Array = np.ndarray
#: A promise for more samples is made where it is about faults smaller, or larger ones too, by this share.
BETTER = 0.05


@dataclass(frozen=True)
class Channel:
    """What one unit of a fault does, per mode.

    Parameters
    ----------
    name : str
    seen : ndarray (N, n_y)
        To y.
    pushed, off : ndarray (N, n_x)
        To S x over a period, and by how much that may be off.
    top : dict
        Sign -> largest size of that sign; a sign that the range has not is left out.
    """

    name: str
    seen: Array
    pushed: Array
    off: Array
    top: dict[int, float]


def channel(plant, t, j: int) -> Channel:
    """Fault j of a plant; the push is calculated in balls.

    Parameters
    ----------
    plant : Plant
        Without parameters.
    t : ModeTables
    j : int

    Returns
    -------
    Channel
    """
    n, f, before = plant.n_x, plant.f[j], ctx.prec
    pushed, off = np.zeros((2, plant.n_modes, n))
    ctx.prec = PRECISION
    try:
        for q, mode in enumerate(plant.modes):
            if not mode.Bf[:, j].any():
                continue
            push = ball(mode.Bf[:, j])
            if plant.kind == "continuous":
                whole = ball(np.zeros((n + 1, n + 1)))
                whole[:n, :n], whole[:n, n] = ball(mode.A), push
                push = exponential(whole, arb(float(plant.sample_period)))[:n, n]
            for r, value in enumerate(ball(t.S) @ push):
                pushed[q, r] = float(value.mid())
                off[q, r] = np.nextafter(float(abs(value - arb(pushed[q, r])).abs_upper()), np.inf)
    finally:
        ctx.prec = before
    ends = {1: f.hi, -1: -f.lo}
    return Channel(f.name, np.array([m.Df[:, j] for m in plant.modes]), pushed, off,
                   {sign: float(end) for sign, end in ends.items() if end > 0})


class FaultCourse(Course):
    """Stories of one true mode with a step of a fault from sample 0 on.

    Parameters
    ----------
    claims : Claims
    widths : ndarray (n_x,)
    seen : ndarray (n_y,), pushed : ndarray (n_x,), off : ndarray (n_x,)
        Rows of ``Channel`` of that mode, with the sign of the fault.
    top : float
        Largest fault.
    name : str
        Of the fault, where multipliers are kept.
    """

    def __init__(self, claims, widths: Array, seen: Array, pushed: Array, off: Array, top: float, name: str = ""):
        super().__init__(claims.t, *claims.x, *claims.u, widths, claims.kept, name)
        self.seen, self.pushed, self.off = seen[:, None], pushed[:, None], off * top
        self.top, self.more = top, np.abs(seen) * top

    def _measured(self, out, k: int, now: dict) -> None:
        if k < 0:
            super()._measured(out, k, now)
            return
        if k == 0:
            out.fault = out.variables([0.0], [self.top])
        one, d = np.eye(self.p), self.seen
        out.below([(one, now["y"]), (-one, now["xi"][:self.p]), (-d, out.fault)], self.t.v_hi)
        out.below([(-one, now["y"]), (one, now["xi"][:self.p]), (d, out.fault)], -self.t.v_lo)

    def _truth(self, out, story: Story, k: int, a: dict, b: dict) -> None:
        if k < 0 or not self.pushed.any():
            super()._truth(out, story, k, a, b)
            return
        t, unit, q = self.t, np.eye(self.n), story.old
        A, B, c, g, reach = t.Phi[q], t.Gamma[q], t.shift[q], self.pushed, t.reach[q] + self.off
        out.below([(unit, b["xi"]), (-A, a["xi"]), (-B, a["u"]), (-g, out.fault)], outward(c + reach))
        out.below([(-unit, b["xi"]), (A, a["xi"]), (B, a["u"]), (g, out.fault)], outward(-c + reach))

    def lives(self, story: Story, last: int, sign: int = 1) -> float:
        """A sure bound of the largest fault with which the hypothesis may live; of minus the least one for -1."""
        program, _ = self.told(story, min(-1, -1 if story.born is None else story.born), last)
        if sign < 0:
            program.kept = None  # the proof is about faults up to it
        return program.most({int(program.fault[0]): float(sign)}, "fault")


class _Search:
    """Least size from which on a channel is found within so many samples, with faults up to a limit."""

    def __init__(self, claims, widths: Array, quiet: int, of: Channel, within: int, name: str):
        self.claims, self.widths, self.quiet, self.of, self.within, self.name = claims, widths, quiet, of, within, name
        self.size, self.limit, self.own = 0.0, np.inf, {}

    def course(self, true: int, sign: int) -> FaultCourse:
        """Stories of a true mode with faults of one sign, up to the limit."""
        of = self.of
        return FaultCourse(self.claims, self.widths, sign * of.seen[true], sign * of.pushed[true], of.off[true],
                           min(of.top[sign], self.limit), self.name + ("+" if sign > 0 else "-"))

    def until(self, true: int, sign: int, sample: int) -> float:
        """With which fault the hypothesis of the true mode may live until a sample."""
        key = true, sign, sample
        if key not in self.own:
            self.own[key] = max(self.course(true, sign).lives(Story(true, true, true), sample), 0.0)
        return self.own[key]

    def run(self, limit: float) -> bool:
        """Set ``size`` and ``limit``, which is lowered where a child may take the largest faults for a switch."""
        self.size, self.limit, self.own = 0.0, limit, {}
        cases = [(true, sign) for true in self.claims.modes for sign in self.of.top]
        for true, sign in cases:
            alone = self.until(true, sign, self.within)
            if alone >= min(self.of.top[sign], limit) * (1 - 1e-6):
                return False
            self.size = max(self.size, alone)
        least = self.size
        return all(self._children(true, sign, least) for true, sign in cases)

    def _children(self, true: int, sign: int, least: float) -> bool:
        course = self.course(true, sign)
        for born in range(-self.quiet, self.within):
            if born >= 0 and self.until(true, sign, born) <= self.size:  # no parent is left
                break
            last = min(self.within, born + 1 + self.claims.t.ages)
            for story in [Story(true, true, m, born) for m in self.claims.modes if m != true]:
                most = course.lives(story, last)
                if most <= self.size:
                    continue
                below = -course.lives(story, last, -1) * (1 - 1e-6)  # it lives with those between
                if most < course.top * (1 - 1e-6) and below * most <= self.size * course.top:
                    self.size = most
                    continue
                self.limit = below
                if below <= (1 + BETTER) * least:
                    return False
                course = self.course(true, sign)
        return True

    def pruned(self, kept: dict) -> None:
        """Leave of the multipliers those that the size rests on: of each mode until its hypothesis is dead."""
        for name in [n for n in kept if n.split()[0] in (f"{self.name}+", f"{self.name}-")]:
            of, mode, _, _, born, _, _, _, last, *_ = name.split()
            case = int(mode), 1 if of.endswith("+") else -1
            dead = min(k for (*which, k), bound in self.own.items() if (*which,) == case and bound <= self.size)
            if int(born) >= dead if born != "-" else int(last) != dead:
                kept.pop(name)


def smallest(claims, widths: Array, quiet: int, of: Channel, within: int, name: str = "",
             limit: float = np.inf) -> tuple[float, float]:
    """Least step of a fault from which on no hypothesis is left in time, and up to which size that is sure.

    Parameters
    ----------
    claims : Claims
    widths : ndarray (n_x,)
        Of the box of the established mode.
    quiet : int
        Age that a wrong child does not reach while the mode stays, without fault.
    of : Channel
    within : int
        Samples after the first one of the fault.
    name : str
        Of the fault, where multipliers are kept.
    limit : float
        Larger faults are not asked for.

    Returns
    -------
    size, limit : float
        The size is infinite where none is sure; the limit where it is beyond the range of the channel.
    """
    search, most = _Search(claims, widths, quiet, of, within, name), max(of.top.values(), default=0.0)
    while 0.0 < most < np.inf and search.run(limit):
        if search.limit >= limit:
            if claims.kept is not None:
                search.pruned(claims.kept)
            return search.size * (1 + 1e-9), limit if limit < most else np.inf
        limit = search.limit
        forget(claims.kept, name)
    forget(claims.kept, name)
    return np.inf, np.inf


def forget(kept: dict | None, name: str) -> None:
    """Drop the multipliers of a promise."""
    for key in [k for k in kept or () if k.split()[0] in (f"{name}+", f"{name}-")]:
        kept.pop(key)


def label(j: int, within: int) -> str:
    """Name of the courses of a promise, where their multipliers are kept; a sign follows."""
    return f"fault{j}" if within == 1 else f"fault{j}@{within}"


def surely_found(plant, claims, widths: Array, quiet: int, asked, better: bool = False) -> list[dict]:
    """State the faults that leave no mode possible.

    Parameters
    ----------
    plant : Plant
        Without parameters.
    claims : Claims
    widths : ndarray (n_x,)
    quiet : int
    asked : list of (str, int, float)
        Channel, within how many samples after the first one, and the largest size to ask for.
    better : bool
        Leave out what promises no more of a channel than what was found before.

    Returns
    -------
    list of dict
        "channel", "size" from which on it is found, "upto" which size (where that is less than its range), "within"
        samples after its first, "after": samples since power-up and the last switch.
    """
    out, last, names = [], {}, [f.name for f in plant.f]
    known = {name: channel(plant, claims.t, names.index(name)) for name in {name for name, *_ in asked}}
    for name, within, limit in asked:
        course = label(names.index(name), within)
        size, upto = smallest(claims, widths, quiet, known[name], within, course, limit)
        before = last.get(name, (np.inf, 0.0))
        more = size < (1 - BETTER) * before[0] or upto > (1 + BETTER) * before[1]
        if np.isfinite(size) and (more or not better):
            last[name] = size, upto
            least = {"size": float(size)} | ({"upto": float(upto)} if np.isfinite(upto) else {})
            out.append({"channel": name, **least, "within": within, "after": claims.dwell + quiet})
        else:
            forget(claims.kept, course)
    return out
