"""`make bench-train` times the work of a real training."""

from pathlib import Path

import numpy as np
import pytest
import torch
from lightning import Trainer

from benchmarks import training
from benchmarks.training import assignment, block_seconds, network_step, recipe_of
from shaftpose.core.instruments import Annotations
from shaftpose.dataset.batches import pad_batch
from shaftpose.training.assembly import build_module
from tests.pipeline.small_data import write_training_data

ROOT = Path(__file__).parents[2]


def test_the_papers_network_is_timed_and_a_smaller_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    paper, bench = (recipe_of(profile).size for profile in training.PROFILES)
    assert (paper.width, paper.depth) == (1.0, 1.0)
    assert 0 < bench.width < 1 and 0 < bench.depth < 1


def test_what_is_wanted_is_held_against_what_was_measured() -> None:
    speeds = {"paper": {"loop_over_step": 0.85, "matching_and_mining_share": 0.02}}
    loop, matching = training.verdicts(speeds, training.LOOP_AIM["cpu"])
    assert (loop["wanted"], loop["measured"], loop["verdict"]) == (">= 0.9", 0.85, "missed")
    assert (matching["wanted"], matching["verdict"]) == ("< 0.05", "met")
    (small,) = training.verdicts({"bench": speeds["paper"]}, training.LOOP_AIM["cuda"])
    assert (small["profile"], small["verdict"]) == ("bench", "met")


def test_both_speeds_of_each_batch_are_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_training_data(tmp_path)  # 8 images to train on
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "BATCHES", {"cpu": (2, 4, 16)})
    speeds = training.timed_profile("smoke", "cpu", steps=2, rounds=1)
    assert (speeds["width"], speeds["depth"], speeds["batch_size"]) == (0.1875, 0.25, 2)
    assert [tried["batch_size"] for tried in speeds["batches"]] == [2, 4]
    for tried in speeds["batches"]:
        ratio = tried["loop_images_per_s"] / tried["step_images_per_s"]
        assert tried["loop_over_step"] == pytest.approx(ratio, rel=0.02)
        assert 0 < tried["matching_and_mining_share"] < 1


def test_the_step_alone_trains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    recipe = recipe_of("smoke")
    module = build_module(recipe).train()
    module.trainer = Trainer(accelerator="cpu", logger=False, enable_checkpointing=False)
    rgb = np.random.default_rng(0).integers(0, 256, (299, 299, 3), dtype=np.uint8)
    known = Annotations(np.array([[50.0, 50, 200, 200]]), np.array([[0.0, 0, 20, 70, 100]]))
    batch = pad_batch([(rgb, known)] * 2)
    stem = next(module.network.parameters())  # the gradient reaches it last
    before = stem.detach().clone()
    assert block_seconds(network_step(module, batch, recipe.size), 1) > 0
    assert not torch.equal(stem, before)
    assigned = assignment(module, batch)()
    assert assigned.positive.any()
    assert (assigned.negative.sum(1) == 3 * assigned.positive.sum(1)).all()
