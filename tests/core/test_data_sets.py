"""BDD100K, KITTI, nuScenes and OpenLABEL.

Small sets made here, what they say, and what is refused by place.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipeline.artefacts.openlabel_tags import Tagged
from pipeline.artefacts.point_table import PointTable, read_points
from pipeline.artefacts.space_file import read_space_file
from pipeline.core.variable import Variable
from pipeline.errors import InputError


def rows_of(table: PointTable) -> list[list[int]]:
    return [row for batch in table.counting() for row in batch.tolist()]


def points(folder: Path, space: str, source: str, metadata: str | None = None) -> PointTable:
    (folder / "space.yaml").write_text(f"variables: {{{space}}}")
    if metadata is not None:
        (folder / "meta.csv").write_text(metadata)
    given = None if metadata is None else folder / "meta.csv"
    return read_points(folder / source, read_space_file(folder / "space.yaml"), metadata=given)


def lay(folder: Path, files: dict[str, Any]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content if isinstance(content, str) else json.dumps(content))


BOX = {"category": "car", "box2d": {"x1": 0, "y1": 0, "x2": 9, "y2": 9}}
LANE = {"category": "lane", "poly2d": []}
FRAMES: list[dict[str, Any]] = [
    {
        "name": "a.jpg",
        "attributes": {"weather": "rainy", "scene": "highway", "timeofday": "night"},
        "labels": [BOX, LANE, BOX],
    },
    {
        "name": "b.jpg",
        "attributes": {"weather": "undefined", "scene": "highway", "timeofday": "dawn/dusk"},
        "labels": None,
    },
    {
        "name": "c.jpg",
        "attributes": {"weather": "clear", "scene": "city street", "timeofday": "daytime"},
    },
]
BDD = (
    "weather: {values: [clear, rainy]}, timeofday: {values: [daytime, dawn/dusk, night]}, "
    "objects: {interval: [0, 99], cuts: [1]}"
)


@pytest.mark.parametrize("plain", [FRAMES, {"frames": FRAMES, "config": {}}])
def test_bdd100k_gives_its_attributes_and_boxes(plain: Any, tmp_path: Path) -> None:
    lay(tmp_path, {"labels.json": plain})
    table = points(tmp_path, BDD, "labels.json")
    assert rows_of(table) == [[1, 2, 1], [-1, 1, 0], [0, 0, 0]]
    assert (
        table.told(table.faults[0])
        == "image b.jpg: weather must be one of clear, rainy, got 'undefined'"
    )


def test_bdd100k_files_of_one_image_and_further_conditions(tmp_path: Path) -> None:
    alone = {
        "name": "a",
        "attributes": FRAMES[0]["attributes"],
        "frames": [{"timestamp": 10000, "objects": [BOX, LANE]}],
    }
    lay(tmp_path, {"a.json": alone})
    table = points(
        tmp_path,
        f"{BDD}, country: {{values: [us, il]}}",
        "a.json",
        "file_name,country,weather\na.jpg,il,clear\n",
    )
    assert rows_of(table) == [[0, 2, 1, 1]]  # The table's weather counts.


CAR = "Car {} {} -1.58 587.01 173.33 614.12 200.12 1.65 1.67 3.64 -0.65 1.71 46.70 -1.59"
KITTI = {
    "label_2/000000.txt": "\n".join(
        [CAR.format("0.00", 0), CAR.format("0.31", 2), CAR.format("0.10", 3)]
    ),
    "label_2/000001.txt": "DontCare -1 -1 -10 5.00 229.89 214.12 367.61 "
    "-1 -1 -1 -1000 -1000 -1000 -10\n",
    "label_2/000002.txt": "\n".join([CAR.format("0.00", 1), CAR.format("0.00", 3)]) + "\n",
    "label_2/000003.txt": "",
}
KITTI_SPACE = (
    "occlusion: {values: [0, 1, 2, not_applicable]}, truncation: {interval: [0, 1], cuts: "
    "[0.2]}, objects: {interval: [0, 9], cuts: [1, 3]}"
)


@pytest.mark.parametrize("named", [".", "label_2"])
def test_kitti_gives_the_largest_occlusion_and_truncation(named: str, tmp_path: Path) -> None:
    lay(tmp_path / "set", KITTI)
    table = points(tmp_path, KITTI_SPACE, f"set/{named}")
    # An unknown occlusion is the largest unless another object is largely occluded; an image
    # without objects has none.
    assert rows_of(table) == [[2, 1, 2], [3, -1, 0], [-1, 0, 1], [3, -1, 0]]
    assert table.images == ("000000", "000001", "000002", "000003")


def test_kitti_takes_further_conditions_from_a_table(tmp_path: Path) -> None:
    lay(tmp_path / "set", KITTI)
    rows = "".join(
        f"00000{i}.png,{road}\n" for i, road in enumerate(["city", "road", "city", "campus"])
    )
    table = points(
        tmp_path,
        "road: {values: [city, road]}, objects: {interval: [0, 9], cuts: [1]}",
        "set",
        f"file_name,road\n{rows}",
    )
    assert rows_of(table) == [[0, 1], [1, 0], [0, 1], [-1, 0]]
    with pytest.raises(InputError, match=r"the set itself has no road; .* by --metadata"):
        points(tmp_path, "road: {values: [city, road]}", "set")


NUSCENES: dict[str, Any] = {
    "log.json": [
        {
            "token": "l1",
            "logfile": "n015",
            "vehicle": "n015",
            "date_captured": "2018-07-24",
            "location": "singapore-onenorth",
        },
        {
            "token": "l2",
            "logfile": "n008",
            "vehicle": "n008",
            "date_captured": "2018-08-01",
            "location": "boston-seaport",
        },
    ],
    "scene.json": [
        {
            "token": "s1",
            "log_token": "l1",
            "nbr_samples": 2,
            "name": "scene-0001",
            "description": "Night, heavy rain, parked trucks",
        },
        {
            "token": "s2",
            "log_token": "l2",
            "nbr_samples": 1,
            "name": "scene-0002",
            "description": "Cross a train line, parked cars",
        },
    ],
    "sample.json": [
        {
            "token": "k1",
            "timestamp": 1532402927647951,
            "scene_token": "s1",
            "prev": "",
            "next": "k2",
        },
        {
            "token": "k2",
            "timestamp": 1532402928147847,
            "scene_token": "s1",
            "prev": "k1",
            "next": "",
        },
        {"token": "k3", "timestamp": 1533151603512404, "scene_token": "s2", "prev": "", "next": ""},
    ],
    "sample_annotation.json": [
        {"token": "a1", "sample_token": "k2"},
        {"token": "a2", "sample_token": "k2"},
    ],
}
NUSCENES_SPACE = (
    "location: {values: [boston-seaport, singapore-onenorth]}, rain: {values: [false, true]}, "
    "night: {values: [false, true]}, "
    "parked_car: {values: [false, true]}, objects: {interval: [0, 99], cuts: [1]}"
)


def test_nuscenes_joins_its_tables(tmp_path: Path) -> None:
    lay(tmp_path / "set", NUSCENES)
    table = points(tmp_path, NUSCENES_SPACE, "set")
    assert table.images == ("k1", "k2", "k3")
    assert rows_of(table) == [[1, 1, 1, 0, 0], [1, 1, 1, 0, 1], [0, 0, 0, 1, 0]]


def openlabel(tags: dict[str, Any], **more: Any) -> dict[str, Any]:
    uri = "https://openlabel.asam.net/V1-0-0/ontologies/openlabel_ontology_scenario_tags.ttl"
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0"},
            "ontologies": {"0": {"uri": uri}},
            "tags": tags,
            **more,
        }
    }


def tag(kind: str, **data: Any) -> dict[str, Any]:
    return {"type": kind, "ontology_uid": "0", **({"tag_data": data} if data else {})}


OPENLABEL_SPACE = (
    "road: {values: [RoadTypeMotorway, RoadTypeMinor]}, WeatherRain: "
    "{interval: [0, 100], cuts: [2.5, 7.6]}, "
    "IlluminationLowLight: {values: [false, true]}, SubjectVehicleSpeed: "
    "{interval: [0, 130], cuts: [30, 60]}"
)


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        (
            [tag("RoadTypeMinor"), tag("WeatherRain", num=[{"type": "value", "val": 3.1}])],
            [1, 1, -1, -1],
        ),
        ([tag("IlluminationLowLight"), tag("Unknown"), tag("WeatherRain")], [-1, -1, 1, -1]),
        ([tag("IlluminationLowLight", boolean=[{"val": False}])], [-1, -1, 0, -1]),
        ([tag("RoadTypeMinor", boolean=[{"val": False}])], [-1, -1, -1, -1]),
        ([tag("RoadTypeMinor"), tag("RoadTypeMotorway")], [-1, -1, -1, -1]),
        ([tag("road", text=[{"type": "value", "val": "RoadTypeMotorway"}])], [0, -1, -1, -1]),
        ([{"type": "road", "tag_data": "RoadTypeMinor"}], [1, -1, -1, -1]),
        ([tag("SubjectVehicleSpeed", vec=[{"type": "range", "val": [35, 55]}])], [-1, -1, -1, 1]),
        (
            [tag("SubjectVehicleSpeed", vec=[{"type": "range", "val": ["20", "55"]}])],
            [-1, -1, -1, -1],
        ),
        ([tag("SubjectVehicleSpeed", vec=[{"type": "values", "val": [20]}])], [-1, -1, -1, 0]),
        ([tag("SubjectVehicleSpeed", num=[{"type": "min", "val": 61}])], [-1, -1, -1, 2]),
        (
            [
                tag(
                    "SubjectVehicleSpeed",
                    num=[{"type": "min", "val": 31}, {"type": "max", "val": 59}],
                )
            ],
            [-1, -1, -1, 1],
        ),
        (
            [
                tag(
                    "Weather",
                    num=[{"name": "WeatherRain", "val": 1}],
                    text=[{"name": "road", "val": "RoadTypeMinor"}],
                )
            ],
            [1, 0, -1, -1],
        ),
    ],
)
def test_openlabel_tags_are_a_point(
    tags: list[dict[str, Any]], expected: list[int], tmp_path: Path
) -> None:
    lay(tmp_path, {"scenario.json": openlabel(dict(zip("0123", tags, strict=False)))})
    table = points(tmp_path, OPENLABEL_SPACE, "scenario.json")
    assert rows_of(table) == [expected] and table.images == ("scenario.json",)


def test_stretches_of_frames_with_the_same_tags_are_points(tmp_path: Path) -> None:
    def during(one: dict[str, Any], *intervals: tuple[int, int]) -> dict[str, Any]:
        return {
            **one,
            "frame_intervals": [{"frame_start": a, "frame_end": b} for a, b in intervals],
        }

    wet = during(tag("RoadTypeMinor"), (0, 9), (20, 29))
    lay(tmp_path, {"gap/a.json": openlabel({"0": wet})})
    assert points(tmp_path, OPENLABEL_SPACE, "gap").images == (
        "a.json, frames 0 to 9",
        "a.json, frames 20 to 29",
    )
    rain = during(tag("WeatherRain", num=[{"val": 5}]), (10, 19))
    dark = {
        "type": "Light",
        "context_data": {"boolean": [{"name": "IlluminationLowLight", "val": True}]},
    }
    plain = openlabel(
        {"0": tag("RoadTypeMinor"), "1": rain, "2": during(tag("Other"), (12, 14))},
        contexts={"0": during(dark, (0, 4), (15, 29))},
        frame_intervals=[{"frame_start": 0, "frame_end": 29}],
    )
    lay(
        tmp_path, {"drive/a.json": plain, "drive/b.json": openlabel({"0": tag("RoadTypeMotorway")})}
    )
    table = points(tmp_path, OPENLABEL_SPACE, "drive")
    assert table.images == (
        "a.json, frames 0 to 4",
        "a.json, frames 5 to 9",
        "a.json, frames 10 to 14",
        "a.json, frames 15 to 19",
        "a.json, frames 20 to 29",
        "b.json",
    )
    assert rows_of(table) == [
        [1, -1, 1, -1],
        [1, -1, -1, -1],
        [1, 1, -1, -1],
        [1, 1, 1, -1],
        [1, -1, 1, -1],
        [0, -1, -1, -1],
    ]


def changed(path: str, value: Any) -> Callable[[], Any]:
    """An OpenLABEL file in which one place holds another value."""

    def make() -> Any:
        plain: Any = openlabel({"7": tag("WeatherRain", num=[{"val": 1}])})
        *way, last = path.split(".")
        inner: Any = plain["openlabel"]
        for key in way:
            inner = inner[int(key)] if isinstance(inner, list) else inner[key]
        inner[last] = value
        return plain

    return make


REFUSED: list[tuple[Any, str, str]] = [
    (
        changed("metadata", {}),
        OPENLABEL_SPACE,
        "openlabel.metadata.schema_version: expected a text, got none",
    ),
    (
        changed("metadata", {"schema_version": "0.2.0"}),
        OPENLABEL_SPACE,
        "schema_version: expected 1.x, got 0.2.0",
    ),
    (changed("tags", []), OPENLABEL_SPACE, "openlabel.tags: expected a mapping, got []"),
    (
        changed("tags.7", {"ontology_uid": "0"}),
        OPENLABEL_SPACE,
        "openlabel.tags.7.type: expected a text, got none",
    ),
    (
        changed("tags.7.ontology_uid", "4"),
        OPENLABEL_SPACE,
        "openlabel.tags.7.ontology_uid: expected one of 0, got '4'",
    ),
    (
        changed("tags.7.tag_data.num", {}),
        OPENLABEL_SPACE,
        "openlabel.tags.7.tag_data.num: expected a list, got {}",
    ),
    (
        changed("tags.7.tag_data.num", [{"val": "wet"}]),
        OPENLABEL_SPACE,
        "openlabel.tags.7.tag_data.num[0].val: expected a number, got 'wet'",
    ),
    (
        changed("tags.7.tag_data.num", [{"name": ["v"], "val": 1}]),
        OPENLABEL_SPACE,
        "tag_data.num[0].name: expected a text, got ['v']",
    ),
    (
        changed("tags.7.tag_data.num", [{"val": 10**400}]),
        OPENLABEL_SPACE,
        "tag_data.num[0].val: expected a number, got 1000",
    ),
    (
        changed("tags.7.tag_data.num", [3]),
        OPENLABEL_SPACE,
        "openlabel.tags.7.tag_data.num[0]: expected a mapping with val, got 3",
    ),
    (
        changed("frame_intervals", [{"frame_start": 3, "frame_end": 1}]),
        OPENLABEL_SPACE,
        "frame_intervals[0]: expected frame_start before",
    ),
    (
        openlabel({"0": tag("wet")}),
        "a: {values: [wet, dry]}, b: {values: [wet, dry]}",
        "openlabel.tags.0: wet is a category of a and of b",
    ),
    ([{"attributes": {}}], BDD, "[0].name: expected a text, got none, only keys attributes"),
    (
        [{"name": "a", "attributes": {"weather": ["x"]}}],
        BDD,
        "[0].attributes.weather: expected a text, got ['x']",
    ),
    ([{"name": "a"}, {"name": "a"}], BDD, "the image a appears twice"),
    ([{"name": "a", "labels": [3]}], BDD, "[0].labels: expected mappings, got 3"),
    ([], BDD, "expected images, got none"),
]


@pytest.mark.parametrize(("plain", "space", "message"), REFUSED)
def test_wrong_files_are_refused_by_place(
    plain: Any, space: str, message: str, tmp_path: Path
) -> None:
    lay(tmp_path, {"file.json": plain() if callable(plain) else plain})
    with pytest.raises(InputError) as refused:
        points(tmp_path, space, "file.json")
    assert message in str(refused.value) and str(tmp_path / "file.json") in str(refused.value)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        (
            "sample.json",
            [{"token": "k1", "scene_token": "s9"}],
            "sample.json: k1.scene_token: expected a token of scene.json, got s9",
        ),
        ("log.json", [{"token": "l1"}, {"token": "l1"}], "log.json: the token l1 appears twice"),
        ("scene.json", {}, "scene.json: expected a list of rows, got {}"),
        (
            "log.json",
            [{"token": "l1"}, {"token": "l2"}],
            "log.json: log l1.location: expected a text, got none, only keys token",
        ),
    ],
)
def test_wrong_nuscenes_tables_are_refused_by_row(
    file: str, content: Any, message: str, tmp_path: Path
) -> None:
    lay(tmp_path / "set", {**NUSCENES, file: content})
    with pytest.raises(InputError) as refused:
        points(tmp_path, NUSCENES_SPACE, "set")
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Car 0 0 1", r"000003.txt: line 2: expected 15 fields, got 4"),
        (
            CAR.format("2", 0),
            r"000003.txt: line 2: expected a truncation from 0 to 1 and an occlusion from 0 to 3, "
            r"got 2 and 0",
        ),
        (CAR.format("0", 7), r"line 2: .* got 0 and 7"),
    ],
)
def test_wrong_kitti_lines_are_refused(line: str, message: str, tmp_path: Path) -> None:
    lay(tmp_path / "set", {**KITTI, "label_2/000003.txt": f"{CAR.format('0', 0)}\n{line}\n"})
    with pytest.raises(InputError, match=message):
        points(tmp_path, KITTI_SPACE, "set")


def test_a_tag_holds_in_the_first_and_the_last_frame_of_its_interval() -> None:
    said = Tagged(Variable("lit", "categorical", values=("no", "yes")), "yes", ((3, 3), (5, 6)))
    assert [said.holds(frame) for frame in range(2, 8)] == [False, True, False, True, True, False]
