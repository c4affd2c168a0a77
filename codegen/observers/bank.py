r"""Run-time family "bank": one polytopic observer per fault, each without the sensors of its fault; who is to blame.

Member p has outputs of its own choice, y_p, and answers at every measured sample::

    1  x_hat = z + T2 y_p,  r = y_p - C x_hat,  z+ = sum_j h_j (F_j x_hat + G_j u - K_j r)     ``polytopic``
       h_j of x_hat, u and the parameters that are measured at this sample
    2  a    += rate (M r - a)                    moving average of the weighted residual
    3  level = a' a                              over ``bound``: something is wrong that member p sees

A fault of the sensors that member p does not read leaves it alone, exactly, and moves the others. So fault p is
isolated where all members but p are raised. A member counts as raised for ``keep`` samples after its last alarm: a
fault that changes its sign would else drop out at every zero. Any other pattern is ambiguous, and names nobody.

What is accepted takes no state and no average beyond its limit; where a spoilt memory does, all members start anew.

The members start at z0 when the plant may be anywhere in its range; for ``settle`` samples they say nothing. At
``<p>_init`` the plant is in its initial box, and ``begin`` samples are enough.

A sample without a measurement is bridged: the last one stands in for it in 1, averages, levels and all that waits or
is raised stand still. To the states that is a measurement like any other, so that their limits hold, and what it leaves
shrinks as certified. Each measured sample adds one to a credit, of ``gap bridge`` at most, a lost one takes ``gap``:
so no more are bridged in the long run, nor in succession, than in the runs that the thresholds come from. Without
credit all members start anew.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from random import Random

import numpy as np

from .bank_tables import BankTables, Member
from .polytopic_step import step, summed
from .runner import Runner, pack
from .supervisor import SupervisorState, judge
from .thresholds import refuse
from .trace import Rows, blank

Array = np.ndarray
#: Answer of a bank that blames nobody.
NOBODY = -1


@dataclass(frozen=True)
class BankTrace(Rows):
    """Answers of a bank; row k is what it says at sample k.

    Parameters
    ----------
    r : ndarray (K, P)
        Level of each member: square of the norm of its averaged, weighted residual; NaN without a measurement.
    r_bound : ndarray (K, P)
        Largest level that is no alarm.
    alarm, alarm_bits, latched_bits, raw_bits, assured, status
        As in ``Trace``; bit p is member p.
    isolated : ndarray (K,) int32
        The fault channel that is to blame, -1 where none is.
    ready, inside : ndarray (K,) uint32
        1 where the levels are judged; 1 where all estimates are where the weights are in force.
    raised : ndarray (K,) uint32
        Bits of the members that are raised.
    """

    r: Array
    r_bound: Array
    alarm: Array
    alarm_bits: Array
    latched_bits: Array
    raw_bits: Array
    assured: Array
    status: Array
    isolated: Array
    ready: Array
    inside: Array
    raised: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...], members: int, n_y: int, dtype) -> BankTrace:
        """Allocate for runs of the given leading shape; ``n_y`` is not used."""
        del n_y
        *common, ready, inside, raised = blank(shape, (members, members), dtype, 3)
        return cls(*common, np.full(shape, NOBODY, dtype=np.int32), ready, inside, raised)

    def words(self) -> list[Array]:
        """The fields that other families do not have, in their order, as the C's words."""
        return [self.isolated.view(np.uint32), self.ready, self.inside, self.raised]

    def word_names(self) -> list[str]:
        """The names of these fields."""
        return ["isolated", "ready", "inside", "raised"]


