"""Films of a campaign's kept frames, one a failure, in the layout of FiftyOne's `CSVDataset`."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.frame_tags import tags_of_tests
from pipeline.artefacts.stamps import remove
from pipeline.artefacts.tables import read_frames
from pipeline.report.replays import write_mp4


def write_films(frames: Path, out: Path, rate_hz: float) -> int:
    """Write out/data/<test_id>.mp4 and out/labels.csv, with the tags of each test.

    Removes the films of an earlier export in `out`. Without tests.parquet beside the frames no test
    counts as a failure, so there are no films.

    Args:
        frames: frames.parquet of a campaign.
        out: Folder to write.
        rate_hz: Steps of the camera per second.

    Returns:
        The number of films.
    """
    tags = {}
    for test, tags_of_test in tags_of_tests(frames).items():
        if tags_of_test["outcome"] == "failure":
            tags[test] = tags_of_test
    table = read_frames(frames).sort_values(["test_id", "step"], kind="stable")
    remove(out / "data")
    (out / "data").mkdir(parents=True)
    rows = []
    for test, kept in table[table["test_id"].isin(tags)].groupby("test_id"):
        path = out / "data" / f"{test}.mp4"
        images = [decode_jpeg(image) for image in kept["image"]]
        height, width = (side // 2 * 2 for side in images[0].shape[:2])
        every = kept["step"].diff().median() if len(kept) > 1 else 1
        even = [image[:height, :width] for image in images]
        write_mp4(even, path, max(1, round(rate_hz / every)))
        rows.append({"filepath": path.name, "test_id": test, **tags[str(test)]})
    labels = pd.DataFrame(rows, columns=None if rows else ["filepath", "test_id"])
    text = labels.to_csv(index=False, lineterminator="\n", float_format="%.6g")
    write_bytes(out / "labels.csv", text.encode())
    return len(rows)
