import math
from pathlib import Path

import pytest
import torch
from lightning import Trainer
from torch.utils.data import DataLoader, Dataset

from shaftpose.batches import Batch, Targets
from shaftpose.errors import InputError
from shaftpose.network.checkpoint import load_network_weights
from shaftpose.network.detector import ShaftDetector
from shaftpose.network.loss import ShaftLoss
from shaftpose.network.module import ShaftModule
from shaftpose.network.shaft_network import ShaftNetwork

IDENTITY: dict[str, str | float] = {"variant": "D", "width": 0.04}


@pytest.fixture
def module(tiny_network: ShaftNetwork) -> ShaftModule:
    loss = ShaftLoss(alpha=1.5, beta=(1, 1, 2, 2, 2), gamma=5.0)
    return ShaftModule(
        tiny_network, loss, IDENTITY, learning_rate=1e-3, total_steps=20, warmup_steps=4
    )


def random_batch(seed: int) -> Batch:
    generator = torch.Generator().manual_seed(seed)
    images = torch.randint(0, 256, (2, 299, 299, 3), generator=generator, dtype=torch.uint8)
    boxes = torch.tensor([[[0.2, 0.2, 0.6, 0.9]], [[0.0, 0.5, 1.0, 0.8]]])
    poses = torch.tensor([[[5.0, -5.0, 20.0, 70.0, 100.0]]] * 2)
    targets = Targets(boxes, poses, torch.ones(2, 1, dtype=torch.bool), torch.tensor([True, False]))
    return Batch(images, targets)


class RandomBatches(Dataset[Batch]):
    def __init__(self, count: int) -> None:
        self.count = count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> Batch:
        return random_batch(seed=index)


def loader(batches: int) -> DataLoader[Batch]:
    return DataLoader(RandomBatches(batches), batch_size=None)


@pytest.fixture
def trainer(tmp_path: Path) -> Trainer:
    return Trainer(
        num_sanity_val_steps=0,
        accelerator="cpu", max_steps=2, default_root_dir=tmp_path, logger=False,
        enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("step", "factor"), [(0, 0.25), (3, 1.0), (4, 1.0), (12, 0.25), (16, 0.0625), (20, 0), (25, 0)]
)
def test_learning_rate(module: ShaftModule, step: int, factor: float) -> None:
    assert module.learning_rate_factor(step) == pytest.approx(factor)


def test_learning_rate_without_warm_up(module: ShaftModule) -> None:
    module.warmup_steps = 0
    assert module.learning_rate_factor(0) == 1.0
    assert module.learning_rate_factor(10) == pytest.approx(0.25)


def test_learning_rate_of_a_run_that_is_all_warm_up(module: ShaftModule) -> None:
    module.warmup_steps = module.total_steps
    assert module.learning_rate_factor(19) == 1.0
    assert module.learning_rate_factor(20) == 0.0


def test_training_logs_saves_and_loads(
    module: ShaftModule, trainer: Trainer, tmp_path: Path
) -> None:
    trainer.fit(module, loader(2), loader(1))
    assert {"training/loss", "training/pose", "validation/loss"} <= trainer.callback_metrics.keys()
    # Warm-up of four steps: after two of them the third part of it is next.
    assert trainer.optimizers[0].param_groups[0]["lr"] == pytest.approx(1e-3 * 3 / 4)
    path = tmp_path / "last.ckpt"
    trainer.save_checkpoint(path)
    trained = {name: value.clone() for name, value in module.network.state_dict().items()}
    for parameter in module.network.parameters():
        parameter.data.zero_()
    load_network_weights(path, module.network, IDENTITY)
    for name, value in module.network.state_dict().items():
        assert torch.equal(value, trained[name]), name


def test_validation_returns_what_the_exported_detector_finds(module: ShaftModule) -> None:
    detector = ShaftDetector(module.network, top_k=250, iou_threshold=0.5, keep=20).eval()
    batch = random_batch(seed=0)
    with torch.inference_mode():
        found, expected = module.eval().validation_step(batch, 0), detector(batch.images)
    assert found["scores"].max() > 0
    assert found.keys() == {"boxes", "scores", "poses"}
    for name, values in expected._asdict().items():
        assert torch.equal(found[name], values), name


def test_loss_that_is_no_number_stops_the_training(module: ShaftModule, trainer: Trainer) -> None:
    next(module.network.parameters()).data.fill_(math.nan)
    with pytest.raises(InputError, match="nan at step 0"):
        trainer.fit(module, loader(1), loader(1))


def saved(path: Path, network: ShaftNetwork) -> Path:
    weights = {f"network.{name}": value for name, value in network.state_dict().items()}
    torch.save({"identity": IDENTITY, "state_dict": weights}, path)
    return path


def test_other_identity_is_refused(tiny_network: ShaftNetwork, tmp_path: Path) -> None:
    path = saved(tmp_path / "d.ckpt", tiny_network)
    with pytest.raises(InputError, match=r"'D'.*'C'"):
        load_network_weights(path, tiny_network, {"variant": "C", "width": 0.04})


def test_missing_checkpoint_is_named(tiny_network: ShaftNetwork, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing.ckpt: no such checkpoint"):
        load_network_weights(tmp_path / "missing.ckpt", tiny_network, IDENTITY)


@pytest.mark.parametrize("size", [0, 10, 5000])
def test_cut_off_checkpoint_is_named(tiny_network: ShaftNetwork, tmp_path: Path, size: int) -> None:
    path = saved(tmp_path / "cut.ckpt", tiny_network)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match="cut.ckpt: not a readable checkpoint"):
        load_network_weights(path, tiny_network, IDENTITY)


def test_foreign_checkpoint_is_named(tiny_network: ShaftNetwork, tmp_path: Path) -> None:
    torch.save({"weights": torch.zeros(1)}, tmp_path / "foreign.ckpt")
    with pytest.raises(InputError, match="foreign.ckpt: not a checkpoint of this project"):
        load_network_weights(tmp_path / "foreign.ckpt", tiny_network, IDENTITY)


def test_weights_of_another_shape_are_refused(tiny_network: ShaftNetwork, tmp_path: Path) -> None:
    path = saved(tmp_path / "d.ckpt", tiny_network)
    tiny_network.head = torch.nn.Linear(1, 1)
    with pytest.raises(InputError, match="d.ckpt: its weights do not fit"):
        load_network_weights(path, tiny_network, IDENTITY)
