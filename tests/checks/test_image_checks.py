"""Checks of an image: a set with exactly one defect is refused, in one line that names it."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.checks.expected_sets import Body, ExpectedSet
from shaftpose.checks.image_checks import check_image
from shaftpose.checks.rendered_image import read_image
from shaftpose.checks.set_checks import find_problems, read_members, refuse
from shaftpose.checks.silhouette_checks import cylinder_depths, silhouette_ious
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import encode_jpeg
from shaftpose.core.samples import Sample
from shaftpose.settings.schema import Distortion, LensSettings
from tests.checks.rendered_sets import (
    BACKGROUNDS,
    BELOW,
    CAMERA,
    LEFT,
    RIGHT,
    ROD,
    checked,
    edit_json,
    first,
    rewrite,
    sample,
    settings,
    silhouettes,
    write_set,
)

KEY = "000000000"


def complaint(expected: ExpectedSet) -> str:
    """The error message for a set with exactly one defect."""
    with pytest.raises(InputError) as caught:
        refuse(find_problems([expected], checked(expected)))
    message = str(caught.value)
    assert "(problem 1 of 1)" in message
    assert message.startswith(f"{expected.folder / 'shard-000000.tar'}: {KEY}: ")
    assert "dvc repro -s -f render" in message
    return message


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> ExpectedSet:
    """A correct image of two shafts."""
    return write_set(tmp_path_factory.mktemp("pair"), [[sample(0, [LEFT, RIGHT])]])


def test_a_sound_image_passes(pair: ExpectedSet) -> None:
    (shard,) = checked(pair)
    refuse(find_problems([pair], [shard]))
    (image,) = shard.images
    assert [shaft.silhouette_iou for shaft in image.shafts] == [1.0, 1.0]


@pytest.mark.parametrize(
    ("suffix", "edit", "says"),
    [
        ("gt_info.json", lambda c: first(c, bbox_visib=[1, 2, 3, 4]),
         "shaft 0: bbox_visib = (1, 2, 3, 4): the mask's extent is"),
        ("gt_info.json", lambda c: first(c, bbox_obj=[0, 0, 299, 299]),
         "shaft 0: bbox_obj = (0, 0, 299, 299): the amodal extent is ("),
        ("gt_info.json", lambda c: first(c, px_count_visib=7),
         "shaft 0: px_count_visib = 7: the mask has"),
        ("gt_info.json", lambda c: first(c, px_count_valid=7),
         "shaft 0: px_count_valid = 7: the amodal mask has"),
        ("gt_info.json", lambda c: first(c, px_count_all=9000),
         "shaft 0: px_count_all = 9000: the amodal mask has "),
        ("gt_info.json", lambda c: first(c, visib_fract=0.25),
         "shaft 0: visib_fract = 0.25:"),
        ("gt_info.json", lambda c: c[0].pop("bbox_obj"),
         "gt_info.json: 0.bbox_obj"),
        ("gt_info.json", lambda c: c.pop(),
         "gt_info.json: 1 entries for the 2 shafts"),
        ("gt.json", lambda c: first(c, cam_t_m2c=[1.0, 2.0, 25.0]),
         "shaft 0: cam_t_m2c = (1.0, 2.0, 25.0): shaft.json says [-6.0, -3.0, 25.0]"),
        ("gt.json", lambda c: first(c, cam_R_m2c=c[1]["cam_R_m2c"]),
         "shaft 0: cam_R_m2c has pitch 60.0000 and yaw 340.0000 deg: shaft.json says 70.0000"),
        ("gt.json", lambda c: first(c, cam_R_m2c=[
            value * (-1 if n % 3 == 0 else 1) for n, value in enumerate(c[0]["cam_R_m2c"])]),
         "shaft 0: cam_R_m2c = ("),
        ("gt.json", lambda c: first(c, cam_R_m2c=[
            value * (2 if n % 3 == 0 else 1) for n, value in enumerate(c[0]["cam_R_m2c"])]),
         ": not a rotation matrix"),
        ("gt.json", lambda c: first(c, cam_R_m2c=[1.0, 2.0]),
         "gt.json: 0.cam_R_m2c.2 = '[1.0, 2.0]'"),
        ("gt.json", lambda c: first(c, obj_id=2),
         "shaft 0: obj_id = 2, not 1"),
        ("camera.json", lambda c: c["cam_K"].__setitem__(0, 140.0),
         "cam_K = (140.0, "),
        ("camera.json", lambda c: c.update(distortion=[1e-9, 0.0]),
         "k1 = 1e-09: outside lens.distortion.k1 = [0, 0]"),
        ("camera.json", lambda c: c.update(field_px=250.0),
         "field_px = 250.0, not lens.field_px = None"),
        ("shaft.json", lambda c: c.update(rolls_deg=[0.0, 45.0]),
         "shaft.json says roll 45 deg"),
        ("shaft.json", lambda c: c.update(rolls_deg=[45.0]),
         "shaft.json: rolls_deg: 1 entries for the 2 shafts"),
        ("mask_visib.json", lambda c: c["1"]["counts"].append(5),
         "mask_visib.json: mask 1 has 89406 px"),
        ("mask_visib.json", lambda c: c["1"].update(size=[1, 89401]),
         "mask_visib.json: mask 1 has 89401 px and the size (1, 89401)"),
        ("mask_visib.json", lambda c: c.update({"2": c.pop("0")}),
         "mask_visib.json: no mask 0"),
        ("mask.json", lambda c: c["1"]["counts"].append(5),
         "mask.json: mask 1 has 89406 px"),
        ("mask.json", lambda c: c.pop("1"),
         "mask.json: 1 entries for the 2 shafts"),
        ("mask_visib.json", lambda c: c["0"].update(counts=[-1, 89402]),
         "mask_visib.json: mask 0 has a run of -1 px"),
        ("mask_tool.json", lambda c: c["counts"].append(5),
         "mask_tool.json: the mask has 89406 px"),
        ("mask_tool.json", lambda c: c.update(counts=[89399, 2]),
         "2 px in the tool mask: shaft.json has no jaws"),
        ("shaft.json", lambda c: c.update(background="x.jpg"),
         "background = 'x.jpg': not among the backgrounds of this set"),
        ("shaft.json", lambda c: c.update(source="tissue-1"),
         "source = 'tissue-1': the library has 'tissue-0' for 000000.jpg"),
        ("shaft.json", lambda c: c.update(samples=5),
         "samples = 5: outside the profile's samples = [2, 4]"),
        ("shaft.json", lambda c: c.pop("tries"),
         "shaft.json: tries"),
        ("shaft.json", lambda c: c["steels"].pop(),
         "shaft.json: steels: 1 entries for the 2 shafts"),
    ],
)  # fmt: skip
def test_a_wrong_value(
    pair: ExpectedSet, tmp_path: Path, suffix: str, edit: Callable[[Any], Any], says: str
) -> None:
    shutil.copytree(pair.folder, tmp_path, dirs_exist_ok=True)
    rewrite(tmp_path / "shard-000000.tar", edit_json(f"{KEY}.{suffix}", edit))
    assert says in complaint(replace(pair, folder=tmp_path))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"bbox_obj": [0, 0, 2, 2]}, "bbox_obj = (0, 0, 2, 2): the amodal extent is ("),
        ({"px_count_all": 500, "px_count_valid": 500}, "px_count_all = 500: the amodal mask has"),
    ],
)  # fmt: skip
def test_a_wrong_extent_of_another_shape(tmp_path: Path, values: dict[str, Any], says: str) -> None:
    """A forceps has no exact silhouette, so its values are compared with its masks."""
    mask = np.zeros((299, 299), dtype=bool)
    mask[100:120, 50:80] = True
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[mask])]])
    rewrite(
        tmp_path / "shard-000000.tar",
        edit_json(f"{KEY}.gt_info.json", lambda content: first(content, **values)),
    )
    (shard,) = checked(replace(expected, body=replace(ROD, is_rod=False)))
    assert f"shaft 0: {says}" in " ".join(problem.what for problem in shard.problems)


def test_a_wrong_amodal_mask(tmp_path: Path) -> None:
    good = sample(0, [LEFT])
    amodal = good.instruments[0].amodal_mask.copy()
    row, column = np.argwhere(amodal)[len(np.argwhere(amodal)) // 2]  # in the middle of the shaft
    amodal[row, column] = False
    wrong = replace(good.instruments[0], amodal_mask=amodal)
    expected = write_set(tmp_path, [[replace(good, instruments=(wrong,))]])
    (shard,) = checked(expected)
    assert [problem.what for problem in shard.problems] == [
        "shaft 0: 1 px of its visible mask are not in its amodal mask",
        "shaft 0: 1 px of its amodal mask differ from its pose's silhouette",
    ]


@pytest.mark.parametrize(
    ("suffix", "data", "says"),
    [
        ("rgb.jpg", b"no picture", "rgb.jpg: 10 bytes that are not a complete JPEG image"),
        ("rgb.jpg", b"no picture\xff\xd9", "rgb.jpg: 12 bytes that are not a complete JPEG image"),
        ("rgb.jpg", encode_jpeg(np.zeros((64, 80, 3), np.uint8), 95),
         "rgb.jpg: 80 x 64 px, not 299 x 299"),
        ("gt.json", b'[{"cam_R', "gt.json: content = "),
        ("shaft.json", None, "shaft.json: missing"),
    ],
)  # fmt: skip
def test_a_damaged_member(
    pair: ExpectedSet, tmp_path: Path, suffix: str, data: bytes | None, says: str
) -> None:
    shutil.copytree(pair.folder, tmp_path, dirs_exist_ok=True)

    def damage(members: dict[str, bytes]) -> None:
        members.pop(f"{KEY}.{suffix}")
        if data is not None:
            members[f"{KEY}.{suffix}"] = data

    rewrite(tmp_path / "shard-000000.tar", damage)
    assert says in complaint(replace(pair, folder=tmp_path))


def test_an_image_that_was_cut_short(pair: ExpectedSet, tmp_path: Path) -> None:
    shutil.copytree(pair.folder, tmp_path, dirs_exist_ok=True)
    name = f"{KEY}.rgb.jpg"
    rewrite(
        tmp_path / "shard-000000.tar",
        lambda members: members.update({name: members[name][: len(members[name]) // 2]}),
    )
    assert "rgb.jpg: " in complaint(replace(pair, folder=tmp_path))


TOO_FAR = ShaftPose(-6.0, -3.0, 45.0, 70.0, 150.0)
TIP_BESIDE = ShaftPose(20.0, 0.0, 12.0, 90.0, 180.0)  # u = 137 * 20 / 12 + 149.5 = 378
THROUGH_LENS = ShaftPose(13.38, 0.0, 14.86, 50.0, 180.0)  # passes the camera at 2.8 mm
FLAT, ACROSS = ShaftPose(0.0, 0.0, 20.0, 90.0, 0.0), ShaftPose(5.0, -5.0, 20.0, 90.0, 90.0)


@pytest.mark.parametrize(
    ("poses", "says"),
    [
        ([TOO_FAR], "shaft 0: z_mm = 45: outside poses.z_mm = [10, 40]"),
        ([TIP_BESIDE], "shaft 0: tip at 377.8, 149.5 px: outside the image"),
        ([THROUGH_LENS], "shaft 0: 1.283 mm from the camera: below scene.lens_radius_mm = 3.0"),
        ([FLAT, ACROSS], "shafts 0 and 1: axes 0.000 mm apart: they intersect"),
        ([], "shafts = 0: outside scene.instruments = [1, 2]"),
    ],
)
def test_an_impossible_scene(tmp_path: Path, poses: list[ShaftPose], says: str) -> None:
    assert says in complaint(write_set(tmp_path, [[sample(0, poses)]]))


def test_a_yaw_may_be_written_in_more_than_one_way(tmp_path: Path) -> None:
    """Rotations do not count full turns."""
    expected = write_set(tmp_path, [[sample(0, [replace(LEFT, yaw_deg=150.0 - 360.0)])]])
    wide = replace(expected.settings.poses, yaw_deg=(-360.0, 0.0))
    expected = replace(expected, settings=replace(expected.settings, poses=wide))
    refuse(find_problems([expected], checked(expected)))


def test_a_mask_beside_its_shaft(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[np.roll(mask, 2, axis=0)])]])
    message = complaint(expected)
    assert "shaft 0: IoU 0." in message
    assert "of its mask and the silhouette of its pose: below 0.95" in message


def test_masks_of_occluded_shafts_are_not_compared(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    mask[:, :75] = False
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[mask], occluders=[{}])]])
    (shard,) = checked(with_scene(expected, occluder_probability=0.5))
    assert not shard.problems
    assert shard.images[0].shafts[0].silhouette_iou is None


def test_a_tool_mask_on_a_shaft(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    tool = np.zeros_like(mask)
    tool.flat[np.flatnonzero(mask)[:3]] = tool[0, 0] = True
    wrong = replace(sample(0, [LEFT], jaws=[{}]), tool_mask=tool)
    (shard,) = checked(write_set(tmp_path, [[wrong]]))
    assert "shaft 0: 3 px of its visible mask are in the tool mask" in [
        problem.what for problem in shard.problems
    ]


def test_masks_behind_jaws_are_not_compared(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    mask[:, :75] = False
    behind, free = [{"opening_deg": 30.0}], [None]
    assert "below 0.95" in complaint(
        write_set(tmp_path, [[sample(0, [LEFT], masks=[mask], jaws=free)]])
    )
    (shard,) = checked(write_set(tmp_path, [[sample(0, [LEFT], masks=[mask], jaws=behind)]]))
    assert not shard.problems


def test_a_mask_beside_its_occluded_shaft(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    aside = np.roll(mask, 2, axis=0)
    share = np.sum(aside & ~mask) / np.sum(aside)
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[aside], occluders=[{}])]])
    assert (
        f"shaft 0: {share:.3f} of its mask lies outside the silhouette of its pose: more than 0.05"
        in complaint(with_scene(expected, occluder_probability=1.0))
    )


def across(pose: ShaftPose) -> ShaftPose:
    """A shaft that passes 6 mm in front of the visible middle of another one."""
    x, y, z = pose.tip_mm + 8 * pose.direction - [0, 0, 6]
    return ShaftPose(x, y, z, 85.0, pose.yaw_deg - 90)


@pytest.mark.parametrize(
    ("described", "option", "says"),
    [
        ({}, {"occluder_probability": 1.0}, "occluders = 0: scene.occluder_probability = 1"),
        ({"occluders": [{}]}, {"occluder_probability": 0.0},
         "occluders = 1: scene.occluder_probability = 0"),
        ({}, {"crossing_probability": 1.0}, "crossing = 0: scene.crossing_probability = 1"),
        ({"crossing": 1}, {"crossing_probability": 0.0},
         "crossing = 1: scene.crossing_probability = 0"),
    ],
)  # fmt: skip
def test_what_is_there_though_it_never_is_or_lacks_though_it_always_is(
    tmp_path: Path, described: dict[str, Any], option: dict[str, float], says: str
) -> None:
    expected = write_set(tmp_path, [[sample(0, [LEFT, across(LEFT)], **described)]])
    assert says in complaint(with_scene(expected, **option))
    (name,) = option
    refuse(find_problems([expected], checked(with_scene(expected, **{name: 0.5}))))


def test_an_image_without_shafts_has_nothing_to_hide(tmp_path: Path) -> None:
    expected = with_scene(
        write_set(tmp_path, [[sample(0, [])]]),
        instruments=(0, 1), occluder_probability=1.0, crossing_probability=1.0,
    )  # fmt: skip
    refuse(find_problems([expected], checked(expected)))


def test_a_mask_too_small_to_learn_from(tmp_path: Path) -> None:
    mask = np.zeros((299, 299), dtype=bool)
    mask[100:110, 50:80] = True
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[mask])]])
    few = replace(expected, body=replace(ROD, is_rod=False))
    assert "shaft 0: mask of 300 px: fewer than scene.min_visible_px = 400" in complaint(few)


def test_a_pixel_of_two_shafts(tmp_path: Path) -> None:
    one, two = silhouettes([LEFT, RIGHT])
    two[100:105, 100:110] = True
    one[100:105, 100:110] = True
    expected = write_set(tmp_path, [[sample(0, [LEFT, RIGHT], masks=[one, two])]])
    shared = replace(expected, body=replace(ROD, is_rod=False))
    assert "shafts 0 and 1: their visible masks share 50 px" in complaint(shared)


def test_iou_of_a_mask_of_which_half_is_there(tmp_path: Path) -> None:
    (mask,) = silhouettes([BELOW])
    rows = np.flatnonzero(mask.any(axis=1))
    kept = mask.copy()
    kept[rows[len(rows) // 2] :] = False
    expected = write_set(tmp_path, [[sample(0, [BELOW], masks=[kept])]])
    members = read_members(tmp_path / "shard-000000.tar")[KEY]
    image = read_image(members, 299)
    found = silhouette_ious(image, cylinder_depths(image, CAMERA, expected.body))
    assert found == [pytest.approx(kept.sum() / mask.sum())]


def test_facts_of_an_image_by_hand(tmp_path: Path) -> None:
    write_set(tmp_path, [[sample(0, [FLAT])]])
    members = read_members(tmp_path / "shard-000000.tar")[KEY]
    checked, problems = check_image(KEY, members, settings(), ROD, BACKGROUNDS)
    assert not problems
    assert checked is not None
    assert (checked.key, checked.background, checked.source) == (KEY, "000000.jpg", "tissue-0")
    assert (checked.tries, checked.light_strength, checked.light_kelvin) == (4, 1000.0, 5000.0)
    (shaft,) = checked.shafts
    assert (shaft.x_mm, shaft.z_mm, shaft.pitch_deg) == (0.0, 20.0, 90.0)
    # From the tip at the centre, column 149, to the right edge. Height: 3 mm at 18.5 mm are 22 px.
    assert shaft.box_width_px == 150
    assert shaft.box_height_px == pytest.approx(3 * 136.99 / 19.94, abs=1)
    assert shaft.lens_distance_mm == pytest.approx(20.0)
    assert shaft.roughness == 0.2


def with_lens(expected: ExpectedSet, **changed: Any) -> ExpectedSet:
    lens: LensSettings = replace(expected.settings.lens, **changed)
    return replace(expected, settings=replace(expected.settings, lens=lens))


def with_scene(expected: ExpectedSet, **changed: Any) -> ExpectedSet:
    scene = replace(expected.settings.scene, **changed)
    return replace(expected, settings=replace(expected.settings, scene=scene))


# Barrel distortion: moves points at the edge inwards.
BARREL = replace(CAMERA, k1=-0.1, k2=0.01)
BARREL_RANGES = Distortion((-0.2, -0.05), (0.0, 0.02))
# 170 px from the centre in a pinhole camera (u = 319.5), 144 px with barrel distortion.
AT_THE_EDGE = ShaftPose(18.62, 0.0, 15.0, 70.0, 180.0)


def test_an_image_is_compared_through_its_own_lens(tmp_path: Path) -> None:
    poses = [AT_THE_EDGE]
    seen = sample(0, poses, camera=BARREL)
    expected = with_lens(write_set(tmp_path, [[seen]]), distortion=BARREL_RANGES)
    (shard,) = checked(expected)
    assert not shard.problems
    assert shard.images[0].shafts[0].silhouette_iou == 1.0


def test_a_mask_of_another_lens(tmp_path: Path) -> None:
    seen = sample(0, [LEFT], masks=silhouettes([LEFT]), camera=BARREL)
    expected = with_lens(write_set(tmp_path, [[seen]]), distortion=BARREL_RANGES)
    assert "of its mask and the silhouette of its pose: below 0.9 " in complaint(expected)


def test_a_lens_that_is_not_stated(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, [LEFT])]])
    expected = with_lens(expected, distortion=Distortion((0.0, 0.1), (0.01, 0.02)))
    assert "k2 = 0: outside lens.distortion.k2 = [0.01, 0.02]" in complaint(expected)


def test_a_tip_outside_the_round_field(tmp_path: Path) -> None:
    round_field = replace(CAMERA, field=CAMERA.disc(220.0))
    outside = ShaftPose(17.0, 0.0, 20.0, 80.0, 180.0)  # 116 px from the centre
    seen = sample(0, [outside], camera=round_field)
    expected = with_lens(write_set(tmp_path, [[seen]]), field_px=220.0)
    assert "shaft 0: tip at 265.9, 149.5 px: outside the image" in complaint(expected)


THREE = [LEFT, RIGHT, BELOW]


def test_a_shaft_may_cross_beside_those_of_the_settings(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, [LEFT, RIGHT, across(LEFT)], crossing=1)]])
    expected = with_scene(expected, crossing_probability=0.5)
    refuse(find_problems([expected], checked(expected)))
    one_too_many = with_scene(expected, instruments=(1, 1))
    says = "shafts = 2 plus 1 crossing: outside scene.instruments = [1, 1]"
    assert says in complaint(one_too_many)


def test_a_crossing_shaft_hides_the_required_share(tmp_path: Path) -> None:
    """An independent count: pixels of the other's cylinder missing from its visible mask."""
    crossed = sample(0, [LEFT, across(LEFT)], crossing=1)
    hidden = 1 - crossed.instruments[0].visible_fraction
    assert 0.05 < hidden < 0.5
    expected = write_set(tmp_path, [[crossed]])
    expected = with_scene(expected, crossing_probability=1.0)
    around = with_scene(expected, crossing_coverage=(hidden - 0.01, hidden + 0.01))
    refuse(find_problems([around], checked(around)))
    more = with_scene(expected, crossing_coverage=(0.6, 0.8))
    says = f"shaft 1: hides {hidden:.3f} of the shaft it crosses: must be above 0 and within "
    assert f"{says}scene.crossing_coverage = [0.6, 0.8]" in complaint(more)


