"""What a plant file becomes: shapes, defaults, overrides, the gallery and the other ways in."""

import numpy as np
import pytest
import scipy.optimize
import scipy.signal

from codegen.errors import PlantError
from codegen.plant.load import gallery_folder, gallery_names, load, loads, starter
from codegen.plant.model import Fault
from codegen.plant.objects import plant_from

BASE = """
format = 1
name = "two-tanks"
[time]
kind = "discrete"
sample_period = 0.5
[signals]
x = [{ name = "a" }, { name = "b" }]
y = [{ name = "level" }]
{signals}
[initial]
x_lo = [0, 0]
x_hi = [1, 1]
{rest}
"""


def text(rest, signals=""):
    return BASE.replace("{rest}", rest).replace("{signals}", signals)


COMMON = "[common]\nA = [[0.5, 0], [0.1, 0.5]]\nC = [[0, 1]]\n"


def test_common_alone_is_one_mode_called_only():
    plant = loads(text(COMMON))
    assert [mode.name for mode in plant.modes] == ["only"]
    mode = plant.modes[0]
    assert mode.A.tolist() == [[0.5, 0], [0.1, 0.5]]
    shapes = {name: getattr(mode, name).shape for name in ("B", "D", "Bw", "Dv", "Bf", "Df")}
    assert shapes == {"B": (2, 0), "D": (1, 0), "Bw": (2, 0), "Dv": (1, 0), "Bf": (2, 0), "Df": (1, 0)}


def test_missing_input_matrices_are_zero():
    mode = loads(text(COMMON, 'u = [{ name = "valve" }, { name = "pump" }]')).modes[0]
    assert mode.B.tolist() == [[0, 0], [0, 0]]
    assert mode.D.tolist() == [[0, 0]]


@pytest.mark.parametrize("given, other", [("Bf = [[1], [0]]", "Df"), ("Df = [[1]]", "Bf")])
def test_one_of_the_fault_matrices_may_be_missing(given, other):
    mode = loads(text(COMMON + given, 'f = [{ name = "leak" }]')).modes[0]
    assert not getattr(mode, other).any()
    assert getattr(mode, given[:2]).any()


def test_a_mode_overrides_common_and_the_others_keep_it():
    plant = loads(text(COMMON + '[[mode]]\nname = "one"\n[[mode]]\nname = "two"\nC = [[1, 1]]\n'))
    assert plant.modes[0].C.tolist() == [[0, 1]]
    assert plant.modes[1].C.tolist() == [[1, 1]]


def test_missing_ranges_are_infinite_and_arrays_are_read_only():
    plant = loads(text(COMMON))
    assert plant.limits("x")[0].tolist() == [-np.inf, -np.inf]
    assert plant.sample_period == 0.5
    with pytest.raises(ValueError):
        plant.modes[0].A[0, 0] = 3
    with pytest.raises(ValueError):
        plant.x0_lo[0] = 3


def test_mode_bounds_override_the_bounds_of_that_mode_only():
    signals = 'w = [{ name = "gust", bounds = [-1, 2] }, { name = "rain", bounds = [0, 1] }]'
    modes = '[[mode]]\nname = "one"\n[[mode]]\nname = "two"\nbounds = { rain = [0, 0.5] }\n'
    plant = loads(text(COMMON + "Bw = [[1, 0], [0, 1]]\n" + modes, signals))
    assert (plant.modes[0].w_lo.tolist(), plant.modes[0].w_hi.tolist()) == ([-1, 0], [2, 1])
    assert (plant.modes[1].w_lo.tolist(), plant.modes[1].w_hi.tolist()) == ([-1, 0], [2, 0.5])
    assert plant.modes[1].v_lo.shape == (0,)


