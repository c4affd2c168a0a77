"""``residua check`` and the methods for parameters and continuous time: what a plant is told before any design."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.varying import HEATER, HELD  # noqa: E402

from codegen import show  # noqa: E402
from codegen.errors import DesignError  # noqa: E402
from codegen.plant.load import loads  # noqa: E402
from codegen.plant.properties import properties  # noqa: E402
from codegen.selection.select import choose  # noqa: E402
from codegen.synthesis import METHODS  # noqa: E402

DISCRETE = HEATER.replace('"continuous"', '"discrete"').replace(", rate = 2", "")
VARYING = [name for name, m in METHODS.items() if "continuous LPV" in m.kinds]


def shown(text, monkeypatch):
    """What ``check`` prints."""
    page = io.StringIO()
    monkeypatch.setattr(show, "out", Console(file=page, highlight=False, soft_wrap=True, width=300))
    show.plant(loads(text))
    return page.getvalue()


def row(page, name):
    """Cells of the last line of the page that begins with a name."""
    line = [line for line in page.splitlines() if line.startswith(name)][-1]
    return [cell.strip() for cell in re.split("[│┃]", line)]


def test_parameters_and_sampling_are_listed(monkeypatch):
    page = shown(HEATER, monkeypatch)
    parameters = page[page.index("\nparameters"):page.index("\nsampling")]
    assert row(parameters, "flow") == ["flow", "open: 0.5 to 1.5; shut: 0.5 to 0.8", "0.5", "yes", "0.02"]
    assert row(parameters, "loss") == ["loss", "0.1 to 0.3", "any", "no", "-"]
    assert "sampling: exponential; power moves by at most 2 W/s; inlet is held; the mode changes at samples" in page
    assert "modes, worst corner of theta" in page and row(page, "component-interval")[1].startswith("the parameter")
    constant = shown(re.sub(r"theta = \[.*?\n\]\n", "", DISCRETE, flags=re.S).replace("flow", "1").replace(
        "loss", "1").replace("bounds = { 1 = [0.5, 0.8] }\n", "").replace('theta = "uniform"\n', ""), monkeypatch)
    assert "parameters" not in constant.replace("scheduling parameters", "") and "sampling" not in constant
    assert "corner" not in constant


def test_modes_are_judged_at_the_corners_of_their_own_box():
    """x' = (flow - 1) x: stable up to 0.8, not up to 1.5; at the middle, and at zero, both look stable."""
    text = HEATER.replace('[["-1 - flow", 0.5], ', '[["flow - 1", 0], ').replace('[["-0.5 - flow", 0.5], ',
                                                                                 '[["flow - 1", 0], ')
    first, second = properties(loads(text))
    assert first.radius == pytest.approx(0.5) and not first.stable and first.detectable and first.cooperative
    assert second.radius == pytest.approx(-0.2) and second.stable
    # Unseen: C looks at the other state, which this one does not drive.
    unseen = text.replace("C = [[1, 0]]", "C = [[0, 1]]").replace("[0.4, ", "[0, ")
    assert not properties(loads(unseen))[0].detectable and properties(loads(unseen))[1].detectable
    # A sign that turns within the box.
    turning = HEATER.replace("[0.4, ", '["flow - 1", ')
    assert [p.cooperative for p in properties(loads(turning))] == [False, False]
    # An output that depends on a parameter is judged at its corners too.
    scaled = text.replace("C = [[1, 0]]", 'C = [["flow - 0.5", 0]]')
    assert not properties(loads(scaled))[0].observable and properties(loads(text))[0].observable == (
        np.linalg.matrix_rank([[1, 0], [0.5, 0]]) == 2)


