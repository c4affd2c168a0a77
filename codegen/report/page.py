"""The report: one HTML file that shows a design, its proof, its validation and its firmware to a person."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from ..analysis.validate import Outcome
from ..emit.render import template_root
from ..errors import EmitError
from . import (
    assurance_words,
    compare_words,
    firmware_words,
    frequency_words,
    outcome_words,
    period_words,
    plant_words,
    plots,
    set_words,
    steering_words,
)
from .assurance_words import AssuranceWords
from .design_words import DesignWords, words_of
from .frequency_words import FrequencyWords
from .period_words import PeriodWords
from .set_words import SetWords, Watched
from .table import Fact, Folded, Link, Plot, Table
from .verdict import Verdict, verdict


@dataclass(frozen=True)
class ScenarioView:
    """One scenario: words, faults, plots; ``states`` is folded open."""

    name: str
    anchor: str
    summary: str
    faults: tuple[Table, ...]
    folded: tuple[Folded, ...]
    plots: tuple[Plot, ...]
    sets: tuple[Plot, ...]
    states: tuple[Plot, ...]


@dataclass(frozen=True)
class ReportView:
    """Everything on the page, in its order."""

    title: str
    verdict: Verdict
    plant_facts: tuple[Fact, ...]
    plant_tables: tuple[Table, ...]
    design: DesignWords
    periods: tuple[PeriodWords, ...]
    frequencies: tuple[FrequencyWords, ...]
    sets: tuple[SetWords, ...]
    validation: tuple[Table, ...]
    scenarios: tuple[ScenarioView, ...]
    cost_facts: tuple[Fact, ...]
    cost_tables: tuple[Table, ...]
    compared: tuple[Table, ...]
    gains: tuple[Folded, ...]
    assurance: AssuranceWords
    provenance: tuple[Fact, ...]
    files: tuple[Link, ...]


def write_report(folder, design, driver, outcomes: list[Outcome], periods: Sequence = (),
                 compared: Sequence = ()) -> Path:
    """Write ``report.html`` into the output folder; whole or not at all.

    Parameters
    ----------
    folder : str or Path
        That ``generate`` wrote.
    design : Design
    driver : Driver
        Of ``host.build``; its ``real``, ``layout`` and ``prefix`` are shown.
    outcomes : list of Outcome
        Of ``analysis.validate``.
    periods : sequence of PeriodPoint
        Of ``periods.curve`` for a continuous plant.
    compared : sequence of Compared
        Of ``compare``, where it was run.

    Returns
    -------
    path : Path

    Raises
    ------
    EmitError
        The file cannot be written.
    """
    path = Path(folder) / "report.html"
    text = _print(view(Path(folder), design, driver, outcomes, periods, compared))
    part = path.with_name("report.html.part")
    try:
        part.write_text(text, encoding="utf-8", newline="\n")
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise EmitError(f"{path}: {error.strerror or error}. Choose a folder that can be written.") from error
    return path


def view(folder: Path, design, driver, outcomes: list[Outcome], periods: Sequence = (),
         compared: Sequence = ()) -> ReportView:
    """Decide everything that the template prints; the parameters are those of ``write_report``."""
    plant, real, record = design.plant, driver.real, firmware_words.read_record(folder)
    cost_facts, cost_tables = firmware_words.cost(record)
    scenes = set_words.watched(design, real, outcomes)
    return ReportView(
        title=f"{plant.title or plant.name}: fault-detection firmware",
        verdict=verdict(design, real, record, outcomes),
        plant_facts=plant_words.facts(plant), plant_tables=plant_words.tables(plant),
        design=words_of(design, real), periods=period_words.words_of(design, real, periods),
        frequencies=frequency_words.words_of(design, real),
        sets=set_words.words_of(design, scenes),
        validation=(outcome_words.validation_table(outcomes), *steering_words.tables(outcomes)) if outcomes else (),
        scenarios=tuple(_scenario(design, real, i, o, w) for i, (o, w) in enumerate(zip(outcomes, scenes))),
        cost_facts=cost_facts, cost_tables=cost_tables, compared=compare_words.tables(design, compared),
        gains=firmware_words.gains(design, real),
        assurance=assurance_words.words_of(folder),
        provenance=firmware_words.provenance(design, real, driver.layout, driver.prefix),
        files=firmware_words.links(folder, driver.prefix))


def _scenario(design, real: str, index: int, o: Outcome, w: Watched | None) -> ScenarioView:
    faults, folded = outcome_words.episode_tables(design, real, o)
    anchor = f"s{index}"
    return ScenarioView(o.scenario.name, anchor, outcome_words.summary(design, o), faults, folded,
                        plots.tracking(design, real, o, anchor) + plots.residuals(design.plant, o, anchor),
                        set_words.pictures(design, w, anchor),
                        plots.states(design.plant, o, anchor))


@cache
def _environment() -> Environment:
    """The jinja environment of HTML: as the one of the C, but everything is escaped."""
    return Environment(loader=FileSystemLoader(template_root()), undefined=StrictUndefined, trim_blocks=True,
                       lstrip_blocks=True, keep_trailing_newline=True, autoescape=True)


def _print(report: ReportView) -> str:
    try:
        return _environment().get_template("report/report.html.jinja").render(r=report)
    except TemplateError as error:
        raise EmitError(f"templates/report: {type(error).__name__}: {error}. Correct the template.") from error
