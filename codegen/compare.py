"""Every applicable method side by side on one plant: designed, certified, printed and measured alike.

A point observer is tried with every set and every table that the methods know. Where the plant file gives gains they
belong to the method that it names, and the others find their own.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from .analysis.detectability import limited, ultimate_errors
from .certify.claims import ultimate_width
from .designs import Design
from .emit.package import generate
from .emit.render import template_root
from .errors import CertificateError, DesignError, EmitError, ToolError
from .observers import ModeTables
from .pipeline import design, silent
from .plant.model import Plant
from .synthesis import METHODS, SETS, known_options
from .target.boards import BOARDS
from .target.onboard import present, run_on

#: Options that make a variant: they are not taken from the plant file.
VARIANT = ("set", "order", "tables", "rows", "stages", "directions", "schedule", "weights")
BOARD, CHIP = "m4f", "cortex-m4f"


@dataclass(frozen=True)
class Variant:
    """What is tried: a method, and options beside those of the plant file."""

    name: str
    method: str
    options: dict


@dataclass(frozen=True)
class Compared:
    """What a variant gave on a plant; None where there is no such figure.

    Parameters
    ----------
    name, method : str
    options : dict
    reason : str
        Why there is no design; empty where there is one.
    family : str
        Run-time family.
    label : str
        Which of the method's candidates was chosen.
    width : float or None
        Guaranteed ultimate width of the states, each in units of its declared range, summed.
    faults : list of list of float or None
        By channel and samples since the onset: smallest step that is surely detected.
    dwell : float or None
        Samples that a mode has to last (on average) for the guarantee; 0: any switching.
    multiply, add : int or None
        Of the dearest step.
    instructions : int or None
        Of the dearest ordinary step on a simulated Cortex-M4F.
    flash, ram, stack : int or None
        Bytes: code and constants, the observer's state, a step; by the compiler in ``chip``.
    chip : str
    """

    name: str
    method: str
    options: dict
    reason: str = ""
    family: str = ""
    label: str = ""
    width: float | None = None
    faults: list | None = None
    dwell: float | None = None
    multiply: int | None = None
    add: int | None = None
    instructions: int | None = None
    flash: int | None = None
    ram: int | None = None
    stack: int | None = None
    chip: str = ""


def variants(orders: Sequence[int] = ()) -> list[Variant]:
    """Walk over the methods; a point observer comes once per set and once per table.

    Parameters
    ----------
    orders : sequence of int
        Of zonotopes; none: the one that the design chooses.

    Returns
    -------
    list of Variant
    """
    found = []
    for name, method in METHODS.items():
        if not method.sets:
            found.append(Variant(name, name, {}))
            continue
        for kind in SETS["set"]:
            found += [Variant(", ".join([f"{name}: {kind}", *(f"{k} {v}" for k, v in o.items())]), name,
                              {"set": kind, **o}) for o in kinds_of(kind, orders)]
        found += [Variant(f'{name}: table "{t}"', name, {"tables": t}) for t in SETS["tables"] if t != "none"]
    return found


def kinds_of(kind: str, orders: Sequence[int]) -> list[dict]:
    """Options that make several variants of one set: orders of a zonotope, weights of an ellipsoid."""
    several = {"zonotope": [{"order": n} for n in orders],
               "ellipsoid": [{"weights": w} for w in SETS.get("weights", ())]}
    return several.get(kind) or [{}]


def chosen_variants(methods: Sequence[str], orders: Sequence[int] = ()) -> list[Variant]:
    """Those of ``variants`` whose method is named; all where none is.

    Raises
    ------
    DesignError
        A method that does not exist.
    """
    for name in methods:
        if name not in METHODS:
            raise DesignError(f'compare: method "{name}" (found), expected one of {", ".join(METHODS)}.')
    return [v for v in variants(orders) if not methods or v.method in methods]


def options_for(plant: Plant, variant: Variant) -> dict:
    """Options of the plant file that the variant's method reads, and its own."""
    known, own = known_options([variant.method]), plant.method == variant.method
    kept = {k: v for k, v in plant.options.items() if k in known and k not in VARIANT and (own or k != "gains")
            and (own or not isinstance(known[k], tuple) or v in known[k] or not isinstance(v, str))}
    return kept | variant.options


