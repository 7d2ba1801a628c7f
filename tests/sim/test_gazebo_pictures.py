"""Textures: seen by their size first, then decoded one at a time and packed."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from gazebo_files import FLOOR, WALLS, write_world
from PIL import Image

from vsx_ros.errors import InputError
from vsx_ros.sim.gazebo import pictures
from vsx_ros.sim.gazebo.pictures import Textures, pack, picture_of, read_picture, substitute
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.scene import GREY


def packed(image: Image.Image) -> Textures:
    return pack([picture_of("a picture", image)])


def bytes_of(textures: Textures, level: int) -> list[int]:
    """Red, green, blue and grey of a level's first texel."""
    at = textures.levels[0, level]
    return [int(byte) for byte in textures.texels[at : at + 1].view(np.uint8)]


def test_texels_are_the_colours_with_their_grey_at_all_levels() -> None:
    colour = np.array([200, 100, 50])
    textures = packed(Image.new("RGB", (8, 2), tuple(colour.tolist())))
    grey = round(float(np.sqrt(GREY / GREY.sum() @ np.square(colour))))
    assert textures.logs.tolist() == [[3, 1]]
    assert len(textures.texels) == 1 + 16 + 4 + 2 + 1
    assert textures.levels[0].tolist() == [0, 16, 20, *[22] * 9]
    assert all(bytes_of(textures, level) == [*colour, grey] for level in range(4))
    assert textures.contrast[0] == 0.0


def test_sides_become_powers_of_two_and_large_ones_smaller() -> None:
    assert picture_of("a", Image.new("L", (6, 70))).size == (8, 64)
    columns = np.tile(np.array([10, 30], np.uint8), (16, 2048))  # 4096 wide
    textures = packed(Image.fromarray(columns))
    assert textures.logs.tolist() == [[11, 4]]
    assert bytes_of(textures, 0) == [20, 20, 20, 20]


def test_only_pictures_with_holes_keep_their_alpha() -> None:
    solid, cut = (Image.new("RGBA", (1024, 4), (9, 9, 9, alpha)) for alpha in (255, 0))
    cut.paste((9, 9, 9, 255), (512, 0, 1024, 4))
    palette = Image.new("P", (2, 2))
    palette.info["transparency"] = 0
    assert packed(solid).alphas == [None]
    assert packed(Image.new("RGB", (4, 4))).alphas == [None]
    alpha = packed(cut).alphas[0]
    assert alpha is not None
    assert alpha.shape == (4, 512)
    assert (alpha[:, :255] == 0).all()
    assert (alpha[:, 257:] == 255).all()
    assert packed(palette).alphas[0] is not None


def test_a_file_is_read_once_and_paint_depends_on_the_name(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png")
    first, second = (read_picture(tmp_path / "a.png") for _ in range(2))
    assert first == second
    assert len({first, second, read_picture(tmp_path / "a.png")}) == 1
    one, same, other = (pack([substitute(name)]).texels for name in ("a.png", "a.png", "b.png"))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_too_many_texels_are_refused_before_one_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MOST_TEXELS", 41)
    never = [pictures.Picture("a", object(), (4, 4)) for _ in range(2)]  # cannot be decoded
    with pytest.raises(InputError, match=r"2 textures have 42 texels, at most 41 can be drawn; leave some out"):
        pack(never)


def test_a_damaged_picture_is_named_when_the_world_is_read(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "torn.png")
    content = (tmp_path / "torn.png").read_bytes()
    (tmp_path / "torn.png").write_bytes(content[: len(content) // 2])
    look = "<material><pbr><metal><albedo_map>torn.png</albedo_map></metal></pbr></material>"
    shape = "<geometry><box><size>1 1 1</size></box></geometry>"
    model = f'<model name="m"><link name="l"><visual name="v">{shape}{look}</visual></link></model>'
    with pytest.raises(InputError, match=r"texture .*torn\.png cannot be read.*save it again"):
        load_gazebo(write_world(tmp_path, FLOOR, WALLS, model), [])


@pytest.mark.parametrize("channels", [3, 4])
def test_a_webp_picture_is_drawn_as_the_same_png(tmp_path: Path, channels: int) -> None:
    rng = np.random.default_rng(channels)
    given = Image.fromarray(cv2.resize(rng.integers(0, 256, (20, 30, channels), dtype=np.uint8), (512, 256)))
    for kind in ("png", "webp"):
        given.save(tmp_path / f"a.{kind}", **({"lossless": True, "exact": True} if kind == "webp" else {}))
    png, webp = (pack([read_picture(tmp_path / f"a.{kind}")]) for kind in ("png", "webp"))
    np.testing.assert_array_equal(webp.texels, png.texels)
    assert (webp.alphas[0] is None) == (png.alphas[0] is None)


def test_half_a_webp_picture_is_told(tmp_path: Path) -> None:
    Image.new("RGB", (256, 256), "red").save(tmp_path / "a.webp", lossless=False)
    data = (tmp_path / "a.webp").read_bytes()
    (tmp_path / "a.webp").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"a\.webp"):
        pack([read_picture(tmp_path / "a.webp")])


@pytest.mark.parametrize(
    ("name", "mode", "kind", "white"),
    [
        ("a.png", "I;16", "<u2", 65535),
        ("a.tif", "I;16", "<u2", 65535),
        ("a.tif", "I;16B", ">u2", 65535),
        ("a.tif", "I", "<i4", 65535),
        ("a.tif", "I", "<i4", 2**31 - 1),
        ("a.tif", "F", "<f4", 1.0),
    ],
)
def test_a_grey_picture_of_more_bits_keeps_its_greys(
    tmp_path: Path, name: str, mode: str, kind: str, white: float
) -> None:
    shares = np.array([[0.0, 0.25], [0.5, 1.0]])
    Image.frombytes(mode, (2, 2), (white * shares).astype(kind).tobytes()).save(tmp_path / name)
    textures = pack([read_picture(tmp_path / name)])
    reds = textures.texels[:4].view(np.uint8).reshape(4, 4)[:, 0]
    np.testing.assert_allclose(reds, 255.0 * shares.ravel(), atol=1.0)
