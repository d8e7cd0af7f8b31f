import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning import Callback, LightningModule, Trainer
from torch.utils.data import DataLoader, Dataset

from shaftpose.core.errors import InputError
from shaftpose.dataset.batches import Batch, Targets
from shaftpose.export.onnx_export import ShaftDetector
from shaftpose.network.checkpoint import load_network_weights, resumed_step
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.training.module import ShaftModule
from tests.network.tiny import LIMITS

IDENTITY: dict[str, str | float] = {"variant": "D", "width": 0.1875, "depth": 0.25}


@pytest.fixture
def module(tiny_network: SingleShotNetwork) -> ShaftModule:
    return ShaftModule(
        tiny_network, IDENTITY, LIMITS, "adam", learning_rate=1e-3, total_steps=20, warmup_steps=4
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


def test_muon_moves_convolutions_with_batch_normalisation_and_adam_the_rest(
    tiny_network: SingleShotNetwork, trainer: Trainer
) -> None:
    module = ShaftModule(
        tiny_network, IDENTITY, LIMITS, "muon", 1e-3, total_steps=2, warmup_steps=0
    )
    before = {name: weight.clone() for name, weight in tiny_network.named_parameters()}
    trainer.fit(module, loader(2))
    (optimizer,) = trainer.optimizers
    matrices, others = (group["params"] for group in optimizer.param_groups)
    assert matrices
    assert all(weight.dim() == 4 for weight in matrices)
    names = {id(weight): name for name, weight in tiny_network.named_parameters()}
    # Only prediction convolutions have a bias: batch normalisation makes it superfluous.
    without_bias = {
        name
        for name, weight in before.items()
        if weight.dim() == 4 and name.replace("weight", "bias") not in before
    }
    assert {names[id(weight)] for weight in matrices} == without_bias
    assert {"head.pose_paths.0.merge.conv.weight"} <= without_bias
    assert len(matrices) + len(others) == len(before)
    assert [group["initial_lr"] for group in optimizer.param_groups] == [5e-3, 1e-3]
    for name, weight in tiny_network.named_parameters():
        # The last maps have no matched box, so nothing to learn from.
        if name.startswith(("backbone.trunk", "head.class_convs.0")):
            assert not torch.equal(weight, before[name]), name


def test_norm_is_frozen_in_the_last_steps(module: ShaftModule, trainer: Trainer) -> None:
    """Only the first of two steps changes the statistics; both change the weights."""
    after_each: list[dict[str, torch.Tensor]] = []

    class Keep(Callback):
        def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *_: Any) -> None:
            state = pl_module.state_dict()
            after_each.append({name: value.clone() for name, value in state.items()})

    before = {name: value.clone() for name, value in module.state_dict().items()}
    module.total_steps, module.frozen_norm_from = 2, 1
    trainer.callbacks.append(Keep())  # type: ignore[attr-defined]
    trainer.fit(module, loader(2))
    means = [name for name in before if name.endswith("running_mean")]
    first, second = after_each
    assert not any(torch.equal(before[name], first[name]) for name in means)
    assert all(torch.equal(first[name], second[name]) for name in means)
    weight = next(name for name in before if name.endswith("conv.weight"))
    assert not torch.equal(first[weight], second[weight])


def test_weights_have_their_channels_last_in_memory(module: ShaftModule) -> None:
    weights = [weight for weight in module.network.parameters() if weight.ndim == 4]
    assert all(weight.is_contiguous(memory_format=torch.channels_last) for weight in weights)
    assert any(not weight.is_contiguous() for weight in weights)  # else the check says nothing


