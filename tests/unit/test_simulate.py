"""The simulated plant: its equations, its limits, its records."""

from dataclasses import replace

import numpy as np
import pytest

from codegen.errors import PlantError
from codegen.plant.load import gallery_names, load, loads
from codegen.plant.model import Scenario
from codegen.plant.simulate import matrices_at, range_violations, simulate

LPV = """
format = 1
name = "lpv"
[time]
kind = "discrete"
sample_period = 0.1
[signals]
x = [{ name = "a", range = [-9, 9] }, { name = "b" }]
u = [{ name = "valve", range = [-1, 1] }]
y = [{ name = "level" }, { name = "flow" }]
w = [{ name = "rain", bounds = [0, 0.2] }]
v = [{ name = "noise", bounds = [-0.1, 0.3] }]
f = [{ name = "leak", range = [0, 2] }]
theta = [{ name = "rho", bounds = [0, 1], rate = 0.5 }]
[initial]
x_lo = [-1, 2]
x_hi = [1, 3]
[common]
A = [["0.5 - 0.2*rho", 0.1], ["rho", 0.3]]
B = [[1], ["rho"]]
C = [[0, 1], [1, 0]]
D = [[0], [0.5]]
Bw = [[0], [1]]
Dv = [[1], [0]]
Bf = [[0], [-1]]
Df = [[0], [1]]
[[mode]]
name = "dry"
[[mode]]
name = "wet"
bounds = { rain = [0.1, 0.15] }
[[scenario]]
name = "run"
steps = 60
mode = [[0, "dry"], [20, "wet"]]
u = ["sin(k)"]
w = "corner"
v = "uniform"
theta = "corner"
fault = [{ channel = "leak", from = 10, to = 20, value = "0.1*(k - 9)" }]
"""


def recomputed(plant, trace):
    """x+ and y of a trace by the plant's equations, written out once more."""
    x, y = np.empty_like(trace.x), np.empty_like(trace.y)
    for k in range(len(x)):
        m = matrices_at(plant.modes[trace.q[k]], trace.theta[k])
        x[k] = m["A"] @ trace.x[k] + m["B"] @ trace.u[k] + m["Bw"] @ trace.w[k] + m["Bf"] @ trace.f[k]
        y[k] = m["C"] @ trace.x[k] + m["D"] @ trace.u[k] + m["Dv"] @ trace.v[k] + m["Df"] @ trace.f[k]
    return x, y


def test_the_trace_solves_the_equations_with_theta():
    plant = loads(LPV)
    trace = simulate(plant, "run", seed=3)
    x_next, y = recomputed(plant, trace)
    np.testing.assert_allclose(trace.x[1:], x_next[:-1], atol=1e-12)
    np.testing.assert_allclose(trace.y, y, atol=1e-12)
    assert trace.q.tolist() == [0] * 20 + [1] * 40
    np.testing.assert_allclose(trace.f[:, 0], [0] * 10 + [0.1 * (k - 9) for k in range(10, 20)] + [0] * 40)
    np.testing.assert_allclose(trace.u[:, 0], np.sin(np.arange(60)))


def test_matrices_at_a_theta():
    matrices = matrices_at(loads(LPV).modes[0], np.array([0.5]))
    np.testing.assert_allclose(matrices["A"], [[0.4, 0.1], [0.5, 0.3]])
    np.testing.assert_allclose(matrices["B"], [[1], [0.5]])
    assert matrices["C"].tolist() == [[0, 1], [1, 0]]


def test_corner_signals_sit_on_the_bounds_of_their_mode_and_uniform_inside():
    trace = simulate(loads(LPV), "run")
    assert set(trace.w[:20, 0]) == {0, 0.2}
    assert set(trace.w[20:, 0]) == {0.1, 0.15}
    assert (trace.v >= -0.1).all()
    assert (trace.v <= 0.3).all()
    assert len(set(trace.v[:, 0])) == 60
    assert set(trace.x[0]) <= {-1, 1, 2, 3}


