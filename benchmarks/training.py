"""Training speed: `make bench-train`, after `dvc repro split`.

For the networks of the profiles `paper` and `bench`: images per second of (a) the network's step
alone, i.e. forward, loss, backward and optimiser on one repeated batch, and (b) whole training
steps of the pipeline's trainer, which reads, decodes and augments the images. The two alternate, so
that other load on the machine affects both. Prints the speeds and writes
`reports/benchmarks/train.json`; on a GPU, also tries larger batches than the paper's 32, and
writes `train-gpu.json`.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from lightning.fabric.utilities import move_data_to_device

from benchmarks.aims import Aim
from benchmarks.machine import RESULTS, machine
from pipelines.train import FOLDERS
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_json
from shaftpose.dataset.batches import Batch
from shaftpose.dataset.split import read_keys
from shaftpose.dataset.training_stream import SkippedImages
from shaftpose.network.pose_network import normalise_images
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.schema import RunSize
from shaftpose.training.assembly import build_module, build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.data import training_data
from shaftpose.training.module import ShaftModule
from shaftpose.training.recipe import Recipe, training_recipe

ROOT = Path(__file__).parents[1]
OUT = {"cpu": RESULTS / "train.json", "cuda": RESULTS / "train-gpu.json"}
VARIANT = "d"
PROFILES = ("paper", "bench")
# On a GPU, batches grow until its memory is full.
BATCHES = {"cpu": (8,), "cuda": (32, 64, 128, 256, 512)}
STEPS = {"cpu": 10, "cuda": 300}
ROUNDS, WARM_UP = 5, 3
LOOP_AIM = {
    device: Aim("training loop as fast as its step alone", least=share)
    for device, share in (("cpu", 0.9), ("cuda", 0.85))
}
MATCHING_AIM = Aim("matching and mining, share of a step", below=0.05)


class Clock(Callback):
    """Seconds from the end of step `first` to the end of step `last`."""

    def __init__(self, first: int, last: int) -> None:
        self._times: dict[int, float] = {}
        self._first, self._last = first, last

    @property
    def seconds(self) -> float:
        """The time between the two steps."""
        return self._times[self._last] - self._times[self._first]

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Read the clock."""
        if trainer.global_step in (self._first, self._last):
            self._times[trainer.global_step] = now()


