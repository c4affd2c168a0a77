"""What is given as a plant and is none: files, folders, names."""

import pytest

from codegen.errors import PlantError
from codegen.plant.load import load, starter


@pytest.mark.parametrize(
    "content, fragments",
    [
        (None, ["no such file", "gallery: ", "buck, cart", "Correct the path"]),
        (b"", ["is empty", "residua init"]),
        (b" \n\n", ["is empty"]),
        (b"\xff\xfe\x00n", ["no UTF-8 text", "byte 0", "Save it as UTF-8"]),
        (b"format = 1\nname = \x00", ["no TOML"]),
        (b"format = " + b"9" * 5000, ["no TOML"]),
        (b"format = 1\nA = " + b"[" * 5000, ["Flatten it"]),
    ],
)
def test_a_file_that_is_no_plant(tmp_path, content, fragments):
    path = tmp_path / "x.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PlantError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    for fragment in fragments:
        assert fragment in message


def test_a_folder_is_no_plant(tmp_path):
    with pytest.raises(PlantError, match="is a folder .expected a plant file.. Give the .toml file in it"):
        load(tmp_path)


def test_a_path_under_a_file_is_told(tmp_path):
    (tmp_path / "a").write_text("x")
    with pytest.raises(PlantError, match=r"cannot be read \(Not a directory\)"):
        load(tmp_path / "a" / "b.toml")


def test_a_name_near_a_gallery_plant_is_suggested():
    with pytest.raises(PlantError, match='no gallery plant .*Did you mean "zammali_fd"?'):
        load("zamali_fd")


def test_the_starter_refuses_a_bad_name():
    with pytest.raises(PlantError, match='name: is "a b"'):
        starter("a b")
