"""Compile and run the unit tests of generated folders: ``python c_tests/run.py [FOLDER ...]``.

Default: every folder in generated/. Each is compiled with every warning an error, optimised and under
sanitizers, with the unit tests and with its own golden test; then all of them in one binary.
Needs nothing but Python and gcc.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Wdouble-promotion",
            "-Wfloat-equal", "-Wvla", "-Walloca", "-Wshadow", "-Wundef", "-Wstrict-prototypes", "-Wmissing-prototypes",
            "-Wcast-align=strict", "-Wcast-qual", "-Wswitch-enum", "-Wswitch-default", "-Wnull-dereference",
            "-Wduplicated-cond", "-Wduplicated-branches", "-Wlogical-op", "-Werror"]
UNIT_TESTS = tuple(HERE / f"test_{name}.c" for name in ("observer", "supervisor", "ranges"))
BUILDS = {
    "optimised": ["-O2"],
    "sanitized": ["-O1", "-g", "-fsanitize=address,undefined,bounds-strict", "-fno-sanitize-recover=all"],
}


#: Words of the state by which a set finds its place in tables, each with the macro of its largest value or one more.
COUNTS = {"stage": "STAGES", "since": "ROWS", "phase_at": "PERIOD", "block": "MODES", "before": "MODES"}
#: Where that is another one.
SINCE = {"schedule": "SETTLED", "blocks": "LONGEST"}


def folders() -> list[Path]:
    """The committed designs."""
    return sorted(p.parent for p in (HERE.parent / "generated").glob("*/resources.json"))


def case(record: dict) -> str:
    """Print case.h: the names and numbers of the design under test."""
    suffix = "F" if record["real"] == "float32" else ""
    supervision = record["supervision"]
    values = {f"CASE_{name.upper()}": "{ " + ", ".join(f"{v!r}{suffix}" for v in record["ranges"][name]) + " }"
              for name in ("u_lo", "u_hi", "y_lo", "y_hi", "x_lo", "x_hi", "x0_lo", "x0_hi")}
    values |= {f"CASE_{name.upper()}": "{ " + ", ".join(f"{v!r}{suffix}" for v in record["ranges"][name]) + " }"
               for name in ("z_lo", "z_hi") if name in record["ranges"]}
    boxes = {name: record["ranges"][name] for name in ("theta_lo", "theta_hi") if name in record["ranges"]}
    values |= {f"CASE_{name.upper()}": braced(rows, suffix) for name, rows in boxes.items()}
    members = {name for name, _, _ in record["state"]}
    numbers = {name: supervision[name] for name in ("dwell_add", "dwell_drain", "dwell_limit", "hold")}
    numbers |= {"state_bytes": record["state_bytes"], "recover": max(supervision["recover"], 1),
                "debounce_m": supervision["debounce"][0], "debounce_n": supervision["debounce"][1]}
    flags = {"nu": record["n_u"], "ntheta": record["n_theta"], "latch": supervision["latch"],
             "assures": supervision.get("assures", True),
             "has_phase": "phase" in members, "point": "x_hat" in members, "filter": "xi" in members,
             "polytopic": record["family"] in ("polytopic", "descriptor"), "holds_faults": "faults" in record,
             "boxes": "alive" in members, "sliding": "level" in members,
             "guided": record["family"] == "guided",
             "guides_point": {"level", "told_x_hat"} <= members, "guides_filter": {"level", "told_xi"} <= members,
             "has_frames": "frame_lo" in members, "follows": "followed" in members,
             "has_filters": "running" in members,
             "has_origin": "origin" in members, "has_shape": "shape" in members,
             "bank": record["family"] == "bank",
             "square_shape": record["family"].startswith("ellipsoid"), "signed_shape": record["family"] != "box",
             "told": "mode" in {name for name, _, _ in record["in"]},
             "has_z": "z_lo" in members, "has_mode": "mode" in members, "counts_hold": "hold" in members}
    values |= {f"CASE_{name.upper()}": f"{value}U" for name, value in numbers.items()}
    values |= {f"CASE_{name.upper()}": f"{int(value)}" for name, value in flags.items()}
    values["CASE_SOLVED"] = f"{sum(1 << k for k in record.get('algebraic', []))}U"  # states that no z decides
    values["CASE_LAW"] = f"{int('law' in record)}"
    values |= {f"CASE_{name.upper()}": "{ " + ", ".join(f"{v!r}{suffix}" for v in row) + " }"
               for name, row in record.get("law", {}).items()}
    apart = flags["filter"] or flags["sliding"] or flags["polytopic"]
    counts = [name for name in COUNTS if name in members and not apart]
    if flags["polytopic"] or flags["bank"]:
        values[f"{record['macro']}_MODES"] = "1U"
    if counts:
        values["CASE_COUNTS(s)"] = "{ " + ", ".join(f"&(s)->{name}" for name in counts) + " }"
        tops = COUNTS | {"since": SINCE.get(record["family"], COUNTS["since"])}
        values["CASE_TOPS"] = "{ " + ", ".join(f"M({tops[name]})" for name in counts) + " }"
    values["CASE_N_COUNTS"] = f"{len(counts)}U"
    return "\n".join(["#ifndef CASE_H", "#define CASE_H", f'#include "{record["prefix"]}.h"',
                      f"#define T(name) {record['prefix']}_##name", f"#define M(name) {record['macro']}_##name",
                      *(f"#define {name} {value}" for name, value in values.items()), "#endif", ""])


def braced(rows: list[list[float]], suffix: str) -> str:
    """Print numbers per mode as a C initialiser."""
    return "{ " + ", ".join("{ " + ", ".join(f"{v!r}{suffix}" for v in row) + " }" for row in rows) + " }"


def failure(command: list, cwd: Path) -> str:
    """Run a command; return what is wrong with it, or nothing."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)
    return "" if done.returncode == 0 else f"status {done.returncode}: {(done.stderr or done.stdout)[:2000]}"


