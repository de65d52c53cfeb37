"""The labelled sheet behind the filter's thresholds: judgements of two raters on 210 pedestrians near the border, against the filter's.

`python benchmarks/filter_sheet.py` prints how far the raters agree with each other, and how far each agrees with the thresholds, with
nearby ones and with other measures. The labels are in docs/filter-sheet. `--draw frames.parquet ...` draws new sheets and an unlabelled
table instead, from the kept frames of a study.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.tables import read_frames
from pipeline.config.composing import compose
from pipeline.core.visibility import MIN_VISIBLE_PIXELS
from pipeline.report.border import VISIBLE

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "filter-sheet"
CASES, COLUMNS, ROWS = 210, 7, 6
CONTEXT, TILE, CAPTION = 96, 176, 20
RATERS = ("rater_1", "rater_2")
PIXELS, CONTRAST = (6, 150), (2.0, 32.0)
"""Range of the deciding measure that counts as near the border; the other measure is near its threshold or clearly above."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--draw",
        type=Path,
        nargs="+",
        metavar="frames.parquet",
        help="draw new sheets from these frames instead",
    )
    parser.add_argument(
        "--out", type=Path, default=FOLDER, help="output folder (default: %(default)s)"
    )
    options = parser.parse_args()
    if options.draw:
        draw(options.draw, options.out)
    else:
        agreement(pd.read_csv(options.out / "labels.csv"))


def draw(frames: list[Path], out: Path) -> None:
    """Write sheet-N.jpg and cases.csv: frames near the border, one per test, in a random order that hides which measure chose them."""
    rows = pd.concat([read_frames(path) for path in frames], ignore_index=True)
    pixels, contrast = rows["visible_pixels"], rows["contrast"]
    small = pixels.between(*PIXELS) & (contrast >= CONTRAST[0])
    faint = contrast.between(*CONTRAST) & (pixels >= MIN_VISIBLE_PIXELS)
    rng = np.random.default_rng(0)
    chosen = pd.concat(
        [
            _spread(rows[small], "visible_pixels", CASES // 2, rng),
            _spread(rows[faint], "contrast", CASES, rng),
        ]
    )
    chosen = (
        chosen.drop_duplicates("test_id")
        .head(CASES)
        .sample(frac=1, random_state=0)
        .reset_index(drop=True)
    )
    for first in range(0, len(chosen), COLUMNS * ROWS):
        tiles = [
            tile(row, number)
            for number, row in chosen.iloc[first : first + COLUMNS * ROWS].iterrows()
        ]
        tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
        sheet = np.vstack(
            [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
        )
        cv2.imwrite(
            str(out / f"sheet-{first // (COLUMNS * ROWS) + 1}.jpg"),
            sheet[..., ::-1],
            [cv2.IMWRITE_JPEG_QUALITY, 88],
        )
    chosen[["test_id", "step", "visible_pixels", "whole_pixels", "contrast"]].to_csv(
        out / "cases.csv", index_label="number"
    )
    print(f"{out}: {len(chosen)} cases")


def _spread(rows: pd.DataFrame, measure: str, count: int, rng: np.random.Generator) -> pd.DataFrame:
    """About `count` rows, evenly spread over the logarithm of a measure, one per test."""
    rows = rows.sample(frac=1, random_state=rng.integers(2**31)).drop_duplicates("test_id")
    bins = np.floor(np.log2(rows[measure]) * 3)
    each = -(-count // bins.nunique())
    return rows.groupby(bins).head(each)


def tile(row: pd.Series, number: int) -> NDArray[np.uint8]:
    """The enlarged surroundings of a pedestrian, who is in the middle and unmarked, with the case number below."""
    image = decode_jpeg(row["image"])
    box = row[VISIBLE].to_numpy(float)
    side = max(CONTEXT, 1.6 * float(np.max(box[2:] - box[:2])))
    left, top = (box[:2] + box[2:]) / 2 - side / 2
    scale = TILE / side
    matrix = np.array([[scale, 0, -scale * left], [0, scale, -scale * top]])
    shown = cv2.warpAffine(
        image, matrix, (TILE, TILE), flags=cv2.INTER_CUBIC, borderValue=(255, 255, 255)
    )
    caption = np.full((CAPTION, TILE, 3), 255, np.uint8)
    cv2.putText(
        caption, str(number), (4, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA
    )
    return np.pad(
        np.vstack([np.asarray(shown, np.uint8), caption]),
        ((2, 2), (2, 2), (0, 0)),
        constant_values=255,
    )


def agreement(labels: pd.DataFrame) -> None:
    """Print how often measured visibility agrees with each rater, and the raters with each other."""
    first, second = (labels[name].to_numpy(bool) for name in RATERS)
    used = compose("default", []).filter
    pixels, contrast = labels["visible_pixels"].to_numpy(), labels["contrast"].to_numpy()
    detectability = contrast * np.sqrt(pixels)
    same = float(np.mean(first == second))
    chance = float(np.mean(first) * np.mean(second) + np.mean(~first) * np.mean(~second))
    print(
        f"{len(labels)} cases; seen by the first rater {first.sum()}, by the second {second.sum()}"
    )
    print(f"the raters agree in {same:.3f}, Cohen's kappa {(same - chance) / (1 - chance):.2f}")
    print(
        "of each rater:                         agreement     kept but not seen  seen but rejected"
    )
    for least in (15, 20, 25, 30):
        for threshold in (40, 50, 60, 70):
            mark = (
                "  <- in use"
                if (least, threshold) == (used.min_visible_pixels, used.min_detectability)
                else ""
            )
            line(
                f"pixels {least}, detectability {threshold}",
                (pixels >= least) & (detectability >= threshold),
                (first, second),
                mark,
            )
    for least in (20, 30, 40):
        for threshold in (6, 8, 10):
            line(
                f"pixels {least}, contrast {threshold}",
                (pixels >= least) & (contrast >= threshold),
                (first, second),
                "",
            )


def line(
    name: str,
    kept: NDArray[np.bool_],
    raters: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    mark: str,
) -> None:
    agree = ", ".join(f"{np.mean(kept == saw):.3f}" for saw in raters)
    unseen, lost = (
        ", ".join(f"{np.sum(wrong):2}" for wrong in cases)
        for cases in zip(*((kept & ~s, ~kept & s) for s in raters), strict=True)
    )
    print(f"{name:39}{agree:14}{unseen:>17}  {lost:>17}{mark}")


if __name__ == "__main__":
    main()
