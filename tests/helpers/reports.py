"""Small certified designs in a tenth of a second, and a stand-in for the compiled driver: no solver, no gcc."""

import json
from dataclasses import dataclass, replace

from codegen.analysis.validate import validate
from codegen.plant.load import load
from codegen.selection.select import choose

# Rounded from designs that the synthesis found.
GAINS = {"cart": {"L": [[[1.0], [-100.0]], [[1.0], [-90.0]]], "N": [[[-0.0003095], [100.0]], [[-0.0003095], [90.0]]]},
         "emps": {"L": [[[1.108], [-198.9]], [[1.099], [-198.9]], [[1.001], [-198.9]]],
                  "N": [[[-0.1082], [198.9]], [[-0.09916], [198.9]], [[-0.00106], [198.9]]]}}
RESOURCES = {"real": "float32", "layout": "table", "state_bytes": 44,
             "operations_per_step": {"multiply": 7, "add": 13, "compare": 14},
             "measured": {"host": {"compiler": "gcc 12.2.0", "flags": "-Os", "flash_bytes": 1594, "ram_bytes": 0,
                                   "stack_bytes": {"step": 16}},
                          "cortex-m4f": {"compiler": "arm-none-eabi-gcc", "flags": "-Os", "flash_bytes": 1212,
                                         "ram_bytes": 0, "stack_bytes": {"step": None}}}}


@dataclass(frozen=True)
class StandInDriver:
    """Answers as the compiled C does: with the reference, in the same number type."""

    design: object
    real: str = "float32"
    layout: str = "table"

    @property
    def prefix(self):
        return self.design.plant.target.prefix

    def run(self, u, y, q=None, theta=None, x0_lo=None, x0_hi=None):
        return self.design.observer.run(u=u, y=y, q=q, theta=theta, real=self.real, x0_lo=x0_lo, x0_hi=x0_hi)

    def run_many(self, u, y, q, theta=None):
        return self.design.observer.run_many(u, y, q, self.real, theta=theta)


def small_design(name, **changes):
    """A gallery plant with given gains; ``changes`` are fields of the plant."""
    return choose(replace(load(name), **changes), "tnl-interval", {"gains": GAINS[name]}, lambda text: None)


def short_record(steps):
    """The emps design whose only scenario is the beginning of the record with pulses."""
    pulses = next(s for s in load("emps").scenarios if s.name == "pulses")
    return small_design("emps", scenarios=(replace(pulses, steps=steps),))


def output_folder(folder, design):
    """A folder as generate leaves it, with the files that the report reads or lists."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in (f"{design.plant.target.prefix}.c", f"{design.plant.target.prefix}.h"):
        (folder / name).write_text("")
    (folder / "resources.json").write_text(json.dumps(RESOURCES))
    design.save(folder / "design.json")
    return folder


def outcomes_of(design):
    return validate(design, StandInDriver(design))
