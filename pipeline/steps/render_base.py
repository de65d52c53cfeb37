"""Step `render_base`: renders the random base training set (thesis section 5.4), in shards that survive a kill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.artefacts.dataset import Record, Split, move_dataset, remove_leftovers, write_image, write_truth
from pipeline.artefacts.files import program_sha256, read_json, write_json
from pipeline.config.schema import BaseSet, held_out_worlds
from pipeline.contract import Job, Step
from pipeline.core.truth import Truth
from pipeline.execution.pool import render_pool

SHARD_IMAGES = 100
"""Images per town and population: few, so that a base set shows many of both and a kill loses little."""

STEP = Step(
    "Render the random base training set.",
    writes=lambda folders: folders.written_dataset("base_set"),
    sections=lambda config, wildcards: ("base_set", "simulator", *held_out_worlds(config)),
    parallel=True,
)


def run(job: Job) -> None:
    """Render `base_set.images` random scenes into a YOLO and COCO data set.

    The last `validation_share` of each town's images are validation images. The images depend on the config alone, not on the threads.
    """
    config, root = job.config, job.scratch
    images = config.base_set.images
    shards = [(shard, min(SHARD_IMAGES, images - shard * SHARD_IMAGES)) for shard in range(-(-images // SHARD_IMAGES))]
    camera = config.simulator.get("camera", {})
    program = program_sha256()
    jobs = [(*shard, config.base_set, camera, config.unseen, root, program) for shard in shards]
    records: list[Record] = []
    with render_pool(min(job.threads, len(jobs))) as pool:
        for done, shard_records in enumerate(pool.imap(_render_shard, jobs), 1):
            records += shard_records
            job.progress(len(records), images, f"town {done} of {len(jobs)}")
    remove_leftovers(root, records)
    write_truth(root, records)
    move_dataset(root, job.output("truth").parent)


def _shard_file(out: Path, shard: int) -> Path:
    return out / "shards" / f"{shard:04d}.json"


def _render_shard(job: tuple[int, int, BaseSet, dict[str, Any], dict[str, str], Path, str]) -> list[Record]:
    """Render one town's images, unless its shard file records the same settings and the same code."""
    from pipeline.simulators.mujoco.lens import CameraSettings
    from pipeline.simulators.mujoco.random_scenes import scenes  # Needs a GL library, unlike the parent process.

    shard, count, base_set, camera, unseen, out, program = job
    key = {**base_set.model_dump(exclude={"images"}), "count": count, "camera": camera, "program": program}
    path = _shard_file(out, shard)
    if path.exists() and (done := read_json(path))["key"] == key:
        return [_record(plain) for plain in done["records"]]
    settings = CameraSettings.model_validate(camera)
    records = []
    first_validation = count - round(count * base_set.validation_share)
    for i, scene in enumerate(scenes(shard, count, base_set, settings, unseen)):
        split: Split = "val" if i >= first_validation else "train"
        index = shard * SHARD_IMAGES + i
        write_image(out, split, index, scene.image, scene.truth)
        records.append(Record(split, index, settings.width, settings.height, scene.truth, scene.attributes))
    write_json(path, {"key": key, "records": [_plain(record) for record in records]})
    return records


def _plain(record: Record) -> dict[str, Any]:
    return {**vars(record), "truth": vars(record.truth), "attributes": dict(record.attributes)}


def _record(plain: dict[str, Any]) -> Record:
    truth: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in plain["truth"].items()}
    return Record(**{**plain, "truth": Truth(**truth)})
