"""The plant file's tables, keys and types, as pydantic models: structure only.

What needs two tables at once (shapes, names, ranges against boxes) is checked where it is built:
`signals.py`, `matrices.py`, `scenarios.py`. ``messages.py`` turns pydantic's errors into ours.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat

from codegen.plant import values

MATRIX_NAMES = ("A", "B", "C", "D", "Bw", "Dw", "Dv", "Bf", "Df")


Interval = Annotated[list[float], BeforeValidator(values.interval)]
Matrix = Annotated[list[list[float | str]], BeforeValidator(values.matrix)]
Numbers = list[FiniteFloat]
Signals = Annotated[Any, BeforeValidator(values.excitation)]
Schedule = Annotated[Any, BeforeValidator(values.schedule)]
Shared = Annotated[Any, BeforeValidator(values.shared)]


class Table(BaseModel):
    """A table whose keys are all known and whose values have the exact type."""

    model_config = ConfigDict(extra="forbid", strict=True, populate_by_name=False)


class RangeSignal(Table):
    """A channel of x, u, y or f; the range is what the firmware checks or relies on."""

    name: str
    unit: str = ""
    range: Interval | None = None


class BoundSignal(Table):
    """A channel of w or v; the bounds are an assumption of every guarantee, so they are required."""

    name: str
    unit: str = ""
    bounds: Interval


class InputSignal(RangeSignal):
    """A channel of u; rate is its largest change per second between samples (left out: it is held)."""

    rate: Annotated[FiniteFloat, Field(gt=0)] | None = None


class ThetaSignal(BoundSignal):
    """A scheduling parameter: its largest change per second, the largest error of its measurement."""

    measured: bool = True
    rate: Annotated[FiniteFloat, Field(gt=0)] | None = None
    error: Annotated[FiniteFloat, Field(ge=0)] = 0.0


class TimeTable(Table):
    """``[time]``: sample_period in seconds."""

    kind: Literal["discrete", "continuous"]
    sample_period: Annotated[FiniteFloat, Field(gt=0)]


class SignalsTable(Table):
    """``[signals]``."""

    x: Annotated[list[RangeSignal], Field(min_length=1)]
    u: list[InputSignal] = []
    y: Annotated[list[RangeSignal], Field(min_length=1)]
    w: list[BoundSignal] = []
    v: list[BoundSignal] = []
    f: list[RangeSignal] = []
    theta: list[ThetaSignal] = []


class InitialTable(Table):
    """``[initial]``: the box of the initial state."""

    x_lo: Numbers
    x_hi: Numbers


class MatricesTable(Table):
    """``[common]``, and the matrices of a mode."""

    E: Matrix | None = None
    A: Matrix | None = None
    B: Matrix | None = None
    C: Matrix | None = None
    D: Matrix | None = None
    Bw: Matrix | None = None
    Dw: Matrix | None = None
    Dv: Matrix | None = None
    Bf: Matrix | None = None
    Df: Matrix | None = None


class ModeTable(MatricesTable):
    """``[[mode]]``; ``bounds`` replaces the bounds of w, v and theta in this mode."""

    name: str
    bounds: dict[str, Interval] = {}


class VertexTable(Table):
    """``[[vertex]]`` of a polytopic plant; E and the outputs are the same at all vertices, so they are in [common]."""

    name: str = ""
    A: Matrix | None = None
    B: Matrix | None = None
    Bw: Matrix | None = None
    Bf: Matrix | None = None
    offset: Numbers | None = None
    weight: str = "1"
    E: Shared = None
    C: Shared = None
    D: Shared = None
    Dv: Shared = None
    Df: Shared = None


class PremiseTable(Table):
    """An entry of ``premise``: a term of the equations that the vertices take at its bounds."""

    name: str
    term: str
    bounds: Interval | None = None


class PointTable(Table):
    """An entry of ``point``: where the equations are linearised, and the weight of what comes out."""

    name: str = ""
    x: Numbers
    u: Numbers = []
    theta: Numbers = []
    weight: str


class NonlinearTable(Table):
    """``[nonlinear]``: E x' = f, by sectors (A and B as factors, known terms, premises) or linearised at points."""

    E: Matrix | None = None
    f: Annotated[list[str], Field(min_length=1)]
    A: Matrix | None = None
    B: Matrix | None = None
    known: list[str] | None = None
    premise: list[PremiseTable] = []
    point: list[PointTable] = []


class SwitchingTable(Table):
    """``[switching]``: dwell times in seconds, or a schedule in samples."""

    known: bool = True
    late: bool = False
    average_dwell: Annotated[FiniteFloat, Field(gt=0)] | None = None
    minimum_dwell: Annotated[FiniteFloat, Field(gt=0)] | None = None
    chatter: Annotated[FiniteFloat, Field(ge=1)] = 1.0
    schedule: Schedule = None


class ObserverTable(BaseModel):
    """``[observer]``: the options are the method's to check."""

    model_config = ConfigDict(extra="allow", strict=True)

    method: str = ""


class AlarmTable(Table):
    """``alarm = { debounce = [m, n], latch = true }``."""

    debounce: list[int] = [1, 1]
    latch: bool = True


class TargetTable(Table):
    """``[target]``: how the C is to look."""

    prefix: str | None = None
    real: Literal["float32", "float64"] = "float32"
    layout: Literal["literal", "table", "loop"] = "table"
    alarm: AlarmTable = AlarmTable()
    recover: Annotated[int, Field(ge=1)] = 50
    hold: Annotated[int, Field(ge=1)] = 10


class FaultTable(Table):
    """An entry of ``fault``; ``to`` is the first sample after the fault (default: it stays)."""

    channel: str
    start: Annotated[int, Field(alias="from", ge=0)]
    stop: Annotated[int | None, Field(alias="to")] = None
    value: str


class ScenarioTable(Table):
    """``[[scenario]]``; steps in samples or duration in seconds."""

    name: str
    steps: Annotated[int, Field(ge=1)] | None = None
    duration: Annotated[FiniteFloat, Field(gt=0)] | None = None
    mode: Schedule = None
    u: list[str] | None = None
    w: Signals = "uniform"
    v: Signals = "uniform"
    theta: Signals = "uniform"
    fault: list[FaultTable] = []
    csv: str = ""


class PlantFile(Table):
    """The whole file."""

    format: Literal[1]
    name: str
    title: str = ""
    source: str = ""
    time: TimeTable
    signals: SignalsTable
    constants: dict[str, FiniteFloat] = {}
    initial: InitialTable
    common: MatricesTable = MatricesTable()
    mode: list[ModeTable] = []
    vertex: list[VertexTable] = []
    nonlinear: NonlinearTable | None = None
    switching: SwitchingTable = SwitchingTable()
    observer: ObserverTable = ObserverTable()
    target: TargetTable = TargetTable()
    scenario: list[ScenarioTable] = []
