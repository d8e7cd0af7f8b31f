"""How fast networks train: `make bench-train`, after `dvc repro split real_images`.

For the networks of the profiles `paper` and `bench`: images per second of (a) the network's step
alone, forward, loss, backward and optimiser on one batch again and again, and (b) whole training
steps by the pipeline's trainer, which reads, decodes and augments the images. The two are timed in
turns, so that whatever else the machine does hits both. Prints them and writes
`benchmarks/results/train.json`; on a GPU, at the paper's batch of 32 and at the fastest batch, and
into `train-gpu.json` in the same folder.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from hydra import compose, initialize_config_dir
from lightning import Callback, LightningModule, Trainer
from omegaconf import OmegaConf

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "pipelines")]

from networks import variant  # noqa: E402
from settings import size  # noqa: E402
from stage import Config  # noqa: E402
from train import build_module, build_trainer, training_data, with_precision  # noqa: E402

from benchmarks.aims import Aim  # noqa: E402
from benchmarks.machine import machine  # noqa: E402
from shaftpose.batches import Batch, Targets  # noqa: E402
from shaftpose.config import Size  # noqa: E402
from shaftpose.dataset.skipped import SkippedImages  # noqa: E402
from shaftpose.dataset.split import read_keys  # noqa: E402
from shaftpose.errors import InputError  # noqa: E402
from shaftpose.network.curves import Curves  # noqa: E402
from shaftpose.network.module import ShaftModule  # noqa: E402
from shaftpose.network.shaft_network import normalise_images  # noqa: E402

RESULTS = ROOT / "benchmarks/results"
OUT = {"cpu": RESULTS / "train.json", "cuda": RESULTS / "train-gpu.json"}
VARIANT = "d"
PROFILES = ("paper", "bench")
# A GPU is tried with batches that grow until its memory is full.
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
        """The time between the two."""
        return self._times[self._last] - self._times[self._first]

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Read the clock."""
        if trainer.global_step in (self._first, self._last):
            self._times[trainer.global_step] = now()


def main() -> None:
    """Time both profiles at each batch size that the device is tried with."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    device = "cuda" if torch.cuda.is_available() else "cpu"
    parser.add_argument("--steps", type=int, default=STEPS[device], help="of each timed block")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="blocks of each kind")
    arguments = parser.parse_args()
    os.chdir(ROOT)
    try:
        profiles = {
            name: timed_profile(name, device, arguments.steps, arguments.rounds)
            for name in PROFILES
        }
    except InputError as error:
        sys.exit(f"error: {error}")
    about = {**machine(), "threads": torch.get_num_threads()}
    if device == "cuda":
        about["device"] = torch.cuda.get_device_name()
    counts = {"steps": arguments.steps, "rounds": arguments.rounds}
    result = {"machine": about, "torch": torch.__version__, "variant": VARIANT, **counts}
    RESULTS.mkdir(parents=True, exist_ok=True)
    result |= {"aims": verdicts(profiles, LOOP_AIM[device]), "profiles": profiles}
    OUT[device].write_text(json.dumps(result, indent=1) + "\n")
    print(f"written to {OUT[device].relative_to(ROOT)}")


def timed_profile(profile: str, device: str, steps: int, rounds: int) -> dict[str, Any]:
    """The profile's width, depth, precision and speeds: those at the first batch size, and each
    that was tried.

    The fastest batch size is the one with the most `loop_images_per_s`.
    """
    config = composed(profile)
    own, speeds = size(config), []
    if own.precision not in ("32-true", "bf16-mixed"):
        raise InputError(f"profile {profile}: the step alone is not timed in {own.precision}")
    images = len(read_keys(Path("data/split"), "train"))
    for batch_size in BATCHES[device]:
        if batch_size > images:
            break
        sizes = replace(own, batch_size=batch_size, steps=WARM_UP + steps, warmup_steps=0)
        try:
            speeds.append(timed(config, sizes, torch.device(device), rounds))
        except torch.OutOfMemoryError:
            torch.cuda.empty_cache()
            break
        shown = "  ".join(f"{key} {value:g}" for key, value in speeds[-1].items())
        print(f"{profile}: width {own.width:g}, depth {own.depth:g}  {shown}", flush=True)
    if not speeds:
        raise InputError(
            f"profile {profile}: no batch of {BATCHES[device][0]} images: the {device} has too "
            f"little memory for one, or data/split lists too few ({images})"
        )
    best = max(speeds, key=lambda speed: speed["loop_images_per_s"])
    network = {"width": own.width, "depth": own.depth, "optimizer": own.optimizer}
    result = {**network, "precision": own.precision, **speeds[0]}
    return result | {"best_batch_size": best["batch_size"], "batches": speeds}


def verdicts(profiles: Mapping[str, Mapping[str, Any]], loop: Aim) -> list[dict[str, Any]]:
    """What is wanted of each profile, what was measured, and whether that is enough."""
    wanted = [
        (profile, aim, speeds[key])
        for profile, speeds in profiles.items()
        for aim, key in ((loop, "loop_over_step"), (MATCHING_AIM, "matching_and_mining_share"))
        # In smaller networks, all work other than convolutions weighs more.
        if aim is loop or profile == "paper"
    ]
    return [
        {"profile": profile, "what": aim.title, "wanted": str(aim), "measured": value,
         "verdict": aim.verdict(value)}
        for profile, aim, value in wanted
    ]  # fmt: skip


def composed(profile: str) -> Config:
    """The pipeline's configuration at a profile's sizes."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        # What Hydra fills in for a script that it starts.
        overrides = ["out=.", f"variant_file={VARIANT}", f"variant={VARIANT}"]
        overrides.append("variant.start=null")  # speed does not depend on the weights
        # Of the few steps that are timed none is among the last ones of a training.
        whole = "training.frozen_norm_share=0"
        content = compose("config", [*overrides, f"profile={profile}", whole])
    config = OmegaConf.to_container(content, resolve=True)
    assert isinstance(config, dict)
    return with_precision({str(key): value for key, value in config.items()})


