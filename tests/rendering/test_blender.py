"""Blender's renders, against exact geometry, Blender's own files and other renders."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import read_written
from shaftpose.core.samples import Sample, encode_sample
from shaftpose.rendering.poses import PoseSampler
from shaftpose.rendering.scene import Scene
from shaftpose.settings.schema import RenderSettings
from tests.rendering.blender_process import run_python

if TYPE_CHECKING:
    from shaftpose.rendering.blender import Foreground, Renderer
    from shaftpose.rendering.generator import SampleGenerator

SEED = 11
JPEG_QUALITY = 95
LEFT_TO_RIGHT = ShaftPose(-12.0, 0.0, 20.0, 90.0, 0.0)
TOP_TO_BOTTOM_BEHIND = ShaftPose(0.0, -14.0, 30.0, 90.0, 90.0)

# A pass -> its name in the compositor.
PASSES = {"Combined": "Image", "IndexOB": "IndexOB"}

ONE_IMAGE_ALONE = """
from shaftpose.rendering.generator import SampleGenerator
from shaftpose.core.samples import encode_sample
sources = {Path(path): source for path, source in backgrounds}
sample = SampleGenerator(settings, sources, seed).sample(index)
Path("image.rgb").write_bytes(sample.rgb.tobytes())
for suffix, data in encode_sample(sample, quality).items():
    Path(f"sample.{suffix}").write_bytes(data)
