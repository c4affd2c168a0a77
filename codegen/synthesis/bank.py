"""Which sensor is at fault: a bank of detection observers, one per fault, each without the sensors of its fault.

Plant: polytopic, y = C x + Dv v + Df f, every fault one of sensors alone (Bf = 0). Member p reads the outputs that
fault p leaves alone. It is the detection observer of ``hminus_hinf`` for slow faults, of all other faults at once,
stepped by Euler's rule, or of a discrete plant that of ``hminus_hinf_discrete``: fault p cannot move it, whatever its
course, and every other constant fault moves its residual by a certified size. The run-time logic is in
``observers.bank``.

Weights may read states, inputs and measured parameters. Where these are measured exactly (and inputs are), plant and
observer weigh alike what rests on them alone, and T1 is one for all vertices (``descriptor_problem.pairs_of``).

A fault that moves the state (Bf is not zero) enters the error of every member as T1 Bf f, whichever outputs it reads:
none would stay quiet. That takes an observer with T1 Bf = 0, where the outputs see the fault at once. It is another
design, in which rounding leaves a little of that zero to be bounded.

Source: F. R. Lopez-Estrada, PhD thesis, Universite de Lorraine, 2014, section 3.6 (generalised scheme) and Theorem
4.3.3. Differences from the print:

* the observers are those of chapter 4, sensitive to what they are to see: the H-infinity designs of section 3.6 lower
  the residual and the faults in it together.
* the incidence of fault 2 on residual 2 is 0, where tables 3.3 and 3.8 print 1.
* thresholds ("predefined" in print) come from a campaign of fault-free runs, with the confidence of order statistics.
* residuals are averaged before they are compared, and an alarm holds for a while; lost samples are bridged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..algebra.pencil import rank
from .descriptor_problem import DescriptorProblem, Scaling, refusal
from .hminus_hinf import Faults

Array = np.ndarray

#: Options of ``[observer]``: decay of the errors (1/s; of a discrete plant per sample) and size of the gains, time
#: constant of the averages and how long an alarm holds (s), lost samples in succession that are bridged, factor on the
#: largest fault-free residual, probability that a run of the campaign's kind exceeds it, the confidence in that, seed
#: of the campaign.
OPTIONS = {"decay": (1e-9, 1e9), "gain": (1e-6, 1e9), "average": (1e-9, 1e6), "keep": (0.0, 1e6), "bridge": (1, 100),
           "margin": (1.0, 100.0), "probability": (1e-3, 0.5), "confidence": (0.5, 0.999), "seed": (0, 2**31)}
#: Where the plant file says nothing.
GAIN, MARGIN, PROBABILITY, CONFIDENCE = 100.0, 1.25, 0.05, 0.95
#: Then the errors decay so many times faster than the slowest mode, of a discrete plant by a factor e per sample at
#: most; samples that averages take and alarms hold.
FASTER, AVERAGE, KEEP = 1.5, 25, 100
#: Lost samples in succession that are bridged; measured ones that pay for each.
BRIDGE, GAP = 5, 20


def inapplicable(plant) -> str | None:
    """Why a plant cannot have a bank, with what to change; None if it can.

    Parameters
    ----------
    plant : Plant
    """
    reason = refusal(plant)
    if reason is not None:
        return f"{reason}."
    if plant.n_f < 2:
        return f"signals.f has {plant.n_f} faults, expected two at least: with one there is nothing to tell apart."
    p = plant.polytope
    for k, fault in enumerate(plant.f):
        if any(np.any(v.Bf[:, k]) for v in p.vertices):
            other = "hminus-hinf" if plant.kind == "continuous" else "descriptor-discrete"
            return (f'fault "{fault.name}" acts on the state (Bf is not zero), expected faults of sensors: it '
                    "enters the error of every observer (T1 Bf f), so that none is blind to it for reading fewer "
                    f'outputs. That there is a fault, not which, method "{other}" says; leave it out to tell the '
                    "sensors apart while it does not act.")
        rows = sensors(plant, k)
        if not 0 < len(rows) < plant.n_y:
            return f'fault "{fault.name}" acts on {len(rows)} of {plant.n_y} outputs, expected some, but not all.'
        hidden = [g.name for j, g in enumerate(plant.f) if j != k and set(sensors(plant, j)) <= set(rows)]
        if hidden:
            return (f'fault "{hidden[0]}" acts on no output that "{fault.name}" leaves alone, so that nothing tells it '
                    "from that. Declare them as one fault.")
        left = [i for i in range(plant.n_y) if i not in rows]
        if rank(np.vstack([p.E, p.C[left]])) < plant.n_x:
            return (f'without the sensors of "{fault.name}" rank [E; C] is less than the number of states: the outputs '
                    "that are left do not see an algebraic state. Measure it twice, or leave this fault out.")
    return None


def decay_of(problem: DescriptorProblem) -> float:
    """How fast the errors decay where the plant file does not say, per second, or per sample where it is discrete.

    Parameters
    ----------
    problem : DescriptorProblem
    """
    if problem.kind == "discrete":
        slow = problem.slowest_step()
        return float(min(-FASTER * np.log(slow), 1.0)) if slow > 0 else 1.0
    return FASTER * problem.slowest()


def sensors(plant, fault: int) -> list[int]:
    """The outputs that a fault acts on.

    Parameters
    ----------
    plant : Plant
        With a polytope.
    fault : int
        Channel.
    """
    return [int(i) for i in np.flatnonzero(plant.polytope.Df[:, fault])]


def member(plant, problem: DescriptorProblem, faults: Faults, s: Scaling,
           fault: int) -> tuple[Array, DescriptorProblem, Faults, Scaling]:
    """The task of the observer that leaves out the sensors of one fault.

    Parameters
    ----------
    plant : Plant
    problem : DescriptorProblem
    faults : Faults
        All, in units of their ranges.
    s : Scaling
    fault : int
        Channel.

    Returns
    -------
    seen : ndarray (p,) int
        The outputs that are left.
    problem : DescriptorProblem
    faults : Faults
        The other ones.
    s : Scaling
    """
    seen = np.array([i for i in range(plant.n_y) if i not in sensors(plant, fault)])
    other = [k for k in range(plant.n_f) if k != fault]
    left = replace(problem, C=problem.C[seen], Dd=problem.Dd[seen], H=problem.C[seen], J=problem.Dd[seen])
    others = Faults(faults.Bf[:, :, other], faults.Df[np.ix_(seen, other)])
    return seen, left, others, replace(s, outputs=s.outputs[seen])
