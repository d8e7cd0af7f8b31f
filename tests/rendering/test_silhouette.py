import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.poses import PoseSampler
from shaftpose.settings.schema import RenderSettings
from tests.rendering.blender_process import run_python

NEAR = ShaftPose(-12.0, 0.0, 20.0, 90.0, 0.0)
FAR = ShaftPose(0.0, -14.0, 30.0, 90.0, 90.0)
OUT_OF_VIEW = ShaftPose(200.0, 0.0, 20.0, 90.0, 0.0)

RENDER_SILHOUETTES = """
import numpy as np
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.silhouette import SilhouetteRenderer
print("before")
render = SilhouetteRenderer(settings)
masks = {}
for name, poses in groups.items():
    found = render(np.array(poses, dtype=float).reshape(-1, 5), middle_camera(settings))
    masks[name] = np.array(found, dtype=bool).reshape(len(poses), *found[0].shape) if found else []
np.savez("masks.npz", **masks)
print("after")
"""


@pytest.fixture(scope="module")
def groups(camera: Camera, settings: RenderSettings) -> dict[str, list[ShaftPose]]:
    draw = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    rng = np.random.default_rng(31)
    singles = {f"single {n}": [draw(rng, 1).poses[0]] for n in range(6)}
    pairs = {"near first": [NEAR, FAR], "far first": [FAR, NEAR]}
    return singles | pairs | {"none": [], "out of view": [OUT_OF_VIEW, NEAR]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("silhouettes")


@pytest.fixture(scope="module")
def masks(
    groups: dict[str, list[ShaftPose]], settings: RenderSettings, folder: Path
) -> dict[str, NDArray[np.bool_]]:
    """Group -> (N, H, W), all rendered by one SilhouetteRenderer."""
    arrays = {name: [pose.as_array().tolist() for pose in group] for name, group in groups.items()}
    run_python(RENDER_SILHOUETTES, folder, settings, groups=json.loads(json.dumps(arrays)))
    with np.load(folder / "masks.npz") as file:
        return dict(file)


def cylinder_mask(camera: Camera, pose: ShaftPose, settings: RenderSettings) -> NDArray[np.bool_]:
    shaft = settings.shaft
    return np.isfinite(cylinder_depth(camera, pose, shaft.diameter_mm, shaft.length_mm))


def iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_a_mask_equals_the_exact_cylinder(
    masks: dict[str, NDArray[np.bool_]],
    groups: dict[str, list[ShaftPose]],
    camera: Camera,
    settings: RenderSettings,
) -> None:
    for name, (pose, *others) in ((name, group) for name, group in groups.items() if group):
        if not others:
            assert iou(masks[name][0], cylinder_mask(camera, pose, settings)) >= 0.99, pose


def test_no_poses_have_no_masks(masks: dict[str, NDArray[np.bool_]]) -> None:
    assert len(masks["none"]) == 0


def test_masks_follow_the_poses_and_nearer_hides_farther(
    masks: dict[str, NDArray[np.bool_]], camera: Camera, settings: RenderSettings
) -> None:
    near, far = (cylinder_mask(camera, pose, settings) for pose in (NEAR, FAR))
    for name, of_near, of_far in (("near first", 0, 1), ("far first", 1, 0)):
        assert iou(masks[name][of_near], near) >= 0.99
        assert iou(masks[name][of_far], far & ~near) >= 0.99


def test_a_pose_out_of_view_has_an_empty_mask(
    masks: dict[str, NDArray[np.bool_]], camera: Camera, settings: RenderSettings
) -> None:
    hidden, seen = masks["out of view"]
    assert not hidden.any()
    assert iou(seen, cylinder_mask(camera, NEAR, settings)) >= 0.99


def test_standard_output_is_left_to_the_user(settings: RenderSettings, tmp_path: Path) -> None:
    script = """
import contextlib, os, sys
from shaftpose.rendering.silhouette import blender_output_hidden
print("before")
with blender_output_hidden():
    os.write(1, b"chatter of Blender")
with contextlib.suppress(ValueError), blender_output_hidden():
    raise ValueError
print("after", flush=True)
os.write(1, b"still open")
"""
    from tests.rendering.blender_process import start_python

    output, _ = start_python(script, tmp_path, settings).communicate(timeout=60)
    assert output.split() == ["before", "after", "still", "open"]
