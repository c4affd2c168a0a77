"""What surrounds the recursion: input checks, alarms with debounce and latch, recovery, dwell time.

All of it is integer arithmetic and comparisons, the same in every family. ``assured`` says whether the
guarantee is in force at this very sample: no alarm now, the hold time since the last one over, no alarm
latched, and the switching so far as slow as the certificate asks. A fault that goes on may be absorbed by
framers that restarted within it, so that it shows no longer: a latched alarm therefore keeps ``assured``
down until it is acknowledged. Without the latch the hold time alone decides, and rests on the fault being
over by then.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

Array = np.ndarray

OK, BAD_MODE, BAD_INPUT, BAD_OUTPUT, BAD_PARAMETER = 0, 1, 2, 3, 4


@dataclass(frozen=True)
class Supervision:
    """Settings of the supervisor, all integers.

    Parameters
    ----------
    debounce : (int, int)
        (m, n): alarm when m of the last n samples were outside.
    latch : bool
    recover : int
        Re-initialise the framers after so many samples of alarm in a row.
    hold : int
        Quiet samples after an alarm before ``assured`` returns.
    dwell_add, dwell_drain, dwell_limit : int
        Leaky bucket: each sample takes ``dwell_drain`` out, each switch puts ``dwell_add`` in; more than
        ``dwell_limit`` in it breaks the average dwell time dwell_add/dwell_drain (samples) with chatter
        bound dwell_limit/dwell_add. All zero: switching is arbitrary, no monitor.
    assures : bool
        Whether anything is guaranteed; without, ``assured`` is never set.
    """

    debounce: tuple[int, int] = (1, 1)
    latch: bool = True
    recover: int = 50
    hold: int = 10
    dwell_add: int = 0
    dwell_drain: int = 0
    dwell_limit: int = 0
    assures: bool = True

    @classmethod
    def of(cls, target, **rest) -> Supervision:
        """Alarm handling of a plant file's ``[target]``; ``rest`` are the other fields."""
        return cls(debounce=target.debounce, latch=target.latch, recover=target.recover, hold=target.hold, **rest)

    @property
    def monitors_dwell(self) -> bool:
        """Whether there is a dwell-time monitor."""
        return self.dwell_add > 0

    @property
    def counts_hold(self) -> bool:
        """Whether there is a hold time that matters: where every sample outside is latched, the latch says more."""
        return self.hold > 0 and not (self.latch and self.debounce[0] == 1)

    def to_dict(self) -> dict:
        """Return a plain dict for design.json."""
        data = asdict(self) | {"debounce": list(self.debounce)}
        if self.assures:  # the rule goes without saying
            del data["assures"]
        return data

    @classmethod
    def from_dict(cls, data: dict) -> Supervision:
        """Rebuild from ``to_dict``."""
        return cls(**{**data, "debounce": tuple(data["debounce"])})


class SupervisorState:
    """Integer state of S runs: bucket, alarm history, counters."""

    def __init__(self, runs: int, n_bits: int, n_modes: int):
        self.mode = np.full(runs, n_modes)  # n_modes: no mode seen yet, so the first is no switch
        self.bucket = np.zeros(runs, dtype=np.int64)
        self.too_fast = np.zeros(runs, dtype=bool)
        self.run = np.zeros(runs, dtype=np.int64)
        self.hold = np.zeros(runs, dtype=np.int64)
        self.history = np.zeros((runs, n_bits), dtype=np.int64)
        self.latched = np.zeros((runs, n_bits), dtype=bool)


def watch_dwell(s: Supervision, st: SupervisorState, on: Array, q: Array, n_modes: int) -> None:
    """Feed the leaky bucket with this sample's mode, for the runs in ``on``."""
    if s.monitors_dwell:
        bucket = np.maximum(st.bucket - s.dwell_drain, 0)
        bucket = bucket + np.where((st.mode != n_modes) & (q != st.mode), s.dwell_add, 0)
        over = bucket > s.dwell_limit
        bucket = np.where(over, s.dwell_limit, bucket)
        # Once broken the guarantee is back when the bucket has run empty: a fresh start of the bound.
        too_fast = np.where(over, True, np.where(bucket == 0, False, st.too_fast))
        st.bucket = np.where(on, bucket, st.bucket)
        st.too_fast = np.where(on, too_fast, st.too_fast)
    st.mode = np.where(on, q, st.mode)


def judge(s: Supervision, st: SupervisorState, on: Array, raw: Array):
    """Debounce, latch and recovery for one measured sample of the runs in ``on``.

    Parameters
    ----------
    raw : ndarray (S, n_bits) bool
        Outputs outside their bounds at this sample.

    Returns
    -------
    alarm : ndarray (S, n_bits) bool
        After the debounce.
    again : ndarray (S,) bool
        The framers must restart from the declared ranges.
    assured : ndarray (S,) bool
    """
    m, n = s.debounce
    history = ((st.history << 1) | raw) & ((1 << n) - 1)
    alarm = np.bitwise_count(history) >= m
    latched = (st.latched | alarm) if s.latch else alarm
    fault = raw.any(axis=1)
    run = np.where(fault, st.run + 1, 0)
    # A framer that has met a fault is worthless: start again at the first quiet sample, or when the
    # alarm has lasted long enough that the old framers may keep it alive by themselves.
    again = np.where(fault, run >= s.recover, st.run > 0)
    run = np.where(again, 0, run)
    hold = np.where(fault, s.hold, np.maximum(st.hold - 1, 0))
    st.history = np.where(on[:, None], history, st.history)
    st.latched = np.where(on[:, None], latched, st.latched)
    st.run = np.where(on, run, st.run)
    st.hold = np.where(on, hold, st.hold)
    return alarm, again, ~fault & undisturbed(s, st)


def undisturbed(s: Supervision, st: SupervisorState) -> Array:
    """Whether nothing from earlier samples breaks the guarantee: hold time, latched alarms, switching."""
    kept = st.latched.any(axis=1) if s.latch else False
    return (st.hold == 0) & ~st.too_fast & ~np.asarray(kept) & s.assures