"""


@pytest.fixture(scope="session")
def renderer(generator: "SampleGenerator") -> "Renderer":
    return generator._renderer


def first_scene(generator: "SampleGenerator", index: int) -> Scene:
    return next(generator._sampler.candidates(index))


def cylinder_mask(camera: Camera, pose: ShaftPose, settings: RenderSettings) -> NDArray[np.bool_]:
    shaft = settings.shaft
    return np.isfinite(cylinder_depth(camera, pose, shaft.diameter_mm, shaft.length_mm))


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def extent(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    """x0, y0, x1, y1 from the coordinates of the pixels."""
    rows, columns = np.nonzero(mask)
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


def projected_rod(camera: Camera, pose: ShaftPose, settings: RenderSettings) -> NDArray[np.float32]:
    """Corners (N, 2), px, of a shaft's outline in the image: the hull of projected surface points,
    as a rod is convex. Independent of the rays of the amodal annotation."""
    radius, angles = settings.shaft.diameter_mm / 2, np.linspace(0, 2 * np.pi, 96, endpoint=False)
    around, along = np.meshgrid(angles, np.linspace(0, settings.shaft.length_mm, 601))
    rod = np.stack([radius * np.cos(around), radius * np.sin(around), along], axis=-1)
    points = rod.reshape(-1, 3) @ pose.rotation.T + pose.tip_mm
    # Points nearer than 1 mm are out of view: `scene.lens_radius_mm` is 3.
    hull = cv2.convexHull(camera.project(points[points[:, 2] > 1]).astype(np.float32))
    width, height = camera.width, camera.height
    image = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    return cv2.intersectConvexConvex(hull, image)[1].reshape(-1, 2)


def is_occluded(sample: Sample) -> bool:
    return bool(sample.scene_description["occluders"])


def assert_same(a: Sample, b: Sample) -> None:
    np.testing.assert_array_equal(a.rgb, b.rgb)
    assert encode_sample(a, JPEG_QUALITY) == encode_sample(b, JPEG_QUALITY)


def assert_foregrounds_equal(a: "Foreground", b: "Foreground") -> None:
    assert a.region == b.region
    np.testing.assert_array_equal(a.linear, b.linear)
    np.testing.assert_array_equal(a.index, b.index)


def test_mask_equals_the_exact_cylinder(
    renderer: "Renderer", camera: Camera, settings: RenderSettings
) -> None:
    draw = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    rng = np.random.default_rng(21)
    for pose in [draw(rng, 1).poses[0] for _ in range(15)]:
        mask = renderer.silhouettes([pose], camera) == 1
        assert iou(mask, cylinder_mask(camera, pose, settings)) >= 0.99, pose


def test_mask_of_a_shaft_that_runs_on_behind_the_camera(
    renderer: "Renderer", camera: Camera, settings: RenderSettings
) -> None:
    pose = ShaftPose(-12.0, 3.0, 38.0, 50.0, 170.0)
    assert (pose.tip_mm + settings.shaft.length_mm * pose.direction)[2] < -50
    mask = renderer.silhouettes([pose], camera) == 1
    assert iou(mask, cylinder_mask(camera, pose, settings)) >= 0.99


def test_the_nearer_shaft_hides_the_farther(
    renderer: "Renderer", camera: Camera, settings: RenderSettings
) -> None:
    near = cylinder_mask(camera, LEFT_TO_RIGHT, settings)
    far = cylinder_mask(camera, TOP_TO_BOTTOM_BEHIND, settings)
    assert (near & far).sum() > 50
    poses = [LEFT_TO_RIGHT, TOP_TO_BOTTOM_BEHIND]
    for order in (poses, poses[::-1]):
        index = renderer.silhouettes(order, camera)
        assert iou(index == order.index(LEFT_TO_RIGHT) + 1, near) >= 0.99
        assert iou(index == order.index(TOP_TO_BOTTOM_BEHIND) + 1, far & ~near) >= 0.99


def test_a_shaft_out_of_view_leaves_no_pixel(renderer: "Renderer", camera: Camera) -> None:
    assert not renderer.silhouettes([ShaftPose(200.0, 0.0, 20.0, 90.0, 0.0)], camera).any()
    assert not renderer.silhouettes([], camera).any()


def test_samples_cover_what_these_tests_need(samples: list[Sample]) -> None:
    assert {len(sample.instruments) for sample in samples} == {1, 2}
    assert {is_occluded(sample) for sample in samples} == {False, True}


def test_enough_of_every_shaft_is_visible(samples: list[Sample], settings: RenderSettings) -> None:
    for instrument in (i for sample in samples for i in sample.instruments):
        assert instrument.mask.sum() >= settings.scene.min_visible_px
        assert not (instrument.mask & ~instrument.amodal_mask).any()


def test_amodal_masks_have_the_extent_and_area_of_the_projected_rod(
    samples: list[Sample], camera: Camera, settings: RenderSettings
) -> None:
    for instrument in (i for sample in samples for i in sample.instruments):
        outline = projected_rod(camera, instrument.pose, settings)
        expected = [*outline.min(axis=0), *outline.max(axis=0)]
        np.testing.assert_allclose(extent(instrument.amodal_mask), expected, atol=1)
        area = cv2.contourArea(outline)
        assert instrument.amodal_mask.sum() == pytest.approx(area, rel=0.02)


def test_masks_of_unhidden_shafts_equal_the_exact_cylinder(
    samples: list[Sample], camera: Camera, settings: RenderSettings
) -> None:
    singles = [s for s in samples if len(s.instruments) == 1 and not is_occluded(s)]
    assert singles
    for (instrument,) in (sample.instruments for sample in singles):
        cylinder = cylinder_mask(camera, instrument.pose, settings)
        assert iou(instrument.mask, cylinder) >= 0.99
        assert instrument.visible_fraction > 0.99


def test_tissue_hides_a_part_of_the_shafts(
    samples: list[Sample], camera: Camera, settings: RenderSettings
) -> None:
    hidden = [i for sample in samples if is_occluded(sample) for i in sample.instruments]
    assert min(instrument.visible_fraction for instrument in hidden) < 0.9
    for instrument in hidden:
        cylinder = cylinder_mask(camera, instrument.pose, settings)
        # Except single edge pixels, the visible mask lies inside the whole silhouette.
        assert (instrument.mask & ~cylinder).sum() <= 0.01 * cylinder.sum()


def test_masks_of_one_image_are_disjoint(samples: list[Sample]) -> None:
    for masks in ([i.mask for i in s.instruments] for s in samples if len(s.instruments) == 2):
        assert not (masks[0] & masks[1]).any()


def test_background_stays_byte_equal_around_the_shafts(
    samples: list[Sample], backgrounds: Mapping[Path, str]
) -> None:
    files = {path.name: path for path in backgrounds}
    for sample in (sample for sample in samples if not is_occluded(sample)):
        background = read_written(files[sample.scene_description["background"]])
        mask = np.any([instrument.mask for instrument in sample.instruments], axis=0)
        # The pixel filter reaches 0.75 px to each side.
        touched = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        differs = np.any(sample.rgb != background, axis=-1)
        assert not differs[~touched].any()
        assert differs[mask].mean() > 0.9


def test_an_image_does_not_depend_on_those_before_it(
    generator: "SampleGenerator", samples: list[Sample]
) -> None:
    for index in (7, 3, 4):
        assert_same(generator.sample(index), samples[index])


@pytest.mark.parametrize("occluded", [False, True])
def test_an_image_is_the_same_alone_in_a_process(
    samples: list[Sample],
    occluded_settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    tmp_path: Path,
    occluded: bool,
) -> None:
    # The last of its kind, which has the most images before it.
    sample = [sample for sample in samples if is_occluded(sample) == occluded][-1]
    run_python(
        ONE_IMAGE_ALONE,
        tmp_path,
        occluded_settings,
        backgrounds=[(str(path), source) for path, source in backgrounds.items()],
        seed=SEED,
        index=sample.scene_description["index"],
        quality=JPEG_QUALITY,
    )
    assert (tmp_path / "image.rgb").read_bytes() == sample.rgb.tobytes()
    for suffix, data in encode_sample(sample, JPEG_QUALITY).items():
        assert (tmp_path / f"sample.{suffix}").read_bytes() == data, suffix


def test_rendering_twice_gives_the_same_bits(
    generator: "SampleGenerator", renderer: "Renderer"
) -> None:
    scene = first_scene(generator, 0)
    first, again = renderer.render(scene), renderer.render(scene)
    assert first is not None
    assert again is not None
    assert_foregrounds_equal(first, again)


@pytest.mark.parametrize("index", [0, 1, 2, 3])
def test_the_rendered_region_equals_a_full_frame(
    generator: "SampleGenerator",
    renderer: "Renderer",
    camera: Camera,
    monkeypatch: pytest.MonkeyPatch,
    index: int,
) -> None:
    scene = first_scene(generator, index)
    part = renderer.render(scene)
    assert part is not None
    full = render_full_frame(renderer, scene, camera, monkeypatch)
    assert full.linear.shape == (camera.height, camera.width, 4)
    assert part.linear.shape[:2] != full.linear.shape[:2]
    np.testing.assert_array_equal(part.linear, full.linear[part.region.slices])
    np.testing.assert_array_equal(part.index, full.index[part.region.slices])
    outside = full.linear.copy()
    outside[part.region.slices] = 0
    assert not outside.any()


def render_full_frame(
    renderer: "Renderer", scene: Scene, camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> "Foreground":
    everything = np.ones((camera.height, camera.width), dtype=bool)
    monkeypatch.setattr("shaftpose.rendering.blender.touched_pixels", lambda *_: everything)
    full = renderer.render(scene)
    assert full is not None
    return full


@pytest.mark.parametrize(
    ("far_mm", "pitch_deg"), [(40.0, 90.0), (150.0, 90.0), (40.0, 100.0), (40.0, 180.0)]
)
def test_the_room_holds_all_that_is_seen_of_a_shaft(
    settings: RenderSettings, camera: Camera, far_mm: float, pitch_deg: float
) -> None:
    from shaftpose.rendering.surroundings import room_half_mm

    poses = replace(settings.poses, z_mm=(10.0, far_mm), pitch_deg=(50.0, pitch_deg))
    half_mm = room_half_mm(replace(settings, poses=poses), camera)
    rng = np.random.default_rng(4)
    for pose in map(ShaftPose.from_array, rng.uniform(poses.low, poses.high, (200, 5))):
        along = np.linspace(0, settings.shaft.length_mm, 500)[:, None]
        points = pose.tip_mm + along * pose.direction
        points = points[points[:, 2] > 0]
        seen = points[camera.shows(camera.project(points))]
        reach = np.abs(seen).max(initial=0) + settings.shaft.diameter_mm / 2
        assert reach < half_mm


def test_the_room_of_the_repository_s_own_settings(
    settings: RenderSettings, camera: Camera
) -> None:
    from shaftpose.rendering.surroundings import room_half_mm

    assert room_half_mm(settings, camera) == 60.0


def test_metal_mirrors_the_background_in_its_place_and_without_detail(
    renderer: "Renderer",
) -> None:
    import bpy

    from shaftpose.rendering.materials import mirrored_image

    rgb = np.zeros((299, 299, 3), dtype=np.uint8)
    rgb[:140, :140, 0] = 255  # top left
    rgb[160:, :, 2] = np.where(np.arange(299) % 2, 255, 0)  # fine stripes at the bottom
    image = mirrored_image(rgb)
    width, height = image.size
    pixels = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    from_top = pixels.reshape(height, width, 4)[::-1]
    np.testing.assert_allclose(from_top[0, 0], [1, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(from_top[0, -1], [0, 0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(from_top[-1, :, 2], 0.5, atol=0.05)


def test_scratches_make_steel_rougher(generator: "SampleGenerator") -> None:
    from shaftpose.rendering.materials import roughness_with_scratches

    steel = replace(first_scene(generator, 0).steels[0], roughness=0.3, scratches=0.0)
    assert roughness_with_scratches(steel) == pytest.approx(0.3)
    rougher = [roughness_with_scratches(replace(steel, scratches=s)) for s in (0.1, 0.3, 1.0)]
    assert 0.3 < rougher[0] < rougher[1] < rougher[2] < 1.0


def test_the_slope_of_the_normal_map_is_the_one_stated() -> None:
    from shaftpose.rendering.materials import _SLOPE, scratch_normals

    normals = 2 * scratch_normals(np.random.default_rng(0), 512) - 1
    slopes = normals[..., :2] / normals[..., 2:]
    assert np.sqrt(np.mean(slopes**2)) == pytest.approx(_SLOPE, rel=0.05)


def test_anisotropy_changes_the_steel_and_nothing_else(
    generator: "SampleGenerator", renderer: "Renderer"
) -> None:
    scenes = (first_scene(generator, index) for index in range(50))
    scene = next(scene for scene in scenes if not scene.occluders)

    def seen(anisotropy: float) -> "Foreground":
        steels = tuple(replace(steel, anisotropy=anisotropy) for steel in scene.steels)
        foreground = renderer.render(replace(scene, steels=steels))
        assert foreground is not None
        return foreground

    plain, turned, again = seen(0.0), seen(0.9), seen(0.0)
    assert_foregrounds_equal(plain, again)
    np.testing.assert_array_equal(plain.index, turned.index)
    steel = plain.index > 0
    difference = np.abs(plain.linear - turned.linear)[steel][:, :3].mean()
    assert difference > 0.05 * plain.linear[steel][:, :3].mean()


def test_lamps_of_both_light_shapes_are_as_far_from_the_lens(
    with_scene: Callable[..., RenderSettings],
) -> None:
    from shaftpose.rendering.surroundings import lamp_places

    twin, ring = (np.array(lamp_places(with_scene(light_shape=s).scene)) for s in ("twin", "ring"))
    np.testing.assert_array_equal(twin, [[-2, 0], [2, 0]])
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 2)
    np.testing.assert_allclose(ring.mean(axis=0), 0, atol=1e-12)
    neighbours = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    assert len(ring) > 4
    assert np.ptp(neighbours) < 1e-12


@pytest.mark.parametrize(
    ("kelvin", "rgb"),
    [
        (3000.0, (1.0, 0.45, 0.15)),
        (4750.0, (1.0, 0.725, 0.575)),  # halfway between its two neighbours
        (6500.0, (1.0, 1.0, 1.0)),
        (10000.0, (0.62, 0.75, 1.0)),
    ],
)
def test_colour_temperatures_by_hand(kelvin: float, rgb: tuple[float, ...]) -> None:
    from shaftpose.rendering.surroundings import kelvin_to_rgb

    assert kelvin_to_rgb(kelvin) == pytest.approx(rgb)


def test_every_lump_has_its_own_tint(generator: "SampleGenerator", renderer: "Renderer") -> None:
    scenes = (first_scene(generator, index) for index in range(50))
    scene = next(scene for scene in scenes if len(scene.occluders) == 2)

    def seen(*tints: float) -> NDArray[np.float32]:
        pairs = zip(scene.occluders, tints, strict=True)
        occluders = tuple(replace(occluder, tint=tint) for occluder, tint in pairs)
        foreground = renderer.render(replace(scene, occluders=occluders))
        assert foreground is not None
        return foreground.linear

    both = seen(1.0, 1.0)
    for first, second in ((0.5, 1.0), (1.0, 0.5)):
        assert seen(first, second)[..., :3].sum() < 0.99 * both[..., :3].sum()


def test_passes_in_memory_equal_the_files_that_blender_writes(
    generator: "SampleGenerator",
    renderer: "Renderer",
    camera: Camera,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    scenes = (first_scene(generator, index) for index in range(50))
    scene = next(s for s in scenes if len(s.shafts) == 2 and not s.occluders)
    # In one piece, like the file.
    foreground = render_full_frame(renderer, scene, camera, monkeypatch)
    height, width = foreground.index.shape
    written = render_to_exr(tmp_path, height, width)
    assert foreground.linear[..., 3].max() == 1.0
    assert {*foreground.index.ravel()} == {0, 1, 2}
    # 32-bit EXR: bit-identical.
    np.testing.assert_array_equal(foreground.linear, written["Combined"])
    for channel in range(3):  # a single-channel file is loaded as grey
        np.testing.assert_array_equal(foreground.index, written["IndexOB"][..., channel])


def render_to_exr(folder: Path, height: int, width: int) -> dict[str, NDArray[np.float32]]:
    """Render the current scene to a 32-bit EXR file for each pass: (h, w, 4), top row first.

    A compositor node of Blender writes the passes unchanged.
    """
    import bpy

    scene: Any = bpy.context.scene
    scene.use_nodes = scene.render.use_compositing = True
    nodes, links = scene.node_tree.nodes, scene.node_tree.links
    nodes.clear()
    layers, files = nodes.new("CompositorNodeRLayers"), nodes.new("CompositorNodeOutputFile")
    files.base_path, files.format.file_format = str(folder), "OPEN_EXR"
    files.format.color_depth = "32"
    files.file_slots.clear()
    for name, output in PASSES.items():
        files.file_slots.new(name)
        links.new(layers.outputs[output], files.inputs[name])
    bpy.ops.render.render()
    scene.use_nodes = scene.render.use_compositing = False
    return {name: read_exr(folder / f"{name}0001.exr", height, width) for name in PASSES}


def read_exr(path: Path, height: int, width: int) -> NDArray[np.float32]:
    import bpy

    image = bpy.data.images.load(str(path))
    pixels = np.empty(height * width * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1]
