"""Step `front_car_evaluate`: tests both detectors of the forward vehicle.

Both see the same snapshots of every feasible point.
"""

from __future__ import annotations

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.front_car_results import DetectorResult, Evaluation, Judged, Points
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.results import read, write
from pipeline.contract import Job, Step
from pipeline.core.detections import Detections
from pipeline.core.truth import Truth

VERSIONS = ("existing", "covered")


STEP = Step(
    "Test the detectors of the forward vehicle.",
    reads=lambda folders, wildcards: {
        "points": f"{folders.root}/points.json",
        **folders.dataset("snapshots/test"),
        "cards": [folders.version(name, "detectors")["card"] for name in VERSIONS],
        "models": [folders.version(name, "detectors")["onnx"] for name in VERSIONS],
    },
    writes=lambda folders: {"evaluation": f"{folders.root}/evaluation.json"},
    sections=("front_car.space", "front_car.test_images", "front_car.images", "detector"),
)


def run(job: Job) -> None:
    """Write evaluation.json."""
    from pipeline.detectors.evaluation import evaluate, truths_of
    from pipeline.learning.versions import detect_all

    threshold, settings = job.config.threshold, job.config.front_car
    points = read(job.input("points"), Points)
    images = read_dataset(job.input("truth").parent, "val")
    space, each = settings.space.space(), settings.test_images
    results = []
    models = list(zip(job.inputs("cards"), job.inputs("models"), strict=True))
    for done, (path, model) in enumerate(models, 1):
        card = read_card(path)
        detections = detect_all(model, images, job.progress)
        right = [
            is_right(in_image, truth, threshold)
            for in_image, truth in zip(detections, truths_of(images), strict=True)
        ]
        judged = []
        for i, row in enumerate(settings.space.feasible_points()):
            values = {name: str(value) for name, value in space.decode(row.astype(float)).items()}
            judged.append(Judged(values=values, right=tuple(right[i * each : (i + 1) * each])))
        result = DetectorResult(
            version=card.version,
            learnt_points=points.existing if card.version == "existing" else len(points.points),
            images=settings.images,
            metrics=evaluate(detections, images, threshold),
            points=tuple(judged),
        )
        results.append(result)
        job.progress(done, len(models), f"{card.version}: right on {sum(right)} of {len(right)}")
    write(job.output("evaluation"), Evaluation(threshold=threshold, detectors=tuple(results)))


def is_right(detections: Detections, truth: Truth, threshold: float) -> bool:
    """Whether the detector finds the forward vehicle if it is there, and nothing else."""
    from pipeline.detectors.evaluation import matching_at

    matching = matching_at(threshold, detections, truth)
    there = truth.visible_box is not None and not truth.barely_visible
    return (matching.confidence > 0 or not there) and matching.false_positives == 0
