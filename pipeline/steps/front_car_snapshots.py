"""Step `front_car_snapshots`: renders the training or test snapshots, with their segmentation."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.artefacts.dataset import (
    Record,
    Split,
    place_dataset,
    remove_leftovers,
    write_classes,
    write_image,
    write_truth,
)
from pipeline.artefacts.files import write_json
from pipeline.artefacts.front_car_results import Points
from pipeline.artefacts.results import read
from pipeline.config.schema import Config
from pipeline.contract import Job, Step
from pipeline.errors import InputError, SimulationError
from pipeline.execution.worker import in_order

TOWNS = 3
"""Number of towns per kind of street; test towns are separate."""
LEARNING, TESTING = 0, 1
"""Streams of random numbers: training and test snapshots share none."""
Shot = tuple[dict[str, str], tuple[int, ...], Split, int]
"""Point, seed, split, index of the image."""
TownJob = tuple[int, list[Shot], dict[str, Any], Path]


STEP = Step(
    "Render the snapshots of some points.",
    reads=lambda folders, wildcards: {"points": f"{folders.root}/points.json"},
    writes=lambda folders: {
        **folders.written_dataset("snapshots/{version}"),
        "segments": f"{folders.root}/snapshots/{{version}}/segments/",
    },
    sections=(
        "front_car.space",
        "front_car.seed",
        "front_car.images",
        "front_car.validation_share",
        "front_car.test_images",
        "simulator",
    ),
    wildcards={"version": "existing|covered|test"},
    parallel=True,
)


def run(job: Job) -> None:
    """Write a data set and its segmentations.

    `existing` renders the random points alone, `covered` all points, both with the same number of
    snapshots; `test` renders every feasible point in other towns, as validation images.
    """
    config, version, root = job.config, job.wildcards["version"], job.scratch
    settings, points = config.front_car, read(job.input("points"), Points)
    if version == "test":
        space = settings.space.space()
        shown = [space.decode(row.astype(float)) for row in settings.space.feasible_points()]
        counts, share, stream = [settings.test_images] * len(shown), 1.0, TESTING
    else:
        chosen = points.points[: points.existing] if version == "existing" else points.points
        shown = [dict(point.values) for point in chosen]
        counts, share, stream = (
            settings.images_of(len(shown)),
            settings.validation_share,
            LEARNING,
        )
        if not all(counts) or not any(round(count * share) for count in counts):
            raise InputError(
                f"front_car.images: expected an image of each of {len(shown)} points and, at a "
                f"validation share of {share:g}, a validation image, got {settings.images}"
            )
    jobs = _jobs(config, shown, counts, share, stream, root)
    records: list[Record] = []
    for done, rendered in enumerate(in_order(render_town, jobs, job.threads), 1):
        records += rendered
        job.progress(len(records), sum(counts), f"town {done} of {len(jobs)}")
    remove_leftovers(root, records)
    write_truth(root, records, category="forward vehicle")
    place_dataset(root, job.output("truth").parent)


def _jobs(
    config: Config, shown: list[Any], counts: list[int], share: float, stream: int, root: Path
) -> list[TownJob]:
    """A job per town; a point's snapshots alternate between the towns of its kind of street."""
    space, seed = config.front_car.space.space(), config.front_car.seed
    towns: dict[tuple[int, int, int], list[Shot]] = {}
    first = 0
    for values, count in zip(shown, counts, strict=True):
        code = int(np.ravel_multi_index(tuple(space.encode(values).astype(int)), space.sizes))
        validation = count - round(count * share)
        for n in range(count):
            town = (int(values["lanes"]), int(values["lane_orientation"] == "curvy"), n % TOWNS)
            split: Split = "val" if n >= validation else "train"
            shot = (values, (seed, stream, code, n), split, first + n)
            towns.setdefault(town, []).append(shot)
        first += count
    jobs: list[TownJob] = []
    for town, shots in sorted(towns.items()):
        town_seed = int(np.random.default_rng([seed, stream, *town]).integers(2**31))
        jobs.append((town_seed, shots, config.camera, root))
    return jobs


def render_town(job: TownJob) -> list[Record]:
    """Render and write the snapshots of a town, in a worker process."""
    from pipeline.simulators.mujoco.lens import CameraSettings

    # Needs a GL library, unlike the parent process.
    from pipeline.simulators.mujoco.snapshots import CLASSES, snapshots

    town_seed, shots, camera, root = job
    settings = CameraSettings.model_validate(camera)
    rendered = snapshots(town_seed, [(values, seed) for values, seed, _, _ in shots], settings)
    records = []
    try:
        for (_, _, split, index), snapshot in zip(shots, rendered, strict=True):
            write_image(root, split, index, snapshot.image, snapshot.truth)
            write_classes(root, split, index, snapshot.classes)
            size = settings.width, settings.height
            records.append(Record(split, index, *size, snapshot.truth, snapshot.attributes))
    except SimulationError as error:
        raise InputError(
            f"simulator.camera: {error}; take more pixels or a narrower view"
        ) from error
    os.sync()
    write_json(root / "segments" / "classes.json", dict(enumerate(CLASSES)))
    return records