def test_theta_keeps_to_its_bounds_and_rate():
    theta = simulate(loads(LPV), "run").theta
    assert theta.min() >= 0
    assert theta.max() <= 1
    assert np.abs(np.diff(theta, axis=0)).max() <= 0.05 * (1 + 1e-9)
    assert np.ptp(theta) > 0.1


def test_the_seed_decides():
    plant = loads(LPV)
    one, same, other = simulate(plant, 0, seed=1), simulate(plant, 0, seed=1), simulate(plant, 0, seed=2)
    assert np.array_equal(one.x, same.x)
    assert not np.array_equal(one.x, other.x)


def test_a_given_theta_is_used_and_checked():
    plant = loads(LPV)
    assert (simulate(plant, "run", theta=np.full((60, 1), 0.25)).theta == 0.25).all()
    with pytest.raises(PlantError, match=r"theta is \(60,\), expected \(60, 1\)"):
        simulate(plant, "run", theta=np.full(60, 0.25))
    with pytest.raises(PlantError, match=r"theta\.rho: is 2 at sample 0 .*\[0, 1\]"):
        simulate(plant, "run", theta=np.full((60, 1), 2.0))


@pytest.mark.parametrize(
    "change, fragments",
    [
        ({"u": ("0.1*k",)}, ["u.valve: is 1.1 at sample 11", "[-1, 1]", "Reduce"]),
        ({"u": ("1/(k - 7)",)}, ["u.valve", "no finite value at sample 7", "Correct"]),
        ({"w": ("0.15",)}, []),
        ({"w": ("0.18",)}, ["w.rain: is 0.18 at sample 20", "[0.1, 0.15]"]),
        ({"v": ("-0.2",)}, ["v.noise: is -0.2 at sample 0", "[-0.1, 0.3]"]),
        ({"theta": ("0.1*k",)}, ["theta.rho: is 1.1 at sample 11"]),
        ({"theta": ("0.1*min(k, 5)",)}, ["theta.rho: changes by 0.1 at sample 1", "at most 0.05", "Slow"]),
        ({"theta": ("0.004*k",)}, []),
    ],
)
def test_expressions_that_leave_their_limits(change, fragments):
    plant = loads(LPV)
    scenario = replace(plant.scenarios[0], **change)
    if not fragments:
        assert len(simulate(plant, scenario).x) == 60
        return
    with pytest.raises(PlantError) as caught:
        simulate(plant, scenario)
    message = str(caught.value)
    assert message.startswith("lpv: scenarios.run: ")
    for fragment in fragments:
        assert fragment in message


def test_a_fault_that_leaves_its_range_is_refused():
    plant = loads(LPV.replace("0.1*(k - 9)", "-0.1"))
    with pytest.raises(PlantError, match=r"fault\.leak: is -0.1 at sample 10 .*\[0, 2\]"):
        simulate(plant, "run")


def test_a_bound_touched_by_rounding_becomes_the_bound():
    plant = loads(LPV)
    trace = simulate(plant, replace(plant.scenarios[0], w=("0.1*1.5 + 0*k",)))  # 0.15000000000000002
    assert (trace.w[20:] <= 0.15).all()


@pytest.mark.parametrize(
    "scenario, fragment", [("rum", 'Did you mean "run"?'), (1, "the plant has 1"), (-1, "no scenario -1")]
)
def test_an_unknown_scenario(scenario, fragment):
    with pytest.raises(PlantError) as caught:
        simulate(loads(LPV), scenario)
    assert fragment in str(caught.value)


