"""Step `render_base`: renders the random base training set (thesis section 5.4).

It renders in shards that survive a kill.
"""

from __future__ import annotations

from pipeline.config.schema import held_out_worlds
from pipeline.contract import Job, Step

STEP = Step(
    "Render the random base training set.",
    writes=lambda folders: folders.written_dataset("base_set"),
    sections=lambda config, wildcards: ("base_set", "simulator", *held_out_worlds(config)),
    parallel=True,
)


def run(job: Job) -> None:
    """Render `base_set.images` random scenes into a YOLO and COCO data set."""
    from pipeline.execution.image_sets import Drawing, render_images

    config = job.config
    drawing = Drawing(config.base_set, config.camera, config.unseen)
    render_images(drawing, job.scratch, job.output("truth").parent, job.threads, job.progress)
