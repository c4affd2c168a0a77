"""A finished design: the tables that the C will hold, their certificate, and design.json, which keeps both."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import __version__
from .analysis.detectability import surely_detected
from .certify import (
    driven_certificate,
    follower_certificate,
    guided_certificate,
    guided_point_certificate,
    mode_certificate,
    set_claims,
    sliding_claims,
)
from .certify.claims import check, check_monitor, check_ranges, digest
from .certify.freeze import limits
from .errors import CertificateError, PlantError, ResiduaError
from .observers import (
    FAMILIES,
    BankTables,
    DrivenTables,
    FilterTables,
    FollowerTables,
    GuidedFilterTables,
    GuidedPointTables,
    GuidedTables,
    ModeTables,
    PointTables,
    PolytopicTables,
    Runner,
    SlidingTables,
    Supervision,
    TrailingTables,
)
from .plant.bounded import bounded
from .plant.load import loads
from .plant.model import Plant
from .selection import (
    bank_claims,
    filter_designs,
    guided_filter_claims,
    polytopic_designs,
    tracking_claims,
    trailing_claims,
)

FORMAT = 1
#: Of claims about the discrete plant that encloses a continuous one.
OF_A_STEP = ("; disturbances of the tables are the mean of each over a period, what parameters do, and for each state "
             "one that holds all else")


@dataclass(frozen=True)
class Design:
    """A plant with an observer whose constants are final and certified.

    Parameters
    ----------
    plant : Plant
    method : str
    observer : Runner
        Of the run-time family of the method; ``observer.tables[real]`` for both number types.
    certificate : dict
        real -> certificate of ``certify.claims``.
    proved : dict
        real -> list of sentences.
    detection : dict
        real -> list of {"channel", "unit", "by_delay"}: surely detected faults.
    choice : list of dict
        What was tried: label, criterion figures, chosen or not.
    options : dict
    """

    plant: Plant
    method: str
    observer: Runner
    certificate: dict[str, dict]
    proved: dict[str, list[str]]
    detection: dict[str, list[dict]]
    choice: list[dict] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def plant_sha256(self) -> str:
        """Hash of the plant file's text."""
        return hashlib.sha256(self.plant.text.encode()).hexdigest()

    @property
    def digest(self) -> str:
        """Hash over everything that design.json says."""
        return digest(self.plant_sha256, self.method, self.observer.family, self.observer.supervision.to_dict(),
                      {r: t.to_dict() for r, t in self.observer.tables.items()}, self.certificate, self.proved,
                      self.detection, self.choice, self.options)

    def claims(self, real: str) -> list[str]:
        """What is proved for the tables of one number type, one sentence per claim."""
        return self.proved[real]

    def save(self, path) -> Path:
        """Write design.json; whole or not at all.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Path
        """
        path = Path(path)
        part = path.with_name(path.name + ".part")
        part.write_text(self.to_json(), encoding="utf-8")
        part.replace(path)
        return path

    def to_json(self) -> str:
        """The text of design.json."""
        data = {
            "format": FORMAT, "tool": f"residua {__version__}", "digest": self.digest, "method": self.method,
            "family": self.observer.family, "options": self.options,
            "plant": {"name": self.plant.name, "sha256": self.plant_sha256, "toml": self.plant.text},
            "supervision": self.observer.supervision.to_dict(),
            "tables": {r: t.to_dict() for r, t in self.observer.tables.items()},
            "certificate": self.certificate, "proved": self.proved, "detection": self.detection, "choice": self.choice,
        }
        return pretty(data) + "\n"


def pretty(value, depth: int = 3, indent: str = "") -> str:
    """JSON with one key per line down to a depth, and numbers on one line below it."""
    if isinstance(value, dict) and value and depth > 0:
        inner = indent + " "
        rows = [f"{inner}{json.dumps(k)}: {pretty(v, depth - 1, inner)}" for k, v in value.items()]
        return "{\n" + ",\n".join(rows) + "\n" + indent + "}"
    if isinstance(value, list) and value and isinstance(value[0], dict) and depth > 0:
        inner = indent + " "
        return "[\n" + ",\n".join(inner + json.dumps(v) for v in value) + "\n" + indent + "]"
    return json.dumps(value)


def read_design(path) -> Design:
    """Read design.json back, and check that it belongs together.

    Parameters
    ----------
    path : str or Path
        The file, or the folder that holds it.

    Returns
    -------
    Design

    Raises
    ------
    CertificateError
        The digest does not fit the content.
    PlantError
        The file cannot be read, or the plant inside it is wrong.
    """
    path = Path(path)
    path = path / "design.json" if path.is_dir() else path
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PlantError(f"{path}: cannot be read ({error.strerror}). Give a design.json or the folder "
                         "that holds one.") from error
    except ValueError as error:
        raise PlantError(f"{path}: is no JSON text ({error}). Make it again with: residua design PLANT "
                         "-o design.json") from error
    try:
        return _assemble(path, data)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CertificateError(f"{path}: not a design of format {FORMAT} ({type(error).__name__}: {error}). "
                               "Make it again with: residua design PLANT -o design.json") from error


