"""`coverage score`, `propose`, `plan` and `verify` on the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.__main__ import main

pytestmark = pytest.mark.usefixtures("short_annealing")

SPACE = """
variables:
  weather: {values: [sunny, cloudy, rainy]}
  fog: {interval: [0, 100], cuts: [50], unit: "%"}
  lanes: {values: [1, 2]}
  current_lane: {values: [1, 2]}
constraints:
  - [lanes = 2, current_lane != 2]
"""
POINTS = "weather,fog,lanes,current_lane\nsunny,3,1,1\nrainy,55.5,2,2\ncloudy,100,2,1\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "space.yaml").write_text(SPACE)
    (tmp_path / "points.csv").write_text(POINTS)
    return tmp_path


def said(capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> Any:
    capsys.readouterr()
    assert main(["coverage", *map(str, words), "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_score_counts_by_hand(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    space, points = folder / "space.yaml", folder / "points.csv"
    result = said(capsys, "score", "--space", space, "--points", points, "--k", 2)
    # Planes of 6, 6, 6, 4, 4 and 3 feasible cells; the three points cover 3 cells of each, and 2 of
    # fog x lanes.
    assert (result["numerator"], result["denominator"], result["k"]) == (17, 29, 2)
    assert result["coverage"] == pytest.approx(17 / 29)
    assert [row["numerator"] for row in result["by_k"]] == [9, 17]
    assert (
        result["infeasible"] == [{"lanes": "1", "current_lane": "2"}]
        and result["uncovered_cells"] == 12
    )
    assert (
        len(result["next"]) == 5 and {"weather": "rainy", "fog": "[0, 50)"} in result["uncovered"]
    )


@pytest.mark.parametrize(("operator", "expected"), [("product", 8), ("sum", 12), ("max", 8)])
def test_score_uses_weights(
    operator: str, expected: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "w.yaml").write_text(
        "variables: {a: {values: [x, y], weights: {y: 3}}, b: {values: [x, y], weights: [1, 1]}}"
    )
    (folder / "w.csv").write_text("a,b\nx,x\ny,y\ny,y\n")
    result = said(
        capsys,
        "score",
        "--space",
        folder / "w.yaml",
        "--points",
        folder / "w.csv",
        "--operator",
        operator,
    )
    assert (result["numerator"], result["denominator"]) == (3, expected)


def test_score_draws_and_prints(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "--space",
        str(folder / "space.yaml"),
        "--points",
        str(folder / "points.csv"),
        "--figures",
        str(folder / "figures"),
    ]
    assert main(["coverage", "score", *words]) == 0
    text = capsys.readouterr().out
    assert (
        "2  17       29      58.62 %" in text
        and "What to collect next" in text
        and "lanes = 1, current_lane = 2" in text
    )
    for name in ("growth", "planes"):
        assert np.asarray(Image.open(folder / "figures" / f"{name}.png")).std() > 10


def test_the_least_covered_planes_are_those_of_all(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"c{i}" for i in range(20)]
    (folder / "wide.yaml").write_text(
        f"variables: {{{', '.join(f'{name}: {{values: [x, y]}}' for name in names)}}}"
    )
    rows = [["x" if j > 16 or i >> j % 5 & 1 else "y" for j in range(20)] for i in range(32)]
    (folder / "wide.csv").write_text("\n".join(map(",".join, [names, *rows])))
    words = [
        "score",
        "--space",
        str(folder / "wide.yaml"),
        "--points",
        str(folder / "wide.csv"),
        "--k",
        "3",
    ]
    assert said(capsys, *words)["planes"][0]["conditions"] == ["c17", "c18", "c19"]
    assert main(["coverage", *words]) == 0
    assert (
        "Least covered of 1,140 planes" in (text := capsys.readouterr().out)
        and "c17 × c18 × c19" in text
    )


def test_labels_with_one_name_in_two_folders_are_two_images(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "space.yaml").write_text(
        "variables: {weather: {values: [sunny, rainy]}, objects: {interval: [0, 9], cuts: [1, 3]}}"
    )
    for name, count in (("train/1", 3), ("val/1", 0)):
        (folder / "labels" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "labels" / f"{name}.txt").write_text("0 0.5 0.5 0.1 0.1\n" * count)
    (folder / "meta.csv").write_text("file_name,weather\nval/1.jpg,rainy\ntrain/1.jpg,sunny\n")
    words = [
        "score",
        "--space",
        folder / "space.yaml",
        "--metadata",
        folder / "meta.csv",
        "--points",
        folder,
    ]
    assert said(capsys, *words)["points"] == 2
    (folder / "meta.csv").write_text("file_name,weather\n1.jpg,rainy\n")
    assert main(["coverage", *map(str, words)]) == 2
    assert "there is none for train/1, and several images are called 1" in capsys.readouterr().err


def test_images_of_coco_and_yolo_are_points(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "space.yaml").write_text(
        "variables: {weather: {values: [sunny, rainy]}, objects: {interval: [0, 9], cuts: [1, 3]}}"
    )
    images = [{"id": i, "file_name": f"{name}.jpg"} for i, name in enumerate("abc")]
    annotations = [{"id": i, "image_id": image} for i, image in enumerate((0, 0, 0, 2))]
    (folder / "truth.json").write_text(
        json.dumps({"images": images, "annotations": annotations, "categories": []})
    )
    (folder / "labels").mkdir()
    for name, count in (("a", 3), ("b", 0), ("c", 1)):
        (folder / "labels" / f"{name}.txt").write_text("0 0.5 0.5 0.1 0.1\n" * count)
    (folder / "meta.csv").write_text("file_name,weather\nc.jpg,rainy\na.jpg,sunny\nb.jpg,sunny\n")
    words = [
        "score",
        "--space",
        folder / "space.yaml",
        "--metadata",
        folder / "meta.csv",
        "--points",
    ]
    for points in (folder / "truth.json", folder):
        result = said(capsys, *words, points)
        assert (result["numerator"], result["denominator"], result["points"]) == (3, 6, 3)
    (folder / "meta.csv").write_text("file_name,weather\nc.jpg,rainy\na.jpg,sunny\n")
    assert main([*map(str, ["coverage", *words, folder / "truth.json"])]) == 2
    assert "there is none for b.jpg" in capsys.readouterr().err


@pytest.mark.parametrize("exact", [[], ["--exact"]])
def test_propose_reaches_full_coverage_with_few_points(
    exact: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    space, output = folder / "space.yaml", folder / "next.csv"
    words = [
        "propose",
        "--space",
        space,
        "--points",
        folder / "points.csv",
        "--count",
        4,
        *exact,
        "--output",
        output,
    ]
    result = said(capsys, *words)
    assert result["gain"] == 12 and result["after"]["coverage"] == 1 and result["count"] == 4
    table = pd.read_csv(output)
    assert list(table.columns) == ["weather", "fog", "lanes", "current_lane"] and len(table) == 4
    both = folder / "both.csv"
    both.write_text(POINTS + "".join(output.read_text().splitlines(keepends=True)[1:]))
    assert said(capsys, "score", "--space", space, "--points", both)["coverage"] == 1
    assert said(capsys, "propose", "--space", space, "--points", both)["count"] == 0


def test_propose_completes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "propose",
        "--space",
        folder / "space.yaml",
        "--points",
        folder / "points.csv",
        "--complete",
    ]
    result = said(capsys, *words)
    # A single plane asks for three only.
    assert (
        result["after"]["coverage"] == 1
        and result["optimal"]
        and result["count"] == result["needed_at_least"] == 4
    )
    single = said(capsys, *words, "--k", 1)
    assert single["count"] == single["needed_at_least"] == 0
    assert main(["coverage", *map(str, words)]) == 0
    text = capsys.readouterr().out
    assert (
        "more points 29/29 = 100.00 %" in text and "This is the smallest possible number." in text
    )


def test_propose_begins_from_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = said(capsys, "propose", "--space", folder / "space.yaml", "--k", 4, "--exact")
    assert result["gain"] == 1 and result["optimal"] and result["before"]["numerator"] == 0


@pytest.mark.parametrize("strength", [1, 2, 3, 4])
def test_a_plan_is_valid_and_its_table_reads_back(
    strength: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    space, output = folder / "space.yaml", folder / "plan.csv"
    words = [
        "plan",
        "--space",
        space,
        "--strength",
        strength,
        "--include",
        folder / "points.csv",
        "--output",
        output,
    ]
    result = said(capsys, *words)
    assert (
        result["size"] >= result["lower_bound"]
        and result["cells"] == {1: 9, 2: 29, 3: 39, 4: 18}[strength]
    )
    assert output.read_text().splitlines()[0] == "weather,fog,lanes,current_lane"
    assert len(pd.read_csv(output)) == result["size"]
    checked = said(capsys, "verify", "--space", space, "--points", output, "--strength", strength)
    assert checked["valid"] and checked["cells"] == result["cells"]
    shorter = folder / "shorter.csv"
    shorter.write_text("\n".join(output.read_text().splitlines()[:3]) + "\n")
    assert (
        said(
            capsys, "verify", "--space", space, "--points", shorter, "--strength", strength, code=1
        )["missing_cells"]
        > 0
    )


MIXED = """planes:
  sight: {conditions: [weather, fog, lanes]}