def test_theta_entries_go_to_theta_terms():
    rho = '{ name = "rho", bounds = [0, 1], rate = 2 }'
    signals = f'theta = [{rho}, {{ name = "eta", bounds = [1, 2], measured = false }}]'
    rest = '[constants]\nm = 4\n[common]\nA = [["-2 + rho", 0], ["eta/m", "1/m"]]\nC = [[0, 1]]\n'
    plant = loads(text(rest, signals))
    mode = plant.modes[0]
    assert mode.A.tolist() == [[-2, 0], [0, 0.25]]
    assert [term.tolist() for term in mode.theta_terms["A"]] == [[[1, 0], [0, 0]], [[0, 0], [0.25, 0]]]
    assert list(mode.theta_terms) == ["A"]
    assert (plant.theta[0].rate, plant.theta[0].measured) == (2, True)
    assert (plant.theta[1].rate, plant.theta[1].measured) == (np.inf, False)


def test_switching_forms():
    assert loads(text(COMMON)).switching.average_dwell is None
    minimum = loads(text(COMMON + "[switching]\nminimum_dwell = 2\n")).switching
    assert (minimum.average_dwell, minimum.chatter, minimum.known) == (2.0, 1.0, True)
    average = loads(text(COMMON + "[switching]\naverage_dwell = 2\nchatter = 3\nknown = false\n")).switching
    assert (average.average_dwell, average.chatter, average.known) == (2.0, 3.0, False)


def test_a_schedule_is_one_period():
    said = 'schedule = { every = 2, order = ["a", "b", "a"] }\n'
    modes = "".join(f'[[mode]]\nname = "{name}"\nA = [[0.5, 0], [0, 0.5]]\n' for name in "ab")
    plant = loads(text("[common]\nC = [[0, 1]]\n" + modes + "[switching]\n" + said))
    assert plant.switching.schedule == (0, 0, 1, 1, 0, 0)
    for wrong, message in (('[[0, "a"]]', "is a list .*every = 1"), ('{ every = 0, order = ["a"] }', "every >= 1"),
                           ('{ every = 2, order = ["c"] }', '"c"'),
                           ('{ every = 200, order = ["a", "b"] }', "has 400 samples .expected at most 256"),
                           ('{ every = 2, order = ["a", "b", "a"] }\nminimum_dwell = 3',
                            "has a stay of 1 s .expected at least the minimum_dwell of 3 s")):
        with pytest.raises(PlantError, match=f"switching.schedule.*{message}"):
            loads(text("[common]\nC = [[0, 1]]\n" + modes + "[switching]\nschedule = " + wrong))


def test_target_defaults_and_extensions():
    target = loads(text(COMMON)).target
    assert (target.prefix, target.real, target.layout) == ("two_tanks", "float32", "table")
    assert (target.debounce, target.latch, target.recover, target.hold) == ((1, 1), True, 50, 10)
    target = loads(text(COMMON + "[target]\nrecover = 7\nhold = 3\nalarm = { debounce = [2, 5] }\n")).target
    assert (target.debounce, target.recover, target.hold) == ((2, 5), 7, 3)


def test_observer_options_are_kept_as_they_are():
    plant = loads(text(COMMON + '[observer]\nmethod = "zonotope"\norder = 5\nweights = { a = [1, 2] }\n'))
    assert plant.method == "zonotope"
    assert plant.options == {"order": 5, "weights": {"a": [1, 2]}}
    assert loads(text(COMMON)).method == ""


def test_a_scenario_in_full():
    rest = COMMON + "Df = [[1]]\n"
    rest += '[[mode]]\nname = "one"\n[[mode]]\nname = "two"\n'
    rest += '[[scenario]]\nname = "s"\nduration = 5.2\nmode = { every = 4, order = ["two", "one"] }\n'
    rest += 'fault = [{ channel = "leak", from = 3, value = "k" }]\n'
    scenario = loads(text(rest, 'f = [{ name = "leak" }]')).scenarios[0]
    assert scenario.steps == 11  # 5.2 s at 0.5 s, rounded up
    assert scenario.mode == ((0, 1), (4, 0), (8, 1))
    assert scenario.fault == (Fault(channel=0, start=3, stop=11, value="k"),)
    assert (scenario.u, scenario.w, scenario.v) == ((), "uniform", "uniform")


