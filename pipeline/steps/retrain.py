"""Step `retrain`: makes an arm's version of a round from its predecessor (thesis section 7.1).

Examples are D_r and D_a.
"""

from __future__ import annotations

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.folders import Folders
from pipeline.config.schema import BASE_SET, Config, held_out_worlds
from pipeline.config.sections import Retraining
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.lineage import Version
from pipeline.errors import InputError

FAN_OUT = ("seeds", "rounds", "searches")
"""Keys of `retraining` that determine which versions there are."""


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config, version = folders.config, wildcards["version"]
    own_arm = Version.named(version).arm
    if own_arm not in config.arms:
        raise InputError(
            f"version: '{version}' is not retrained; the study's arms are {', '.join(config.arms)}"
        )
    files: dict[str, Files] = {
        **folders.dataset("base_set"),
        "parent": folders.parent(version, "model.json"),
        "weights": folders.parent(version, "weights.safetensors"),
        "spaces": folders.spaces(config.search),
    }
    if config.arms[own_arm] == BASE_SET:
        return files
    for arm, source in config.arms.items():
        if arm in config.sources:
            files[f"{arm}_filters"] = folders.added_filters(version, arm)
            files[f"{arm}_tests"] = folders.added(version, arm, "tests.parquet")
        elif source != BASE_SET:
            truth, images = folders.dataset(folders.scenes(version, arm)).values()
            files[f"{arm}_scenes"] = truth
            files[f"{arm}_images"] = images
    if own_arm in config.sources:
        files["frames"] = folders.added(version, own_arm, "frames.parquet")
    return files


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """Another round or seed adds versions and leaves the present ones unchanged.

    Section `training` only matters for training from scratch, the filter's limits only for new
    scenes, because campaigns are filtered before.
    """
    names = [name for name in Retraining.model_fields if name not in FAN_OUT]
    keys = [f"retraining.{name}" for name in names]
    if Version.named(wildcards["version"]).seed is None:
        keys.append("retraining.seeds.0")
    if config.retraining.start == "scratch":
        keys.append("training")
    if config.learns_from_scenes:
        keys += ["filter.min_visible_pixels", "filter.min_detectability"]
    return (*keys, "regions", "detector", *held_out_worlds(config))


STEP = Step(
    "Retrain a model version on the base set and campaign frames.",
    reads=_reads,
    writes=lambda folders: folders.version("{version}"),
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Retrain and write the weights, the ONNX file, the training curve and the card of the version.

    The job reads the sources of all arms, because all get the same number of added frames; a
    control gets none. A killed training resumes from its checkpoint.
    """
    from pipeline.detectors.yolo.retraining import ImageSets
    from pipeline.detectors.yolo.training import Run
    from pipeline.learning import leakage
    from pipeline.learning.added_frames import Campaigns, Scenes, Source, choose
    from pipeline.learning.fitting import fit_version, settings_taken
    from pipeline.learning.versions import Origin, write_version

    config, described = job.config, Version.named(job.wildcards["version"])
    seed = config.retraining.seeds[0] if described.seed is None else described.seed
    truth, weights = job.input("truth"), job.input("weights")
    # Not from config.arms: a version does not depend on the names of other arms.
    arms = [name.removesuffix("_filters") for name in job.reads if name.endswith("_filters")]
    scene_inputs = [name for name in job.reads if name.endswith("_scenes")]
    scenes = {name.removesuffix("_scenes"): job.input(name) for name in scene_inputs}
    truths = [truth, *scenes.values()]
    worlds = leakage.refuse_worlds(config, truths, job.inputs("spaces"), job.input("parent"))
    base, validation = (read_dataset(truth.parent, split) for split in ("train", "val"))
    added = None
    if arms or scenes:
        sources: dict[str, Source] = {arm: Scenes(config, path) for arm, path in scenes.items()}
        for arm in arms:
            frames = job.inputs("frames") if arm == described.arm else ()
            sources[arm] = Campaigns(
                config,
                job.inputs(f"{arm}_filters"),
                job.inputs(f"{arm}_tests"),
                job.inputs("spaces"),
                frames,
            )
        chosen = choose(config, sources, described, seed)
        added = sources[described.arm].read(chosen)
        leakage.refuse_frames(config.held_out, chosen, added, validation)
    data = {"base_set": base.digest, "parent": sha256(weights)}
    if added is not None:
        data["added"] = added.digest
    # The same batches again would teach a second round nothing new.
    stream = (seed,) if described.round == 1 else (seed, described.round)
    resumable = Run(job.scratch / "checkpoint.pt", job.threads, job.progress)
    fitted = fit_version(config, weights, ImageSets(base, added, validation), stream, resumable)
    training = settings_taken(config) | {
        "seed": seed,
        "round": described.round,
        "base_images": len(base),
        "added_frames": 0 if added is None else len(added),
    }
    origin = Origin(str(described), str(described.parent), data, training, seed, worlds)
    write_version(config, fitted, validation, origin, job.output("card"), job.progress)
