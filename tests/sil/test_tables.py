"""Tables along a schedule and tables of blocks in C: no false alarm and no state lost, whatever the firmware meets."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.folders import built
from helpers.points import changed, point_design, random_plant
from sil.test_sets import driven, exact_run, lost, worst_noise

from codegen.errors import DesignError
from codegen.host import build

TURN = (0, 0, 1, 2, 1)
KINDS = {"schedule": {"tables": "schedule", "rows": 24}, "blocks": {"tables": "arbitrary", "rows": 4, "order": 5}}


@pytest.fixture(scope="module")
def design():
    """One per family, of a plant with little noise: rounding matters."""
    plants = {"schedule": random_plant(noise=1e-6, seed=7, schedule=TURN), "blocks": random_plant(noise=1e-6, seed=7)}
    plants = {k: replace(p, x0_lo=np.full(3, 0.1), x0_hi=np.full(3, 0.1 + 1e-6)) for k, p in plants.items()}
    return {k: point_design(p, "tnl", **KINDS[k]) for k, p in plants.items()}


def modes(family, steps, rng):
    """In turn, from another phase now and then, with single modes out of turn; or any."""
    if family == "blocks":
        return np.repeat(rng.integers(0, 3, steps), rng.integers(1, 7, steps))[:steps]
    q = np.resize(TURN, steps)
    q[60:] = np.resize(np.roll(TURN, -int(rng.integers(5))), steps - 60)
    q[[100, 131]] = (q[[100, 131]] + rng.integers(1, 3, 2)) % 3
    return q


def mutant(folder, old, new):
    """The same C with one place changed, compiled."""
    text = (folder / "pt.c").read_text()
    assert old in text
    (folder / "pt.c").write_text(text.replace(old, new))
    return build(folder)


def test_modes_out_of_turn_do_not_alarm(tmp_path):
    """The noise that is worst for the modes as they are, not as they should be; blind to them, the list alarms."""
    plant = random_plant(seed=9, schedule=TURN)
    d = point_design(plant, "tnl", tables="schedule", rows=6)
    driver, runs = built(d, tmp_path), []
    for i, angle in enumerate(np.linspace(0, np.pi, 10, endpoint=False)):
        q = np.resize(TURN, 16)
        q[11 + i % 3:] = i % 2
        w, v = worst_noise(plant, d.observer.tables["float64"], q, np.array([np.cos(angle), np.sin(angle)]))
        runs.append((driven(plant, q, w, v).astype(np.float32), q))
    y, q = (np.stack(a) for a in zip(*runs))
    u = np.zeros((*q.shape, 1))
    assert not driver.run_many(u, y, q).raw_bits.any()
    assert mutant(tmp_path, "(cycle[at] != in->mode)", "(at > 99U)").run_many(u, y, q).raw_bits.any()


@pytest.mark.parametrize("family", KINDS)
def test_no_state_is_lost_in_exact_arithmetic(family, design, tmp_path):
    """Corners of the noise, missing and refused samples, modes out of turn. Smaller tables, and the same run tells."""
    sound, z = design[family], design[family].observer.tables["float32"].shape
    share = np.float32(0.1)  # most of it is rounding
    names = ("h", "hx") if family == "schedule" else ("scalars", "noise")
    wrong = {"small": changed(sound, shape={name: getattr(z, name) * share for name in names})}
    if family == "blocks":  # the error of the initial box, wherever the set starts anew
        wrong["first"] = changed(sound, shape={"anywhere": z.start})
    drivers = {name: built(d, tmp_path / name) for name, d in [("sound", sound), *wrong.items()]}
    if family == "schedule":
        drivers["first"] = mutant(tmp_path / "sound", "s->phase_at = PT_PERIOD;\n    s->since = PT_BEGIN;",
                                         "s->phase_at = 0U;\n    s->since = 0U;")
    found = {name: np.zeros(2, dtype=int) for name in drivers}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        u, y, q, states = exact_run(sound.plant, 200, rng, modes(family, 200, rng))
        y[[20, 21, 90, 150]] = np.nan
        told = u.copy()
        told[[40, 170]] = 9.0  # refused: the firmware resets
        for name, driver in drivers.items():
            trace = driver.run(u=told, y=y, q=q)
            assert set(np.unique(trace.status)) == {0, 2}
            said = np.flatnonzero(trace.status == 0)
            found[name] += lost(trace.row(said), [states[k] for k in said]), int((trace.raw_bits[said] != 0).sum())
            if name == "sound":
                assert trace.assured[said].all() and (trace.r_bound[180:].max(axis=0) < 2e-4).all()
    assert found.pop("sound").tolist() == [0, 0]
    assert all(n.sum() > 0 for n in found.values()), found


def test_an_upset_count_starts_anew(design):
    """A phase or a count that cannot be: the thresholds of any error, at any mode; a set that is no number as well."""
    observer = design["schedule"].observer
    t, q = observer.tables["float32"], np.array([1, 2])
    for at in ([9, 3], [3, 99], [0, 3]):  # beyond the period, beyond the count, another mode's phase
        h = t.shape.h[observer._row(t, q, np.array([at, at]))]
        assert np.array_equal(h, t.shape.h[t.shape.rows + q])
    observer = design["blocks"].observer
    t = observer.tables["float32"]
    observer.start(t, 1)
    observer.phase[:], observer.guard.mode[:] = 2, 0
    observer.set = observer.set.copy()
    observer.set[:, :4] = np.nan
    out, one = observer.empty(t, (1,)), np.array([True])
    with np.errstate(invalid="ignore"):
        observer.sample(t, one, one, np.zeros((1, 1), np.float32), np.zeros((1, 2), np.float32), np.zeros(1, int), None,
                        out)
    assert np.isfinite(out.r_bound).all() and not out.alarm.any() and (out.r_bound > 1).all()


def test_detection_is_back_after_a_sample_out_of_turn(design):
    """J samples later the thresholds are those of the schedule again."""
    d = design["schedule"]
    z, q = d.observer.tables["float32"].shape, np.resize(TURN, 60)
    q[31] = 2  # expected 0: taken for the 2 before the last mode of the period, until the true 2 comes at 33
    y = driven(d.plant, q, np.zeros((60, 2)), np.zeros((60, 2)))
    trace = d.observer.run(np.zeros((60, 1)), y, q)
    settled, since = z.h[-5:, :2], np.arange(33, 60) - 33
    assert np.array_equal(trace.r_bound[25:31], settled[[0, 1, 2, 3, 4, 0]])
    anew = z.h[z.rows + since[:z.rows] * 3 + q[33:33 + z.rows], :2]
    assert np.array_equal(trace.r_bound[33:33 + z.rows], anew) and (anew[0] > 100 * settled.max(axis=0)).all()
    assert np.array_equal(trace.r_bound[33 + z.rows:], settled[np.arange(33 + z.rows, 60) % 5])


@pytest.mark.parametrize("options,change,message", [
    ({"tables": "schedule"}, {"schedule": ()}, "without a schedule .found., expected switching.schedule"),
    ({"tables": "schedule"}, {"schedule": (0, 1, 0, 1, 1, 0)}, None),
    ({"tables": "arbitrary", "order": 3}, {}, "order is 3 .found., expected at least 4"),
    ({"tables": "arbitrary", "order": 4, "rows": 2}, {"A": 4.0}, "grows without bound with 4 columns"),
    ({"tables": "schedule"}, {"schedule": (0, 1), "A": 12.0}, "schedule: spectral radius"),
    ({"tables": "arbitrary"}, {"C": 2.0}, "C that differs between modes"),
])
def test_what_cannot_be_is_said(options, change, message):
    plant = random_plant(seed=7, schedule=change.get("schedule", ()))
    first = plant.modes[0]
    grown = replace(first, A=first.A * change.get("A", 1.0), C=first.C * change.get("C", 1.0))
    plant = replace(plant, modes=(grown, *plant.modes[1:]))
    if message is None:
        assert point_design(plant, **options).observer.family == "schedule"
        return
    with pytest.raises(DesignError, match=message):
        point_design(plant, **options)
