"""Options of point observers that nothing would read, or that contradict each other, are refused with the reason."""

import pytest
from helpers.points import TOML

from codegen.analysis.validate import validate
from codegen.errors import DesignError, PlantError
from codegen.plant.load import loads
from codegen.selection.select import choose
from codegen.synthesis import SETS
from codegen.synthesis.set_options import check_set_options, readers

WRONG = [  # options, family, outputs, message
    ({"order": 4.5}, "zonotope", 2, "order is 4.5, expected a whole number"),
    ({"rows": 2.5, "tables": "dwell"}, "zonotope", 2, "rows is 2.5, expected a whole number"),
    ({"order": 6}, "ellipsoid", 2, 'order is given with set = "ellipsoid", which does not read it'),
    ({"order": 6, "tables": "dwell"}, "zonotope", 2, 'order is given with tables = "dwell"'),
    ({"set": "ellipsoid", "tables": "dwell"}, "zonotope", 2, 'set is given with tables = "dwell"'),
    ({"rows": 6}, "zonotope", 2, 'rows is given with set = "zonotope"'),
    ({"stages": 6}, "ellipsoid", 2, 'stages is given with set = "ellipsoid".* expected tables = "dwell"'),
    ({"directions": 8}, "zonotope", 2, 'directions is given with set = "zonotope"'),
    ({"directions": 7, "tables": "dwell"}, "zonotope", 2, "directions is 7, expected an even number"),
    ({"directions": 8, "tables": "dwell"}, "zonotope", 1, "directions is given for 1 output, expected two"),
]
RIGHT = [({}, "zonotope", 2), ({"order": 6}, "zonotope", 3), ({"set": "zonotope", "order": 6.0}, "ellipsoid", 1),
         ({"tables": "dwell", "rows": 4, "stages": 3, "directions": 8}, "ellipsoid", 2),
         ({"tables": "none", "set": "ellipsoid"}, "zonotope", 4)]


@pytest.mark.parametrize("options,family,n_y,message", WRONG, ids=lambda x: str(x)[:40])
def test_what_nothing_reads_is_refused(options, family, n_y, message):
    with pytest.raises(DesignError, match=message):
        check_set_options("pt", options, family, n_y)


@pytest.mark.parametrize("options,family,n_y", RIGHT, ids=str)
def test_what_is_read_is_taken(options, family, n_y):
    check_set_options("pt", options, family, n_y)


def test_every_option_of_sets_is_judged():
    assert set(SETS) - set(readers({}, "zonotope")) == {"tables", "gains"}


def test_the_plant_file_hears_of_it():
    plant = loads(TOML.replace("gains = {", 'rows = 6\ngains = {'))
    with pytest.raises(DesignError, match="pt: observer.rows is given with"):
        choose(plant, "zonotope", plant.options, lambda text: None)


def test_a_scenario_that_is_not_there_is_named():
    plant = loads(TOML)
    made = choose(plant, "zonotope", plant.options, lambda text: None)
    with pytest.raises(PlantError, match='scenario "nope" .found., expected one of no fault, sensor'):
        validate(made, None, ["nope"])
