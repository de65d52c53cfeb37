"""The commands that show and export.

They are `simulate`, `contact-sheet`, `export-scenario` and `export-frames`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.__main__ import main
from pipeline.artefacts.dataset import SPLITS, encode_jpeg, read_dataset
from pipeline.artefacts.openscenario import open_drive
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import read_frames, read_tests, write_frames
from pipeline.commands.simulate import concrete_scenario
from pipeline.commands.top_view import top_view
from pipeline.config.composing import compose, dump, functional_scenario
from pipeline.core.paths import Pose
from pipeline.errors import InputError
from pipeline.report.films import write_films
from pipeline.scenarios.streets import Crosswalk, Town, streets
from tests.analysis.fabricated import FabricatedStudy

FOUND = [
    "fog=80",
    "rain=20",
    "pedestrian_speed=2",
    "pedestrian_shift=0.3",
    "sun_azimuth=0",
    "blueprint=M 03",
]


def test_simulate_films_one_test(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = tmp_path / "replay.mp4"
    assert main(["simulate", "F7", *FOUND, "--out", str(film)]) == 0
    assert "adj. TTC" in capsys.readouterr().out
    capture = cv2.VideoCapture(str(film))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) > 15
    read, image = capture.read()
    assert read and image.std() > 20


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulate", "F9"], "there is no conf/scenario/F9.yaml; did you mean"),
        (["simulate", "F1", "fogg=3"], "there is no variable 'fogg'; did you mean 'fog'?"),
        (["simulate", "F1", "fog"], "write fog=VALUE, got 'fog'"),
        (["simulate", "F1", "fog=thick"], "fog: expected a number, got 'thick'"),
        (["simulate", "F1", "fog=120"], "fog must be in [0, 100] %, got 120.0"),
        (["simulate", "F1", "animation=dancing"], "animation must be one of walking, texting,"),
        (
            ["simulate", "F1", "--out", "film.avi"],
            "a replay must be an .mp4 or a .gif, got film.avi",
        ),
        (
            ["simulate", "F1", "--model", "docs"],
            "docs holds neither model.onnx nor weights.safetensors",
        ),
        (
            ["simulate", "F1", "--model", "README.md"],
            "README.md: expected the folder of a version, got a file",
        ),
        (
            ["test-detector", "models/uniform"],
            "models/uniform: expected the file of a detector, got a folder; name the file, such "
            "as models/uniform/weights.safetensors",
        ),
        (["verdict", "--params", "nope.yaml"], "nope.yaml: no such file"),
        (
            ["verdict", "--comparison", "nope.json"],
            "nope.json: expected a readable file, got No such file",
        ),
        (
            ["compose", "study=smoke", "filter.overrules=nope.csv"],
            "filter.overrules: expected a CSV, found no file nope.csv",
        ),
        (
            ["compose", "study=smoke", "base.weights=nope"],
            "base.weights: expected the folder of a detector, found no file "
            "nope/weights.safetensors",
        ),
        (
            ["simulate", "F1", "--out", "README.md/film.mp4"],
            "README.md: expected a folder to write in, got a file",
        ),
        (
            ["simulate", "F1", "--out", "/proc/film.mp4"],
            "/proc/film.mp4: expected a file to write to, got",
        ),
        (
            ["replay", "F1-random-base-0-00000", "--out", "README.md/film.gif"],
            "README.md: expected a folder to write in, got a file",
        ),
        (
            ["contact-sheet", "F1", "--out", "sheet.tiff"],
            "a contact sheet must be a .png or a .jpg, got sheet.tiff",
        ),
        (["top-view", "F1", "--out", "view.jpg"], "a view from above must be a .png, got view.jpg"),
        (
            ["top-view", "F1", "--speeds", "1", "nan"],
            "--speeds: expected speeds from 0 to 20 m/s, got nan",
        ),
        (
            ["top-view", "F1", "--speeds", "inf"],
            "--speeds: expected speeds from 0 to 20 m/s, got inf",
        ),
        (
            ["compose", "study=smoke", "--out", "README.md/params.yaml"],
            "params.yaml: expected a file to write to, got one in README.md, which is not a folder",
        ),
        (
            ["compose", "study=smoke", "--out", "docs"],
            "docs: expected a file to write to, got a folder",
        ),
        (
            ["verify", "--folder", "nowhere"],
            "--folder: expected the folder of a study, found no folder nowhere",
        ),
        (
            ["verify", "--folder", "docs"],
            "--folder: expected the folder of a study, found no stamped file in docs",
        ),
        (["export-scenario", "F1", "fog=-1"], "fog must be in [0, 100] %, got -1.0"),
        (
            ["export-frames", "nowhere.parquet", "--out", "README.md"],
            "README.md: expected a folder to write in, got a file; choose another --out",
        ),
        (
            ["simulate", "F1", "--model", "README.md"],
            "README.md: expected the folder of a version, got a file\n",
        ),
        (["explore", "nothing"], "there is no study 'nothing'"),
        (
            ["export-frames", "nowhere.parquet"],
            "nowhere.parquet: expected a readable file, got No such file or directory; ./run "
            "makes the files of a study",
        ),
    ],
)
def test_wrong_arguments_are_named(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["step", "define-space", "--scenario", "F1", "--threads"],
        ["campaign", "--threads"],
        ["likelihood", "--threads"],
        ["test-detector", "mine.onnx", "--cores"],
        ["rescore", "data", "--workers"],
    ],
)
def test_work_needs_at_least_one_process(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    for wrong in ("0", "-1", "two"):
        with pytest.raises(SystemExit, match="2"):
            main([*words, wrong])
        assert (
            f"argument {words[-1]}: expected a whole number from 1 to 10000000, got '{wrong}'"
            in capsys.readouterr().err
        )


def test_an_omitted_value_equals_its_default() -> None:
    space = functional_scenario("F1").logical_space()
    messages = [
        repr(concrete_scenario(space, words)) for words in ([], ["fog=0"], ["fog=0.0", "rain=0"])
    ]
    assert len(set(messages)) == 1


def test_a_contact_sheet_has_a_row_per_weather(tmp_path: Path) -> None:
    path = tmp_path / "a new folder" / "sheet.png"
    assert main(["contact-sheet", "F5", "--out", str(path)]) == 0
    sheet = cv2.imread(str(path))
    assert sheet is not None and sheet.shape == (7 * 192, 4 * 320, 3)
    day, night = sheet[:192], sheet[3 * 192 : 4 * 192]
    assert day.mean() > night.mean() + 15


@pytest.mark.parametrize("name", ["F1", "F5", "F8", "F3star"])
def test_a_finding_is_exported_as_openscenario(name: str, tmp_path: Path) -> None:
    out, scenario = tmp_path / "find", functional_scenario(name)
    values = [*FOUND[:-1], f"blueprint={scenario.logical_space().variables[-1].values[39]}"]
    assert main(["export-scenario", name, *values, "--out", str(out)]) == 0
    story = Xml.parse(out.with_suffix(".xosc")).getroot()
    logic = story.find("RoadNetwork/LogicFile")
    assert logic is not None and logic.attrib["filepath"] == "find.xodr"
    assert {entity.attrib["name"] for entity in story.iter("ScenarioObject")} == {
        "ego",
        "pedestrian",
        *scenario.actors,
    }
    tracks = {}
    for trajectory in story.iter("Trajectory"):
        times = [float(vertex.attrib["time"]) for vertex in trajectory.iter("Vertex")]
        places = [
            (float(p.attrib["x"]), float(p.attrib["y"])) for p in trajectory.iter("WorldPosition")
        ]
        assert times == sorted(times) and len(times) == len(places)
        tracks[trajectory.attrib["name"]] = dict(zip(times, places, strict=True))
    # At the horizon the ego's front is at the conflict point, and the pedestrian is past it by its
    # shift.
    x, y = tracks["ego"][scenario.ego.horizon_s]
    at = np.array(scenario.pedestrian.at)
    assert np.hypot(*(np.array([x, y]) - at)) == pytest.approx(2.5, abs=0.2)
    assert np.hypot(
        *(np.array(tracks["pedestrian"][scenario.ego.horizon_s]) - at)
    ) == pytest.approx(0.3, abs=1e-5)
    fog, sun = story.find(".//Fog"), story.find(".//Sun")
    assert fog is not None and 40 < float(fog.attrib["visualRange"]) < 120
    # A sun ahead is in the east of OpenSCENARIO's compass.
    assert sun is not None and float(sun.attrib["azimuth"]) == pytest.approx(np.pi / 2)
    assert float(sun.attrib["intensity"]) == pytest.approx(
        100_000 * np.sin(float(sun.attrib["elevation"]))
    )


@pytest.mark.parametrize("name", ["F2", "F4", "F6", "F7"])
def test_the_roads_of_a_finding_are_connected(name: str, tmp_path: Path) -> None:
    out = tmp_path / "find"
    assert main(["export-scenario", name, "--out", str(out)]) == 0
    town, network = functional_scenario(name).town, Xml.parse(out.with_suffix(".xodr")).getroot()
    roads = {road.attrib["id"]: road for road in network.iter("road")}
    assert set(roads) == ({"1", "2", "3", "11", "12", "13"} if town.junction else {"1"})
    ends = {}
    for number, road in roads.items():
        pose, s = None, 0.0
        for geometry in road.iter("geometry"):
            start = Pose(*(float(geometry.attrib[key]) for key in ("x", "y", "hdg")))
            length = float(geometry.attrib["length"])
            assert float(geometry.attrib["s"]) == pytest.approx(s, abs=1e-4)
            if pose:
                assert (pose.x, pose.y) == pytest.approx((start.x, start.y), abs=1e-3)
            arc = geometry.find("arc")
            pose, s = (
                _after(start, length, float(arc.attrib["curvature"]) if arc is not None else 0.0),
                s + length,
            )
        assert pose is not None and float(road.attrib["length"]) == pytest.approx(s, abs=1e-4)
        first = next(road.iter("geometry")).attrib
        ends[number] = ((float(first["x"]), float(first["y"])), (pose.x, pose.y))
    if town.junction:
        inside = {
            "11": (ends["1"][1], ends["2"][0]),
            "12": (ends["1"][1], ends["3"][0]),
            "13": (ends["3"][0], ends["2"][0]),
        }
        for number, (first_end, last_end) in inside.items():
            assert ends[number][0] == pytest.approx(first_end, abs=1e-3)
            assert ends[number][1] == pytest.approx(last_end, abs=1e-3)
        # The side street runs away from the junction: traffic from it drives left of its line.
        lanes = {}
        for connection in network.iter("connection"):
            links_of = connection.iter("laneLink")
            lanes[connection.attrib["id"]] = [tuple(link.attrib.values()) for link in links_of]
        assert lanes == {"11": [("-1", "-1")], "12": [("-1", "-1")], "13": [("1", "-1")]}
        links = {
            lane.attrib["id"]: lane.find("link/predecessor") for lane in roads["13"].iter("lane")
        }
        before = {number: link.attrib["id"] for number, link in links.items() if link is not None}
        assert before == {"-1": "1", "1": "-1"}
    assert len(list(network.iter("object"))) == len(town.crosswalks)


def test_a_crosswalk_lies_at_its_place_in_a_curve_and_in_no_junction() -> None:
    curve = Town(
        style="urban",
        seed=1,
        curvature_1pm=0.02,
        lanes_ahead=2,
        crosswalks=(Crosswalk(street="main", at_m=60),),
    )
    road = next(open_drive(curve).iter("road"))
    geometry, (crosswalk,) = next(road.iter("geometry")).attrib, road.iter("object")
    start = Pose(*(float(geometry[key]) for key in ("x", "y", "hdg")))
    arc = next(road.iter("arc"))
    on_line = _after(start, float(crosswalk.attrib["s"]), float(arc.attrib["curvature"]))
    main, *_ = streets(curve)
    assert (on_line.x, on_line.y) == pytest.approx(main.world(60, main.middle), abs=0.01)
    junction = functional_scenario("F6").town.model_copy(
        update={"crosswalks": (Crosswalk(street="side", at_m=5),)}
    )
    with pytest.raises(InputError, match="expected crosswalks on a road, got 1 in the junction"):
        open_drive(junction)


@pytest.mark.parametrize("name", ["f1.fog50", "f1.xosc"])
def test_a_name_with_a_dot_keeps_it(name: str, tmp_path: Path) -> None:
    assert main(["export-scenario", "F1", "--out", str(tmp_path / name)]) == 0
    stem = name.removesuffix(".xosc")
    assert {path.name for path in tmp_path.iterdir()} == {f"{stem}.xodr", f"{stem}.xosc"}


def _after(start: Pose, length: float, curvature: float) -> Pose:
    """The end of a geometry, by many small steps."""
    x, y, heading = start.x, start.y, start.heading
    for _ in range(2000):
        heading += curvature * length / 4000
        x, y = x + np.cos(heading) * length / 2000, y + np.sin(heading) * length / 2000
        heading += curvature * length / 4000
    return Pose(float(x), float(y), float(heading))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with frames in a study with failure regions."""
    study = FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()
    return study.search_tests[2].with_name("frames.parquet")


