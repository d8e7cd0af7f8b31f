"""Training on a GPU: `pytest -m gpu tests/training/test_gpu.py`, which needs neither Hydra nor
MLflow.

The bounds in bfloat16 are several times the differences that it makes on a CPU.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from lightning import Callback, Trainer
from lightning.fabric.utilities import move_data_to_device
from torch import Tensor

from shaftpose.dataset.batches import Batch
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import TrainingStream
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.network.pose_network import PoseNetwork, normalise_images
from shaftpose.network.ssd.pose_coding import RegressionCoder
from shaftpose.refinement.contour import Shaft
from shaftpose.training.curves import Curves
from shaftpose.training.module import ShaftModule, freeze_statistics
from shaftpose.training.resume import LAST_CHECKPOINT, LastCheckpoint
from shaftpose.training.run import fit
from tests.network.dense.test_dense import CAMERA, DIAMETER_MM, LENGTH_MM, POSES, SIDE, targets_of
from tests.network.tiny import E_LOSS, LIMITS, tiny_d
from tests.training.rank_process import BATCH, HIGH, LOW, Noise

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU"),
]
DEVICE, STEPS = "cuda", 5


def d() -> PoseNetwork:
    return tiny_d(RegressionCoder(tuple(LOW), tuple(HIGH)))


def e() -> PoseNetwork:
    torch.manual_seed(0)
    return DenseNetwork((8, 8, 16, 16), CAMERA, Shaft(DIAMETER_MM, LENGTH_MM), E_LOSS)


def random_batch() -> Batch:
    generator = torch.Generator().manual_seed(0)
    images = torch.randint(0, 256, (2, SIDE, SIDE, 3), generator=generator, dtype=torch.uint8)
    return Batch(images, targets_of(POSES))


def step(network: PoseNetwork, device: str, bfloat16: bool) -> tuple[dict[str, float], Tensor]:
    """The loss terms of a training step with fixed batch normalisation, and the gradient."""
    torch.manual_seed(0)  # E's outlines are random
    network = network.to(device, memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    freeze_statistics(network)
    images, targets = move_data_to_device(random_batch(), torch.device(device))
    with torch.autocast(device, torch.bfloat16, enabled=bfloat16):
        terms = network.loss_terms(network(normalise_images(images)), targets)
    terms["loss"].backward()
    gradients = [w.grad.flatten() for w in network.parameters() if w.grad is not None]
    return {name: term.item() for name, term in terms.items()}, torch.cat(gradients).double().cpu()


@pytest.mark.parametrize("build", [d, e])
@pytest.mark.parametrize(
    ("bfloat16", "compiled", "of_loss", "of_gradient"),
    [(False, False, 1e-4, 1e-3), (True, False, 1e-2, 0.05), (True, True, 1e-2, 0.05)],
)
def test_a_step_is_that_of_a_cpu(
    build: Callable[[], PoseNetwork],
    bfloat16: bool,
    compiled: bool,
    of_loss: float,
    of_gradient: float,
) -> None:
    """Each loss term, relative to itself, and the gradient, relative to its norm."""
    expected, gradient = step(build(), "cpu", bfloat16=False)
    on_gpu = build()
    if compiled:
        on_gpu.compile()
    with torch.backends.cudnn.flags(allow_tf32=False):  # it has 11 digits, as bfloat16 has 8
        found, other = step(on_gpu, DEVICE, bfloat16)
    assert found == pytest.approx(expected, rel=of_loss)
    assert (other - gradient).norm() <= of_gradient * gradient.norm()


class Killed(Exception):
    pass


class Death(Callback):
    """Ends a training before one of its steps, and notes the others."""

    def __init__(self, before: int | None) -> None:
        self.before = before
        self.taken: list[int] = []

    def on_train_batch_start(self, trainer: Trainer, *args: Any) -> None:
        if trainer.global_step == self.before:
            raise Killed
        self.taken.append(trainer.global_step)


def trained(folder: Path, dies_before: int | None = None) -> tuple[list[int], dict[Any, float]]:
    """The steps taken, and the values of the curves."""
    curves, death = Curves(), Death(dies_before)
    trainer = Trainer(
        accelerator=DEVICE, devices=1, precision="bf16-mixed", max_steps=STEPS, max_epochs=1,
        val_check_interval=STEPS, log_every_n_steps=2, logger=[curves],
        callbacks=[death, LastCheckpoint(folder / LAST_CHECKPOINT, 0.0, curves)],
        default_root_dir=folder, enable_progress_bar=False, enable_model_summary=False,
        use_distributed_sampler=False,
    )  # fmt: skip
    module = ShaftModule(d(), {}, LIMITS, "adam", 1e-3, STEPS, warmup_steps=0)
    stream = TrainingStream(Noise(), None, 0.0, (), length=STEPS * BATCH, seed=3)
    fit(trainer, module, TrainingData(stream, Noise(), BATCH, 2), folder)  # type: ignore[arg-type]
    return death.taken, {(name, at): value for at, name, value in curves.rows}


def test_a_killed_training_resumes(tmp_path: Path) -> None:
    undisturbed, resumed = tmp_path / "undisturbed", tmp_path / "resumed"
    for folder in (undisturbed, resumed):
        folder.mkdir()
    steps, expected = trained(undisturbed)
    assert steps == list(range(STEPS))
    with pytest.raises(Killed):
        trained(resumed, dies_before=4)
    steps, found = trained(resumed)
    assert steps == [3, 4]
    assert found == pytest.approx(expected, rel=0.05)
