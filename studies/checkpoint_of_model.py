"""Make a checkpoint of an exported model, to train on from it.

`python -m studies.checkpoint_of_model shaftpose --out models/former.ckpt --with variant=e_real`: a
file without the training that made it holds each batch normalisation merged with the convolution
before it. Here they are parted again, with the statistics of one training batch, so that in a
training, too, the network begins with what it knew. For variants e and e_real, with Hydra's
overrides of the training: `python pipelines/train.py variant=e_real
variant.start=models/former.ckpt` goes on.
"""

import argparse
import os
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import onnx
import torch
from onnx import ModelProto, numpy_helper
from torch import Tensor, nn

from pipelines.train import FOLDERS
from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import new_file
from shaftpose.dataset.batches import Batch
from shaftpose.dataset.training_stream import SkippedImages
from shaftpose.inference.model_files import model_file
from shaftpose.inference.predictor import Predictor
from shaftpose.network.building import build_network, identity
from shaftpose.network.checkpoint import WEIGHT_PREFIX
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.network.pose_network import normalise_images
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.schema import Variant
from shaftpose.training.data import training_data
from shaftpose.training.recipe import Recipe, training_recipe


def main() -> None:
    """Write the checkpoint of the command line's model."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model", help="a bundled model, or an exported file")
    parser.add_argument("--out", type=Path, required=True, help="the checkpoint to write")
    parser.add_argument("--with", nargs="*", default=[], dest="settings", help="Hydra's overrides")
    options = parser.parse_args()
    with exit_on_input_error():
        recipe = training_recipe(composed_settings(Path(), *options.settings))
        network = build_network(recipe.variant)
        if not isinstance(network, DenseNetwork):
            raise InputError(f"variant={recipe.variant.name}: give variant=e or variant=e_real")
        with model_file(options.model) as path:
            load(network, path)
        take_statistics(network, training_batch(recipe))
        write(network, recipe.variant, options.out)
        print(f"{options.out}: start a training from it with variant.start={options.out}")


def load(network: DenseNetwork, model: Path) -> None:
    """Load the weights of an exported model, and of its edge reader, in evaluation mode.

    Raises InputError if the file is no model, or one of another network.
    """
    reader = Predictor(model).metadata.edge_reader
    values = _weights(onnx.load(str(model)), "network.")
    if reader is not None:
        values |= _weights(onnx.load_from_string(reader), "", "edges.")
    state = network.state_dict()
    for convolution, name, norm in normalised(network):
        values[f"{name}.running_var"] = torch.full_like(norm.weight, 1 - norm.eps)  # 1 with epsilon
        # Named by torch's exporter where it has merged the two, else as in a network.
        for shift in ("weight_bias", "bias"):
            if f"{convolution}.{shift}" in values:
                values[f"{name}.bias"] = values[f"{convolution}.{shift}"]
    known = {
        name for name in values.keys() & state.keys() if values[name].shape == state[name].shape
    }
    needed = {name for name, weight in network.named_parameters() if weight.ndim == 4}
    if missing := sorted(needed - known):
        raise InputError(f"{model}: lacks {missing[0]} of this variant; name a model of it")
    network.load_state_dict(state | {name: values[name] for name in known})


def _weights(model: ModelProto, prefix: str, becomes: str = "") -> dict[str, Tensor]:
    """The stored arrays whose names begin with `prefix`, by their names in the network, those of 16
    bits as floats."""
    return {
        becomes + stored.name.removeprefix(prefix).removesuffix(".half"): torch.tensor(
            numpy_helper.to_array(stored)
        ).float()
        for stored in model.graph.initializer
        if stored.name.startswith(prefix)
    }


def normalised(network: nn.Module) -> Iterator[tuple[str, str, nn.BatchNorm2d]]:
    """Each batch normalisation: the name of the convolution before it, its own, and itself."""
    for name, layers in network.named_modules():
        if isinstance(layers, nn.Sequential):
            for n, (first, second) in enumerate(pairwise(layers)):
                if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                    yield f"{name}.{n}", f"{name}.{n + 1}", second


@torch.no_grad()
def take_statistics(network: DenseNetwork, batch: Batch) -> None:
    """Give each batch normalisation, which so far only adds its bias, the statistics of a batch,
    and scale and bias that undo them: on this batch, the network gives the same as before in
    evaluation and in training."""
    hooks = [norm.register_forward_pre_hook(_undone) for *_, norm in normalised(network)]
    network.eval()
    network.loss_terms(network(normalise_images(batch.images)), batch.targets)
    for hook in hooks:
        hook.remove()


def _undone(norm: nn.Module, inputs: tuple[Tensor, ...]) -> None:
    assert isinstance(norm, nn.BatchNorm2d)
    assert norm.running_mean is not None and norm.running_var is not None
    variance, mean = torch.var_mean(inputs[0], (0, 2, 3), correction=0)
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)
    norm.weight.copy_((variance + norm.eps).sqrt())
    norm.bias.add_(mean)


def training_batch(recipe: Recipe) -> Batch:
    """The first batch of a training."""
    skipped = SkippedImages(Path(os.devnull))  # the training records them
    batches = training_data(recipe, FOLDERS, skipped, with_instances=True).train_dataloader()
    batch: Batch = next(iter(batches))
    return batch


def write(network: DenseNetwork, variant: Variant, out: Path) -> None:
    """Write the network as a checkpoint of its variant."""
    out.parent.mkdir(parents=True, exist_ok=True)
    weights = {f"{WEIGHT_PREFIX}{name}": value for name, value in network.state_dict().items()}
    with new_file(out) as part:
        torch.save({"identity": identity(variant), "state_dict": weights}, part)


if __name__ == "__main__":
    main()
