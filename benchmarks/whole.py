"""What surrounds the maps in a whole generated step: range checks, supervisor, alarms, keeping the sample.

For each committed design, on Cortex-M4F at -O2: its whole step (the dearest ordinary call of its golden self-test),
and the same C with the step replaced by its two maps alone. The difference is what a rival's kernel would still need
to become an observer that checks its inputs, judges, latches and says whether its guarantee is in force.
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from pathlib import Path

from codegen.target.onboard import run_on

from .measure import START

GENERATED = Path(__file__).resolve().parents[1] / "generated"
MAPS = {"interval": "{p}_arrive(s, out); {p}_residual(in, out); {p}_forward(s, in, out);",
        "tnl": "{p}_forward(s, in, out); {p}_residual(in, out);"}


def measure() -> list[dict]:
    """Measure every committed design of a family whose maps are known here.

    Returns
    -------
    records : list of dict
        ``design``, ``layout``, ``step``, ``maps`` (instructions), ``flash_bytes``, ``stack_bytes`` of the whole.
    """
    records = []
    for folder in sorted(p.parent for p in GENERATED.glob("*/resources.json")):
        resources = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        if resources["family"] not in MAPS:
            continue
        whole = run_on(folder, "m4f", START)
        with tempfile.TemporaryDirectory(prefix="residua-") as scratch:
            alone = run_on(only_maps(folder, resources, Path(scratch) / "maps"), "m4f", START, ("-w",))
        records.append({"design": folder.name, "layout": resources["layout"],
                        "step": whole.counts["ordinary"].most, "maps": alone.counts["step"].most,
                        "flash_bytes": whole.flash_bytes, "stack_bytes": whole.stack_bytes})
    return records


def only_maps(folder: Path, resources: dict, copy: Path) -> Path:
    """Copy a generated folder, the body of its step replaced by the two maps."""
    prefix, family = resources["prefix"], resources["family"]
    shutil.copytree(folder, copy)
    path = copy / f"{prefix}.c"
    head, body, tail = re.fullmatch(rf"(.*\n{prefix}_status {prefix}_step\([^)]*\)\n{{\n)(.*?)(^}}\n.*)",
                                    path.read_text(encoding="ascii"), re.S | re.M).groups()
    assert f"{prefix}_judge" in body
    path.write_text(f"{head}{MAPS[family].format(p=prefix)}\nreturn {prefix.upper()}_OK;\n{tail}", encoding="ascii")
    return copy


def render(records: list[dict]) -> str:
    """Print the records as Markdown."""
    lines = ["## Whole steps of the committed designs", "",
             "Cortex-M4F, -O2; layout and type as their plant files choose. Instructions and bytes.", "",
             "| design | layout | whole step | its maps alone | around them | flash of all | stack |",
             "|---|---|--:|--:|--:|--:|--:|"]
    lines += [f"| {r['design']} | {r['layout']} | {r['step']} | {r['maps']} | {int(r['step']) - int(r['maps'])} "
              f"| {r['flash_bytes']} | {r['stack_bytes']} |" for r in records]
    return "\n".join(lines) + "\n"
