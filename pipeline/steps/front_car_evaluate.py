"""Step `front-car-evaluate`: both detectors of the forward vehicle on the same test snapshots of every feasible point."""

from __future__ import annotations

from pathlib import Path

from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.artefacts.front_car_results import DetectorResult, Evaluation, Judged, Points
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.results import read, write
from pipeline.config.schema import Config
from pipeline.core import kpi
from pipeline.core.detections import Detections
from pipeline.core.statistics import mcnemar
from pipeline.detectors.evaluation import evaluate, matching_of
from pipeline.learning.versions import detect_all
from pipeline.progress import Progress


def run(config: Config, *, points: Path, test: Path, models: list[Path], out: Path, progress: Progress) -> None:
    """Write evaluation.json. test: truth.coco.json of the test set. models: model.json of `existing` and of `covered`."""
    threshold = float(config.detector.get("threshold", 0.5))
    known, images = read(points, Points), read_dataset(test.parent, "val")
    space, each = config.front_car.space.space(), config.front_car.test_images
    results = []
    for done, path in enumerate(models, 1):
        card = read_card(path)
        found = detect_all(path.with_name("model.onnx"), images)
        right = [_right(detections, images, index, threshold) for index, detections in enumerate(found)]
        judged = []
        for i, row in enumerate(config.front_car.space.feasible_points()):
            values = {name: str(value) for name, value in space.decode(row.astype(float)).items()}
            judged.append(Judged(values=values, right=tuple(right[i * each : (i + 1) * each])))
        learnt = known.existing if card.version == "existing" else len(known.points)
        metrics = evaluate(found, images, threshold)
        results.append(
            DetectorResult(
                version=card.version, learnt_points=learnt, images=config.front_car.images, metrics=metrics, points=tuple(judged)
            )
        )
        progress(done, len(models), f"{card.version}: right on {sum(right)} of {len(right)}")
    wrong = [[not right for point in result.points for right in point.right] for result in results]
    write(out, Evaluation(threshold=threshold, p_value=mcnemar(*wrong).p_value, detectors=tuple(results)))


def _right(detections: Detections, images: ImageSet, index: int, threshold: float) -> bool:
    """Whether the forward vehicle is found if it is there, and nothing else is."""
    matching = matching_of(detections, images, index, threshold)
    box = images.boxes[index]
    there = box[2] > box[0] and not kpi.barely_visible(int(images.visible_pixels[index]), float(images.contrast[index]))
    found = matching.confidence > 0 or not there
    return bool(found and matching.far + matching.localisation + matching.duplicate == 0)
