"""The C unit tests of c_tests/, on stand-ins and on every committed design; and mutants that they must kill."""

import importlib.util
import re
from pathlib import Path

import pytest
from helpers.designs import VARIANTS, stand_in
from helpers.folders import write
from helpers.kept import first_of_each, whole

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("c_tests_run", ROOT / "c_tests" / "run.py")
c_tests = importlib.util.module_from_spec(spec)
spec.loader.exec_module(c_tests)

LAYOUTS = ("literal", "table", "loop")


@pytest.mark.parametrize("family", ["interval", "tnl"])
@pytest.mark.parametrize("variant", ["full", "smallest", "guarded", "unequal"])
def test_stand_ins(family, variant, tmp_path):
    number = list(VARIANTS).index(variant) + (family == "tnl")
    folder = write(stand_in(family, prefix="cart", **VARIANTS[variant]), tmp_path / "cart",
                   ("float32", "float64")[number // 3 % 2], LAYOUTS[number % 3])
    assert c_tests.check_folder(folder, tmp_path) == []


#: Those whose C is built with sanitizers too.
WHOLE = whole(first_of_each(c_tests.folders()))


@pytest.mark.parametrize("folder", c_tests.folders(), ids=lambda folder: folder.name)
def test_committed_designs(folder, tmp_path):
    builds = c_tests.BUILDS if folder in WHOLE else ("optimised",)
    assert c_tests.check_folder(folder, tmp_path, builds) == []


def test_designs_live_together(tmp_path):
    """Two families, two types and all layouts in one program; and the committed designs in another."""
    folders = [write(stand_in(family, prefix=f"{family}_{layout}"), tmp_path / f"{family}_{layout}", real, layout)
               for family, layout, real in (("interval", "literal", "float32"), ("tnl", "table", "float64"),
                                            ("tnl", "loop", "float32"))]
    assert c_tests.check_together(folders, tmp_path) == []
    if len(c_tests.folders()) > 1:
        assert c_tests.check_together(c_tests.folders(), tmp_path) == []


MUTANTS = {  # what a generator might get wrong, and who must notice: the hand-written tests, or the golden vectors
    "state not cleared": (r"    s->run = 0U;\n(?=    s->latched)", "", "observer"),
    "mode accepted": (r"in->mode >= CART_MODES", "in->mode > CART_MODES", "observer"),
    "input not checked": (r"else if \(!cart_u_accepted\(in\)\)",
                          "else if (!cart_u_accepted(in) && (in->mode > CART_MODES))", "observer"),
    "nan accepted": (r"\(in->y\[1\] >= (\S+)\) && \(in->y\[1\] <= (\S+)\)",
                     r"!((in->y[1] < \1) || (in->y[1] > \2))", "observer"),
    "output written on refusal": (r"status = CART_BAD_OUTPUT;", "status = CART_BAD_OUTPUT; out->raw = 9U;", "observer"),
    "latch lost": (r"s->latched = s->latched \| alarm;", "s->latched = alarm;", "golden"),
    "latch cleared by predict": (r"out->latched = s->latched;\n(?=    out->assured = \(s)", "out->latched = 0U;\n",
                                 "observer"),
    "recovery": (r"again = fault \|\| \(s->run > 0U\);", "again = fault;", "golden"),
    "assured over a latch": (r"\(\(!fault\) && \(s->latched == 0U\)\)", "(!fault)", "golden"),
    "residual sign": (r"r_hi\[0\] < 0.0F|r_hi\[i\] < 0.0F", "r_hi[i] > 0.0F", "golden"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants(name, tmp_path):
    pattern, replacement, killer = MUTANTS[name]
    folder = write(stand_in("tnl", prefix="cart"), tmp_path / "cart", "float32", "table")
    text, count = re.subn(pattern, replacement, (folder / "cart.c").read_text(), count=1)
    assert count == 1
    (folder / "cart.c").write_text(text)
    failures = c_tests.check_folder(folder, tmp_path, ["optimised"])
    assert any("status" in f and ("test_observer.c" if killer == "observer" else "test_cart.c") in f for f in failures)


@pytest.mark.parametrize("family", ["interval", "tnl"])
def test_golden_vectors_kill_coefficients(family, tmp_path):
    """A coefficient changed by one in a thousand, anywhere in the three maps: the golden test of the user sees it."""
    design = stand_in(family, prefix="cart", sizes=(2, 2, 2, 2))
    folder = write(design, tmp_path / "cart", "float32", "literal")
    text = (folder / "cart.c").read_text()
    start, end = text.index("static void cart_residual_0"), text.index("static void cart_clear")
    places = [m for m in re.finditer(r"(\d+\.\d*)F", text) if start < m.start() < end]
    survivors = []
    for m in places[:: max(len(places) // 24, 1)]:
        changed = text[:m.start()] + f"({m.group()} * 1.001F)" + text[m.end():]
        (folder / "cart.c").write_text(changed)
        sources = [folder / "cart.c", folder / "test_cart.c"]
        wrong = c_tests.compile_and_run(sources, [f"-I{folder}", "-O0"], tmp_path, ())
        survivors += [] if wrong.startswith("status") else [text[m.start() - 60:m.end() + 20]]
    assert len(places) > 60 and survivors == []