CONTINUOUS = """
format = 1
name = "ramp"
[time]
kind = "continuous"
sample_period = 0.5
[signals]
x = [{ name = "a", range = [-99, 99] }]
u = [{ name = "u", range = [-9, 9] RATE }]
y = [{ name = "y", range = [-99, 99] }]
theta = [{ name = "e", bounds = [-2, 2], rate = 4 }]
[initial]
x_lo = [1]
x_hi = [1]
[[mode]]
name = "one"
A = [["e"]]
B = [[1]]
C = [[1]]
[[mode]]
name = "two"
A = [["e"]]
B = [[1]]
C = [[1]]
BOUNDS
[[scenario]]
name = "run"
steps = 9
mode = { every = 3, order = ["one", "two"] }
u = ["INPUT"]
theta = ["PATH"]
"""


def continuous(rate="", bounds="", u="0", theta="0"):
    text = CONTINUOUS.replace("RATE", rate).replace("BOUNDS", bounds).replace("INPUT", u).replace("PATH", theta)
    return simulate(loads(text), "run")


def test_a_continuous_plant_between_its_samples():
    """Closed forms: x' = e x with e linear in time, x' = u with u held or a ramp."""
    t = 0.5 * np.arange(9)
    assert continuous(theta="-1 + 0.5*t").x[:, 0] == pytest.approx(np.exp(-t + 0.25 * t**2), rel=1e-13)
    steps = np.concatenate([[0], np.cumsum(np.arange(8))])
    assert continuous(u="k").x[:, 0] == pytest.approx(1 + 0.5 * steps, rel=1e-13)
    assert continuous(", rate = 1", u="t").x[:, 0] == pytest.approx(1 + t**2 / 2, rel=1e-13)


def test_an_input_keeps_to_its_rate():
    with pytest.raises(PlantError, match=r"u\.u: changes by 1 at sample 1 \(expected at most 0\.5, its rate"):
        continuous(", rate = 1", u="k")


def test_theta_jumps_at_a_switch_only_where_a_mode_has_its_own_bounds():
    step = "where(k < 3, -1, where(k < 6, 1, -1))"
    own = continuous(bounds="bounds = { e = [0, 2] }", theta=step)
    assert own.x[:, 0] == pytest.approx(np.exp([0, -0.5, -1, -1.5, -1, -0.5, 0, -0.5, -1]), rel=1e-13)
    with pytest.raises(PlantError, match=r"theta\.e: changes by 2 at sample"):
        continuous(theta=step)
    with pytest.raises(PlantError, match=r"theta\.e: is -1 at sample"):
        continuous(bounds="bounds = { e = [0, 2] }", theta="-1")


def test_range_violations_name_channel_sample_and_value():
    plant = loads(LPV)
    trace = simulate(plant, "run")
    assert range_violations(plant, trace) == []
    trace.x[17, 0] = 12
    trace.x[18, 0] = -12
    assert range_violations(plant, trace) == ["x.a: 12 at sample 17 is outside [-9, 9]"]


CSV = """# a log
valve,level,flow,mode,leak,rho,comment
0.5,1,2,dry,0,0.1,a
-0.5,,3,wet,1,0.2,b
0,nan,4,1,1,0.3,c
"""


def record_plant(tmp_path, csv, extra=""):
    (tmp_path / "log.csv").write_text(csv)
    start = LPV.index("[[scenario]]")
    (tmp_path / "p.toml").write_text(LPV[:start] + f'[[scenario]]\nname = "log"\ncsv = "log.csv"\n{extra}')
    return load(tmp_path / "p.toml")


def test_a_record_is_replayed(tmp_path):
    plant = record_plant(tmp_path, CSV)
    assert plant.scenarios[0].steps == 3
    trace = simulate(plant, "log")
    assert trace.u.tolist() == [[0.5], [-0.5], [0]]
    np.testing.assert_array_equal(trace.y, [[1, 2], [np.nan, 3], [np.nan, 4]])
    assert trace.q.tolist() == [0, 1, 1]
    assert trace.f.tolist() == [[0], [1], [1]]
    assert trace.theta.tolist() == [[0.1], [0.2], [0.3]]
    assert trace.x.shape == (3, 2)
    assert all(np.isnan(values).all() for values in (trace.x, trace.w, trace.v))