def timed(config: Config, sizes: Size, device: torch.device, rounds: int) -> dict[str, float]:
    """Speeds of one network at one batch size: medians over blocks of each kind, in turns.

    `loop_over_step` is the median of the rounds' own ratios: what else the machine does comes and
    goes between rounds, but is much the same within one.
    """
    module, steps = build_module(config, sizes), sizes.steps - WARM_UP
    batch = first_batch(config, sizes, device)
    loop, alone, assigning = [], [], []
    for _ in range(rounds):
        loop.append(loop_seconds(config, sizes, module) / steps)
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


def loop_seconds(config: Config, sizes: Size, module: ShaftModule) -> float:
    """Seconds of the training steps after the warm-up, without validation."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = build_trainer(config, sizes, Path(folder), Curves())
        trainer.limit_val_batches = 0
        clock = Clock(WARM_UP, sizes.steps)
        trainer.callbacks.append(clock)  # type: ignore[attr-defined]
        skipped = SkippedImages(Path(folder) / "skipped_images.txt")
        # Twice the stream: reading goes on until the end, as it does in a training.
        more = replace(sizes, steps=2 * sizes.steps)
        trainer.fit(module, training_data(config, variant(config), more, skipped))
    return clock.seconds


def first_batch(config: Config, sizes: Size, device: torch.device) -> Batch:
    """The batch that a training begins with."""
    with tempfile.TemporaryDirectory() as folder:
        skipped = SkippedImages(Path(folder) / "skipped_images.txt")
        data = training_data(config, variant(config), sizes, skipped)
        batches: Iterator[Any] = iter(data.train_dataloader())
        images, targets = next(batches)
    return Batch(images.to(device), Targets(*(values.to(device) for values in targets)))


def network_step(module: ShaftModule, batch: Batch, sizes: Size) -> Callable[[], None]:
    """Forward, loss, backward and the loop's own optimiser on the one batch."""
    network, loss = module.network, module.loss
    configured: Any = module.configure_optimizers()
    optimizer = configured["optimizer"]
    mixed = torch.autocast(
        batch.images.device.type, torch.bfloat16, enabled=sizes.precision == "bf16-mixed"
    )

    def step() -> None:
        optimizer.zero_grad()
        with mixed:
            outputs = network(normalise_images(batch.images))
            terms = loss(outputs, batch.targets, network.defaults, network.pose_coder)
        terms.total.backward()
        optimizer.step()

    return step


def assignment(module: ShaftModule, batch: Batch) -> Callable[[], object]:
    """Matching and mining alone, on the outputs for the one batch."""
    with torch.no_grad():
        outputs = module.network(normalise_images(batch.images))
    return lambda: module.loss.assign(outputs, batch.targets, module.network.defaults)


def block_seconds(step: Callable[[], object], steps: int) -> float:
    """Seconds of so many steps, after the warm-up."""
    for _ in range(WARM_UP):
        step()
    start = now()
    for _ in range(steps):
        step()
    return now() - start


def now() -> float:
    """Seconds by the clock, when the GPU has done all that it was given."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


if __name__ == "__main__":
    main()
