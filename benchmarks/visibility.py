"""Could a person answer "is there a pedestrian here?" Size and contrast of a nearby pedestrian in random weather, and the worst crops.

    python benchmarks/visibility.py [--tests 40] [--scenario F1 F2 ...] [--sheet worst.png]

Counts every second frame of unbraked random tests in which the pedestrian is within 25 m and at most half hidden.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from tqdm import tqdm

from pipeline.config.composing import CONF, compose, functional_scenario
from pipeline.core.episode import Frame
from pipeline.core.identity import CampaignId
from pipeline.core.statistics import wilson_interval
from pipeline.detectors.scripted import BlindDetector
from pipeline.execution.campaign import sampler_seed
from pipeline.simulators.mujoco.simulator import MujocoSimulator

NEAR_M = 25.0
HALF = 0.5
CROP = 128
WORST = 50


class Seen(NamedTuple):
    """A frame that counts."""

    scenario: str
    distance_m: float
    frame: Frame

    @property
    def contrast(self) -> float:
        return self.frame.truth.contrast

    @property
    def answerable(self) -> bool:
        """The same limits as in the metrics."""
        return not self.frame.truth.barely_visible


def frames(name: str, tests: int) -> list[Seen]:
    """The frames of a scenario that count."""
    described = functional_scenario(name)
    space, simulator = (
        described.logical_space(),
        MujocoSimulator(described, compose("default", []).car),
    )
    found = []
    try:
        points = space.sample(
            tests, np.random.default_rng(sampler_seed(CampaignId(name, "random", "base", 17)))
        )
        for point in tqdm(points, desc=name, unit="test", mininterval=2):
            episode = simulator.execute(space.decode(point), BlindDetector(), keep_every=2)
            away = np.hypot(
                *(
                    np.asarray(episode.signals[f"pedestrian_{axis}_m"])
                    - np.asarray(episode.signals[f"ego_{axis}_m"])
                    for axis in "xy"
                )
            )
            for kept in episode.frames:
                truth, distance = kept.frame.truth, float(away[kept.step])
                if (
                    distance <= NEAR_M
                    and truth.whole_pixels
                    and truth.visible_pixels >= HALF * truth.whole_pixels
                ):
                    found.append(Seen(name, distance, kept.frame))
    finally:
        simulator.close()
    return found


def sheet(worst: list[Seen], columns: int = 10) -> np.ndarray:
    """Crops around the pedestrians, three times as large, with contrast in grey levels and distance."""
    tiles = []
    for seen in worst:
        left, top, right, bottom = seen.frame.truth.whole_box or (0, 0, 1, 1)
        half = int(max(20, 0.8 * (bottom - top)))
        padded = np.pad(seen.frame.image, ((half, half), (half, half), (0, 0)))
        x, y = int(left + right) // 2, int(top + bottom) // 2
        tile = cv2.resize(
            padded[y : y + 2 * half, x : x + 2 * half], (CROP, CROP), interpolation=cv2.INTER_CUBIC
        )
        text = f"{seen.scenario} {seen.distance_m:.0f}m c{seen.contrast:.0f} {seen.frame.truth.visible_pixels}px"
        cv2.putText(
            tile, text, (2, CROP - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.32, (255, 255, 0), 1, cv2.LINE_AA
        )
        tiles.append(tile)
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles) - columns + 1, columns)]
    return np.vstack(rows)[..., ::-1]


def main() -> None:
    """Print the share of answerable frames by scenario, and draw the worst."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=40, help="tests per scenario")
    parser.add_argument(
        "--scenario",
        nargs="+",
        default=sorted(path.stem for path in (CONF / "scenario").glob("[!_]*.yaml")),
    )
    parser.add_argument("--sheet", type=Path, default=Path("worst.png"))
    options = parser.parse_args()
    every: list[Seen] = []
    for name in options.scenario:
        found = frames(name, options.tests)
        answerable = sum(seen.answerable for seen in found)
        print(
            f"{name}: {answerable} of {len(found)} frames ({answerable / max(1, len(found)):.1%})",
            flush=True,
        )
        every += found
    answerable = sum(seen.answerable for seen in every)
    low, high = wilson_interval(answerable, len(every))
    print(
        f"all: {answerable} of {len(every)} frames ({answerable / len(every):.1%}, {low:.1%} to {high:.1%})"
    )
    # Avoids repeats of one test: one frame per scenario and whole metre.
    worst: dict[tuple[str, int], Seen] = {}
    for seen in sorted(every, key=lambda seen: seen.contrast):
        worst.setdefault((seen.scenario, int(seen.distance_m)), seen)
    cv2.imwrite(str(options.sheet), sheet(list(worst.values())[:WORST]))


if __name__ == "__main__":
    main()