def test_a_continuous_plant_loads():
    assert loads(text(COMMON).replace('"discrete"', '"continuous"')).kind == "continuous"


def test_the_identity_is_accepted_as_e():
    assert loads(text(COMMON + "E = [[1, 0], [0, 1]]\n")).n_x == 2


def test_a_file_of_windows_is_the_same_plant(tmp_path):
    path = tmp_path / "p.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text(COMMON).replace("\n", "\r\n").encode())
    plant = load(path)
    assert plant.text == text(COMMON)
    assert plant.folder == str(tmp_path)


def test_a_plant_is_loaded_again_from_its_text_without_its_records(tmp_path):
    (tmp_path / "log.csv").write_text("level\n1\n2\n")
    (tmp_path / "p.toml").write_text(text(COMMON + '[[scenario]]\nname = "log"\ncsv = "log.csv"\n'))
    plant = load(tmp_path / "p.toml")
    assert plant.scenarios[0].steps == 2
    again = loads(plant.text, scenarios=False)
    assert again.scenarios == ()
    assert np.array_equal(again.modes[0].A, plant.modes[0].A)


@pytest.mark.parametrize("name", gallery_names())
def test_every_gallery_plant_loads_and_says_where_it_is_from(name):
    plant = load(name)
    assert plant.name == name
    assert plant.title
    assert plant.source
    assert plant.folder == str(gallery_folder())
    assert plant.scenarios


def test_the_gallery_has_our_three():
    assert {"cart", "press", "zammali_fd"} <= set(gallery_names())


def test_the_starter_loads_under_any_name():
    plant = loads(starter("my-rig"))
    assert (plant.name, plant.target.prefix, plant.n_modes) == ("my-rig", "my_rig", 2)
    cart = load("cart")
    for ours, theirs in zip(plant.modes, cart.modes):
        assert np.array_equal(ours.A, theirs.A)
        assert np.array_equal(ours.B, theirs.B)


def test_zammali_matrices_are_the_printed_ones():
    plant = load("zammali_fd")
    assert plant.modes[1].A.tolist() == [[0.9, -0.8, 0], [0.1, 0, 1], [0, 0.5, 0.1]]
    assert plant.modes[2].Bw.tolist() == [[0], [0.1], [0.1]]
    assert plant.modes[0].Df.tolist() == [[0.5], [-0.5]]
    assert not plant.modes[0].Bf.any()
    assert plant.modes[0].Dv.tolist() == [[0.1, 0], [0, 0.1]]
    assert plant.switching.average_dwell is None


def test_the_ranges_of_the_press_are_the_computed_bound():
    """z of the file's comment is invariant, exactly, and inside the declared ranges."""
    plant = load("press")
    z = np.array([187, 209.5, 231.4, 265.4])
    u = np.maximum(*map(np.abs, plant.limits("u")))
    w = np.maximum(*map(np.abs, plant.limits("w")))
    v = np.maximum(*map(np.abs, plant.limits("v")))
    for mode in plant.modes:
        assert (abs(mode.A) @ z + abs(mode.B) @ u + abs(mode.Bw) @ w <= z).all()
        assert (abs(mode.C) @ z + abs(mode.Dv) @ v <= plant.limits("y")[1]).all()
    assert (z <= plant.limits("x")[1]).all()
    assert plant.modes[2].w_hi.tolist() == [0.1, 0.02]
    assert plant.modes[2].v_lo.tolist() == [-0.02, -0.01]


