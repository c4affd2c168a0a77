"""What the user states: a plant, frozen, every number already checked by ``plant.load``.

All arrays are float64 and read-only. A float64 is an exact rational number, and it is *this* number
that the certificates are about.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:  # which is built on this file
    from .polytopic import Polytope

Array = np.ndarray


@dataclass(frozen=True)
class Signal:
    """One channel of x, u, y, w, v, f or theta.

    Parameters
    ----------
    name : str
        As in the plant file; unique within its vector.
    unit : str
        SI unit, may be empty.
    lo, hi : float
        Range (x, u, y, f) or bounds (w, v, theta); ``-inf``/``inf`` where the file gives none.
    measured : bool
        For theta only: the firmware reads it.
    rate : float
        For theta and u: largest absolute rate of change per second. An input without a rate is held between
        samples (rate 0); a parameter without one may jump (rate inf).
    error : float
        For a measured theta: largest error of the measurement.
    """

    name: str
    unit: str = ""
    lo: float = -np.inf
    hi: float = np.inf
    measured: bool = True
    rate: float = np.inf
    error: float = 0.0


@dataclass(frozen=True)
class Mode:
    """One mode of the plant: x+ = A x + B u + Bw w + Bf f, y = C x + D u + Dw w + Dv v + Df f.

    Parameters
    ----------
    name : str
    A : ndarray (n_x, n_x), B : ndarray (n_x, n_u)
    C : ndarray (n_y, n_x), D : ndarray (n_y, n_u)
    Bw : ndarray (n_x, n_w), Dv : ndarray (n_y, n_v)
    Bf : ndarray (n_x, n_f), Df : ndarray (n_y, n_f)
    w_lo, w_hi : ndarray (n_w,)
        Disturbance bounds in this mode; need not be symmetric.
    v_lo, v_hi : ndarray (n_v,)
        Noise bounds in this mode.
    theta_terms : dict
        Matrix name -> tuple of n_theta arrays: the entry is ``A + sum_j theta_j * theta_terms["A"][j]``.
    theta_bounds : (ndarray, ndarray) or None
        Bounds of theta in this mode, where they differ from those of ``[signals]``.
    Dw : ndarray (n_y, n_w)
        What the disturbance does to the outputs; zero where it is not given.
    """

    name: str
    A: Array
    B: Array
    C: Array
    D: Array
    Bw: Array
    Dv: Array
    Bf: Array
    Df: Array
    w_lo: Array
    w_hi: Array
    v_lo: Array
    v_hi: Array
    theta_terms: dict[str, tuple[Array, ...]] = field(default_factory=dict)
    theta_bounds: tuple[Array, Array] | None = None
    Dw: Array | None = None

    def __post_init__(self):
        if self.Dw is None:
            object.__setattr__(self, "Dw", np.zeros((len(self.C), self.Bw.shape[1])))


@dataclass(frozen=True)
class Switching:
    """What is known of the mode signal.

    Parameters
    ----------
    known : bool
        The firmware is told the active mode at every sample.
    late : bool
        What it is told may be the mode of the sample before.
    average_dwell : float or None
        Average dwell time in seconds (None: arbitrary switching). A ``minimum_dwell`` of the file is
        the case ``chatter = 1``.
    chatter : float
        Chatter bound N0 >= 1 of Definition 9 (Zammali (2020)).
    schedule : tuple of int
        Modes of one period, from sample 0 on, where the file says that they come in turn for ever.
    """

    known: bool = True
    average_dwell: float | None = None
    chatter: float = 1.0
    late: bool = False
    schedule: tuple[int, ...] = ()


@dataclass(frozen=True)
class Fault:
    """A fault of a scenario: ``f[channel] += value`` for samples ``start <= k < stop``."""

    channel: int
    start: int
    stop: int
    value: str


@dataclass(frozen=True)
class Scenario:
    """What validate, report and campaign run.

    Parameters
    ----------
    name : str
    steps : int
        Number of samples K.
    mode : tuple of (int, int)
        (sample, mode index) pairs, ascending, the first at sample 0; ignored where ``csv`` has a mode column. Between
        samples, to an eighth of the period, where the plant is continuous and its mode unknown.
    u : tuple of str
        One expression of k and t per input.
    w, v : str or tuple of str
        "corner", "uniform", or one expression per channel.
    theta : str or tuple of str
        The same for the scheduling parameters; "uniform" and "corner" keep to their rates.
    fault : tuple of Fault
    csv : str
        Path of a record as written in the file (empty: none). Columns are named after the signals. With a
        column for every output the scenario is a *record*: its y are replayed, there is no true state.
    """

    name: str
    steps: int
    mode: tuple[tuple[float, int], ...]
    u: tuple[str, ...]
    w: str | tuple[str, ...] = "uniform"
    v: str | tuple[str, ...] = "uniform"
    fault: tuple[Fault, ...] = ()
    csv: str = ""
    theta: str | tuple[str, ...] = "uniform"


@dataclass(frozen=True)
class Target:
    """How the C is to look: prefix, number type, layout, alarm handling.

    Parameters
    ----------
    prefix : str
        C identifier stem.
    real : {"float32", "float64"}
    layout : {"literal", "table", "loop"}
    debounce : (int, int)
        Alarm when m of the last n samples were outside their bounds; 1 <= m <= n <= 32.
    latch : bool
        Alarms stay until acknowledged (``<prefix>_reset``).
    recover : int
        After so many samples of alarm in a row the framers are re-initialised from the declared ranges.
    hold : int
        Quiet samples after an alarm before ``assured`` may return.
    """

    prefix: str
    real: str = "float32"
    layout: str = "table"
    debounce: tuple[int, int] = (1, 1)
    latch: bool = True
    recover: int = 50
    hold: int = 10


@dataclass(frozen=True)
class Plant:
    """A plant file, read and checked.

    Parameters
    ----------
    name, title, source : str
    kind : {"discrete", "continuous"}
    sample_period : float
        Seconds.
    x, u, y, w, v, f, theta : tuple of Signal
    x0_lo, x0_hi : ndarray (n_x,)
        Box of the initial state.
    modes : tuple of Mode
    switching : Switching
    method : str
        Empty: the tool chooses.
    options : dict
        Options of the method, as in ``[observer]``.
    target : Target
    scenarios : tuple of Scenario
    text : str
        The TOML text; goes into design.json, so that a design can be traced and re-run.
    folder : str
        Folder of the file, where its CSV records are looked for.
    constants : dict
        The file's ``[constants]``; the expressions of the scenarios use them.
    polytope : Polytope or None
        Of a polytopic (descriptor) plant: what it has in place of modes, of which there are none then.
    """

    name: str
    title: str
    source: str
    kind: str
    sample_period: float
    x: tuple[Signal, ...]
    u: tuple[Signal, ...]
    y: tuple[Signal, ...]
    w: tuple[Signal, ...]
    v: tuple[Signal, ...]
    f: tuple[Signal, ...]
    theta: tuple[Signal, ...]
    x0_lo: Array
    x0_hi: Array
    modes: tuple[Mode, ...]
    switching: Switching
    method: str
    options: dict[str, Any]
    target: Target
    scenarios: tuple[Scenario, ...]
    text: str = ""
    folder: str = ""
    constants: dict[str, float] = field(default_factory=dict)
    polytope: Polytope | None = None

    @cached_property
    def observed(self) -> Plant:
        """The plant as the firmware sees it: discrete time, measured parameters, the rest as bounds."""
        from .uncertain import observed  # model is what uncertain builds on
        return observed(self)

    @cached_property
    def enclosed(self) -> Plant:
        """The plant with constant matrices where it is continuous, in discrete time; else the plant itself."""
        from .enclosed import enclosed
        return enclosed(self)

    @property
    def reads_both_ends(self) -> bool:
        """Whether a step takes the mean of the parameters at both its ends.

        Of a continuous plant whose measured parameters all have rates, and the same bounds in all modes: then the mean
        is closer to what they are in between than their value at the start.
        """
        known = [s for s in self.theta if s.measured]
        return (self.kind == "continuous" and bool(known) and all(np.isfinite(s.rate) for s in known)
                and all(m.theta_bounds is None for m in self.modes))

    @property
    def multiplies_parameters(self) -> bool:
        """Whether a step multiplies out products of its parameters (``interpolation = "quadratic"``)."""
        return (self.kind == "continuous" and self.options.get("interpolation") == "quadratic"
                and any(s.measured for s in self.theta))

    @property
    def n_x(self) -> int:
        """Number of states."""
        return len(self.x)

    @property
    def n_u(self) -> int:
        """Number of inputs."""
        return len(self.u)

    @property
    def n_y(self) -> int:
        """Number of outputs."""
        return len(self.y)

    @property
    def n_w(self) -> int:
        """Number of disturbances."""
        return len(self.w)

    @property
    def n_v(self) -> int:
        """Number of noise channels."""
        return len(self.v)

    @property
    def n_f(self) -> int:
        """Number of fault channels."""
        return len(self.f)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.modes)

    def limits(self, vector: str) -> tuple[Array, Array]:
        """Return the lower and upper limits of a signal vector as arrays.

        Parameters
        ----------
        vector : {"x", "u", "y", "w", "v", "f", "theta"}

        Returns
        -------
        lo, hi : ndarray (n,)
        """
        signals = getattr(self, vector)
        return np.array([s.lo for s in signals]), np.array([s.hi for s in signals])

    def acts_on_state(self, channel: str) -> bool:
        """Whether a fault reaches the state of a mode.

        Parameters
        ----------
        channel : str
        """
        j = [f.name for f in self.f].index(channel)
        return any(m.Bf[:, j].any() for m in self.modes)

    def estimated(self, count: int) -> tuple[Signal, ...]:
        """Return what an estimate of so many entries is of: the states, then the faults.

        Parameters
        ----------
        count : int
            n_x, or n_x + n_f.

        Returns
        -------
        signals : tuple of Signal
            A fault with the name of a state has "fault" behind it.
        """
        taken = {s.name for s in self.x}
        faults = (replace(s, name=f"{s.name} fault") if s.name in taken else s for s in self.f)
        return (*self.x, *faults)[:count]

    def theta_box(self, mode: Mode) -> tuple[Array, Array]:
        """Return the bounds of all parameters in a mode: its own where it gives some.

        Returns
        -------
        lo, hi : ndarray (n_theta,)
        """
        return self.limits("theta") if mode.theta_bounds is None else mode.theta_bounds


@dataclass(frozen=True)
class PlantTrace:
    """A simulated (or recorded) run of K samples; row k is sample k.

    ``x`` (K, n_x), ``u`` (K, n_u), ``y`` (K, n_y), ``q`` (K,) int, ``theta`` (K, n_theta), ``w`` (K, n_w),
    ``v`` (K, n_v), ``f`` (K, n_f). ``q[k]`` carries x_k to x_{k+1}; ``u[k]`` is held until then. For a
    record ``x``, ``w`` and ``v`` are NaN and ``f`` is the label.
    """

    x: Array
    u: Array
    y: Array
    q: Array
    theta: Array
    w: Array
    v: Array
    f: Array