CASES = {
    "constant methods, continuous": (HEATER, "interval", {}, [
        'method "interval" does not apply: the plant is continuous', 'Use method "tnl-interval-lpv"']),
    "constant methods, parameters": (DISCRETE, "tnl-interval", {}, [
        "scheduling parameters, expected constant matrices", 'Use method "lpv-interval"']),
    "theta in C": (HEATER.replace("C = [[1, 0]]", 'C = [["flow", 0]]'), "lpv-interval", {}, [
        'C of mode "open" depends on a parameter', "expected only A and B to", "widen the bounds of w or v"]),
    "theta in Bw": (HEATER.replace("Bw = [[1], [0]]", 'Bw = [["loss"], [0]]'), "tnl-interval-lpv", {}, [
        'Bw of mode "open" depends on a parameter', "expected only A and B to"]),
    "theta in Dv": (HEATER.replace("Dv = [[1]]", 'Dv = [["flow"]]'), "component-interval", {}, [
        'Dv of mode "open" depends on a parameter']),
    "measured, for component": (HEATER, "component-interval", {}, [
        'the parameter "flow" is measured', "expected none to be", '"lpv-interval"', "set measured = false"]),
    "C switches": (HEATER.replace("C = [[1, 0]]\n", "").replace('name = "open"', 'name = "open"\nC = [[1, 0]]').replace(
        'name = "shut"', 'name = "shut"\nC = [[2, 0]]'), "tnl-interval-lpv", {}, [
            "C differs between modes", 'Use method "lpv-interval"']),
    "feedthrough": (HEATER.replace("C = [[1, 0]]", "C = [[1, 0]]\nD = [[1, 0]]"), "tnl-interval-lpv", {}, [
        "D is not zero", 'Use method "lpv-interval"']),
    "no range": (HEATER.replace('unit = "K", range = [-30, 30]', 'unit = "K"'), "lpv-interval", {}, [
        'signals.y "thermometer" has no range', "Add one"]),
    "scheme": (HEATER, "lpv-interval", {"sampling": "tustin"}, [
        "observer.sampling is 'tustin'", '"euler" or "second-order" or "exponential"']),
    "criterion": (HEATER, "lpv-interval", {"criterion": "detection"}, [
        'criterion "detection" is for constant matrices', '"width" or "linf"', "smallest surely detected fault"]),
    "sampled too slowly": (HEATER.replace("sample_period = 0.02", "sample_period = 60"), "lpv-interval", {}, [
        "time.sample_period is 60 s", "longest period at which one was found", "sample at least as fast"]),
    "sign at a corner": (DISCRETE.replace('"-0.5 - loss"', '"0.9 - flow"'), "lpv-interval", {}, [
        'no L give A - L C >= 0 in mode "open" at theta = (1.52): best entry (wall, wall) is -0.62',
        'Try method "tnl-interval-lpv", or measure wall']),
    "unseen at a corner": (DISCRETE.replace('"-0.5 - loss"', '"1.4 - flow"').replace('"-0.6 - loss"', '"0.1"').replace(
        "[0.5, 1.5], rate", "[0.3, 1.2], rate"), "lpv-interval", {}, [
            'the direction z = 1 wall is invisible to the outputs of mode "open" at theta = (0.28)', "Measure one"]),
}


@pytest.mark.parametrize("name", CASES)
def test_refusals_name_what_obstructs_and_what_to_do(name):
    text, method, options, parts = CASES[name]
    with pytest.raises(DesignError) as error:
        choose(loads(text), method, options, lambda line: None)
    message = str(error.value)
    assert message.startswith("heater: ") and message.endswith(".") and "\n" not in message
    at = [message.find(part) for part in parts]
    assert -1 not in at and at == sorted(at), message


@pytest.mark.parametrize("method", VARYING)
def test_the_refusals_are_due_to_what_was_changed(method):
    unmeasured = HELD.replace("rate = 0.5, error = 0.02", "measured = false")
    plant = loads(unmeasured if method == "component-interval" else HELD)
    assert METHODS[method].module.inapplicable(plant) is None
    constant = replace(plant, kind="discrete", theta=(), modes=tuple(replace(m, theta_terms={}) for m in plant.modes))
    assert METHODS[method].module.inapplicable(constant) == (
        'the plant has constant matrices in discrete time. Use method "tnl-interval" or "interval".')


def test_check_tells_what_would_be_refused(monkeypatch):
    """What the table of methods says is what a design would be refused for; without a sign condition nothing is."""
    page = shown(CASES["sign at a corner"][0], monkeypatch)
    assert 'in mode "open" at theta = (1.52): best entry (wall, wall) is -0.62' in row(page, "lpv-interval")[1]
    negative = HELD.replace("rate = 0.5, error = 0.02", "measured = false").replace(
        '"continuous"', '"discrete"').replace(' 0.5], [0.4,', ' -0.5], [-0.4,')
    page = shown(negative, monkeypatch)
    assert row(page, "component-interval")[1] == "yes" and "no L give" in row(page, "lpv-interval")[1]
    assert row(shown(CASES["no range"][0], monkeypatch), "lpv-interval")[1].startswith('signals.y "thermometer"')
    far = shown(HEATER.replace("sample_period = 0.02", "sample_period = 2000"), monkeypatch)
    assert "so long that the plant moves by more than its own size" in row(far, "lpv-interval")[1]
