"""Step `front-car-report`: the front-car study's figures and the one page that holds them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.artefacts.dataset import decode_jpeg, image_path, segments_path
from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.artefacts.front_car_results import Evaluation, Points
from pipeline.artefacts.results import read
from pipeline.config.schema import Config
from pipeline.progress import Progress
from pipeline.report import front_car_page as draw
from pipeline.report.page import render
from pipeline.report.style import save_png


def run(config: Config, *, points: Path, snapshots: Path, evaluation: Path, out: Path, plots: Path, progress: Progress) -> None:
    """Write the page `out` and its figures as plots/<name>.png. snapshots: truth.coco.json of the set that has all points."""
    known, result = read(points, Points), read(evaluation, Evaluation)
    space, constraints = config.front_car.space.space(), config.front_car.space.clauses()
    categories = space.categorise(np.array([space.encode(dict(point.values)) for point in known.points]))
    each, more = divmod(config.front_car.images, len(known.points))
    first = [i * each + min(i, more) for i in range(len(known.points))]
    images = [decode_jpeg(read_bytes(image_path(snapshots.parent, "train", index))) for index in first]
    classes = [np.asarray(Image.open(segments_path(snapshots.parent, "train", index))) for index in first]
    figures = {
        "table": draw.table(known, categories, space, constraints),
        "growth": draw.growth(known),
        "gallery": draw.gallery([point.name for point in known.points], images, classes),
        "by_condition": draw.by_condition(result, space, config.comparison.confidence),
    }
    for done, (name, figure) in enumerate(figures.items(), 1):
        save_png(figure, plots / f"{name}.png")
        progress(done, len(figures) + 1, name)
    write_bytes(out, render(draw.page(config.study, known, result, figures, config.comparison.confidence)).encode())
    progress(len(figures) + 1, len(figures) + 1, out.name)
