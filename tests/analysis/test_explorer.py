"""The table of every test: its data are the artefacts' rows."""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

import pandas as pd
import pytest

from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.tables import read_tests
from pipeline.report.explorer import THUMBNAILS, Explorer, explorer
from pipeline.report.kept_frames import KeptFrames
from tests.analysis.fabricated import FabricatedStudy


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    return FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()


@pytest.fixture(scope="module")
def rows(study: FabricatedStudy) -> pd.DataFrame:
    return pd.concat(
        map(read_tests, [*study.search_tests, *study.held_out_tests]), ignore_index=True
    )


@pytest.fixture(scope="module")
def table(study: FabricatedStudy, rows: pd.DataFrame) -> Explorer:
    regions = [read(path, FailureRegions) for path in study.regions]
    spaces = {
        name: study.config.space(name) for name in (*study.config.search, *study.config.held_out)
    }
    labels = {name: study.config.scenarios[name].label for name in spaces}
    return explorer(
        rows,
        labels,
        spaces,
        regions,
        KeptFrames([path.with_name("frames.parquet") for path in study.search_tests]),
    )


@pytest.fixture(scope="module")
def shown(table: Explorer) -> dict[str, list[Any]]:
    """Field -> its values, as the browser reads them."""
    fields = json.loads(gzip.decompress(base64.b64decode(table.data)))["fields"]
    values = {}
    for field in fields:
        coded = [field["known"][code] for code in field.get("codes", ())]
        values[field["name"]] = field.get("numbers", coded)
    return values


def test_every_row_is_there_with_its_values(
    shown: dict[str, list[Any]], rows: pd.DataFrame
) -> None:
    assert shown["test"] == rows["test_id"].tolist()
    assert shown["blueprint"] == rows["blueprint"].tolist()
    ok = rows["status"] == "ok"
    for name in ("fog", "sun_altitude", "index"):
        assert shown[name] == pytest.approx(rows[name].tolist(), rel=1e-5)
    kpi = pd.Series(shown["adj_ttc_s"], dtype=float)
    assert kpi[ok].to_numpy() == pytest.approx(rows["adj_ttc_s"][ok].to_numpy(), rel=1e-5)


def test_an_error_has_no_kpi(shown: dict[str, list[Any]], rows: pd.DataFrame) -> None:
    errors = rows.index[rows["status"] == "error"]
    assert len(errors) > 0
    assert {shown["end"][row] for row in errors} == {"error"}
    assert {shown["adj_ttc_s"][row] for row in errors} == {None}


def test_people_have_their_attributes_in_every_space(
    shown: dict[str, list[Any]], rows: pd.DataFrame, study: FabricatedStudy
) -> None:
    people = study.config.space("F1").variables[study.config.space("F1").names.index("blueprint")]
    heights = dict(zip(people.values, dict(people.attributes)["height_m"], strict=True))
    searched = rows.index[rows["scenario"] == "F1"]
    assert [shown["height_m"][row] for row in searched] == pytest.approx(
        [heights[name] for name in rows["blueprint"][searched]]
    )
    assert None not in shown["height_m"]


def test_members_name_their_region(shown: dict[str, list[Any]], study: FabricatedStudy) -> None:
    region = read(study.regions[0], FailureRegions).regions[0]
    listed = zip(shown["test"], shown["region"], shown["scenario"], strict=True)
    named = {test for test, name, scenario in listed if (name, scenario) == (region.name, "F1")}
    assert named == set(region.members)


def test_failures_get_thumbnails_first(table: Explorer, rows: pd.DataFrame) -> None:
    thumbnails = json.loads(table.thumbnails)
    assert 0 < len(thumbnails) <= THUMBNAILS
    assert all(address.startswith("data:image/jpeg;base64,") for address in thumbnails.values())
    assert set(thumbnails) <= set(rows["test_id"])
