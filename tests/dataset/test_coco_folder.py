"""Folders of images without poses: rendered sets as a stand-in."""

from dataclasses import replace
from pathlib import Path

from shaftpose.core.samples import sample_key
from shaftpose.core.shard_writer import shard_name
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_folder import write_stand_in
from tests.core.small_shards import make_sample, write_shard


def test_a_stand_in_has_masks_in_its_test_images_alone(tmp_path: Path) -> None:
    rendered, out = tmp_path / "rendered", tmp_path / "out"
    for name in ("train", "clear", "occluded"):
        sample = make_sample(0)
        scene = {**sample.scene_description, "occluders": name == "occluded"}
        write_shard(rendered / name / shard_name(0), [replace(sample, scene_description=scene)])
    write_stand_in(rendered, out)
    (train,), test = read_coco(out / "train.json"), read_coco(out / "test.json")
    names = [image.path.name for image in (train, *test)]
    assert names == [f"{name}-{sample_key(0)}.jpg" for name in ("train", "clear", "occluded")]
    assert all(image.path.is_file() for image in (train, *test))
    assert [instrument.mask for instrument in train.instruments] == [None, None]
    for image, occluded in zip(test, (False, True), strict=True):
        assert all(instrument.mask is not None for instrument in image.instruments)
        assert {instrument.occluded for instrument in image.instruments} == {occluded}
