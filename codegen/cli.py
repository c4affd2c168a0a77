"""The command line: one function per subcommand, no logic."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import click
from rich.console import Console

from . import __version__, show
from .errors import ResiduaError, ValidationError
from .target.boards import BOARDS

HELP = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
err = Console(stderr=True, highlight=False)


class Progress:
    """One line that is rewritten on a terminal; at most a line every two seconds elsewhere."""

    def __enter__(self):
        self.status = err.status("starting") if err.is_terminal else None
        self.last = time.monotonic()
        if self.status:
            self.status.start()
        return self

    def __exit__(self, *exc):
        if self.status:
            self.status.stop()

    def __call__(self, text: str) -> None:
        """Show what is being done."""
        if self.status:
            self.status.update(text)
        elif time.monotonic() - self.last > 2.0:
            self.last = time.monotonic()
            err.print(f"... {text}")


class Tool(click.Group):
    """Prints our own errors as one line and exits with their status."""

    def invoke(self, ctx):
        """Run the subcommand; a traceback only with --debug, or for errors that are ours to mend."""
        try:
            return super().invoke(ctx)
        except ResiduaError as error:
            if ctx.params.get("debug"):
                raise
            click.echo(f"residua: {error}", err=True)
            ctx.exit(error.exit_code)
        except (KeyboardInterrupt, RuntimeError) as error:  # one within an import arrives as the cause of another
            if not isinstance(error.__cause__ or error, KeyboardInterrupt):
                raise
            click.echo("residua: interrupted; nothing was written.", err=True)
            ctx.exit(130)


@click.group(cls=Tool, context_settings=HELP)
@click.version_option(__version__, prog_name="residua")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """From a plant file to fault-detection firmware with proven bounds."""
    # A polite kill cleans up as Ctrl-C does, so that no half-made folder stays behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)


real_option = click.option("--real", type=click.Choice(["float32", "float64"]), help="Number type of the C.")
layout_option = click.option("--layout", type=click.Choice(["literal", "table", "loop"]), help="Flash against speed.")
method_option = click.option("--method", help="Design method (see: residua methods).")


@main.command(context_settings=HELP)
@click.argument("plant")
@click.option("-o", "out", type=click.Path(path_type=Path), help="Output folder [./<plant>_<method>].")
@method_option
@real_option
@layout_option
@click.option("--compare", is_flag=True, help="Design the other methods too, for a table in the report.")
def run(plant, out, method, real, layout, compare):
    """The whole way: plant file to validated firmware and report."""
    from .pipeline import run as whole

    with Progress() as progress:
        result = whole(plant, out, method, real, layout, progress, compare)
    show.outcomes(result.design, result.outcomes)
    show.folder(result.folder)


@main.command(context_settings=HELP)
@click.argument("plant")
def check(plant):
    """The plant as it is understood, and which methods apply to it."""
    from .plant.load import load

    show.plant(load(plant))


@main.command(context_settings=HELP)
@click.argument("plant")
@click.option("-o", "out", type=click.Path(path_type=Path), default=Path("design.json"), show_default=True)
@method_option
@real_option
def design(plant, out, method, real):
    """Synthesis and certificate only."""
    from dataclasses import replace

    from .pipeline import design as synthesise
    from .plant.load import load

    found = load(plant)
    if real:
        found = replace(found, target=replace(found.target, real=real))
    with Progress() as progress:
        made = synthesise(found, method, progress)
    made.save(out)
    show.claims(made)
    click.echo(f"wrote {out}")


@main.command(context_settings=HELP)
@click.argument("design_json", type=click.Path(path_type=Path))
@click.option("-o", "out", type=click.Path(path_type=Path), required=True, help="Output folder.")
@real_option
@layout_option
def generate(design_json, out, real, layout):
    """Print the C of a design; the same bytes every time."""
    from .designs import read_checked
    from .pipeline import generate as emit

    click.echo(f"wrote {emit(read_checked(design_json), out, real=real, layout=layout)}")


@main.command(context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--scenario", "names", multiple=True, help="Only this scenario (may be repeated).")
@click.option("--seed", default=0, show_default=True, help="Seed of the random signals.")
def validate(folder, names, seed):
    """Compile, drive every scenario, check reference and promises."""
    from .analysis.validate import validate as drive
    from .designs import read_checked
    from .host.build import build
    from .pipeline import broken, record, require

    made = read_checked(folder)
    with Progress() as progress:
        progress("compiling")
        driver = build(folder)
        outcomes = drive(made, driver, list(names), seed, progress)
    show.outcomes(made, outcomes)
    show.recorded(record(folder, "validation", (outcomes, broken(made, driver.real, outcomes), made.plant.scenarios)))
    if not outcomes:
        raise ValidationError(f"{folder}: the plant file has no scenario, expected at least one. Add a [[scenario]].")
    require(made, driver.real, outcomes)


@main.command(context_settings=HELP)
@click.argument("design_json", type=click.Path(path_type=Path))
def certify(design_json):
    """Check the certificate again, all in exact arithmetic."""
    from .designs import read_design, recheck

    made = read_design(design_json)
    show.proved(made, recheck(made))


@main.command(context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
def assurance(folder):
    """Check assurance.json against C and design; show its claims."""
    from .pipeline import check_assurance

    show.assurance(check_assurance(folder))


@main.command("prove", context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
def prove_(folder):
    """Prove the C: run-time errors (Frama-C) and rounding (Gappa)."""
    from .pipeline import record
    from .target.gappa import nothing_to_prove, prove_rounding, require_rounding
    from .target.prove import prove, require

    with Progress() as progress:
        progress("Frama-C Eva")
        result = prove(folder)
    show.proof(result)
    show.recorded(record(folder, "prove", result))
    require(result)
    if why := nothing_to_prove(folder):
        click.echo(why)
        return
    with Progress() as progress:
        progress("Gappa")
        margins = prove_rounding(folder)
    show.margins(margins)
    show.recorded(record(folder, "rounding", margins))
    require_rounding(margins)


@main.command("compare", context_settings=HELP)
@click.argument("plant")
@click.option("-o", "out", type=click.Path(path_type=Path), help="Write the figures as JSON too.")
@click.option("--method", "names", multiple=True, help="Only this method (may be repeated).")
@click.option("--order", "orders", multiple=True, type=click.IntRange(2, 200),
              help="Zonotopes of this order (may be repeated) [the one that the design chooses].")
def compare_(plant, out, names, orders):
    """Design with every method, set and table; show all side by side."""
    from .compare import chosen_variants, compare, save
    from .plant.load import load

    found = load(plant)
    with Progress() as progress:
        rows = compare(found, chosen_variants(names, orders), progress)
    show.compared(found, rows)
    if out:
        click.echo(f"wrote {save(out, found, rows)}")


@main.command("campaign", context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("-n", "runs", default=100, show_default=True, type=click.IntRange(1, 100_000),
              help="Runs without fault, and with each size of each.")
@click.option("--seed", default=0, show_default=True, help="Seed of the random runs.")
def campaign_(folder, runs, seed):
    """Inject faults into random runs of the C: which are found?"""
    from .campaign import campaign
    from .designs import read_checked
    from .host.build import build
    from .pipeline import require

    made = read_checked(folder)
    with Progress() as progress:
        progress("compiling")
        driver = build(folder)
        rows = campaign(made, driver, runs, seed, progress)
    show.campaign(made, rows)
    require(made, driver.real, [o for row in rows for o in row.outcomes])


@main.command(context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@click.option("-o", "out", type=click.Path(path_type=Path), help="Where the results go [FOLDER/replay_<log>].")
def replay(folder, log, out):
    """Run the compiled observer over a recorded log (CSV, MDF4)."""
    from .analysis.replay import replay as run_log
    from .designs import read_checked
    from .host.build import build

    made = read_checked(folder)
    with Progress() as progress:
        progress("compiling")
        result = run_log(made, build(folder), log, out or folder / f"replay_{log.stem}", progress)
    show.replay(result)


@main.command(context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--board", "names", multiple=True, type=click.Choice(list(BOARDS)),
              help="Only this board (may be repeated) [all whose compiler and simulator are installed].")
def target(folder, names):
    """Run on simulated boards; count instructions, flash and stack."""
    from .emit.render import template_root
    from .pipeline import record
    from .target.onboard import require, run_all

    with Progress() as progress:
        runs = run_all(folder, names, template_root() / "harness" / "board", progress)
    show.target(runs)
    show.recorded(record(folder, "target", runs))
    require(runs)


@main.command("fuzz", context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--runs", type=click.IntRange(1), help="So many sequences of calls [50000, unless --seconds].")
@click.option("--seconds", type=click.IntRange(1), help="So long at most.")
@click.option("--seed", default=1, show_default=True, help="The same seed and runs try the same sequences.")
def fuzz_(folder, runs, seconds, seed):
    """Feed the C with random calls under sanitizers (libFuzzer)."""
    from .emit.fuzzing import fuzz_harness
    from .pipeline import record
    from .target.fuzz import fuzz, read_record, require

    harness = fuzz_harness(read_record(folder))
    with Progress() as progress:
        progress("fuzzing")
        found = fuzz(folder, harness, runs or (None if seconds else 50000), seconds, seed)
    show.fuzzed(found)
    show.recorded(record(folder, "fuzz", found))
    require(found)


@main.command(context_settings=HELP)
def methods():
    """The methods."""
    from .synthesis import METHODS

    show.methods(METHODS)


@main.command("list", context_settings=HELP)
def list_():
    """The gallery of plants."""
    from .plant.load import gallery_names, load

    show.gallery([load(name) for name in gallery_names()])


@main.command(context_settings=HELP)
@click.argument("name")
@click.option("--from", "like", metavar="PLANT", help="Gallery plant to start from; without it a cart on a rail.")
def init(name, like):
    """Write NAME.toml, a commented plant file to start from."""
    from .errors import PlantError
    from .plant.load import gallery_names, starter

    path = Path(f"{name}.toml")
    text = starter(name, like)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise PlantError(f"{path}: exists already; nothing was written. Choose another name.") from None
    except OSError as error:
        raise PlantError(f"{path}: cannot be written ({error.strerror}). Choose another folder.") from error
    click.echo(f"wrote {path}; next: residua run {path}")
    if like is None and name in gallery_names():
        click.echo(f"it holds the cart; for the gallery's {name}: residua run {name}, residua init NAME --from {name}")


if __name__ == "__main__":
    sys.exit(main())
