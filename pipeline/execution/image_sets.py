"""Renders random scenes into a data set, in shards that survive a kill."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.artefacts.dataset import (
    Record,
    Split,
    images_sha256,
    place_dataset,
    remove_leftovers,
    write_image,
    write_truth,
)
from pipeline.artefacts.files import program_sha256, read_sealed, write_sealed
from pipeline.config.sections import BaseSet
from pipeline.core.truth import Truth
from pipeline.errors import InputError
from pipeline.execution.worker import in_order
from pipeline.progress import OnProgress

SHARD_IMAGES = 100
"""Images per town and population: few, so that a data set shows many of both and a kill loses
little."""


@dataclass(frozen=True)
class Drawing:
    """How the scenes of a data set are drawn.

    camera: section of the simulator. unseen: as in `scenes`.
    """

    section: BaseSet
    camera: Mapping[str, Any]
    unseen: Mapping[str, str]


def render_images(
    drawing: Drawing, scratch: Path, out: Path, threads: int, progress: OnProgress
) -> None:
    """Render `section.images` random scenes into a YOLO and COCO data set.

    A killed run resumes from the shards in `scratch`, which the caller removes.

    The last `validation_share` of each town's images are validation images. The images depend on
    `drawing` alone, not on the threads.
    """
    images, program = drawing.section.images, program_sha256()
    shards = [
        (shard, min(SHARD_IMAGES, images - shard * SHARD_IMAGES))
        for shard in range(-(-images // SHARD_IMAGES))
    ]
    jobs = [(*shard, drawing, scratch, program) for shard in shards]
    records: list[Record] = []
    for done, shard_records in enumerate(in_order(_render_shard, jobs, threads), 1):
        records += shard_records
        progress(len(records), images, f"town {done} of {len(jobs)}")
    remove_leftovers(scratch, records)
    write_truth(scratch, records)
    place_dataset(scratch, out)


def _render_shard(job: tuple[int, int, Drawing, Path, str]) -> list[Record]:
    """Render one town's images, unless its shard file records the same settings and code."""
    from pipeline.simulators.mujoco.lens import CameraSettings
    from pipeline.simulators.mujoco.random_scenes import (
        scenes,
    )  # Needs a GL library, unlike the parent process.

    shard, count, drawing, out, program = job
    section = drawing.section
    key = {
        **section.model_dump(exclude={"images"}),
        "count": count,
        "camera": dict(drawing.camera),
        "program": program,
    }
    key |= {"unseen": sorted(drawing.unseen)}
    path = out / "shards" / f"{shard:04d}.json"
    if (finished := _finished(path, key, out)) is not None:
        return finished
    settings = CameraSettings.model_validate(drawing.camera)
    records = []
    first_validation = count - round(count * section.validation_share)
    for i, scene in enumerate(scenes(shard, count, section, settings, drawing.unseen)):
        split: Split = "val" if i >= first_validation else "train"
        index = shard * SHARD_IMAGES + i
        write_image(out, split, index, scene.image, scene.truth)
        records.append(
            Record(split, index, settings.width, settings.height, scene.truth, scene.attributes)
        )
    os.sync()
    shard_file = {
        "key": key,
        "sha256": images_sha256(out, records),
        "records": [
            {**vars(record), "truth": vars(record.truth), "attributes": dict(record.attributes)}
            for record in records
        ],
    }
    write_sealed(path, json.dumps(shard_file).encode())
    return records


def _finished(path: Path, key: Mapping[str, Any], out: Path) -> list[Record] | None:
    """The records in a shard's file.

    None if it is missing, damaged or of another key, or if its images are not those that it
    describes.
    """
    try:
        done = json.loads(read_sealed(path))
        if done["key"] != key:
            return None
        records = [_record(plain) for plain in done["records"]]
        return records if images_sha256(out, records) == done["sha256"] else None
    except (InputError, OSError):
        return None


def _record(plain: dict[str, Any]) -> Record:
    truth: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in plain["truth"].items()
    }
    return Record(**{**plain, "truth": Truth(**truth)})