combinations:
  - {of: {weather: rainy, lanes: 2}, weight: 4}
  - {of: {fog: "[50, 100]", weather: cloudy, current_lane: 2}}
"""


def test_named_planes_and_combinations_count_in_every_command(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    space, points, plan = folder / "space.yaml", folder / "points.csv", folder / "plan.csv"
    pairs = said(capsys, "plan", "--space", space, "--output", plan)
    space.write_text(SPACE + MIXED)
    result = said(capsys, "score", "--space", space, "--points", points)
    # Of the pairs, one cell wants four points instead of one; the plane of three has 12 cells, the
    # last combination is a plane of its own.
    assert [row["denominator"] for row in result["by_k"]] == [9, 32] and (
        result["numerator"],
        result["denominator"],
    ) == (17 + 3, 32 + 12 + 1)
    assert result["named_planes"][0] | {"coverage": 0} == {
        "name": "sight",
        "conditions": ["weather", "fog", "lanes"],
        "strength": 3,
        "numerator": 3,
        "denominator": 12,
        "coverage": 0,
    }
    assert [(row["weight"], row["points"]) for row in result["combinations"]] == [(4, 1), (1, 0)]
    assert said(capsys, "verify", "--space", space, "--points", plan, code=1)["missing_cells"] > 0
    mixed = said(capsys, "plan", "--space", space, "--output", plan)
    assert (
        mixed["cells"] == 29 + 12 + 1 and mixed["optimal"] and mixed["size"] == 12 > pairs["size"]
    )
    checked = said(capsys, "verify", "--space", space, "--points", plan)
    assert checked["valid"] and checked["cells"] == mixed["cells"]
    completed = said(capsys, "propose", "--space", space, "--points", points, "--complete")
    assert completed["before"]["numerator"] == 20 and completed["after"]["coverage"] == 1
    assert main(["coverage", "plan", "--space", str(space)]) == 0
    assert (
        "12 points cover all 42 feasible combinations of 2 conditions and 3 of sight, and 2 single "
        "ones;" in capsys.readouterr().out
    )
    assert main(["coverage", "score", "--space", str(space), "--points", str(points)]) == 0
    text = capsys.readouterr().out
    assert (
        "sight: 3 of weather × fog × lanes" in text and "k = 2 with these: 20/45 = 44.44 %" in text
    )


def test_a_space_that_cannot_be_planned_is_refused_with_the_number_of_points(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ", ".join(map(str, range(5000)))
    (folder / "wide.yaml").write_text(
        f"variables:\n  a: {{values: [{names}]}}\n  b: {{values: [{names}]}}\n"
    )
    assert main(["coverage", "plan", "--space", str(folder / "wide.yaml")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        "blindspot coverage: a plan needs at least 25,000,000 points, at most 100,000 can be "
        "planned; take fewer values or a lower strength"
    )


def test_cells_are_counted_before_the_work(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    space, points = folder / "space.yaml", folder / "points.csv"
    # Sizes 3, 2, 2 and 2: 9 categories, 30 pairs, 44 triples.
    for most, verb, k, code in (
        (39, "score", 2, 0),
        (38, "score", 2, 2),
        (44, "propose", 3, 0),
        (43, "propose", 3, 2),
    ):
        monkeypatch.setattr("pipeline.report.coverage_answers.MOST_CELLS", most)
        assert (
            main(["coverage", verb, "--space", str(space), "--points", str(points), "--k", str(k)])
            == code
        )
        assert (f"--k = {k}: about {most + 1} cells are more than" in capsys.readouterr().err) == (
            code == 2
        )


def test_planes_with_too_many_cells_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names, values = "abcdef", ", ".join(map(str, range(100)))
    head = "variables: {" + ", ".join(f"{name}: {{values: [{values}]}}" for name in names) + "}\n"
    for extra, key in (
        ("planes: {all: {conditions: [a, b, c, d, e, f]}}", "planes.all"),
        ("combinations: [{of: {a: 1, b: 1, c: 1, d: 1, e: 1, f: 1}}]", "combinations[1]"),
    ):
        (folder / "wide.yaml").write_text(head + extra)
        assert main(["coverage", "plan", "--space", str(folder / "wide.yaml")]) == 2
        assert (
            f"wide.yaml: {key}: about 1e+12 cells are more than the 2e+08 that fit"
            in capsys.readouterr().err
        )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["score", "--points", "points.csv", "--k", "5"],
            "--k must be in [1, 4], the number of conditions; got 5",
        ),
        (["plan", "--strength", "0"], "--strength must be in [1, 4]"),
        (
            ["score", "--points", "nowhere.csv"],
            "nowhere.csv: expected a CSV or parquet table, got no such file",
        ),
        (["score", "--points", "space.yaml"], "space.yaml: expected a CSV or parquet table, got"),
        (["propose", "--count", "0"], "--count must be at least 1, got 0"),
        (["plan", "--seconds", "-1"], "--seconds must be at least 0"),
        (["plan", "--seconds", "nan"], "--seconds must be at least 0 and finite, got nan"),
        (["plan", "--seconds", "inf"], "--seconds must be at least 0 and finite, got inf"),
        (["plan", "--cpu-seconds", "nan"], "--cpu-seconds must be at least 0 and finite, got nan"),
        (
            ["plan", "--cpu-seconds", "1", "--seconds", "1"],
            "--seconds and --cpu-seconds both limit polish; give one of them",
        ),
        (["plan", "--strength", "7"], "--strength must be in [1, 4]"),
        (
            ["propose", "--complete", "--count", "3"],
            "--complete proposes as many points as are needed; leave out --count",
        ),
        (["plan", "--cpu-seconds", "5"], "--cpu-seconds limits polish; add --effort polish"),
        (["plan", "--seconds", "5"], "--seconds limits polish; add --effort polish"),
        (["propose", "--seconds", "5"], "--seconds limits --exact; add --exact"),
        (["propose", "--complete", "--exact"], "leave out --exact"),
        (["propose", "--complete", "--seconds", "0"], "leave out --seconds"),
        (
            ["propose", "--metadata", "points.csv"],
            "--metadata gives the conditions of images; name the images by --points",
        ),
        (
            ["score", "--points", "points.csv", "--metadata", "points.csv"],
            "--metadata goes with JSON of COCO, BDD100K or OpenLABEL",
        ),
        (
            ["score", "--points", "broken.csv"],
            "row 1 breaks the constraint 'lanes = 2 or current_lane != 2'",
        ),
        (["score", "--points", "empty.json"], "by --metadata"),
    ],
)
def test_bad_input_is_named(
    words: list[str], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "broken.csv").write_text("weather,fog,lanes,current_lane\nsunny,3,1,2\n")
    (folder / "empty.json").write_text('{"images": [], "annotations": []}')
    at = [
        str(folder / word) if word.endswith((".csv", ".yaml", ".json")) else word for word in words
    ]
    assert main(["coverage", at[0], "--space", str(folder / "space.yaml"), *at[1:]]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plan", "--output", "."], "expected a file to write to, got a folder"),
        (["plan", "--output", "nowhere/plan.csv"], "nowhere, which is not a folder"),
        (["propose", "--output", "points.csv/next.csv"], "points.csv, which is not a folder"),
        (
            ["plan", "--output", "/dev/null"],
            "/dev/null: expected a file to write to, got something else",
        ),
        (
            ["plan", "--output", "/proc/plan.csv"],
            "/proc/plan.csv: expected a file to write to, got",
        ),
        (
            ["plan", "--output", "plan.xlsx"],
            "plan.xlsx: expected a name that ends in .csv or .parquet, got .xlsx",
        ),
        (
            ["score", "--points", "points.csv", "--figures", "points.csv"],
            "points.csv: expected a folder to write to, got something else",
        ),
        (
            ["score", "--points", "points.csv", "--figures", "nowhere/figures"],
            "nowhere, which is not a folder",
        ),
    ],
)
def test_outputs_are_checked_before_the_work(
    words: list[str],
    message: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.iterdir())
    assert (
        main(["coverage", words[0], "--space", "missing.yaml", *words[1:]]) == 2
    )  # The space file would be read first.
    error = capsys.readouterr().err
    assert message in error and len(error.splitlines()) == 1 and sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["propose", "--points"], "points"),
        (["plan", "--include"], "include"),
        (["export", "--space"], "space"),
    ],
)
def test_no_output_replaces_an_input(
    words: list[str], option: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = folder / ("space.yaml" if option == "space" else "points.csv")
    before = given.read_bytes()
    space = [] if option == "space" else ["--space", str(folder / "space.yaml")]
    assert (
        main(["coverage", *words, str(given), *space, "--output", str(folder / "." / given.name)])
        == 2
    )
    assert (
        f"--output: expected another file than --{option}, got " in capsys.readouterr().err
        and given.read_bytes() == before
    )


def test_the_strongest_plan_combines_six_conditions(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "eight.yaml").write_text(
        "variables: {" + ", ".join(f"{name}: {{values: [x, y]}}" for name in "abcdefgh") + "}"
    )
    assert main(["coverage", "plan", "--space", str(folder / "eight.yaml"), "--strength", "7"]) == 2
    assert "--strength must be in [1, 6], got 7" in capsys.readouterr().err


def test_weights_of_zero_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "zero.yaml").write_text(
        "variables: {weather: {values: [sunny, cloudy, rainy], weights: [0, 0, 0]}}"
    )
    assert (
        main(
            [
                "coverage",
                "score",
                "--space",
                str(folder / "zero.yaml"),
                "--points",
                str(folder / "points.csv"),
                "--k",
                "1",
            ]
        )
        == 2
    )
    assert (
        "zero.yaml: coverage is undefined: the weights of all feasible cells sum to 0"
        in capsys.readouterr().err
    )


def test_weights_too_large_for_k_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heavy = ", ".join(f"{name}: {{values: [x, y], weights: {{y: 1000}}}}" for name in "abcdefg")
    (folder / "heavy.yaml").write_text(f"variables: {{{heavy}}}")
    (folder / "one.csv").write_text("a,b,c,d,e,f,g\n" + ",".join("x" * 7) + "\n")
    for verb in ("score", "propose"):
        assert (
            main(
                [
                    "coverage",
                    verb,
                    "--space",
                    str(folder / "heavy.yaml"),
                    "--points",
                    str(folder / "one.csv"),
                    "--k",
                    "7",
                ]
            )
            == 2
        )
        assert (
            "heavy.yaml: k = 7: the weights of a plane sum to 1,001 × 1,001"
            in capsys.readouterr().err
        )


@pytest.mark.parametrize("words", [["blindspot"], ["python", "-m", "pipeline"]], ids=" ".join)
def test_the_usage_names_the_command_as_it_was_typed(words: list[str]) -> None:
    program, *rest = words
    command = [str(Path(sys.executable).with_name(program)), *rest, "coverage", "--help"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.startswith(
        f"usage: {' '.join(words)} coverage "
    )
