"""The tests in C notice a changed constant, operator, index or statement anywhere in the C (a drawn sample)."""

import re

import pytest
from helpers.scripts import GENERATED, load
from helpers.tools import need

need("gcc")
mutate = load("mutate")
SMALL = next(folder for folder in GENERATED if folder.name == "cart_tnl-interval")
LAW = next(folder for folder in GENERATED if folder.name == "quadrotor_tracking")
GUIDED = next(folder for folder in GENERATED if folder.name == "vessel_hinf-filter")
SET = next(folder for folder in GENERATED if folder.name == "zammali_ellipsoid_ellipsoid")


def test_a_sample_is_killed():
    tried, survived = mutate.survivors(SMALL, sample=100)
    assert tried > 90 and survived == []


def test_a_sample_of_a_set_is_killed():
    tried, survived = mutate.survivors(SET, sample=24)
    assert tried > 20 and survived == []


def test_a_sample_of_a_law_is_killed(monkeypatch):
    """Of its own functions, among them comparisons that only a number on the very end of a range decides."""
    own = re.compile(r"quadrotor_(command|integrate|ref_accepted|law_init|track|coast): ")
    every = mutate.mutants
    monkeypatch.setattr(mutate, "mutants", lambda text: [m for m in every(text) if own.match(m.describe(text))])
    tried, survived = mutate.survivors(LAW, sample=10)
    assert tried > 8 and survived == []


def test_edges_decide(monkeypatch):
    """A strict comparison differs only for a number on its very threshold, a radius by a set near nothing."""
    every = mutate.mutants
    monkeypatch.setattr(mutate, "mutants", lambda text: [
        m for m in every(text) if (m.old, m.new) == ("<=", "<") and "_outside: " in m.describe(text)
        or m.new == "0.001F" and "_radius: " in m.describe(text)])
    tried, survived = mutate.survivors(SET)
    assert tried > 1 and survived == []
    monkeypatch.setattr(mutate.Bench, "digests", lambda self: [])  # without the random calls one survives
    assert any("[[0.0F=>0.001F]]" in s for s in mutate.survivors(SET)[1])


def test_a_mode_estimator_and_what_it_guides(monkeypatch):
    """Zero at the very edge of a mode's test, and a row of thresholds that counts only while the decision is kept."""
    every = mutate.mutants

    def two(text):
        named = [(m, m.describe(text)) for m in every(text)]
        edges = [m for m, name in named if re.search(r"_holds: if .*\[\[<==><\]\] 0", name)]
        rows = [m for m, name in named if re.search(r"_beyond: \{ \{ .*=>\((?!-)", name)]
        return [edges[0], rows[-1]]

    monkeypatch.setattr(mutate, "mutants", two)
    assert mutate.survivors(GUIDED) == (2, [])
    monkeypatch.setattr(mutate.Bench, "digests", lambda self: [])  # without the random calls both survive
    assert len(mutate.survivors(GUIDED)[1]) == 2


def test_every_kind_is_made():
    text = """static real f(const in_t *in)
{
    real a = 1.5F * in->x_lo[2U]; /* 9U + x */
    a += 0.0F;
    if ((a < 2.0F) && (in->mode == 3U))
    {
        a = table[in->mode];
    }
    return a;
}
"""
    made = {(m.old, m.new) for m in mutate.mutants(text)}
    assert {("1.5F", "(1.5015F)"), ("1.5F", "(-1.5F)"), ("0.0F", "0.001F"), ("2U", "3U"), ("x_lo", "x_hi"), ("<", "<="),
            ("&&", "||"), ("==", "!="), ("[in->mode]", "[0U]"), ("+=", "-="), ("    a += 0.0F;", ";")} <= made
    assert not any(old == "9U" for old, _ in made)  # a comment
    place = next(m for m in mutate.mutants(text) if m.old == "&&")
    assert place.describe(text) == "f: if ((a < 2.0F) [[&&=>||]] (in->mode == 3U))"


def test_a_survivor_is_named(tmp_path, monkeypatch):
    """Without the list of equivalents the mutants on it are reported, so the list is what accepts them."""
    monkeypatch.setattr(mutate, "equivalents", lambda: [])
    every = mutate.mutants
    kinds = (("<", "<="), ("||", "&&"))
    monkeypatch.setattr(mutate, "mutants", lambda text: [m for m in every(text) if (m.old, m.new) in kinds])
    _, survived = mutate.survivors(SMALL)
    assert any("cart_clip: if (value [[<=><=]] least)" in s for s in survived)
    assert not any("||" in s for s in survived)


def test_equivalents_have_reasons():
    patterns = mutate.equivalents()
    assert len(patterns) == mutate.EQUIVALENT.read_text(encoding="ascii").count("\n| `")
    assert all(re.compile(pattern) for pattern in patterns)


@pytest.mark.parametrize("text", ["cart_clip: if (value [[<=><=]] least)", "a_clip: else if (value [[>=>>=]] most)"])
def test_the_list_matches(text):
    assert any(re.search(pattern, text) for pattern in mutate.equivalents())