def test_share_of_steps_with_frozen_norm(tiny_network: SingleShotNetwork) -> None:
    module = ShaftModule(tiny_network, IDENTITY, LIMITS, "adam", 1e-3, 20, 4, frozen_norm_share=0.3)
    assert module.frozen_norm_from == 14


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
    assert {"train/loss", "train/pose", "validation/loss"} <= trainer.callback_metrics.keys()
    # After two of four warm-up steps the next factor is 3 / 4.
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
    detector = ShaftDetector(module.network, LIMITS).eval()
    batch = random_batch(seed=0)
    with torch.inference_mode():
        found, expected = module.eval().validation_step(batch, 0), detector(batch.images)
    assert found["scores"].max() > 0
    assert found.keys() == {"boxes", "scores", "poses"}
    for name, values in expected._asdict().items():
        assert torch.equal(found[name], values), name


def test_loss_that_is_no_number_stops_the_training_and_shows_its_batch(
    module: ShaftModule, trainer: Trainer, tmp_path: Path
) -> None:
    next(module.network.parameters()).data.fill_(math.nan)
    path = tmp_path / "batch-of-step-0-rank-0.npz"
    with pytest.raises(InputError, match=f"loss is nan at step 0.*{path}"):
        trainer.fit(module, loader(1), loader(1))
    batch = random_batch(seed=0)
    with np.load(path, allow_pickle=False) as kept:
        assert kept.files == ["images", *Targets._fields[:4]]  # neither masks nor tips
        np.testing.assert_array_equal(kept["images"], batch.images)
        for name in kept.files[1:]:
            np.testing.assert_array_equal(kept[name], getattr(batch.targets, name))


def test_gradients_that_are_no_numbers_stop_the_training_before_they_spoil_the_weights(
    module: ShaftModule, trainer: Trainer, tmp_path: Path
) -> None:
    first = next(module.network.parameters())
    first.register_hook(lambda gradient: gradient * math.inf)
    before = first.detach().clone()
    path = tmp_path / "batch-of-step-0-rank-0.npz"
    with pytest.raises(InputError, match=f"gradient's norm is (inf|nan) at step 0.*{path}"):
        trainer.fit(module, loader(1), loader(1))
    with np.load(path, allow_pickle=False) as kept:
        np.testing.assert_array_equal(kept["images"], random_batch(seed=0).images)
    assert torch.equal(first, before)


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_gradients_are_clipped_by_their_norm(
    module: ShaftModule, tmp_path: Path, precision: str
) -> None:
    norms: list[float] = []

    class Norms(Callback):
        def on_before_optimizer_step(self, *args: object) -> None:
            gradients = [p.grad for p in module.parameters() if p.grad is not None]
            norms.append(float(torch.nn.utils.get_total_norm(gradients)))

        def on_train_batch_end(self, *args: object) -> None:
            self.on_before_optimizer_step()

    Trainer(
        accelerator="cpu", max_steps=1, precision=precision, gradient_clip_val=0.5,
        default_root_dir=tmp_path, logger=False, callbacks=[Norms()], enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    ).fit(module, loader(1))  # fmt: skip
    before, after = norms
    assert before > 1
    assert after == pytest.approx(0.5, rel=1e-3)


def one_loss(module: ShaftModule, targets: Targets) -> float:
    """The loss of a batch with these targets; its gradients must be finite, too."""
    loss = module.training_step(Batch(random_batch(seed=0).images, targets), 0)
    loss.backward()
    gradients = [weight.grad for weight in module.network.parameters()]
    assert all(g is None or bool(torch.isfinite(g).all()) for g in gradients)
    return loss.item()


def test_a_batch_without_any_match_costs_nothing(module: ShaftModule) -> None:
    known = random_batch(seed=0).targets
    assert one_loss(module, known._replace(valid=torch.zeros(2, 1, dtype=torch.bool))) == 0.0


def test_a_batch_of_real_images_has_a_loss_without_poses(module: ShaftModule) -> None:
    known = random_batch(seed=0).targets
    real = known._replace(has_pose=torch.tensor([False, False]), poses=known.poses * math.nan)
    loss = one_loss(module, real)
    assert math.isfinite(loss)
    assert loss > 0