def main() -> None:
    """Time both profiles at each batch size of the device."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    device = "cuda" if torch.cuda.is_available() else "cpu"
    parser.add_argument("--steps", type=int, default=STEPS[device], help="steps per timed block")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="blocks of each kind")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    with exit_on_input_error():
        profiles = {
            name: timed_profile(name, device, arguments.steps, arguments.rounds)
            for name in PROFILES
        }
    about = {**machine(), "threads": torch.get_num_threads()}
    if device == "cuda":
        about["device"] = torch.cuda.get_device_name()
    counts = {"steps": arguments.steps, "rounds": arguments.rounds}
    result = {"machine": about, "torch": torch.__version__, "variant": VARIANT, **counts}
    result |= {"aims": verdicts(profiles, LOOP_AIM[device]), "profiles": profiles}
    write_json(OUT[device], result)
    print(f"written to {OUT[device]}")


def timed_profile(profile: str, device: str, steps: int, rounds: int) -> dict[str, Any]:
    """The profile's width, depth, precision and speeds, at the first and at each batch size.

    The best batch size has the highest `loop_images_per_s`.
    """
    recipe = recipe_of(profile)
    own, speeds = recipe.size, []
    if own.precision not in ("32-true", "bf16-mixed"):
        raise InputError(f"profile {profile}: the step alone is not timed in {own.precision}")
    images = len(read_keys(FOLDERS.split, "train"))
    for batch_size in BATCHES[device]:
        if batch_size > images:
            break
        sizes = replace(own, batch_size=batch_size, steps=WARM_UP + steps, warmup_steps=0)
        try:
            speeds.append(timed(replace(recipe, size=sizes), torch.device(device), rounds))
        except torch.OutOfMemoryError:
            torch.cuda.empty_cache()
            break
        shown = "  ".join(f"{key} {value:g}" for key, value in speeds[-1].items())
        print(f"{profile}: width {own.width:g}, depth {own.depth:g}  {shown}", flush=True)
    if not speeds:
        raise InputError(
            f"profile {profile}: no batch of {BATCHES[device][0]} images: the {device} has too "
            f"little memory, or data/split lists too few images ({images})"
        )
    best = max(speeds, key=lambda speed: speed["loop_images_per_s"])
    network = {"width": own.width, "depth": own.depth, "optimizer": own.optimizer}
    result = {**network, "precision": own.precision, **speeds[0]}
    return result | {"best_batch_size": best["batch_size"], "batches": speeds}


def verdicts(profiles: Mapping[str, Mapping[str, Any]], loop: Aim) -> list[dict[str, Any]]:
    """Target, measurement and verdict of each profile."""
    wanted = [
        (profile, aim, speeds[key])
        for profile, speeds in profiles.items()
        for aim, key in ((loop, "loop_over_step"), (MATCHING_AIM, "matching_and_mining_share"))
        # In smaller networks, work other than convolutions takes a larger share.
        if aim is loop or profile == "paper"
    ]
    return [
        {"profile": profile, "what": aim.title, "wanted": str(aim), "measured": value,
         "verdict": aim.verdict(value)}
        for profile, aim, value in wanted
    ]  # fmt: skip


def recipe_of(profile: str) -> Recipe:
    """The training of a profile, from random weights, which do not affect speed."""
    # Without the frozen normalisation of a training's last steps.
    whole = "training.frozen_norm_share=0"
    settings = composed_settings(
        ROOT, f"variant={VARIANT}", "variant.start=null", f"profile={profile}", whole
    )
    return training_recipe(settings).resolved()


def timed(recipe: Recipe, device: torch.device, rounds: int) -> dict[str, float]:
    """Speeds of one network at one batch size: medians over alternating blocks.

    `loop_over_step` is the median of each round's ratio, because other load on the machine varies
    between rounds, but little within one.
    """
    sizes = recipe.size
    module, steps = build_module(recipe), sizes.steps - WARM_UP
    batch = first_batch(recipe, device)
    loop, alone, assigning = [], [], []
    for _ in range(rounds):
        loop.append(loop_seconds(recipe, module) / steps)
        module.to(device).train()
        alone.append(block_seconds(network_step(module, batch, sizes), steps) / steps)
        assigning.append(block_seconds(assignment(module, batch), steps) / steps)
    loop_s, step_s = statistics.median(loop), statistics.median(alone)
    ratios = [step / whole for step, whole in zip(alone, loop, strict=True)]
    return {
        "batch_size": sizes.batch_size,
        "step_images_per_s": round(sizes.batch_size / step_s, 2),
        "loop_images_per_s": round(sizes.batch_size / loop_s, 2),
        "loop_over_step": round(statistics.median(ratios), 3),
        "matching_and_mining_share": round(statistics.median(assigning) / step_s, 4),
    }


def loop_seconds(recipe: Recipe, module: ShaftModule) -> float:
    """Seconds of the training steps after the warm-up, without validation."""
    sizes = recipe.size
    with tempfile.TemporaryDirectory() as folder:
        trainer = build_trainer(recipe, Path(folder), Curves())
        trainer.limit_val_batches = 0
        clock = Clock(WARM_UP, sizes.steps)
        trainer.callbacks.append(clock)  # type: ignore[attr-defined]
        skipped = SkippedImages(Path(folder) / "skipped_images.txt")
        # Twice the steps: reading continues to the end, as in a training.
        more = replace(recipe, size=replace(sizes, steps=2 * sizes.steps))
        trainer.fit(module, training_data(more, FOLDERS, skipped))
    return clock.seconds


def first_batch(recipe: Recipe, device: torch.device) -> Batch:
    """The first batch of a training."""
    skipped = SkippedImages(Path(os.devnull))
    batches = training_data(recipe, FOLDERS, skipped).train_dataloader()
    batch: Batch = move_data_to_device(next(iter(batches)), device)
    return batch


def network_step(module: ShaftModule, batch: Batch, sizes: RunSize) -> Callable[[], None]:
    """Forward, loss, backward and the loop's optimiser on one batch."""
    network = module.network
    configured: Any = module.configure_optimizers()
    optimizer = configured["optimizer"]
    mixed = torch.autocast(
        batch.images.device.type, torch.bfloat16, enabled=sizes.precision == "bf16-mixed"
    )

    def step() -> None:
        optimizer.zero_grad()
        with mixed:
            outputs = network(normalise_images(batch.images))
            terms = network.loss_terms(outputs, batch.targets)
        terms["loss"].backward()
        optimizer.step()

    return step


def assignment(module: ShaftModule, batch: Batch) -> Callable[[], object]:
    """Matching and mining alone, on the outputs for one batch."""
    network = module.network
    assert isinstance(network, SingleShotNetwork)
    with torch.no_grad():
        outputs = network(normalise_images(batch.images))
    return lambda: network.loss.assign(outputs, batch.targets, network.defaults)


def block_seconds(step: Callable[[], object], steps: int) -> float:
    """Seconds for a number of steps, after the warm-up."""
    for _ in range(WARM_UP):
        step()
    start = now()
    for _ in range(steps):
        step()
    return now() - start


def now() -> float:
    """Clock time in seconds, after the GPU has finished its queue."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


if __name__ == "__main__":
    main()