@pytest.fixture
def frames(campaign: Path) -> Path:
    """Its frames, with real images."""
    table = read_frames(campaign)
    table["image"] = encode_jpeg(np.full((192, 320, 3), 90, np.uint8))
    write_frames(campaign, table)
    return campaign


def exported(frames: Path, folder: Path) -> Path:
    out, params = folder / "out", folder / "params.yaml"
    params.write_text(
        dump(
            compose(
                "default", ["simulator.camera.distortion=-0.1", "simulator.camera.hfov_deg=90"]
            ),
            "test",
        )
    )
    (out / "openlabel").mkdir(parents=True)
    (out / "openlabel" / "of an earlier export.json").write_text("{}")
    (out / "frames.csv").touch()  # As after a kill.
    assert main(["export-frames", str(frames), "--out", str(out), "--params", str(params)]) == 0
    return out


def test_an_export_touches_no_files_of_others(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = tmp_path / "mine/images/train/000007.jpg"
    image.parent.mkdir(parents=True)
    image.write_bytes(b"mine")
    (tmp_path / "params.yaml").write_text(dump(compose("default", []), "test"))
    words = [
        "export-frames",
        str(frames),
        "--out",
        str(tmp_path / "mine"),
        "--params",
        str(tmp_path / "params.yaml"),
    ]
    assert main(words) == 2
    assert (
        "mine: expected a new folder or that of an earlier export, got other files"
        in capsys.readouterr().err
    )
    assert [path for path in (tmp_path / "mine").rglob("*") if path.is_file()] == [image]


def test_frames_are_exported_as_yolo_coco_and_openlabel(frames: Path, tmp_path: Path) -> None:
    out = exported(frames, tmp_path)
    boxes: dict[str, Any] = {}
    for split in SPLITS:
        images, files = read_dataset(out, split), sorted((out / "images" / split).glob("*.jpg"))
        assert len(images) == len(files) == len(list((out / "labels" / split).glob("*.txt"))) > 0
        boxes |= {
            f"images/{split}/{file.name}": box
            for file, box in zip(files, images.boxes, strict=True)
        }
    compared, files = set(), list((out / "openlabel").glob("*.json"))
    assert len(files) == read_frames(frames)["test_id"].nunique() > 0
    for path in files:
        body = json.loads(path.read_text())["openlabel"]
        assert body["metadata"]["schema_version"] == "1.0.0"
        intrinsics = body["streams"]["camera"]["stream_properties"]["intrinsics_pinhole"]
        assert intrinsics["camera_matrix_3x4"][0] == pytest.approx(160) and intrinsics[
            "distortion_coeffs_1xN"
        ] == [-0.1, 0, 0, 0, 0]
        for frame in body["frames"].values():
            uri = frame["frame_properties"]["streams"]["camera"]["uri"]
            for labelled in frame.get("objects", {}).values():
                visible = next(
                    (box for box in labelled["object_data"]["bbox"] if box["name"] == "visible"),
                    None,
                )
                if visible:
                    x, y, width, height = visible["val"]
                    assert [
                        x - width / 2,
                        y - height / 2,
                        x + width / 2,
                        y + height / 2,
                    ] == pytest.approx(boxes[uri].tolist())
                    compared.add(uri)
    assert compared == {uri for uri, (left, _, right, _) in boxes.items() if right > left}


def test_exported_frames_name_their_region_and_how_their_test_ended(
    frames: Path, tmp_path: Path
) -> None:
    out = exported(frames, tmp_path)
    tests = read_tests(frames.with_name("tests.parquet")).set_index("test_id")
    regions = read(frames.parents[5] / "regions/base/F1.json", FailureRegions).regions
    members = {test: region.name for region in regions for test in region.members}
    truth, table = (
        json.loads((out / "truth.coco.json").read_text()),
        pd.read_csv(out / "frames.csv", keep_default_na=False),
    )
    assert len(truth["images"]) == len(table) == len(read_frames(frames))
    named = 0
    for image, row in zip(
        sorted(truth["images"], key=lambda image: str(image["file_name"])),
        table.sort_values("file").itertuples(),
        strict=True,
    ):
        attributes, test = image["attributes"], tests.loc[row.test_id]
        assert f"images/{image['file_name']}" == row.file and image["split"] == row.split
        assert attributes["region"] == row.region == members.get(row.test_id, "")
        outcome = "failure" if test["failure"] else "pass"
        expected = outcome if test["status"] == "ok" else "error"
        assert attributes["outcome"] == row.outcome == expected
        assert attributes["fog"] == test["fog"] == pytest.approx(row.fog, rel=1e-5)
        named += bool(row.region)
    assert named > 0
    for annotation in truth["annotations"]:
        (image,) = [image for image in truth["images"] if image["id"] == annotation["image_id"]]
        assert annotation["attributes"].items() <= image["attributes"].items()


def test_a_test_is_in_one_split_and_the_names_fit_the_folders(frames: Path, tmp_path: Path) -> None:
    out = exported(frames, tmp_path)
    table = pd.read_csv(out / "frames.csv")
    assert table.groupby("test_id")["split"].nunique().max() == 1
    count = table["test_id"].nunique()
    assert table[table["split"] == "val"]["test_id"].nunique() == round(0.1 * count) > 0
    # A single test cannot be split: both names are those of its folder, not of an empty one.
    table = read_frames(frames)
    write_frames(tmp_path / "frames.parquet", table[table["test_id"] == table["test_id"].iloc[0]])
    (tmp_path / "again").mkdir()
    again = exported(tmp_path / "frames.parquet", tmp_path / "again")
    assert yaml.safe_load((again / "dataset.yaml").read_text()) == {
        "train": "images/train",
        "val": "images/train",
        "names": {0: "pedestrian"},
    }
    assert not (again / "images/val").exists()


def test_a_film_of_each_failure_names_its_region(frames: Path, tmp_path: Path) -> None:
    assert write_films(frames, tmp_path, rate_hz=20) > 0
    labels, tests = (
        pd.read_csv(tmp_path / "labels.csv", keep_default_na=False),
        read_tests(frames.with_name("tests.parquet")),
    )
    kept = read_frames(frames)
    failed = set(tests[tests["failure"] & (tests["status"] == "ok")]["test_id"]) & set(
        kept["test_id"]
    )
    assert set(labels["test_id"]) == failed and (labels["region"] != "").any()
    assert {path.name for path in (tmp_path / "data").iterdir()} == set(labels["filepath"])
    film = cv2.VideoCapture(str(tmp_path / "data" / labels["filepath"][0]))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == (kept["test_id"] == labels["test_id"][0]).sum()
    assert film.get(cv2.CAP_PROP_FPS) == 20  # These frames are those of every step.
    read, image = film.read()
    assert read and abs(image.mean() - 90) < 3


def test_a_scenario_without_pedestrian_is_exported_without_one(tmp_path: Path) -> None:
    assert main(["export-scenario", "N1", "--out", str(tmp_path / "find")]) == 0
    names = {
        entity.attrib["name"]
        for entity in Xml.parse(tmp_path / "find.xosc").getroot().iter("ScenarioObject")
    }
    assert names == {"ego", *functional_scenario("N1").actors}


def test_a_view_from_above_has_a_panel_per_speed() -> None:
    figure = top_view(functional_scenario("F7"), [0.0, 1.5])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "F7, pedestrian 0 m/s",
        "F7, pedestrian 1.5 m/s",
    ]
    paths = []
    for axes in figure.axes:
        paths += [line for line in axes.lines if line.get_marker() == "o"]
    standing, walking = paths
    at = np.array(functional_scenario("F7").pedestrian.at)
    assert np.allclose(standing.get_xydata(), at)
    # Half a second at 1.5 m/s, and the last 0.2 s before the conflict point.
    steps = np.hypot(*np.diff(np.asarray(walking.get_xydata()), axis=0).T)
    assert steps == pytest.approx([0.75] * 6 + [0.3])
    assert np.allclose(np.asarray(walking.get_xydata())[-1], at)


@pytest.mark.parametrize("name", ["N1", "N4"])
def test_a_view_from_above_shows_a_street_without_conflict(name: str, tmp_path: Path) -> None:
    path = tmp_path / "view.png"
    assert main(["top-view", name, "--speeds", "1.4", "--out", str(path)]) == 0
    view = cv2.imread(str(path))
    assert view is not None and view.std() > 20
