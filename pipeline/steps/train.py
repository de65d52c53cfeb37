"""Step `train`: makes the model version `base` (D_o), shipped or trained (thesis section 5.4)."""

from __future__ import annotations

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.model_card import Frequencies, read_card, read_curve
from pipeline.config.schema import Config, held_out_worlds
from pipeline.contract import Job, Step, Wildcards


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """Training parameters matter only if the base is trained."""
    trained = ("training", "base_set.rare") if config.base.source == "trained" else ()
    return ("base", *trained, "detector", *held_out_worlds(config))


STEP = Step(
    "Train or adopt the base detector.",
    reads=lambda folders, wildcards: folders.dataset("base_set") | folders.shipped,
    writes=lambda folders: folders.version("base"),
    sections=_sections,
    parallel=True,
)


def run(job: Job) -> None:
    """Write the weights, the ONNX file, the training curve and the card of the base version.

    The validation images of the base set give the metrics. A killed training resumes from its
    checkpoint.
    """
    from pipeline.detectors.yolo.data import usable
    from pipeline.detectors.yolo.recipe import train_from_scratch
    from pipeline.detectors.yolo.threads import use_threads
    from pipeline.detectors.yolo.training import Fitted, Run
    from pipeline.detectors.yolo.weights import load_weights
    from pipeline.learning import leakage
    from pipeline.learning.versions import Origin, write_version

    use_threads(job.threads)
    config, truth, checkpoint = job.config, job.input("truth"), job.scratch / "checkpoint.pt"
    validation = read_dataset(truth.parent, "val")
    if config.base.source == "shipped":
        curve = tuple(read_curve(job.input("shipped_curve")))
        fitted = Fitted(load_weights(job.input("shipped_weights")), curve)
        card = read_card(job.input("shipped_card"))
        leakage.refuse_worlds(config, [truth], [], job.input("shipped_card"))
        origin = Origin("base", None, card.data, dict(card.training), card.seed, card.worlds)
    else:
        images = read_dataset(truth.parent, "train")
        worlds = leakage.refuse_worlds(config, [truth], [])
        settings = config.training.model_dump()
        resumable = Run(checkpoint, job.threads, job.progress)
        fitted = train_from_scratch(images, usable(images), validation, settings, resumable)
        rare = Frequencies(**config.base_set.rare.model_dump())
        taken = {"images": len(images), **rare.figures(), **settings}
        data = {"base_set": images.digest}
        origin = Origin("base", None, data, taken, config.training.seed, worlds)
    write_version(config, fitted, validation, origin, job.output("card"), job.progress)
    job.progress(1, 1, "evaluated")
