"""Step `front_car_report`: draws the front-car study's figures and writes its page."""

from __future__ import annotations

import io
from itertools import accumulate

import numpy as np
from PIL import Image

from pipeline.artefacts.dataset import decode_jpeg, image_path, segments_path
from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.artefacts.front_car_results import Evaluation, Points
from pipeline.artefacts.results import read
from pipeline.contract import Job, Step

FIGURES = ("table", "growth", "gallery", "by_condition")

STEP = Step(
    "Write the front-car study's page.",
    reads=lambda folders, wildcards: {
        "points": f"{folders.root}/points.json",
        "images": folders.dataset("snapshots/covered")["images"],
        "segments": f"{folders.root}/snapshots/covered/segments/",
        "evaluation": f"{folders.root}/evaluation.json",
    },
    writes=lambda folders: {
        "page": f"{folders.root}/front_car.html",
        "plots": [f"{folders.root}/plots/{name}.png" for name in FIGURES],
    },
    sections=("study", "front_car.space", "front_car.images"),
)


def run(job: Job) -> None:
    """Write the page and its figures."""
    from pipeline.report import front_car_page as draw
    from pipeline.report.page import render
    from pipeline.report.style import save_png

    root, plots = job.input("images").parent, {path.stem: path for path in job.outputs("plots")}
    points, result = read(job.input("points"), Points), read(job.input("evaluation"), Evaluation)
    space = job.config.front_car.space.space()
    encoded = np.array([space.encode(dict(point.values)) for point in points.points])
    images, classes = [], []
    for index in [0, *accumulate(job.config.front_car.images_of(len(points.points)))][:-1]:
        images.append(decode_jpeg(read_bytes(image_path(root, "train", index))))
        segments = read_bytes(segments_path(root, "train", index))
        classes.append(np.asarray(Image.open(io.BytesIO(segments))))
    figures = {
        "table": draw.table(points, space.categorise(encoded), space),
        "growth": draw.growth(points),
        "gallery": draw.gallery([point.name for point in points.points], images, classes),
        "by_condition": draw.by_condition(result, space),
    }
    for done, (name, figure) in enumerate(figures.items(), 1):
        save_png(figure, plots[name])
        job.progress(done, len(figures) + 1, name)
    page = draw.page(job.config.study, points, result, figures)
    write_bytes(job.output("page"), render(page).encode())
    job.progress(len(figures) + 1, len(figures) + 1, job.output("page").name)
