"""Why does a version still fail? Drives its failed held-out tests again, each time with one part of the loop replaced.

    python benchmarks/what_is_left.py adaptive [--scenario F2star]

Reads params.yaml and the finished study that it describes. A part that repairs many failures is the part to work on:

    as it was       nothing replaced; repairs nothing, or the study belongs to other code
    true boxes      detections that touch the pedestrian (IoU above 0.1) get the true box and keep their confidence
    full confidence reported and unreported boxes that match the pedestrian get confidence 1
    both            true boxes with confidence 1
    full braking    the brake acts fully from the detector's threshold on, instead of in proportion to the confidence
    any confidence  the brake acts from a confidence of 0.05 on
    oracle          a detector that reports every visible pedestrian; what it does not repair, no detector can
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from outcomes import held_out_tests

from pipeline.artefacts.calibration_results import read_calibration
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.points import concrete
from pipeline.config.components import make_detector, make_simulator
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.core.boxes import iou
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.kpi import evaluate
from pipeline.core.matching import TOUCH_IOU
from pipeline.detectors.calibrated import as_tested
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.progress import Progress
from pipeline.protocols import Detector


@dataclass(frozen=True)
class Helped:
    """A detector that is told the truth about the pedestrian: where it is, or that it is sure of it.

    least: smallest IoU with the visible box of a detection that is helped. boxes, scores: what is replaced.
    """

    detector: Detector
    least: float
    boxes: bool = False
    scores: bool = False

    def detect(self, frame: Frame) -> Detections:
        """The other detector's report with the true box, or confidence 1, in place of that of detections on the pedestrian."""
        found, truth = self.detector.detect(frame), frame.truth.visible_box
        if truth is None or not len(found.boxes):
            return found
        helped = iou(found.boxes, [truth])[:, 0] > self.least
        boxes = np.where(helped[:, None] & self.boxes, np.asarray(truth, np.float32), found.boxes)
        scores = np.where(helped & self.scores, 1.0, found.scores)
        order = np.argsort(-scores, kind="stable")
        return Detections(boxes[order].astype(np.float32), scores[order].astype(np.float32))


@dataclass(frozen=True)
class Part:
    """A changed loop. car: from the study's car; detector: from the version's detector."""

    car: Callable[[Car], Car] = lambda car: car
    detector: Callable[[Detector], Detector] = lambda detector: detector


def parts(match_iou: float) -> Mapping[str, Part]:
    """Every changed loop by name."""
    return {
        "as it was": Part(),
        "true boxes": Part(detector=partial(Helped, least=TOUCH_IOU, boxes=True)),
        "full confidence": Part(detector=partial(Helped, least=match_iou, scores=True)),
        "both": Part(detector=partial(Helped, least=TOUCH_IOU, boxes=True, scores=True)),
        "full braking": Part(car=lambda car: replace(car, aeb=replace(car.aeb, law="threshold"))),
        "any confidence": Part(
            car=lambda car: replace(car, aeb=replace(car.aeb, brakes_from=0.05))
        ),
        "oracle": Part(detector=lambda detector: VisiblePixelOracle()),
    }


def main() -> None:
    config = load(PARAMS)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("version", choices=[str(version) for version in config.versions])
    parser.add_argument(
        "--scenario", nargs="+", choices=config.held_out, default=list(config.held_out)
    )
    options = parser.parse_args()
    print(what_is_left(config, options.version, options.scenario).to_markdown())


def what_is_left(config: Config, version: str, scenarios: list[str]) -> pd.DataFrame:
    """The failures of a version that each part repairs: a row for each part, a column for each scenario."""
    tests, folders = held_out_tests(config), Folders(config)
    section = as_tested(config.detector, read_calibration(folders.calibrations([version])))
    detector, columns = make_detector(section, Path(folders.detector(version))), {}
    with Progress("what is left") as progress:
        for scenario in scenarios:
            failed = tests.query("scenario == @scenario and version == @version and failure")
            repaired = {"failures": len(failed)}
            for done, (name, part) in enumerate(parts(config.campaign.match_iou).items(), 1):
                repaired[name] = len(failed) - _failures(config, scenario, failed, part, detector)
                progress(done, len(parts(0.5)), f"{scenario}: {name}")
            columns[scenario] = repaired
    return pd.DataFrame(columns).rename_axis("part").reset_index().set_index("part")


def as_table(left: Sequence[pd.DataFrame], version: str) -> str:
    """What `what_is_left` found in one or more studies, summed, as Markdown."""
    repaired = sum(left[1:], start=left[0])
    scenarios = [name.replace("star", "\\*") for name in repaired]
    lines = [
        f"| failures of `{version}` | {' | '.join(scenarios)} | all |",
        "|---" * (2 + len(scenarios)) + "|",
    ]
    return "\n".join(
        [
            *lines,
            *(
                f"| {part} | {' | '.join(map(str, [*row, row.sum()]))} |"
                for part, row in repaired.iterrows()
            ),
        ]
    )


def _failures(
    config: Config, scenario: str, tests: pd.DataFrame, part: Part, detector: Detector
) -> int:
    space, helped = config.space(scenario), part.detector(detector)
    simulator = make_simulator(config.simulator, config.scenarios[scenario], part.car(config.car))
    episodes = (simulator.execute(concrete(row, space), helped) for _, row in tests.iterrows())
    return sum(
        evaluate(episode.signals, config.campaign.failure_threshold_s).failure
        for episode in episodes
    )


if __name__ == "__main__":
    main()