class BankObserver(Runner):
    """The bank as the firmware runs it, on S independent runs at once; see ``Runner`` for the calls.

    Its thresholds come from a campaign: nothing is ``assured``.
    """

    family = "bank"
    tables_class = BankTables
    trace_class = BankTrace

    def empty(self, t: BankTables, shape: tuple[int, ...]) -> BankTrace:
        """Allocate the answers of runs of the given leading shape."""
        return BankTrace.empty(shape, len(t.members), 0, t.dtype)

    @classmethod
    def answers(cls, shape: tuple[int, ...], record: dict, dtype) -> BankTrace:
        """Allocate the answers of compiled C, whose ``resources.json`` is ``record``."""
        return BankTrace.empty(shape, next(n for name, _, n in record["out"] if name == "r"), 0, dtype)

    @classmethod
    def initial(cls, x0_lo, x0_hi, shape: tuple[int, int], record: dict, dtype) -> list[Array | None]:
        """Nothing: the bank starts where it starts, and waits."""
        refuse(x0_lo, x0_hi)
        return []

    def start(self, t: BankTables, runs: int, x0_lo: Array | None = None, x0_hi: Array | None = None) -> None:
        """Set all runs to their start (``<p>_init``).

        Raises
        ------
        ValueError
            Another initial box than the plant file's.
        """
        refuse(x0_lo, x0_hi)
        self.raised = np.zeros((runs, len(t.members)), dtype=np.int64)
        self.guard = SupervisorState(runs, len(t.members), 1)
        self.y = np.zeros((runs, len(t.y_lo)), dtype=t.dtype)
        self._anew(t, runs, t.begin)

    def run_many(self, u, y, q=None, real="float32", x0_lo=None, x0_hi=None, theta=None) -> BankTrace:
        """As ``Runner.run_many``; q is not read."""
        return super().run_many(u, y, np.zeros(np.shape(y)[:2], dtype=np.int64), real, x0_lo, x0_hi, theta)

    def _anew(self, t: BankTables, runs: int, wait: int) -> None:
        """The recursions from z0; alarms are not touched."""
        self.credit = np.zeros(runs, dtype=np.int64)
        self.z = [np.tile(m.z0.astype(t.dtype), (runs, 1)) for m in t.members]
        self.a = [np.zeros((runs, len(m.M)), dtype=t.dtype) for m in t.members]
        self.wait = np.full(runs, wait)

    def sample(self, t: BankTables, on: Array, measured: Array, u: Array, y: Array, q: Array, theta: Array,
               out: BankTrace) -> None:
        """One sample of the runs in ``on``: ``<p>_step`` where ``measured``, else ``<p>_predict``."""
        seen = on & measured
        bridged = on & ~measured & (self.credit >= t.gap)
        moving, self.y = seen | bridged, np.where(seen[:, None], y, self.y)
        level, inside = np.zeros((len(q), len(t.members)), t.dtype), np.ones(len(q), dtype=bool)
        self.z, self.a = list(self.z), list(self.a)
        for p, m in enumerate(t.members):
            _, r, known, after = step(m, self.z[p], u, self.y[:, m.seen], theta, moving)
            a = averaged(m, self.a[p], r, t.dtype.type(t.rate))
            level[:, p], inside = squared(a), inside & known
            self.z[p] = np.where(moving[:, None], after, self.z[p])
            self.a[p] = np.where(seen[:, None], a, self.a[p])
        ready = self.wait == 0
        raw = ready[:, None] & ~(level <= t.bound)
        alarm, _, _ = judge(self.supervision, self.guard, seen, raw)
        raised = np.where(alarm, t.keep, np.maximum(self.raised - 1, 0))
        self.raised = np.where(seen[:, None], raised, self.raised)
        isolated = blamed(t, self.raised > 0)
        self.wait = np.where(seen, np.maximum(self.wait - 1, 0), self.wait)
        self.credit = np.where(seen, np.minimum(self.credit + 1, t.credit), self.credit - t.gap * bridged)
        lost = (on & ~moving) | (moving & ~(within(self.z, t.limit) & within(self.a, t.most)))
        if lost.any():
            kept = self.z, self.a, self.wait, self.credit
            self._anew(t, len(q), t.settle)
            self._merge(lost, *kept)
        out.r[seen], out.r_bound[seen] = level[seen], t.bound
        out.isolated[on], out.ready[seen], out.inside[seen] = isolated[on], ready[seen], inside[seen]
        out.raised[on] = pack(self.raised > 0)[on]
        out.raw_bits[seen], out.alarm_bits[seen] = pack(raw)[seen], pack(alarm)[seen]
        out.latched_bits[on] = pack(self.guard.latched)[on]
        out.alarm[seen] = alarm[seen].any(axis=1)

    def _merge(self, new: Array, z: list[Array], a: list[Array], wait: Array, credit: Array) -> None:
        """Keep the new start for the runs in ``new``, what was before for the others."""
        for now, before in ((self.z, z), (self.a, a)):
            for p, values in enumerate(before):
                now[p] = np.where(new[:, None], now[p], values)
        self.wait, self.credit = np.where(new, self.wait, wait), np.where(new, self.credit, credit)

    def quiet_output(self, t: BankTables, u: Array, q: int, theta: Array) -> Array:
        """A measurement that raises nobody, where one is found; for the golden vectors."""
        draw = Random(int(self.wait[0]))
        for k in range(30):
            y = np.array([0.5**k * (a + (b - a) * draw.random()) for a, b in zip(t.y_lo.astype(float), t.y_hi.astype(
                float))]).astype(t.dtype)
            trial = copy(self)
            trial.guard, out = copy(self.guard), self.empty(t, (1,))
            trial.sample(t, np.array([True]), np.array([True]), u[None], y[None], np.array([q]), theta[None], out)
            if out.raw_bits[0] == 0:
                break
        return np.clip(y, t.y_lo, t.y_hi)

    def reset(self, t: BankTables, on: Array) -> None:
        """Restart the runs in ``on``, alarms cleared (``<p>_reset``)."""
        kept, held = (self.z, self.a, self.wait, self.credit), (self.raised, self.y)
        guard = self.guard
        self.start(t, len(on))
        self._anew(t, len(on), t.settle)
        self._merge(on, *kept)
        self.raised, self.y = (np.where(on[:, None], now, before) for now, before in zip((self.raised, self.y), held))
        for name, value in vars(guard).items():
            mask = on.reshape(-1, *[1] * (value.ndim - 1))
            setattr(self.guard, name, np.where(mask, getattr(self.guard, name), value))


def within(values: list[Array], limit: Array) -> Array:
    """Whether no number of a run is beyond its limit; what is no number is.

    Parameters
    ----------
    values : list of ndarray (S, k)
        One per member.
    limit : ndarray (K,)
        One member after the other.
    """
    whole = np.concatenate(values, axis=1)
    return ((whole >= -limit) & (whole <= limit)).all(axis=1)


def averaged(m: Member, a: Array, r: Array, rate) -> Array:
    """The moving average of the weighted residual, one sample on.

    Parameters
    ----------
    m : Member
    a : ndarray (S, k), r : ndarray (S, p)
    rate : number of the type
    """
    return a + rate * (summed(m.M, r) - a)


def squared(a: Array) -> Array:
    """Sum of squares, from left to right.

    Parameters
    ----------
    a : ndarray (S, k)
    """
    out = a[:, 0] * a[:, 0]
    for k in range(1, a.shape[1]):
        out = out + a[:, k] * a[:, k]
    return out


def blamed(t: BankTables, raised: Array) -> Array:
    """The fault whose pattern is met exactly; -1 where none is.

    Parameters
    ----------
    t : BankTables
    raised : ndarray (S, P) bool
    """
    out = np.full(len(raised), NOBODY, dtype=np.int32)
    for channel, pattern in enumerate(t.incidence):
        out = np.where((raised == pattern).all(axis=1), channel, out)
    return out
