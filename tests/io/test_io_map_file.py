import cv2
import numpy as np
import pytest

from vsx_ros.errors import MapFileError
from vsx_ros.io.map_file import is_map_file, load_map, load_plan, save_map
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

GRID = OccupancyGrid(np.random.default_rng(0).choice([-1, 0, 100], (7, 11)).astype(np.int8), 0.05, -1.25, 3.5)
YAML = "image: m.png\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def test_a_map_is_not_saved_under_another_name_than_it_is_given(tmp_path):
    (tmp_path / "floor.pgm").write_bytes(b"another map")
    with pytest.raises(MapFileError, match=r"end in \.pgm or \.yaml"):
        save_map(GRID, tmp_path / "floor.1st")
    assert (tmp_path / "floor.pgm").read_bytes() == b"another map"


@pytest.mark.parametrize("name", ["map", "map.yaml", "map.pgm"])
def test_a_saved_map_is_loaded_back(tmp_path, name):
    save_map(GRID, tmp_path / name)
    for given in ("map.yaml", "map.pgm"):
        back = load_map(tmp_path / given)
        assert np.array_equal(back.data, GRID.data)
        assert (back.resolution, back.origin_x, back.origin_y) == (0.05, -1.25, 3.5)


def test_a_yaml_of_a_windows_editor_is_one(tmp_path):
    save_map(GRID, tmp_path / "map")
    text = (tmp_path / "map.yaml").read_bytes()
    assert text.startswith(b"image:")
    (tmp_path / "map.yaml").write_bytes(b"\xef\xbb\xbf" + text)
    assert is_map_file(tmp_path / "map.yaml")
    assert np.array_equal(load_map(tmp_path / "map.yaml").data, GRID.data)


def test_the_bottom_row_of_the_image_is_the_first_row_of_the_grid(tmp_path):
    save_map(GRID, tmp_path / "map")
    image = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(image[-1] == 0, GRID.data[0] == OCCUPIED)
    assert np.array_equal(image[-1] == 254, GRID.data[0] == FREE)
    assert np.array_equal(image[-1] == 205, GRID.data[0] == UNKNOWN)


def loaded(tmp_path, image, text=YAML):
    cv2.imwrite(str(tmp_path / "m.png"), image)
    (tmp_path / "m.yaml").write_text(text)
    return load_map(tmp_path / "m.yaml").data


def test_thresholds_are_those_of_the_yaml(tmp_path):
    gray = np.array([[0, 80, 100, 200, 210, 255]], np.uint8)
    assert loaded(tmp_path, gray).tolist() == [[100, 100, -1, -1, 0, 0]]
    assert loaded(tmp_path, gray, YAML.replace("0.65", "0.2")).tolist() == [[100, 100, 100, 100, 0, 0]]


def test_an_angle_of_rounding_is_none(tmp_path):
    gray = np.array([[0, 255]], np.uint8)
    for yaw in ("1e-17", "-9.9e-7"):
        assert loaded(tmp_path, gray, YAML.replace("0.0]", f"{yaw}]")).tolist() == [[100, 0]]


def test_negated_and_raw_maps(tmp_path):
    gray = np.array([[0, 100, 255]], np.uint8)
    assert loaded(tmp_path, gray, YAML.replace("negate: 0", "negate: 1")).tolist() == [[0, -1, 100]]
    assert loaded(tmp_path, gray, YAML + "mode: raw\n").tolist() == [[0, 100, -1]]


def test_colour_transparency_and_sixteen_bits(tmp_path):
    bgra = np.array([[[0, 0, 0, 255], [255, 255, 255, 255], [0, 0, 0, 0]]], np.uint8)
    assert loaded(tmp_path, bgra).tolist() == [[100, 0, -1]]
    assert loaded(tmp_path, bgra[..., :3]).tolist() == [[100, 0, 100]]
    assert loaded(tmp_path, np.array([[0, 65535, 30000]], np.uint16)).tolist() == [[100, 0, -1]]


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("resolution: 0.1", "resolution: -1", "impossible"),
        ("resolution: 0.1", "", "'resolution'"),
        ("0.0, 0.0, 0.0]", "0.0, 0.0, 0.7]", "turned by 0.7"),
        ("0.0, 0.0, 0.0]", "0.0, 0.0, 1.1e-6]", "turned by 1.1e-06"),
        ("0.0, 0.0, 0.0]", "0.0, 0.0, .nan]", "turned by nan"),
        ("0.0, 0.0, 0.0]", "0.0]", "malformed"),
        ("0.0, 0.0, 0.0]", "0.0, .nan, 0.0]", "impossible"),
        ("m.png", "absent.png", r"absent\.png is missing"),
        ("image:", "image: [", "cannot be read"),
        (YAML, "- 1\n", "missing or malformed"),
    ],
)
def test_wrong_maps_are_one_sentence(tmp_path, before, after, message):
    with pytest.raises(MapFileError, match=message) as caught:
        loaded(tmp_path, np.zeros((3, 3), np.uint8), YAML.replace(before, after))
    assert "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(MapFileError, match="cannot be written"):
        save_map(GRID, tmp_path / "absent" / "map")


def test_a_plan_without_a_yaml(tmp_path):
    save_map(GRID, tmp_path / "map.yaml")
    (tmp_path / "map.yaml").unlink()
    back = load_plan(tmp_path / "map.pgm")
    assert np.array_equal(back.data, GRID.data)
    assert (back.resolution, back.origin_x, back.origin_y) == (0.05, 0.0, 0.0)
    with pytest.raises(MapFileError, match="give a PGM or PNG"):
        load_plan(tmp_path / "none.png")
