"""Checks of whole sets: shards and keys, duplicates, error messages, worker processes."""

import logging
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from shaftpose.checks.expected_sets import ExpectedSet
from shaftpose.checks.set_checks import (
    MOST_NAMED,
    Problem,
    check_sets,
    find_problems,
    refuse,
)
from shaftpose.core.errors import InputError
from shaftpose.core.shard_writer import ShardWriter
from tests.checks.rendered_sets import (
    ABOVE,
    BELOW,
    LEFT,
    RIGHT,
    checked,
    edit_json,
    first,
    rewrite,
    sample,
    write_set,
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> ExpectedSet:
    """Three images in two shards."""
    folder = tmp_path_factory.mktemp("sound")
    return write_set(folder, [[sample(0, [LEFT]), sample(1, [RIGHT])], [sample(2, [ABOVE])]])


@pytest.fixture
def spoilt(sound: ExpectedSet, tmp_path: Path) -> ExpectedSet:
    """A copy of `sound` that a test may damage."""
    shutil.copytree(sound.folder, tmp_path / "set")
    return replace(sound, folder=tmp_path / "set")


def complaints(expected: ExpectedSet) -> list[str]:
    return [str(problem) for problem in find_problems([expected], checked(expected))]


def test_a_sound_set_has_no_problem(sound: ExpectedSet) -> None:
    assert complaints(sound) == []


def test_a_missing_shard(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000001.tar"
    path.unlink()
    assert complaints(spoilt) == [f"{path}: 000000002 to 000000002: missing"]


def test_a_truncated_shard(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000000.tar"
    path.write_bytes(path.read_bytes()[:-15_000])
    assert complaints(spoilt) == [f"{path}: 000000000 to 000000001: truncated or damaged"]


def test_a_gap_in_the_keys(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000000.tar"
    rewrite(
        path, lambda members: [members.pop(n) for n in list(members) if n.startswith("000000001")]
    )
    assert complaints(spoilt) == [f"{path}: 000000001: missing"]


def test_an_image_in_the_wrong_shard(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000001.tar"
    with ShardWriter(path, 95) as writer:
        writer.write(sample(2, [ABOVE]))
        writer.write(sample(3, [BELOW]))
    assert complaints(spoilt) == [
        f"{path}: 000000003: not one of this shard's images, 000000002 to 000000002"
    ]


def test_a_shard_too_many(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000002.tar"
    with ShardWriter(path, 95) as writer:
        writer.write(sample(3, [BELOW]))
    assert complaints(spoilt) == [f"{path}: all: not a shard of this set"]


def test_a_shard_of_another_seed(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000001.tar"
    with ShardWriter(path, 95) as writer:
        writer.write(sample(2, [ABOVE], seed=8))
    assert complaints(spoilt) == [f"{path}: 000000002: seed = 8: expected 7"]


def test_an_image_under_the_key_of_another(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000001.tar"
    with ShardWriter(path, 95) as writer:
        writer.write(replace(sample(3, [BELOW]), key="000000002"))
    assert complaints(spoilt) == [f"{path}: 000000002: index = 3: expected 2"]


def test_an_image_that_does_not_say_its_seed(spoilt: ExpectedSet) -> None:
    path = spoilt.folder / "shard-000001.tar"
    rewrite(path, edit_json("000000002.shaft.json", lambda content: content.pop("seed")))
    (found,) = complaints(spoilt)
    assert found.startswith(f"{path}: 000000002: shaft.json: seed = ")


def test_the_same_image_twice(tmp_path: Path) -> None:
    pictures = [[sample(0, [LEFT], look=5)], [sample(1, [RIGHT], look=5)]]
    assert complaints(write_set(tmp_path, pictures)) == [
        f"{tmp_path}/shard-000001.tar: 000000001: the same image file as "
        f"{tmp_path}/shard-000000.tar: 000000000"
    ]


def test_the_same_pose_twice(tmp_path: Path) -> None:
    pictures = [[sample(0, [LEFT, RIGHT]), sample(1, [RIGHT])]]
    assert complaints(write_set(tmp_path, pictures)) == [
        f"{tmp_path}/shard-000000.tar: 000000001: the same pose as "
        f"{tmp_path}/shard-000000.tar: 000000000"
    ]


def test_empty_images_of_one_background_may_be_the_same(tmp_path: Path) -> None:
    expected = write_set(tmp_path, [[sample(0, [], look=5), sample(2, [], look=5)]])
    scene = replace(expected.settings.scene, instruments=(0, 1))
    expected = replace(
        expected,
        settings=replace(expected.settings, scene=scene),
        shards={"shard-000000.tar": range(0, 4, 2)},
    )
    assert complaints(expected) == []


def test_an_image_that_two_sets_share(sound: ExpectedSet, tmp_path: Path) -> None:
    other = write_set(tmp_path, [[sample(2, [ABOVE])]])
    other = replace(other, shards={"shard-000000.tar": range(2, 3)})
    found = find_problems([sound, other], checked(sound) + checked(other))
    assert [str(problem) for problem in found] == [
        f"{tmp_path}/shard-000000.tar: 000000002: the same {what} as "
        f"{sound.folder}/shard-000001.tar: 000000002"
        for what in ("image file", "pose")
    ]


def test_twenty_problems_are_named_and_all_counted(caplog: pytest.LogCaptureFixture) -> None:
    problems = [Problem(Path("shard.tar"), f"{n:09d}", f"value {n}") for n in range(23)]
    with caplog.at_level(logging.ERROR), pytest.raises(InputError) as caught:
        refuse(problems)
    assert str(caught.value).startswith("shard.tar: 000000000: value 0 (problem 1 of 23); ")
    assert "\n" not in str(caught.value)
    assert caplog.messages == [*map(str, problems[:MOST_NAMED]), "and 3 more"]
    assert caplog.messages[19] == "shard.tar: 000000019: value 19"


def test_sets_are_checked_in_processes(
    sound: ExpectedSet, spoilt: ExpectedSet, caplog: pytest.LogCaptureFixture
) -> None:
    """Sound sets give their checked images in order; one damaged set raises."""
    checked = check_sets({"images": sound}, workers=2)
    assert [image.key for image in checked["images"]] == ["000000000", "000000001", "000000002"]
    assert [image.source for image in checked["images"]] == ["tissue-0", "tissue-1", "tissue-0"]
    path = spoilt.folder / "shard-000001.tar"
    rewrite(path, edit_json("000000002.gt_info.json", lambda c: first(c, px_count_visib=7)))
    with pytest.raises(InputError) as caught:
        check_sets({"images": spoilt}, workers=1)
    assert str(caught.value).startswith(f"{path}: 000000002: shaft 0: px_count_visib = 7: ")
    assert len(caplog.messages) == 1