def test_recorded_inputs_drive_the_simulated_plant(tmp_path):
    plant = record_plant(tmp_path, "valve\n0.5\n-0.5\n0.25\n", 'mode = [[0, "wet"]]\nsteps = 2\n')
    trace = simulate(plant, "log")
    assert trace.u.tolist() == [[0.5], [-0.5]]
    assert trace.q.tolist() == [1, 1]
    assert np.isfinite(trace.x).all()


@pytest.mark.parametrize(
    "csv, extra, fragments",
    [
        (CSV, "steps = 4\n", ["scenarios.log.steps: is 4", "log.csv has 3 rows", "at most 3"]),
        (CSV, 'u = ["k"]\n', ["scenarios.log.u", "log.csv too", "Leave u out"]),
        (CSV.replace("flow", "flwo"), "", ['log.csv: has no column "flow"', "valve, level, flwo"]),
        (CSV.replace("wet", "rainy"), "", ["log.csv: line 4", 'unknown mode "rainy"', "dry, wet"]),
        (CSV.replace("leak", "valve"), "", ['log.csv: the column "valve" comes twice', "Rename"]),
        (CSV.replace("-0.5,,3", "-0.5,3"), "", ["log.csv: line 4 has 6 cells, expected 7", "Correct"]),
        ("mode,valve\nwet,1\n", None, ['log.csv: the column "valve" names two signals', "Rename one"]),
        ("valve\n", 'mode = [[0, "wet"]]\n', ["log.csv: has no rows", "Fill it"]),
        ("valve\n1\n", "", ["scenarios.log.mode: is missing"]),
    ],
)
def test_a_wrong_record_is_told_on_loading(tmp_path, csv, extra, fragments):
    with pytest.raises(PlantError) as caught:
        if extra is None:
            (tmp_path / "log.csv").write_text(csv)
            loads(
                LPV.replace('"leak"', '"valve"').replace("steps = 60", 'csv = "log.csv"'),
                folder=str(tmp_path),
            )
        record_plant(tmp_path, csv, extra)
    for fragment in fragments:
        assert fragment in str(caught.value)


@pytest.mark.parametrize(
    "cell, fragment", [("x", 'holds "x"'), ("", 'holds ""'), ("nan", 'holds "nan"'), ("2", "[-1, 1]")]
)
def test_a_wrong_input_cell_is_told_on_replay(tmp_path, cell, fragment):
    plant = record_plant(tmp_path, CSV.replace("-0.5,,", f"{cell},,"))
    with pytest.raises(PlantError) as caught:
        simulate(plant, "log")
    assert fragment in str(caught.value)


CASES = [(name, scenario.name) for name in gallery_names() for scenario in load(name).scenarios]


@pytest.mark.parametrize("name, scenario", [c for c in CASES if load(c[0]).kind == "discrete"])
def test_gallery_scenarios_run_and_stay_in_their_ranges_without_a_fault(name, scenario):
    plant = load(name)
    trace = simulate(plant, scenario)
    assert trace.y.shape == (len(trace.q), plant.n_y)
    assert np.isfinite(trace.u).all()
    if not trace.f.any():
        assert range_violations(plant, trace) == []


@pytest.mark.parametrize("name", ["press", "zammali_fd"])
def test_arbitrary_switching_stays_in_the_declared_ranges(name):
    plant = load(name)
    rng = np.random.default_rng(0)
    largest = tuple(repr(signal.hi) for signal in plant.u)
    for seed in range(5):
        scenario = Scenario(
            name="random",
            steps=400,
            mode=tuple((k, int(q)) for k, q in enumerate(rng.integers(0, 3, 400))),
            u=largest,
            w="corner",
            v="corner",
        )
        assert range_violations(plant, simulate(plant, scenario, seed=seed)) == []
