"""Step `retrain`: the versions random (D_r), adaptive (D_a) and control of a round from their predecessors (thesis section 7.1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.config.schema import Config
from pipeline.core.lineage import Version
from pipeline.learning import leakage
from pipeline.learning.added_frames import Source, _fit, _taken, choose, read_added
from pipeline.learning.versions import write_version
from pipeline.progress import Progress


def run(
    config: Config,
    *,
    version: str,
    base_set: Path,
    parent: Path,
    spaces: Sequence[Path],
    random_filters: Sequence[Path],
    random_frames: Sequence[Path],
    adaptive_filters: Sequence[Path],
    adaptive_frames: Sequence[Path],
    out: Path,
    checkpoint: Path,
    threads: int,
    progress: Progress,
) -> None:
    """Retrain and write weights.safetensors, model.onnx and `out`, the version's model.json.

    parent: model.json of the version before. spaces: of the searched scenarios. The tables and frames of both sources, because both
    versions get the same number of added frames; none for a control. checkpoint: file that a training which was killed goes on from.
    """
    torch.set_num_threads(threads)
    settings, described = config.retraining, Version.named(version)
    seed = settings.seeds[0] if described.seed is None else described.seed
    towns = leakage.refuse_towns(config, base_set, spaces, parent)
    base = read_dataset(base_set.parent, "train")
    weights = parent.with_name("weights.safetensors")
    validation = read_dataset(base_set.parent, "val")
    added = None
    if described.kind != "control":
        sources = {"random": Source(random_filters, random_frames), "adaptive": Source(adaptive_filters, adaptive_frames)}
        chosen = choose(config, sources, described, spaces, seed)
        added = read_added(chosen, sources[described.kind].frames)
        leakage.refuse_frames(config.held_out, chosen["test_id"].tolist(), added, validation)
    data = {"base_set": base.digest, "parent": sha256(weights)} | ({} if added is None else {"added": added.digest})
    # The same batches once more would teach a second round nothing new.
    stream = (seed,) if described.round == 1 else (seed, described.round)
    fitted = _fit(config, weights, base, added, validation, stream, data, checkpoint, threads, progress)
    training = _taken(config) | {"seed": seed, "round": described.round, "base_images": len(base)}
    write_version(
        config,
        fitted,
        validation,
        out,
        version=version,
        parent=str(described.parent),
        data=data,
        training=training | {"added_frames": 0 if added is None else len(added)},
        seed=seed,
        towns=towns,
    )
    checkpoint.unlink(missing_ok=True)
