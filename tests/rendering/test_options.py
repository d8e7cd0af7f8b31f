"""Renders of instruments, light and lenses beyond the paper's setting, against geometry.

A separate process for each set of options renders a few images and their annotations.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import read_written
from shaftpose.core.masks import mask_box
from shaftpose.core.samples import sample_key
from shaftpose.core.shard_writer import shard_name
from shaftpose.core.shards import ShardedDataset
from shaftpose.settings.schema import CadSettings, Distortion, RenderSettings
from tests.rendering.blender_process import run_python

IMAGES = 5
SEED = 23
Mask = NDArray[np.bool_]

RENDER = """
import numpy as np
from shaftpose.rendering.generator import SampleGenerator
from shaftpose.core.shard_writer import ShardWriter
generator = SampleGenerator(settings, {Path(path): source for path, source in backgrounds}, seed)
with ShardWriter(Path(shard), 95) as writer:
    for index in indices:
        sample = generator.sample(index)
        np.save(Path(shard).with_name(f"{sample.key}.npy"), sample.rgb)  # as before the JPEG
        writer.write(sample)
"""


@dataclass(frozen=True)
class Shaft:
    """The annotations of one shaft of an image."""

    pose: ShaftPose
    mask: Mask
    info: dict[str, Any]
    rotation: NDArray[np.float64]


@dataclass(frozen=True)
class Rendered:
    """One image of a shard."""

    rgb: NDArray[np.uint8]
    camera: Camera
    shafts: list[Shaft]
    tool: Mask
    described: dict[str, Any]


def render(
    folder: Path, settings: RenderSettings, backgrounds: Mapping[Path, str], indices: list[int]
) -> None:
    """Render images into a shard of `folder`, in a process."""
    folder.mkdir(exist_ok=True)
    shard = folder / shard_name(0)
    pairs = [(str(path), source) for path, source in backgrounds.items()]
    run_python(
        RENDER, folder, settings, backgrounds=pairs, seed=SEED, shard=str(shard), indices=indices
    )


def read(folder: Path) -> list[Rendered]:
    shards = ShardedDataset(folder)
    images = []
    for key in shards.keys:
        described, known = shards.scene_description(key), zip(
            shards.masks(key), shards._json(key, "gt_info.json"), shards._json(key, "gt.json"),
            strict=True,
        )  # fmt: skip
        shafts = [
            Shaft(ShaftPose(**pose), mask, info, np.reshape(gt["cam_R_m2c"], (3, 3)))
            for pose, (mask, info, gt) in zip(described["shafts"], known, strict=True)
        ]
        images.append(
            Rendered(
                np.load(folder / f"{key}.npy"),
                shards.camera(key),
                shafts,
                shards.tool_mask(key),
                described,
            )
        )
    return images


def iou(a: Mask, b: Mask) -> float:
    return float((a & b).sum() / (a | b).sum())


def grown(mask: Mask, pixels: int) -> Mask:
    size = 2 * pixels + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def corner_and_size(mask: Mask) -> list[int]:
    x0, y0, x1, y1 = mask_box(mask)
    return [x0, y0, x1 - x0, y1 - y0]


# A lens with distortion and a circular field, and plain rods, one of which always crosses another.


@pytest.fixture(scope="module")
def bent_settings(settings: RenderSettings) -> RenderSettings:
    lens = replace(
        settings.lens, distortion=Distortion((-0.2, -0.15), (0.03, 0.05)), field_px=285.0
    )
    scene = replace(settings.scene, instruments=(1, 1), crossing_probability=1.0)
    return replace(settings, lens=lens, scene=scene)


@pytest.fixture(scope="module")
def bent(
    bent_settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> list[Rendered]:
    folder = tmp_path_factory.mktemp("bent")
    render(folder, bent_settings, backgrounds, list(range(IMAGES)))
    return read(folder)


def depth(image: Rendered, shaft: Shaft, settings: RenderSettings) -> NDArray[np.float64]:
    size = settings.shaft.diameter_mm, settings.shaft.length_mm
    return cylinder_depth(image.camera, shaft.pose, *size)


def test_every_image_states_its_own_distortion(
    bent: list[Rendered], bent_settings: RenderSettings
) -> None:
    distortion = bent_settings.lens.distortion
    for camera in (image.camera for image in bent):
        assert distortion.k1[0] <= camera.k1 <= distortion.k1[1]
        assert distortion.k2[0] <= camera.k2 <= distortion.k2[1]
        assert camera.field == camera.disc(285.0)
    assert len({image.camera for image in bent}) == IMAGES


def test_masks_are_where_the_distorted_camera_sees_the_shafts(
    bent: list[Rendered], bent_settings: RenderSettings
) -> None:
    for image in bent:
        depths = np.stack([depth(image, shaft, bent_settings) for shaft in image.shafts])
        nearest = np.argmin(depths, axis=0)
        for number, shaft in enumerate(image.shafts):
            expected = np.isfinite(depths[number]) & (nearest == number)
            assert expected.sum() == pytest.approx(shaft.mask.sum(), rel=0.03)
            # The mask uses the nearest pixel of the pinhole's image, so it may be off by a pixel.
            assert not (shaft.mask & ~grown(expected, 1)).any()
            assert not (expected & ~grown(shaft.mask, 1)).any()


def test_a_projected_tip_falls_on_its_mask(bent: list[Rendered], camera: Camera) -> None:
    moved = []
    for image in bent:
        # The crossing shaft is the last one and in front of the others: its tip is visible.
        shaft = image.shafts[-1]
        u, v = image.camera.project(shaft.pose.tip_mm)
        assert grown(shaft.mask, 1)[int(v), int(u)]
        moved.append(np.linalg.norm(camera.project(shaft.pose.tip_mm) - [u, v]))
    assert max(moved) > 8  # px: the distortion has an effect


def test_boxes_are_those_of_the_bent_masks(
    bent: list[Rendered], bent_settings: RenderSettings
) -> None:
    for image in bent:
        for shaft in image.shafts:
            whole = np.isfinite(depth(image, shaft, bent_settings)) | shaft.mask
            assert shaft.info["bbox_visib"] == corner_and_size(shaft.mask)
            assert shaft.info["bbox_obj"] == corner_and_size(whole)
            assert shaft.info["px_count_all"] == whole.sum()


def test_a_crossing_shaft_hides_a_part_of_another(bent: list[Rendered]) -> None:
    for image in bent:
        assert len(image.shafts) == 2
        behind, front = image.shafts
        assert behind.info["visib_fract"] < 0.99
        assert front.info["visib_fract"] > 0.98
        assert not (behind.mask & front.mask).any()
        assert (grown(behind.mask, 3) & front.mask).any()


def test_the_image_is_bent_like_the_mask_and_black_around_its_field(
    bent: list[Rendered], backgrounds: Mapping[Path, str]
) -> None:
    files = {path.name: path for path in backgrounds}
    for image in bent:
        shown = np.isfinite(image.camera.rays()[..., 0])
        assert not shown.all()
        masks = np.any([shaft.mask for shaft in image.shafts], axis=0)
        assert not (masks & ~shown).any()
        assert not image.rgb[~shown].any()
        background = read_written(files[image.described["background"]])
        differs = np.any(image.rgb != background, axis=-1)
        assert differs[masks].mean() > 0.9
        # The pixel filter and the interpolation reach 1.75 px to each side.
        assert not (differs & shown & ~grown(masks, 3)).any()


# A forceps of turned steel in a ring of light, half of it behind tissue.


@pytest.fixture(scope="module")
def forceps_settings(settings: RenderSettings) -> RenderSettings:
    scene = replace(
        settings.scene,
        instruments=(1, 2),
        light_shape="ring",
        anisotropy=(0.3, 0.9),
        films=(0.2, 0.6),
        coating_probability=0.7,
        contact_shadow=(0.3, 0.8),
        occluder_probability=0.6,
        occluder_coverage=(0.1, 0.6),
    )
    shaft = replace(settings.shaft, tip="forceps", jaw_angle_deg=50.0)
    lens = replace(settings.lens, motion_px=(1.0, 4.0), jpeg_quality=(60, 90))
    return replace(settings, scene=scene, shaft=shaft, lens=lens)


@pytest.fixture(scope="module")
def forceps_folder(
    forceps_settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    folder = tmp_path_factory.mktemp("forceps")
    render(folder, forceps_settings, backgrounds, list(range(IMAGES)))
    return folder


@pytest.fixture(scope="module")
def forceps(forceps_folder: Path) -> list[Rendered]:
    return read(forceps_folder)


def jaw_ends(image: Rendered, shaft: Shaft) -> NDArray[np.float64]:
    """Pixels (2, 2) just inside the ends of both jaws: hinge 9 mm from the ends, 25 deg."""
    reach = 9.0 * np.cos(np.radians(25.0))
    offset = 8.5 * np.array([[0, np.sin(a), -np.cos(a)] for a in np.radians([25.0, -25.0])])
    # In the middle of a jaw's half circle, 0.4 of the shaft's radius thick.
    inside = np.array([[0, 0.25, 0], [0, -0.25, 0]])
    points = np.array([0, 0, reach]) + offset + inside
    return image.camera.project(points @ shaft.rotation.T + shaft.pose.tip_mm)


def test_jaws_are_in_the_mask_where_the_annotated_rotation_has_them(
    forceps: list[Rendered], forceps_settings: RenderSettings
) -> None:
    seen = 0
    for image in forceps:
        assert len(image.described["rolls_deg"]) == len(image.shafts)
        for shaft, roll in zip(image.shafts, image.described["rolls_deg"], strict=True):
            np.testing.assert_allclose(shaft.rotation, shaft.pose.rolled(roll), atol=1e-12)
            x, y, width, height = shaft.info["bbox_obj"]
            for u, v in jaw_ends(image, shaft):
                if image.camera.shows(np.array([u, v])):
                    assert x - 1 <= u <= x + width + 1
                    assert y - 1 <= v <= y + height + 1
                    seen += bool(grown(shaft.mask, 1)[int(v), int(u)])
    assert seen >= IMAGES


def test_amodal_counts_of_a_forceps_hold_what_is_hidden(
    forceps: list[Rendered], forceps_settings: RenderSettings
) -> None:
    coverage = forceps_settings.scene.occluder_coverage
    hidden = [image for image in forceps if image.described["occluders"]]
    assert 0 < len(hidden) < IMAGES
    for image in forceps:
        for shaft in image.shafts:
            info = shaft.info
            assert info["px_count_visib"] == shaft.mask.sum() <= info["px_count_all"]
            assert info["visib_fract"] == pytest.approx(shaft.mask.sum() / info["px_count_all"])
            if image.described["occluders"]:
                assert coverage[0] <= 1 - info["visib_fract"] <= coverage[1]
    alone = [i for i in forceps if len(i.shafts) == 1 and not i.described["occluders"]]
    for image in alone:
        assert image.shafts[0].info["visib_fract"] == 1.0


def test_an_image_of_all_options_is_the_same_alone_in_a_process(
    forceps_settings: RenderSettings,
    forceps_folder: Path,
    backgrounds: Mapping[Path, str],
    tmp_path: Path,
) -> None:
    last = IMAGES - 1
    render(tmp_path / "alone", forceps_settings, backgrounds, [last])
    one, all_of_them = ShardedDataset(tmp_path / "alone"), ShardedDataset(forceps_folder)
    assert one.keys == [sample_key(last)]
    for suffix in ("rgb.jpg", "gt.json", "gt_info.json", "mask.json", "mask_visib.json",
                   "mask_tool.json", "shaft.json"):  # fmt: skip
        members = (shards._location(sample_key(last), suffix) for shards in (one, all_of_them))
        first, second = (member.read() for member in members)
        assert first == second, suffix


# The paper's setting, and options that change pixels but no annotation.


@pytest.fixture(scope="module")
def alike(
    with_scene: Callable[..., RenderSettings],
    backgrounds: Mapping[Path, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, list[Rendered]]:
    """The same images plain, with a contact shadow, films, coatings with films, and jaws."""
    changed = {
        "plain": {},
        "shadow": {"contact_shadow": (0.5, 0.9)},
        "films": {"films": (0.3, 0.6)},
        "coatings": {"coating_probability": 1.0, "films": (0.3, 0.6)},
        "jaws": {"jaws_probability": 1.0},
    }
    rendered = {}
    for name, scene in changed.items():
        folder = tmp_path_factory.mktemp(name)
        render(folder, with_scene(**scene), backgrounds, list(range(3)))
        rendered[name] = read(folder)
    return rendered


def all_masks(image: Rendered) -> Mask:
    return np.any([shaft.mask for shaft in image.shafts], axis=0)


@pytest.mark.parametrize("option", ["shadow", "films", "coatings"])
def test_looks_change_no_annotation(alike: dict[str, list[Rendered]], option: str) -> None:
    for plain, changed in zip(alike["plain"], alike[option], strict=True):
        assert (plain.rgb != changed.rgb).any()
        for before, after in zip(plain.shafts, changed.shafts, strict=True):
            assert (before.pose, before.info) == (after.pose, after.info)
            np.testing.assert_array_equal(before.mask, after.mask)


def test_a_contact_shadow_darkens_the_background_and_no_shaft(
    alike: dict[str, list[Rendered]],
) -> None:
    for plain, changed in zip(alike["plain"], alike["shadow"], strict=True):
        difference = plain.rgb.astype(int) - changed.rgb
        steel = ~grown(~all_masks(plain), 2)  # the rim of a shaft blends with the background
        assert not difference[steel].any()
        assert difference.min() >= 0
        beside = grown(all_masks(plain), 4) & ~grown(all_masks(plain), 2)
        far = ~grown(all_masks(plain), 60)
        assert difference[beside].mean() > 3
        assert difference[far].mean() < 1


def test_a_film_changes_the_shafts_alone(alike: dict[str, list[Rendered]]) -> None:
    shares = []
    for plain, changed in zip(alike["plain"], alike["films"], strict=True):
        differs = np.any(plain.rgb != changed.rgb, axis=-1)
        assert not (differs & ~grown(all_masks(plain), 2)).any()
        shares.append(differs[all_masks(plain)].mean())
    assert min(shares) > 0.1


def test_coatings_change_the_shafts_alone(alike: dict[str, list[Rendered]]) -> None:
    for films, coated in zip(alike["films"], alike["coatings"], strict=True):
        differs = np.any(films.rgb != coated.rgb, axis=-1)
        assert not (differs & ~grown(all_masks(films), 2)).any()
        assert differs[all_masks(films)].mean() > 0.5


def test_jaws_are_drawn_beyond_the_tip_in_the_tool_mask(
    alike: dict[str, list[Rendered]],
) -> None:
    for plain, changed in zip(alike["plain"], alike["jaws"], strict=True):
        beyond = np.any(plain.rgb != changed.rgb, axis=-1) & ~grown(all_masks(plain), 2)
        assert beyond.any()
        for before, after in zip(plain.shafts, changed.shafts, strict=True):
            assert before.pose == after.pose
            assert not (after.mask & ~before.mask).any()  # jaws hide, but are no part of a mask
            assert not (after.mask & changed.tool).any()
        instruments = all_masks(changed) | changed.tool
        assert not plain.tool.any()
        assert not (beyond & ~grown(instruments, 2)).any()


def test_jaws_join_their_shafts_without_a_gap(alike: dict[str, list[Rendered]]) -> None:
    for plain, changed in zip(alike["plain"], alike["jaws"], strict=True):
        instruments = all_masks(changed) | changed.tool
        assert not (all_masks(plain) & ~instruments).any()
        parts, _ = cv2.connectedComponents(instruments.astype(np.uint8))
        assert parts - 1 <= len(changed.shafts)  # the background is a part, too


# A CAD file of a plain rod, whose exact masks are known.


@pytest.fixture(scope="module")
def cad_settings(
    settings: RenderSettings, tmp_path_factory: pytest.TempPathFactory
) -> RenderSettings:
    """The settings' rod in metres, along x, off the origin, with the tip at the high end."""
    rod = trimesh.creation.cylinder(1.5, segment=[[-150, 0, 0], [0, 0, 0]], sections=128)
    rod.apply_translation([70, -20, 5])
    rod.apply_scale(0.001)
    path = tmp_path_factory.mktemp("cad") / "rod.glb"
    rod.export(path)
    cad = CadSettings(path, "m", axis="x", tip="high")
    scene = replace(settings.scene, instruments=(2, 2))
    return replace(settings, shaft=replace(settings.shaft, diameter_mm=9.0, cad=cad), scene=scene)