def compare(plant: Plant, chosen: Sequence[Variant] | None = None, progress: Callable[[str], None] = silent,
            keep: Callable[[Variant, Design], None] = lambda v, made: None) -> list[Compared]:
    """Design, print and measure every variant.

    Parameters
    ----------
    plant : Plant
    chosen : sequence of Variant, optional
        Default: ``variants()``.
    progress : callable
    keep : callable
        Is given every design.

    Returns
    -------
    list of Compared
        In the order given; those without a design say why.
    """
    chosen, out = variants() if chosen is None else chosen, []
    for n, v in enumerate(chosen, 1):
        progress(f"{n} of {len(chosen)}: {v.name}")
        inapplicable = METHODS[v.method].module.inapplicable(plant)
        if inapplicable is not None:
            out.append(Compared(v.name, v.method, v.options, reason=f"does not apply: {inapplicable}"))
            continue
        try:
            out.append(one(plant, v, progress, keep))
        except (DesignError, CertificateError, EmitError) as error:
            out.append(Compared(v.name, v.method, v.options, reason=str(error).removeprefix(f"{plant.name}: ")))
    return out


def one(plant: Plant, v: Variant, progress: Callable[[str], None], keep: Callable[[Variant, Design], None]) -> Compared:
    """Design and measure one variant.

    Raises
    ------
    DesignError, CertificateError, EmitError
    """
    given = options_for(plant, v)
    made = design(replace(plant, options={}), v.method, lambda text: progress(f"{v.name}: {text}"), **given)
    keep(v, made)
    with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
        folder = generate(made, Path(scratch) / "out", real=plant.target.real, layout=plant.target.layout)
        return Compared(v.name, v.method, v.options, **figures(made, folder))


def figures(made: Design, folder: Path) -> dict:
    """Return the figures of ``Compared`` of a design and its printed C.

    Parameters
    ----------
    made : Design
    folder : Path
        Of ``generate``.

    Returns
    -------
    dict
    """
    real = made.plant.target.real
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    chip = CHIP if CHIP in record["measured"] else "host"
    size = record["measured"][chip]
    work = record["operations_per_step"]
    return {"family": made.observer.family, "label": made.choice[0]["design"], "width": relative_width(made),
            "dwell": dwell_of(made), "faults": [f["by_delay"] for f in made.detection[real]],
            "multiply": work["multiply"], "add": work["add"], "flash": size["flash_bytes"],
            "ram": record["state_bytes"], "stack": size["stack_bytes"]["step"], "chip": chip,
            "instructions": instructions(folder)}


def instructions(folder: Path) -> int | None:
    """Instructions of the dearest ordinary step on a simulated Cortex-M4F; None where it cannot be simulated."""
    if not present(BOARDS[BOARD]):
        return None
    try:
        counts = run_on(folder, BOARD, template_root() / "harness" / "board").counts
        return (counts["ordinary"] if counts["ordinary"].calls else counts["step"]).most  # calibrated: none is assured
    except ToolError:
        return None


def relative_width(made: Design) -> float | None:
    """Guaranteed ultimate width, each state in units of its range, summed; None where none is proved."""
    cert = made.certificate[made.plant.target.real]
    width, errors = ultimate_width(cert), ultimate_errors(cert)
    if width is None:
        width = None if errors is None else errors[0] + errors[1]
    lo, hi = made.plant.limits("x")
    return None if width is None else float(np.sum(np.array(width) / np.maximum(hi - lo, 1e-300)))


def dwell_of(made: Design) -> float:
    """Samples that a mode has to last (on average) for what is proved; 0: any switching."""
    cert, t = made.certificate[made.plant.target.real], made.observer.tables[made.plant.target.real]
    if isinstance(t, ModeTables):
        return float(t.ages + 1)
    if cert["kind"] == "filter":
        return cert["dwell_add"] / cert["dwell_drain"] if cert["dwell_add"] else 0.0
    table = getattr(getattr(t, "shape", None), "dwell", 1)
    proof = limited(cert) if cert["kind"] in ("linf", "hinf") else None
    return max(0.0 if table == 1 else float(table), 0.0 if proof is None else float(proof[0]))


def save(path, plant: Plant, found: Sequence[Compared]) -> Path:
    """Write a comparison as JSON; whole or not at all.

    Raises
    ------
    EmitError
        The file cannot be written.
    """
    path = Path(path)
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(json.dumps({"plant": plant.name, "rows": [asdict(c) for c in found]}, indent=1) + "\n",
                        encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise EmitError(f"{path}: {error.strerror or error}. Choose a folder that can be written.") from error
    return path
