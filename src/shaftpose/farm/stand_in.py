"""Rendering of the stand-in for real endoscopic images: boxes, masks in tests, no poses."""

from pathlib import Path

from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco import write_coco
from shaftpose.dataset.stand_in import read_samples
from shaftpose.farm.cluster import cluster_client
from shaftpose.farm.locks import alone_in
from shaftpose.farm.render_sets import render_set
from shaftpose.rendering.stand_in_sets import stand_in_sets
from shaftpose.settings.parts import ClusterSettings, RenderSettings, Size


def write_stand_in(
    settings: RenderSettings,
    size: Size,
    seed: int,
    cluster: ClusterSettings,
    scratch: Path,
    out: Path,
) -> None:
    """Render the sets in `scratch`; write `images/`, `train.json` and `test.json` to `out`."""
    folder, samples = scratch / "stand-in", {}
    # A second run would overwrite the backgrounds that the first one reads.
    with alone_in(folder, scratch), cluster_client(cluster) as client:
        for name, rendered in stand_in_sets(settings, size, seed, folder).items():
            render_set(rendered, scratch, folder / name, client, cluster.hang_s)
            samples[name] = list(read_samples(folder / name, name))
    for name, sample in [pair for pairs in samples.values() for pair in pairs]:
        write_jpeg(sample.rgb, out / name)
    about = "stand-in for real endoscopic images, rendered; no poses"
    write_coco(out / "train.json", samples["train"], with_masks=False, description=about)
    test = samples["clear"] + samples["occluded"]
    write_coco(out / "test.json", test, with_masks=True, description=about)