def _assemble(path: Path, data: dict) -> Design:
    if data["format"] != FORMAT:
        raise CertificateError(f"{path}: format {data['format']} (found), expected {FORMAT}. Use the residua that "
                               "wrote it, or design again.")
    plant = replace(_plant(path, data["plant"]["toml"]), options=data["options"])
    sizes = (plant.n_modes, plant.n_x, plant.n_u, plant.n_y)
    family = FAMILIES[data["family"]]
    tables = {r: family.read(t, sizes) for r, t in data["tables"].items()}
    observer = family(tables, Supervision.from_dict(data["supervision"]))
    design = Design(plant, data["method"], observer, data["certificate"], data["proved"], data["detection"],
                    data["choice"], data["options"])
    if design.digest != data["digest"] or design.plant_sha256 != data["plant"]["sha256"]:
        raise CertificateError(f"{path}: digest {data['digest'][:12]} (found), expected {design.digest[:12]}: a stored "
                               "number was changed. Design again.")
    return design


def _plant(path: Path, text: str) -> Plant:
    """The plant inside a design; its recorded scenarios only where their CSV files are at hand."""
    name, folder = f"{path}: plant", str(path.parent)
    try:
        return loads(text, name=name, folder=folder)
    except PlantError:
        return loads(text, name=name, folder=folder, scenarios=False)


def claims_of(plant: Plant, t, cert: dict) -> list[str]:
    """What is proved of one table, one sentence per claim; a continuous plant is sampled anew for it.

    Raises
    ------
    CertificateError
    """
    if isinstance(t, DrivenTables):
        return driven_certificate.check(bounded(plant), plant.observed.modes, t, cert)
    if isinstance(t, FollowerTables):
        return follower_certificate.check(plant, t, cert)
    if isinstance(t, TrailingTables):
        return trailing_claims.check(plant, t, cert)
    if isinstance(t, ModeTables):
        return mode_certificate.check(bounded(plant), t, cert)
    if isinstance(t, GuidedTables):
        return guided_certificate.check(bounded(plant), plant.observed.modes, t, cert)
    if isinstance(t, GuidedPointTables):
        return guided_point_certificate.check(bounded(plant), plant.enclosed.modes, t, cert, limits(plant))
    if isinstance(t, GuidedFilterTables):
        return guided_filter_claims.check(plant, t, cert)
    if isinstance(t, SlidingTables):
        return sliding_claims.check(bounded(plant), t, cert)
    if isinstance(t, FilterTables):
        return filter_designs.check(plant, t, cert) + between_samples(plant)
    if isinstance(t, PolytopicTables):
        return (polytopic_designs if t.law is None else tracking_claims).check(plant, t, cert)
    if isinstance(t, BankTables):
        return bank_claims.check(plant, t, cert)
    if isinstance(t, PointTables):
        return set_claims.check(plant.enclosed.modes, t, cert) + between_samples(plant, OF_A_STEP)
    return check(plant.observed.modes, t, cert) + between_samples(plant)


def between_samples(plant: Plant, more: str = "") -> list[str]:
    """What is claimed of the time between the samples of a continuous plant, and what its step's disturbances are."""
    if plant.kind != "continuous":
        return []
    return [f"between samples, {plant.sample_period:g} s apart, disturbances and parameters may move as they like "
            "within their bounds and rates: the tables enclose the continuous plant at the samples (the transition "
            f"over a period, recomputed in ball arithmetic at each check){more}"]


def recheck(design: Design) -> dict[str, list[str]]:
    """Repeat every condition of the certificate in exact arithmetic, without the solver.

    The surely detected faults are computed anew too, by the adjoint recursion in double precision.

    Parameters
    ----------
    design : Design

    Returns
    -------
    dict
        real -> what is proved.

    Raises
    ------
    CertificateError
    """
    plant, proved = design.plant, {}
    for real, t in design.observer.tables.items():
        cert = design.certificate[real]
        if design.observer.family == "interval" and np.any([t.N_hi, t.N_lo]):
            raise CertificateError("certificate: N is not zero in tables of a step that does not read the measurement "
                                   'of the next sample (family "interval"). Design again.')
        proved[real] = claims_of(plant, t, cert)
        check_ranges(limits(plant), t)
        check_monitor(design.observer.supervision, cert)
        if proved[real] != design.proved[real]:
            raise CertificateError(f"certificate: the {real} claims of the file are not what is proved. Design again.")
        if not isinstance(t, ModeTables | SlidingTables):  # which promise to find no fault
            _recheck_detection(plant, t, cert, design.detection[real])
    return proved


def _recheck_detection(plant: Plant, t, cert: dict, stored: list[dict]) -> None:
    within = max((len(f["by_delay"]) - 1 for f in stored), default=0)
    for fault, old in zip(surely_detected(plant, t, cert, within), stored, strict=True):
        for d, (new, claimed) in enumerate(zip(fault.by_delay, old["by_delay"], strict=True)):
            if claimed is not None and claimed < new * (1 - 1e-9):
                raise CertificateError(f"certificate: fault {fault.channel} is claimed to be found from {claimed:.6g} "
                                       f"on within {d} samples, only {new:.6g} is sure.")


def read_checked(path) -> Design:
    """``read_design`` for callers that emit: refuses what does not certify."""
    design = read_design(path)
    try:
        recheck(design)
    except ResiduaError as error:
        raise CertificateError(f"{path}: {error}") from error
    return design
