"""The whole way, in six steps: check, synthesise, certify, emit, compile and validate, report."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .analysis.validate import Outcome, validate
from .designs import Design, read_checked
from .errors import EmitError, ValidationError
from .periods import FACTORS, PeriodPoint, curve
from .plant.load import load
from .plant.model import Plant
from .selection.select import choose
from .synthesis import METHODS
from .synthesis.policy import share_of

Progress = Callable[[str], None]


def silent(text: str) -> None:
    """Progress that goes nowhere."""


def design(plant: Plant, method: str | None = None, progress: Progress = silent, **options) -> Design:
    """Synthesise and certify an observer for a plant.

    Parameters
    ----------
    plant : Plant
    method : str, optional
        A key of METHODS; default: the plant file's, else the best of all that apply.
    progress : callable
        Gets one line per step.
    **options
        Override those of ``[observer]``: ``criterion``, ``lyapunov``, ``lambda_`` ...

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        No design exists; says which mode and entry obstructs.
    CertificateError
        None survives rounding.
    """
    given = {k.rstrip("_"): v for k, v in options.items()}
    return choose(plant, method or plant.method or None, {**plant.options, **given}, progress)


@dataclass(frozen=True)
class Result:
    """What ``run`` leaves behind."""

    folder: Path
    design: Design
    outcomes: list[Outcome]


def run(plant, out=None, method: str | None = None, real: str | None = None, layout: str | None = None,
        progress: Progress = silent, compare: bool = False) -> Result:
    """Take a plant to a folder of validated firmware with a report.

    Parameters
    ----------
    plant : Plant, or path or gallery name
    out : path, optional
        Default ``./<plant>_<method>``.
    method, real, layout : str, optional
        Override the plant file.
    progress : callable
    compare : bool
        Design the other methods too; the report then shows them side by side.

    Returns
    -------
    Result

    Raises
    ------
    ResiduaError
        Any step; then nothing is left at ``out`` that was not there before.
    """
    # Here and not above: design() alone needs neither templates nor matplotlib.
    from .assurance import document
    from .emit import package
    from .host.build import build
    from .report.page import write_report

    plant = plant if isinstance(plant, Plant) else load(plant)
    progress(f"plant {plant.name}: {plant.n_x} states, {plant.n_modes} modes")
    if out is not None:  # before minutes of synthesis, not after
        package.check_place(Path(out))
        shutil.rmtree(staging(Path(out)))
    target = replace(plant.target, real=real or plant.target.real, layout=layout or plant.target.layout)
    made = design(replace(plant, target=target), method, progress)
    final = Path(out) if out else Path.cwd() / f"{plant.name}_{made.method}"
    package.check_place(final)
    stage = staging(final)
    try:
        progress("printing C")
        folder = package.generate(made, stage / final.name, real=target.real, layout=target.layout)
        progress("reading the C back")
        document.write(folder, made)
        progress("compiling")
        driver = build(folder)
        outcomes = validate(made, driver, progress=progress)
        periods = period_curve(made, progress)
        others = side_by_side(plant, target, progress) if compare else ()
        progress("writing the report")
        document.update(folder, "validation", (outcomes, broken(made, driver.real, outcomes), plant.scenarios),
                        lambda: made)
        write_report(folder, made, driver, outcomes, periods, others)
        require(made, driver.real, outcomes)
        package.publish(folder, final)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return Result(final, made, outcomes)


def period_curve(made: Design, progress: Progress = silent) -> list[PeriodPoint]:
    """Guaranteed width against sampling period, for the method of a design.

    Empty for a discrete plant, where coordinates are changed (each period would need its own search), and where nobody
    tells the mode: what the framers of one mode guarantee is less than what is answered then.

    Gains N, relative to what reproduces the measurement, are no larger than the design's: it sees faults as well.

    Parameters
    ----------
    made : Design
    progress : callable

    Returns
    -------
    list of PeriodPoint
    """
    if not METHODS[made.method].framers or not made.plant.switching.known:
        return []
    if made.plant.kind != "continuous" or made.observer.tables[made.plant.target.real].change is not None:
        return []
    method, tables = METHODS[made.method], made.observer.tables[made.plant.target.real]
    share = share_of(made.plant.modes[0].C, tables.N_hi.astype(float)) if method.tnl else np.inf
    points = []
    for n, factor in enumerate(FACTORS, 1):
        progress(f"sampling periods, {n} of {len(FACTORS)}: {made.plant.sample_period * factor:.3g} s")
        points += curve(made.plant, method.tnl, getattr(method.module, "SPLIT", False), (factor,), share)
    return points


def side_by_side(plant: Plant, target, progress: Progress) -> list:
    """What the other methods give on a plant, with its number type and layout; see ``compare``."""
    from .compare import compare

    return compare(replace(plant, target=target), progress=progress)


def generate(design: Design, out, real: str | None = None, layout: str | None = None) -> Path:
    """Write the output folder of a design: C, design.json, resources.json, assurance.json.

    Parameters
    ----------
    design : Design
    out : str or Path
        Folder; appears whole or not at all. One that residua made is replaced, any other is refused. Files
        of others in it are kept.
    real : {"float32", "float64"}, optional
        Default: the plant file's.
    layout : {"literal", "table", "loop"}, optional
        Default: the plant file's.

    Returns
    -------
    folder : Path

    Raises
    ------
    EmitError
        The folder exists and is not ours, or cannot be written.
    CertificateError
        The C that was printed does not hold the constants of the design.
    ToolError
        gcc is missing or refuses the C.
    """
    from .assurance import document
    from .emit import package

    final = Path(out)
    package.check_place(final)
    stage = staging(final)
    try:
        folder = package.generate(design, stage / final.name, real=real, layout=layout)
        document.write(folder, design)
        return package.publish(folder, final)
    except OSError as error:
        raise EmitError(f"{final}: {error.strerror or error}. Choose a folder that can be written.") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def record(folder, check: str, result) -> str:
    """Enter a command's result in the folder's assurance.json.

    Parameters
    ----------
    folder : path
    check : str
        Key of ``assurance.checks.CHECKS``.
    result : object
        See ``assurance.checks.outcome``.

    Returns
    -------
    problem : str
        Why it could not be entered, or what is wrong with the file; empty where all is well.
    """
    from .assurance import document

    return document.update(folder, check, result, lambda: read_checked(folder))


def check_assurance(folder) -> dict:
    """Check that the assurance.json of a folder is true of the files beside it.

    Parameters
    ----------
    folder : path

    Returns
    -------
    document : dict
        See ``codegen.assurance``.

    Raises
    ------
    CertificateError
        The design does not certify, or the file differs from what it should say: names the first difference.
    """
    from .assurance import document

    return document.verify(folder, read_checked(folder))


def staging(final: Path) -> Path:
    """Make an empty folder beside the final one, on the same file system.

    Raises
    ------
    EmitError
        The place cannot be written.
    """
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=f".{final.name}.", dir=final.parent))
    except OSError as error:
        raise EmitError(f"{final}: {error.strerror or error}. Choose a folder that can be written.") from error


def require(made: Design, real: str, outcomes: list[Outcome]) -> None:
    """Raise where the compiled C broke a promise: equality, containment, no false alarm, surely detected faults.

    Raises
    ------
    ValidationError
    """
    from .report.outcome_words import kept, promise

    for o in outcomes:
        for e in o.episodes:
            if not kept(made, real, o, e):
                limit, _ = promise(made, real, o, e)
                raise ValidationError(
                    f'scenario "{o.scenario.name}": fault of {e.size:g} on {e.channel} at sample {e.start} found after '
                    f"{e.delay} samples, expected at most {limit}. Do the matrices hold on the real plant?")
        if o.differences:
            raise ValidationError(f'scenario "{o.scenario.name}": C and reference differ in '
                                  f'{", ".join(o.differences)}, expected ==. '
                                  "Check the compiler for -ffast-math or contraction.")
        if o.steering is not None and o.steering.broken:
            raise ValidationError(f'scenario "{o.scenario.name}": {o.steering.broken[0]} (found), expected what the '
                                  "certificate says. Do the matrices hold on the real plant?")
        if o.late:
            raise ValidationError(f'scenario "{o.scenario.name}": a mode ruled out by then was decided for at {o.late} '
                                  "samples, expected none. Does the scenario keep to the declared bounds and dwell "
                                  "time?")
        if o.lost or o.false_alarms:
            raise ValidationError(f'scenario "{o.scenario.name}": {o.lost} samples outside the bounds and '
                                  f"{o.false_alarms} false alarms (found), expected none. Does the scenario keep to "
                                  "the declared bounds, and do they hold on the real plant?")


def broken(made: Design, real: str, outcomes: list[Outcome]) -> str:
    """Say which promise ``require`` finds broken; empty where all are kept."""
    try:
        require(made, real, outcomes)
    except ValidationError as error:
        return str(error)
    return ""


__all__ = ["Design", "Result", "broken", "check_assurance", "design", "generate", "period_curve", "record", "require",
           "run"]