def unfinished(path: Path, module: ShaftModule, trainer: Trainer) -> Path:
    """The checkpoint of a training that has not ended."""
    trainer.fit(module, loader(2), loader(1))
    trainer.save_checkpoint(path)
    return path


def test_an_unfinished_training_tells_where_it_goes_on(
    module: ShaftModule, trainer: Trainer, tmp_path: Path
) -> None:
    path = unfinished(tmp_path / "last.ckpt", module, trainer)
    assert resumed_step(path, IDENTITY) == 2
    with pytest.raises(InputError, match=r"last.ckpt.*'D', 'width': 0.1875.*'D', 'width': 1.0"):
        resumed_step(path, {**IDENTITY, "width": 1.0})


def test_weights_alone_are_no_unfinished_training(
    tiny_network: SingleShotNetwork, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="d.ckpt: not a checkpoint"):
        resumed_step(saved(tmp_path / "d.ckpt", tiny_network), IDENTITY)


class Malicious:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_code_in_a_checkpoint_is_not_run(tiny_network: SingleShotNetwork, tmp_path: Path) -> None:
    path = tmp_path / "evil.ckpt"
    torch.save({"identity": IDENTITY, "state_dict": Malicious(tmp_path / "made")}, path)
    for read in (resumed_step, lambda *args: load_network_weights(path, tiny_network, IDENTITY)):
        with pytest.raises(InputError, match="evil.ckpt: not a readable checkpoint"):
            read(path, IDENTITY)
    assert not (tmp_path / "made").exists()


def saved(path: Path, network: SingleShotNetwork) -> Path:
    weights = {f"network.{name}": value for name, value in network.state_dict().items()}
    torch.save({"identity": IDENTITY, "state_dict": weights}, path)
    return path


def test_other_identity_is_refused(tiny_network: SingleShotNetwork, tmp_path: Path) -> None:
    path = saved(tmp_path / "d.ckpt", tiny_network)
    with pytest.raises(InputError, match=r"'D'.*'C'"):
        load_network_weights(path, tiny_network, {**IDENTITY, "variant": "C"})


def test_missing_checkpoint_is_named(tiny_network: SingleShotNetwork, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing.ckpt: no such checkpoint"):
        load_network_weights(tmp_path / "missing.ckpt", tiny_network, IDENTITY)


@pytest.mark.parametrize("size", [0, 10, 5000])
def test_cut_off_checkpoint_is_named(
    tiny_network: SingleShotNetwork, tmp_path: Path, size: int
) -> None:
    path = saved(tmp_path / "cut.ckpt", tiny_network)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match="cut.ckpt: not a readable checkpoint"):
        load_network_weights(path, tiny_network, IDENTITY)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.999])
def test_one_flipped_bit_is_noticed(
    share: float, tiny_network: SingleShotNetwork, tmp_path: Path
) -> None:
    path = saved(tmp_path / "flipped.ckpt", tiny_network)
    data = bytearray(path.read_bytes())
    data[int(share * len(data))] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="flipped.ckpt: .*damaged; delete it and train"):
        load_network_weights(path, tiny_network, IDENTITY)


def test_foreign_checkpoint_is_named(tiny_network: SingleShotNetwork, tmp_path: Path) -> None:
    torch.save({"weights": torch.zeros(1)}, tmp_path / "foreign.ckpt")
    with pytest.raises(InputError, match="foreign.ckpt: not a checkpoint of this project"):
        load_network_weights(tmp_path / "foreign.ckpt", tiny_network, IDENTITY)


def test_weights_of_another_shape_are_refused(
    tiny_network: SingleShotNetwork, tmp_path: Path
) -> None:
    path = saved(tmp_path / "d.ckpt", tiny_network)
    tiny_network.head = torch.nn.Linear(1, 1)
    with pytest.raises(InputError, match="d.ckpt: its weights do not fit"):
        load_network_weights(path, tiny_network, IDENTITY)