def test_a_shaft_that_crosses_nothing_is_found(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, [LEFT, RIGHT], crossing=1)]])
    expected = with_scene(expected, crossing_probability=1.0)
    assert "shaft 1: hides 0.000 of the shaft it crosses: must be above 0" in complaint(expected)


def test_a_shaft_too_many_where_none_crosses(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, THREE)]])
    assert "shafts = 3: outside scene.instruments = [1, 2]" in complaint(expected)


def test_masks_of_other_shapes_are_not_compared(tmp_path: Path) -> None:
    (mask,) = silhouettes([LEFT])
    expected = write_set(tmp_path, [[sample(0, [LEFT], masks=[np.roll(mask, 2, axis=0)])]])
    (shard,) = checked(replace(expected, body=replace(ROD, is_rod=False)))
    assert not shard.problems
    assert shard.images[0].shafts[0].silhouette_iou is None


@pytest.mark.parametrize(
    ("poses", "body", "says"),
    [
        # Axis 20 mm from the camera, minus the radius of 18 mm.
        ([FLAT], Body(36.0, 150.0, is_rod=False), "2.000 mm from the camera"),
        ([FLAT, ShaftPose(0.0, 6.0, 20.0, 90.0, 0.0)], Body(7.0, 150.0, is_rod=False),
         "axes 6.000 mm apart: they intersect, as their diameter is 7 mm"),
    ],
)  # fmt: skip
def test_the_rod_around_an_instrument_keeps_its_distance(
    tmp_path: Path, poses: list[ShaftPose], body: Body, says: str
) -> None:
    expected = replace(write_set(tmp_path, [[sample(0, poses)]]), body=body)
    assert says in complaint(expected)