@pytest.fixture(scope="module")
def cad(
    cad_settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> list[Rendered]:
    folder = tmp_path_factory.mktemp("cad")
    render(folder, cad_settings, backgrounds, list(range(3)))
    return read(folder)


def test_masks_of_a_cad_file_are_those_of_its_shape(cad: list[Rendered]) -> None:
    for image in cad:
        depths = np.stack([cylinder_depth(image.camera, s.pose, 3.0, 150.0) for s in image.shafts])
        nearest = np.argmin(depths, axis=0)
        for number, shaft in enumerate(image.shafts):
            whole = np.isfinite(depths[number])
            assert iou(shaft.mask, whole & (nearest == number)) > 0.98
            # Rendered alone, a hidden shaft has its geometric size.
            assert shaft.info["px_count_all"] == pytest.approx(whole.sum(), rel=0.02)
            np.testing.assert_allclose(shaft.info["bbox_obj"], corner_and_size(whole), atol=1)


CROSS = """
import numpy as np
from shaftpose.core.geometry import ShaftPose
from shaftpose.rendering.generator import crossed_shares
from shaftpose.core.samples import Instrument
def instrument(visible, whole):
    masks = (np.isin(np.arange(9), pixels).reshape(3, 3) for pixels in (visible, whole))
    return Instrument(ShaftPose(0.0, 0.0, 20.0, 70.0, 0.0), *masks)
hidden_by_tissue = instrument([0], [0, 1])
assert crossed_shares([hidden_by_tissue], 0) == []
assert crossed_shares([hidden_by_tissue, instrument([1, 2], [1, 2])], 1) == [0.5]
assert crossed_shares([hidden_by_tissue, instrument([2, 3], [2, 3])], 1) == [0]
"""


def test_a_shaft_that_tissue_hides_is_not_crossed_for_that(
    settings: RenderSettings, tmp_path: Path
) -> None:
    run_python(CROSS, tmp_path, settings)
