"""Rewrite this folder: design the gallery, or the plants that are named; with --print only print the C again."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from codegen.designs import read_checked
from codegen.emit.package import generate
from codegen.pipeline import design
from codegen.plant.load import load

HERE = Path(__file__).parent
#: What is kept of an output folder; the rest is derived from it.
KEEP = ("design.json", ".h", ".c", ".g", "resources.json")
DESIGNS = (("blower", "zonotope"), ("cart", "tnl-interval"), ("digester", "descriptor-fault-estimation"),
           ("disc", "descriptor-uncertain"),
           ("disc_contact", "descriptor-direct"), ("disc_sensors", "bank"), ("emps", "tnl-interval"),
           ("fan", "zonotope"), ("farhat", "hinf-filter"), ("kiln", "zonotope"), ("press", "tnl-interval"),
           ("pushed", "hinf-filter"), ("quadrotor", "tracking"), ("relay", "tnl-interval"),
           ("valve", "lpv-interval"), ("valve_sliding", "lpv-interval"),
           ("vehicle", "hinf-filter"), ("vessel", "hinf-filter"),
           ("zammali_fd", "interval"), ("zammali_fd", "tnl-interval"), ("buck", "tnl-interval-lpv"),
           ("chevet", "tnl-interval-lpv"), ("hoist", "tnl-interval-lpv"), ("lamouchi", "component-interval"),
           ("lamouchi_coordinates", "component-interval"), ("motor", "tnl-interval-lpv"),
           ("zammali_blocks", "zonotope"), ("zammali_box", "ellipsoid"), ("zammali_dwell", "zonotope"),
           ("zammali_ellipsoid", "ellipsoid"), ("zammali_lpv_ct1", "lpv-interval"), ("zammali_lpv_dt", "lpv-interval"),
           ("zammali_lpv_quadratic", "lpv-interval"), ("zammali_modes", "mode-set"), ("zammali_modes", "mode-sliding"),
           ("zammali_schedule", "ellipsoid"),
           ("zammali_trace", "ellipsoid"), ("zammali_zonotope", "zonotope"))
#: Plants of the gallery whose firmware would have the shape of another's, with other numbers.
LIKE_ANOTHER = ("bioreactor", "lamouchi_detector", "tank", "zammali_lpv_ct2")
#: Plants whose C calls <math.h>: the last bits of its answers are those of the machine, so that none are kept.
WITH_LIBM = ("dlpv",)
#: Methods whose C is that of another method of their family, with other numbers.
SAME_C = ("descriptor-discrete", "descriptor-error", "hminus-hinf")


def main() -> None:
    """Write the folders."""
    named = [a for a in sys.argv[1:] if a != "--print"]
    for plant, method in DESIGNS:
        if named and plant not in named:
            continue
        folder = HERE / f"{plant}_{method}"
        if "--print" in sys.argv:
            made = read_checked(folder)
        else:
            print(f"{plant}, {method} ...", flush=True)
            made = design(load(plant), method)
        with tempfile.TemporaryDirectory() as scratch:
            whole = generate(made, Path(scratch) / "out")
            folder.mkdir(exist_ok=True)
            for path in whole.iterdir():
                if path.name.endswith(KEEP):
                    (folder / path.name).write_bytes(path.read_bytes())


if __name__ == "__main__":
    main()
