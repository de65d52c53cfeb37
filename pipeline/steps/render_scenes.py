"""Step `render_scenes`: renders random scenes for the arms that learn from new images."""

from __future__ import annotations

from pipeline.config.schema import BALANCED_SCENES, NEW_SCENES, Config, held_out_worlds
from pipeline.config.sections import BaseSet, Rarity
from pipeline.contract import Job, Step

SPARE = 1.5
"""Scenes per frame to add: some hide the pedestrian, and `retraining.empty_share` needs enough
scenes without any."""
FIRST_SEED = 10_000
"""Added to a version's seed, so that new scenes show other towns and people than the base set."""
SOURCES = rf"{NEW_SCENES}|{BALANCED_SCENES}"

STEP = Step(
    "Render new random scenes to learn from.",
    writes=lambda folders: folders.written_dataset("retrained/scenes/{source}/{seed}"),
    sections=lambda config, wildcards: (
        *("base_set", "simulator", "retraining.added_frames", "retraining.rounds"),
        *held_out_worlds(config),
    ),
    wildcards={"source": SOURCES},
    parallel=True,
)


def run(job: Job) -> None:
    """Render enough scenes for every frame that an arm may add, all of them for training."""
    from pipeline.execution.image_sets import Drawing, render_images

    config, source, seed = job.config, job.wildcards["source"], int(job.wildcards["seed"])
    drawing = Drawing(scene_settings(config, source, seed), config.camera, config.unseen)
    render_images(drawing, job.scratch, job.output("truth").parent, job.threads, job.progress)


def scene_settings(config: Config, source: str, seed: int) -> BaseSet:
    """The settings of the base set for new scenes.

    With `balanced_scenes`, all people and poses are equally frequent.
    """
    count = round(SPARE * config.retraining.added_frames * config.retraining.rounds)
    rare = Rarity(children=1, crouching=1) if source == BALANCED_SCENES else config.base_set.rare
    return config.base_set.model_copy(
        update={"images": count, "validation_share": 0.0, "seed": FIRST_SEED + seed, "rare": rare}
    )