def test_plant_from_scipy_and_lists_of_modes():
    one = scipy.signal.dlti([[0.9, 0.1], [0, 0.8]], [[1.0], [0.5]], [[1.0, 0]], [[0.0]], dt=0.1)
    two = scipy.signal.dlti([[0.7, 0.1], [0, 0.6]], [[1.0], [0.5]], [[1.0, 0]], [[0.0]], dt=0.1)
    plant = plant_from(
        [one, two],
        x0=([-1, -1], [1, 1]),
        w={"gust": (-0.1, 0.2)},
        v=[(-0.01, 0.01)],
        u=[(-5, 5)],
        f={"sensor": (-1, 1)},
        Bw=[[[0], [1]], [[1], [1]]],
        Dv=[[1]],
        Df=[[1]],
        modes=["fast", "slow"],
        switching={"average_dwell": 1.0},
        target={"real": "float64"},
    )
    assert (plant.kind, plant.sample_period, plant.n_modes) == ("discrete", 0.1, 2)
    assert plant.modes[1].A.tolist() == [[0.7, 0.1], [0, 0.6]]
    assert plant.modes[0].Bw.tolist() == [[0], [1]]
    assert plant.modes[1].Bw.tolist() == [[1], [1]]
    assert (plant.w[0].name, plant.w[0].hi, plant.u[0].lo) == ("gust", 0.2, -5)
    assert plant.target.real == "float64"
    assert plant.switching.average_dwell == 1.0
    assert np.array_equal(loads(plant.text).modes[1].A, plant.modes[1].A)


def test_plant_from_takes_continuous_and_unstated_periods():
    matrices = ([[0.9]], [[1.0]], [[1.0]], [[0.0]])
    continuous = plant_from(scipy.signal.StateSpace(*matrices), x0=([0], [1]), sample_period=0.2)
    assert (continuous.kind, continuous.sample_period) == ("continuous", 0.2)
    unstated = plant_from(scipy.signal.dlti(*matrices, dt=True), x0=([0], [1]), sample_period=0.2)
    assert (unstated.kind, unstated.sample_period) == ("discrete", 0.2)


def test_a_positive_tnl_observer_exists_for_the_press_and_no_classical_one():
    """Linear programmes, row by row: T A - L C >= 0 and (T A - L C) z <= 0.95 z with T = I - N C."""
    plant = load("press")
    z = np.ones(4)
    for mode in plant.modes:
        for i, row in enumerate(mode.A):
            gains = _row_gains(row, np.vstack([mode.C @ mode.A, mode.C]), 0.95 * z[i], z)
            assert gains.status == 0
            assert np.abs(gains.x).max() < 1
        classical = [_row_gains(row, mode.C, 1e6, z).status for row in mode.A]
        assert classical == [0, 0, 2, 0]  # 2: infeasible


def _row_gains(row, spanned, most, z):
    """Gains g with row - g spanned >= 0 and (row - g spanned) z <= most, of least size."""
    n = len(spanned)
    split = np.hstack([np.eye(n), -np.eye(n)])  # g = positive part - negative part
    a_ub = np.vstack([spanned.T @ split, -(spanned @ z) @ split])
    b_ub = np.append(row, most - row @ z)
    return scipy.optimize.linprog(np.ones(2 * n), A_ub=a_ub, b_ub=b_ub)


class _System:
    A, B, C, D, dt = [[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1


@pytest.mark.parametrize(
    "system, arguments, fragment",
    [
        (object(), {}, "object has no A (expected a state-space object)"),
        ([], {}, "system: is an empty list"),
        (_System(), {"w": [(-1, 1)]}, "modes.only.Bw is missing"),
        (_System(), {"w": [(1, -1)], "Bw": [[1]]}, "signals.w.w1.bounds: is the wrong way round"),
        (_System(), {"sample_period": 0.2}, "sample_period: is 0.2, but the system has dt = 0.1"),
        (_System(), {"modes": ["a", "b"]}, "modes: has 2 names, expected 1"),
        ([_System(), _System()], {"Bw": [[[1]]], "w": [(0, 1)]}, "Bw: has 1 matrices, expected 2"),
        (_System(), {"Dv": [[1], [1, 2]], "v": [(0, 1)]}, "Dv: holds no numbers, or rows of unequal length"),
        (_System(), {"x": [(-0.5, 0.5)]}, "the box of x1 leaves its range"),
    ],
)
def test_mistakes_in_plant_from(system, arguments, fragment):
    with pytest.raises(PlantError) as caught:
        plant_from(system, x0=([-1], [1]), **arguments)
    assert str(caught.value).startswith("plant_from: ")
    assert fragment in str(caught.value)