def test_a_short_instrument_may_point_at_the_camera(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, [THROUGH_LENS])]])
    short = replace(expected, body=Body(3.0, 10.0, is_rod=False))
    refuse(find_problems([short], checked(short)))


def half_hidden(pose: ShaftPose) -> Sample:
    """One shaft with every second pixel hidden by an occluder."""
    (mask,) = silhouettes([pose])
    mask[np.nonzero(mask)] = np.arange(mask.sum()) % 2 == 0
    return sample(0, [pose], masks=[mask], occluders=[{}])


def test_an_occluder_hides_the_required_share(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[half_hidden(LEFT)]])
    expected = with_scene(expected, occluder_probability=1.0, occluder_coverage=(0.2, 0.8))
    (shard,) = checked(expected)
    assert not shard.problems
    assert shard.images[0].shafts[0].occluded_share == pytest.approx(0.5, abs=0.001)
    more = with_scene(expected, occluder_coverage=(0.6, 0.8))
    assert "shaft 0: hidden share 0.500: outside scene.occluder_coverage = [0.6, 0.8]" in complaint(
        more
    )


def test_shafts_without_an_occluder_need_not_be_hidden(pair: ExpectedSet) -> None:
    expected = with_scene(pair, occluder_coverage=(0.2, 0.8))
    (shard,) = checked(expected)
    assert not shard.problems
    assert [shaft.occluded_share for shaft in shard.images[0].shafts] == [None, None]