def compiled(sources: list[Path], flags: list[str], cwd: Path, warnings=WARNINGS) -> str:
    """Compile sources as the flags say; return what is wrong, or nothing."""
    return failure(["gcc", "-std=c99", "-ffp-contract=off", *warnings, *flags, *sources], cwd)


def compile_and_run(sources: list[Path], flags: list[str], cwd: Path, warnings=WARNINGS) -> str:
    """Compile sources to one program and run it; return what is wrong, or nothing."""
    wrong = compiled([*sources, "-o", "a.out", "-lm"], flags, cwd, warnings)
    return f"compile: {wrong}" if wrong else failure(["./a.out"], cwd)


def check_folder(folder: Path, scratch: Path, builds=tuple(BUILDS)) -> list[str]:
    """Run all tests of one folder; return the failures (status n: check in line n of the test, or sample n)."""
    record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
    source = folder / f"{record['prefix']}.c"
    (scratch / "case.h").write_text(case(record), encoding="ascii")
    paths = [f"-I{scratch}", f"-I{folder}", f"-I{HERE}"]
    failures = []
    for build in builds:
        flags = [*paths, *BUILDS[build]]
        wrong = compiled([source, "-c", "-o", "observer.o"], flags, scratch)  # once for all programs
        if wrong:
            failures.append(f"{folder.name}, {source.name}, {build}: compile: {wrong}")
            continue
        for test in (*UNIT_TESTS, folder / f"test_{source.name}"):
            wrong = compile_and_run(["observer.o", test], flags, scratch)
            failures += [f"{folder.name}, {test.name}, {build}: {wrong}"] if wrong else []
    return failures


def check_together(all_folders: list[Path], scratch: Path) -> list[str]:
    """Link designs of different prefixes into one program and run their golden tests twice, in turn."""
    by_prefix = {}
    for folder in all_folders:
        record = json.loads((folder / "resources.json").read_text(encoding="ascii"))
        by_prefix.setdefault(record["prefix"], (folder, record["macro"]))
    sources = [f / name for p, (f, _) in by_prefix.items() for name in (f"{p}.c", f"test_{p}.c")]
    calls = "".join(f"    failed |= {p}_self_test();\n" for p in by_prefix)
    declarations = "".join(f"int {p}_self_test(void);\n" for p in by_prefix)
    main = scratch / "together.c"
    main.write_text(f"{declarations}\nint main(void)\n{{\n    int failed = 0;\n\n{calls}{calls}"
                    "    return (failed == 0) ? 0 : 1;\n}\n", encoding="ascii")
    flags = [*(f"-I{f}" for f, _ in by_prefix.values()), *(f"-D{m}_NO_MAIN" for _, m in by_prefix.values()), "-O2"]
    wrong = compile_and_run([*sources, main], flags, scratch)
    return [f"together: {wrong}"] if wrong else []


def main(arguments: list[str]) -> int:
    """Run everything, print what failed, return the exit status."""
    chosen = [Path(a).resolve() for a in arguments] or folders()
    with tempfile.TemporaryDirectory() as scratch:
        failures = [f for folder in chosen for f in check_folder(folder, Path(scratch))]
        failures += check_together(chosen, Path(scratch)) if len(chosen) > 1 else []
    print("\n".join(failures) or f"{len(chosen)} designs: all tests pass")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
