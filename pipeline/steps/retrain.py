"""Step `retrain`: makes the versions random (D_r), adaptive (D_a) and control of a round from their predecessors (thesis section 7.1)."""

from __future__ import annotations

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.folders import Folders
from pipeline.config.schema import Config, Retraining, held_out_worlds
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.lineage import Version


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    version = wildcards["version"]
    files: dict[str, Files] = {
        **folders.dataset("base_set"),
        "parent": folders.parent(version, "model.json"),
        "weights": folders.parent(version, "weights.safetensors"),
        "spaces": folders.spaces(folders.config.search),
    }
    for source in ("random", "adaptive"):
        files[f"{source}_filters"] = folders.added_filters(version, source)
        files[f"{source}_tests"] = folders.added(version, source, "tests.parquet")
    if (kind := Version.named(version).kind) in folders.config.sources:
        files["frames"] = folders.added(version, kind, "frames.parquet")
    return files


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """Another round or seed adds versions and leaves the present ones unchanged; section `training` only matters for training from
    scratch."""
    own = [f"retraining.{name}" for name in Retraining.model_fields if name not in ("seeds", "rounds")]
    seed = ["retraining.seeds.0"] if Version.named(wildcards["version"]).seed is None else []
    scratch = ["training"] if config.retraining.start == "scratch" else []
    return (*own, *seed, *scratch, "regions", "detector", *held_out_worlds(config))


STEP = Step(
    "Retrain a model version on the base set and campaign frames.",
    reads=_reads,
    writes=lambda folders: folders.version("{version}"),
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Retrain and write the weights, the ONNX file, the training curve and the card of the version.

    Reads both sources, because both versions get the same number of added frames; a control gets none. A killed training resumes from its
    checkpoint.
    """
    from pipeline.detectors.yolo.retraining import ImageSets
    from pipeline.detectors.yolo.training import Run
    from pipeline.learning import leakage
    from pipeline.learning.added_frames import Source, choose, read_added
    from pipeline.learning.fitting import fit_version, settings_taken
    from pipeline.learning.versions import Origin, write_version

    config, described = job.config, Version.named(job.wildcards["version"])
    seed = config.retraining.seeds[0] if described.seed is None else described.seed
    truth, weights, checkpoint = job.input("truth"), job.input("weights"), job.scratch / "checkpoint.pt"
    worlds = leakage.refuse_worlds(config, truth, job.inputs("spaces"), job.input("parent"))
    base, validation = (read_dataset(truth.parent, split) for split in ("train", "val"))
    added = None
    if described.kind != "control":
        sources = {name: Source(job.inputs(f"{name}_filters"), job.inputs(f"{name}_tests")) for name in ("random", "adaptive")}
        chosen = choose(config, sources, described, job.inputs("spaces"), seed)
        added = read_added(chosen, job.inputs("frames"))
        leakage.refuse_frames(config.held_out, chosen, added, validation)
    data = {"base_set": base.digest, "parent": sha256(weights)} | ({} if added is None else {"added": added.digest})
    # The same batches again would teach a second round nothing new.
    stream = (seed,) if described.round == 1 else (seed, described.round)
    fitted = fit_version(config, weights, ImageSets(base, added, validation), stream, Run(checkpoint, job.threads, job.progress))
    training = settings_taken(config) | {"seed": seed, "round": described.round, "base_images": len(base)}
    training |= {"added_frames": 0 if added is None else len(added)}
    origin = Origin(str(described), str(described.parent), data, training, seed, worlds)
    write_version(config, fitted, validation, origin, job.output("card"))
    checkpoint.unlink(missing_ok=True)
