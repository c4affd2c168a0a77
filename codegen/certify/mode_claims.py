"""What ``mode-set`` guarantees: how long the old mode and wrong children survive, oldest age needed, start-up time.

Every number is the least for which the stories of ``mode_delay`` are surely infeasible. The box of an established true
mode enters as its widths; they follow from the last switch: the widest hull that children of the right mode, born in
this period or another, leave together, then a dwell time of contraction. That is a fixed point over switches, begun at
power-up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import CertificateError
from .mode_delay import Course, Story, survival
from .mode_restart import restarted
from .mode_widths import AgesError, contracted, measured

Array = np.ndarray
@dataclass(frozen=True)
class ModeDelays:
    """Certified delays, in samples after the last sample before the switch; delay in seconds is samples * period.

    Parameters
    ----------
    old : dict
        (mode, next mode) -> sample at which the old mode is surely dead.
    identified : dict
        (mode, next mode) -> sample from which every wrong hypothesis is dead that is as old as the switch: the decision
        is right from there to the next switch. Younger children never get older than ``quiet``.
    quiet : int
        Age that a wrong child does not reach while the mode stays.
    start : int or None
        Samples from power-up after which no wrong hypothesis as old as that is alive; None: not within the horizon.
    restart, calm : int or None
        Of ``mode_restart``: samples from an alarm or a reset after which the decision is right, and after which all the
        others hold again; None: not asked.
    widths : ndarray (n_x,)
        Widths of the box of the true mode at a switch.
    """

    old: dict
    identified: dict
    quiet: int
    start: int | None
    restart: int | None
    calm: int | None
    widths: Array

    @property
    def worst(self) -> int:
        """Samples after which the decision is right, over all switches."""
        return max(self.identified.values())


class Claims:
    """Computes ``ModeDelays``.

    Parameters
    ----------
    t : ModeTables
    x, u : (ndarray, ndarray)
        Declared ranges of state (n_x,) and input (n_u,).
    dwell : int
        Least number of samples between switches.
    horizon : int
        Samples after which a hypothesis counts as never dying.
    kept : dict or None
        Takes the multipliers that prove something (``mode_program.Program``).
    names : tuple of str
        Of the modes, for messages; left out: their numbers.
    """

    def __init__(self, t, x, u, dwell: int, horizon: int, kept: dict | None = None, names: tuple[str, ...] = ()):
        self.names, self.t, self.x, self.u, self.dwell, self.horizon, self.kept = names, t, x, u, dwell, horizon, kept
        self.modes = range(len(t.Phi))
        self.oldest = 0  # samples that a wrong child may live
        self.hull_begun: dict = {}  # the same after power-up, per mode
        self.hulls: dict = {}  # of the right mode's children, per switch: widths, and at which sample
        self.pairs = [(i, j) for i in self.modes for j in self.modes if i != j]

    def course(self, widths: Array, name: str = "settled") -> Course:
        """Stories with these widths."""
        return Course(self.t, *self.x, *self.u, widths, self.kept, name)

    def survivals(self, course: Course, guess: tuple[dict, dict] = ({}, {}),
                  switched: bool = True) -> tuple[dict, dict]:
        """Of the old mode after a switch (where asked for), and of a child while the mode stays."""
        old = {(i, j): survival(course, Story(i, j, i), self.horizon, guess[0].get((i, j)))
               for i, j in (self.pairs if switched else ())}
        quiet = {(i, m): survival(course, Story(i, i, m, 0), self.horizon, guess[1].get((i, m)))
                 for i, m in self.pairs}
        self._finite(old, "the old mode after a switch")
        self._finite(quiet, "a child while the mode stays")
        return old, quiet

    def _finite(self, found: dict, what: str) -> None:
        for (i, j), last in found.items():
            if last >= self.horizon:
                first, second = (self.names[q] if self.names else q for q in (i, j))
                raise CertificateError(f"certificate: modes {first} and {second} cannot be told apart within "
                                       f"{self.horizon} samples ({what} may live on). Use a longer period or dwell "
                                       "time, closer ranges of x, less noise, or an input that separates them.")

    def hull(self, course: Course, i: int, j: int, old: int, quiet: int) -> tuple[Array, int]:
        """Widths of the hull of all children of the right mode after the switch, and at which sample."""
        stories = [Story(i, j, j, born) for born in range(-quiet, old + 1)]
        return self.together(course, stories, -quiet, old + 1), old + 1

    def together(self, course: Course, stories, first: int, at: int) -> Array:
        """Widths of the hull of the boxes of all these stories of one run, at a sample."""
        t, n, p = self.t, len(course.widths), len(self.t.v_lo)
        above, below = np.zeros(n), np.zeros(n)
        above[p:], below[p:] = -np.inf, -np.inf
        for story in stories:
            program, end = course.told(story, first, at)
            for r in range(p, n):
                above[r] = max(above[r], program.most({end["hi"][r]: 1.0, end["c"][r]: -1.0}, f"hi {r}"))
                below[r] = max(below[r], program.most({end["c"][r]: 1.0, end["lo"][r]: -1.0}, f"lo {r}"))
        widths = above + below
        widths[:p] = measured(t)
        return widths

    def begun(self) -> Array:
        """Widths of the box of the true mode a dwell time after power-up, with what wrong modes gave birth to."""
        course = self.course(self.t.start_hi - self.t.start_lo, "begun")
        widths = np.zeros(len(course.widths))
        for true in self.modes:
            alive = {m: self._begin(course, true, m, "start") for m in self.modes if m != true}
            at = max(alive.values()) + 1
            self._finite({(true, m): k for m, k in alive.items()}, "a wrong mode after power-up")
            stories = [Story(true, true, true, None, true, "start")]
            stories += [Story(true, true, true, born, m, "start") for m, k in alive.items() for born in range(k + 1)]
            hull = self.together(course, stories, 0, max(at, 0))
            self.hull_begun[true] = hull, at
            widths = np.maximum(widths, contracted(self.t, hull, true, max(self.dwell - at, 0)))
        return widths

    def _begin(self, course: Course, true: int, m: int, begin: str) -> int:
        """Last sample at which a wrong mode may be alive that began with the true one in one box; -1: none."""
        story = Story(true, true, m, None, m, begin)
        return -1 if course.program(story, 0).infeasible() else survival(course, story, self.horizon)

    def settled(self, begin: Array | None = None) -> tuple[Array, dict, dict]:
        """Fixed point of the widths over switches, with the survivals at it.

        Parameters
        ----------
        begin : ndarray (n_x,) or None
            Widths to begin with, where they are larger than those after power-up.

        Raises
        ------
        CertificateError
            A mode lives on, or widths grow from switch to switch.
        """
        widths = self.begun()
        widths = widths if begin is None else np.maximum(widths, begin)
        old, quiet, pairs = {}, {}, self.pairs
        for _ in range(40):
            old, quiet = self.survivals(self.course(widths), (old, quiet))
            found = self.returned(widths, old, quiet, pairs)
            most = np.max([widths, *found.values()], axis=0)
            if np.all(most <= widths):
                if pairs is self.pairs:  # they come back no wider: so at every switch
                    return widths, old, quiet
                pairs = self.pairs
            else:  # look at the widest alone until they stand still
                pairs = [pair for pair, own in found.items() if np.any(own >= most)]
                widths = 1.03 * (most + 0.8 * (most - widths))
        raise CertificateError("certificate: the box of the true mode grows from switch to switch. Use a longer dwell "
                               "time or less noise.")

    def returned(self, widths: Array, old: dict, quiet: dict, pairs) -> dict:
        """Widths a dwell time after each of these switches that met the given ones."""
        course, found = self.course(widths), {}
        for i, j in pairs:
            hull, at = self.hull(course, i, j, old[i, j], quiet[i, j])
            if self.dwell < at:
                raise CertificateError(f"certificate: the old mode may live {at} samples, the dwell time is "
                                       f"{self.dwell}. Use a longer dwell time.")
            found[i, j] = contracted(self.t, hull, j, self.dwell - at)
            self.hulls[i, j] = hull, at
        return found

    def early(self, quiet: dict) -> tuple[Array, int]:
        """Widths of the box of the true mode from when it may first give birth itself, and how long that lasts.

        The first of its children that comes of age may have been born before the switch, and lived on into it.
        """
        first = self.t.ages - max(quiet.values())
        late = max(at for _, at in self.hulls.values())
        if first < late:
            least = late - first + self.t.ages
            raise AgesError(f"certificate: a child may come of age {max(first, 0)} samples after the switch, when the "
                            f"old mode may be alive for {late}. Use at least {least} ages.", least)
        widths = np.zeros(len(self.t.wide_lo))
        for q in self.modes:
            widths = np.maximum(widths, contracted(self.t, self.t.start_hi - self.t.start_lo, q, 0))
            widths = np.maximum(widths, contracted(self.t, self.hull_begun[q][0], q,
                                                   max(self.t.ages - self.hull_begun[q][1], 0)))
        for (_, j), (hull, at) in self.hulls.items():
            widths = np.maximum(widths, contracted(self.t, hull, j, first - at))
        return widths, first

    def again(self, widths: Array, old: dict, restart: bool = False) -> ModeDelays:
        """The delays anew, at widths that were found before; ``old`` says where to look first.

        Raises
        ------
        CertificateError
            The widths grow from switch to switch, or are exceeded after power-up; or as ``delays``.
        """
        found = self.survivals(self.course(widths), (old, {}))
        after = self.returned(widths, *found, self.pairs)
        if any(np.any(most > widths) for most in (self.begun(), *after.values())):
            raise CertificateError("certificate: the box of the true mode may grow beyond the widths stated.")
        return self._concluded(widths, *found, restart=restart)

    def delays(self, restart: bool = False, widths: Array | None = None) -> ModeDelays:
        """All of it.

        Parameters
        ----------
        restart : bool
            Also how long it takes after an alarm: the boxes are wide then, which takes more ages.
        widths : ndarray (n_x,) or None
            Where to begin.

        Returns
        -------
        ModeDelays

        Raises
        ------
        CertificateError
            Modes that cannot be told apart, a dwell time or an oldest age that is too short.
        """
        return self._concluded(*self.settled(widths), restart=restart)

    def sized(self, most: int, widths: Array | None = None, restart: bool = False) -> tuple[ModeDelays, int]:
        """``delays`` with the least oldest age that will do, and that age; at most ``most``.

        Raises
        ------
        CertificateError
        """
        found, ages = self.settled(widths), 1
        while True:
            self.t = replace(self.t, ages=ages)
            try:
                return self._concluded(*found, restart=restart), ages
            except AgesError as error:
                if not ages < error.least <= most:
                    raise
                ages = error.least

    def _concluded(self, widths: Array, old: dict, quiet: dict, restart: bool) -> ModeDelays:
        course = self.course(widths)
        wider, first = self.early(quiet)
        young = self.survivals(self.course(wider, "early"), (old, quiet), switched=False)[1]
        self._grown_up(max(young.values()))
        if self.dwell < first + max(young.values()):
            raise CertificateError(f"certificate: a wrong child born {first} samples after a switch may live "
                                   f"{max(young.values())}, the dwell time is {self.dwell}. Use a longer dwell time.")
        if self.dwell < self.t.ages + 1:
            raise CertificateError(f"certificate: the dwell time is {self.dwell} samples, at least {self.t.ages + 1} "
                                   f"(ages + 1) expected. Use fewer ages or a longer dwell time.")
        identified = {}
        for i, j in self.pairs:
            last = old[i, j]
            for m in self.modes:
                if m not in (i, j):
                    last = max(last, self._children(course, Story(i, j, m), range(-quiet[i, m], old[i, j] + 1)))
            identified[i, j] = last + 1
        if max(identified.values()) > self.dwell:
            raise CertificateError(f"certificate: identification may take {max(identified.values())} samples, the "
                                   f"dwell time is {self.dwell}. Use a longer dwell time.")
        start = self.first("start", course)
        self._grown_up(self.oldest)
        right, calm = restarted(self, widths) if restart else (None, None)
        return ModeDelays({k: v + 1 for k, v in old.items()}, identified, max(young.values()) + 1, start, right, calm,
                          widths)

    def _grown_up(self, samples: int) -> None:
        """A wrong child that reached the oldest age would give birth itself."""
        if self.t.ages < samples + 1:
            raise AgesError(f"certificate: a wrong child may reach age {samples}, the oldest age is "
                            f"{self.t.ages}. Use at least {samples + 1} ages.", samples + 1)

    def _children(self, course: Course, story: Story, births) -> int:
        """Longest survival of the children born in these periods."""
        last, guess = -1, None
        for born in births:
            guess = survival(course, replace(story, born=born), self.horizon, guess)
            last = max(last, guess)
            self.oldest = max(self.oldest, guess - born)
        return last

    def first(self, begin: str, course: Course) -> int | None:
        """Samples until only the true mode is left when all modes begin in one box."""
        last = -1
        for true, m in self.pairs:
            alive = self._begin(course, true, m, begin)
            last = max(last, alive)
            if last >= self.horizon:
                return None
            for child in self.modes:
                if child not in (true, m):
                    story = Story(true, true, child, None, m, begin)
                    last = max(last, self._children(course, story, range(alive + 1)))
        return None if last >= self.horizon else last + 1


def certify_delays(t, x, u, dwell: int, horizon: int = 60, restart: bool = False) -> ModeDelays:
    """Certify the delays of an estimator.

    Parameters
    ----------
    t : ModeTables
    x, u : (ndarray (n_x,), ndarray (n_x,)) and (ndarray (n_u,), ndarray (n_u,))
        Declared ranges.
    dwell : int
        Least number of whole samples between switches.
    horizon : int
        Samples after which a hypothesis counts as never dying.
    restart : bool
        Also the time after an alarm.

    Returns
    -------
    ModeDelays

    Raises
    ------
    CertificateError
        Modes cannot be told apart, or ages and dwell time do not fit.
    """
    return Claims(t, x, u, dwell, horizon).delays(restart)
