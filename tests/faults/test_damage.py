"""Damaged files: cut, empty, foreign, with one flipped bit, or replaced by a folder.

Readers name the file; a journal executes its test again.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import chdir, closing
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.faults.damage import READERS, artefacts, flipped, stamp
from pipeline.__main__ import main
from pipeline.artefacts import files, stamps
from pipeline.artefacts.dataset import Record, write_image, write_truth
from pipeline.artefacts.files import read_sealed, sha256, write_json, write_sealed
from pipeline.artefacts.model_card import CurvePoint, read_card, write_card, write_curve
from pipeline.artefacts.tables import (
    DETECTIONS,
    TIMINGS,
    read_signals,
    write_detections,
    write_timings,
)
from pipeline.config.composing import compose
from pipeline.core.columns import Column
from pipeline.core.truth import Truth
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import initial_model
from pipeline.detectors.yolo.weights import load_weights, save_weights
from pipeline.errors import InputError
from pipeline.execution import campaign, journal
from pipeline.execution.journal import Journal, Outcome
from pipeline.progress import Progress
from pipeline.tracking.client import connect
from tests.analysis.fabricated import OVERRIDES, FabricatedStudy
from tests.campaigns import analytic_study, folder, key, same
from tests.campaigns import journal as journal_of
from tests.studies import ROOT


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _garbage(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(path.stat().st_size))


def _flip(path: Path, bit: int) -> None:
    path.write_bytes(flipped(path.read_bytes(), bit))


def _bit(path: Path) -> None:
    _flip(path, 4 * path.stat().st_size)


def _folder(path: Path) -> None:
    path.unlink()
    (path / "inside").mkdir(parents=True)


DAMAGE: Mapping[str, Callable[[Path], object]] = {
    "cut": _cut,
    "empty": lambda path: path.write_bytes(b""),
    "garbage": _garbage,
    "bit": _bit,
    "folder": _folder,
}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study's folder with a file of every kind, all of them stamped."""
    config = compose(
        "default",
        [
            *OVERRIDES,
            "search=[F1]",
            "held_out=[F1star]",
            "seeds=[0]",
            f"base.weights={ROOT / 'models/uniform'}",
        ],
    )
    made = FabricatedStudy(tmp_path_factory.mktemp("study"), config).make().analyse()
    _version(made.root / "models/base")
    _data_set(made.root / "base_set")
    for tests in (*made.search_tests, *made.held_out_tests):
        write_detections(tests.with_name("detections.parquet"), _row(DETECTIONS))
        write_timings(tests.with_name("timings.parquet"), _row(TIMINGS))
    listed = {
        path.parent / name
        for path in made.root.rglob("*.stamp")
        if (known := stamps.read(path))
        for name in known.digests
    }
    for file in [
        path
        for path in made.root.rglob("*")
        if path.is_file() and path.suffix != ".stamp" and path not in listed
    ]:
        stamp(file.with_name(f"{file.name}.stamp"), file)
    return made.root


def _version(root: Path) -> None:
    weights, card = root / "weights.safetensors", root / "model.json"
    save_weights(weights, initial_model(0, lambda: Yolo(Architecture((8, 8, 12, 16, 16), 8))))
    write_card(card, read_card(card).model_copy(update={"weights_sha256": sha256(weights)}))
    write_curve(root / "curve.csv", [CurvePoint(10, 3e-4, 1.5, 0.3, 0.8)])


def _data_set(root: Path) -> None:
    image, truth = np.random.default_rng(0).integers(0, 255, (48, 80, 3), dtype=np.uint8), Truth()
    write_image(root, "train", 0, image, truth)
    write_truth(root, [Record("train", 0, 80, 48, truth)])


def _row(columns: tuple[Column, ...]) -> pd.DataFrame:
    return pd.DataFrame([{column.name: column.kind(0) for column in columns}])


def of_kind(study: Path, kind: str) -> Path:
    """The first file of a kind that its reader takes."""
    for found, file in artefacts(study):
        if found == kind and "retrained" not in file.parts:
            READERS[kind](file)
            return file
    raise AssertionError(f"the study has no {kind}")


@pytest.mark.parametrize("kind", READERS)
def test_readers_name_a_damaged_file(study: Path, tmp_path: Path, kind: str) -> None:
    kept, file = tmp_path / "kept", of_kind(study, kind)
    shutil.copy(file, kept)
    bits = map(int, np.random.default_rng(1).integers(8 * file.stat().st_size, size=20))
    flips: dict[str, Callable[[Path], object]] = {
        f"bit {bit}": partial(_flip, bit=bit) for bit in bits
    }
    for name, damage in {**DAMAGE, **flips}.items():
        damage(file)
        with pytest.raises(InputError) as error:
            READERS[kind](file)
        assert str(file) in str(error.value), name
        assert file in [found for found, _ in stamps.damaged(study)], name
        stamps.remove(file)
        shutil.copy(kept, file)
    READERS[kind](file)


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_stamp_counts_as_none(study: Path, name: str, tmp_path: Path) -> None:
    path = study / "measures.json.stamp"
    shutil.copy(path, tmp_path)
    DAMAGE[name](path)
    assert stamps.read(path) is None
    assert list(stamps.damaged(study)) == [(path, path)]
    stamps.remove(path)
    shutil.copy(tmp_path / path.name, path)


def test_verify_names_what_is_damaged_and_withdraws_its_stamp(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(study, tmp_path / "copy")
    words = ["verify", "--folder", str(tmp_path / "copy")]
    assert main(words) == 0
    assert re.fullmatch(
        rf"{tmp_path}/copy: \d+ stamped files, none damaged\n", capsys.readouterr().out
    )
    for name in ("measures.json", "comparison.json"):
        (_bit if name == "measures.json" else _folder)(tmp_path / "copy" / name)
    (tmp_path / "copy/theta.csv").unlink()  # A deleted file is no damage.
    assert main(words) == 1
    said = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[0] for line in said] == [
        str(tmp_path / "copy" / name) for name in ("comparison.json", "measures.json")
    ]
    assert not any(
        (tmp_path / "copy" / f"{name}.stamp").exists()
        for name in ("measures.json", "comparison.json")
    )
    assert not (tmp_path / "copy/comparison.json").exists() and main(words) == 0


def test_a_job_that_ends_beside_a_check_keeps_its_stamp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, stamp, digest = tmp_path / "a.json", tmp_path / "a.json.stamp", stamps.digest
    file.write_text("{}")
    stamp.write_text(stamps.made(stamp, "before", [file]).text())

    def late(path: Path) -> str:
        monkeypatch.setattr(stamps, "digest", digest)
        file.write_text("[]")
        stamp.write_text(stamps.made(stamp, "now", [file]).text())
        return digest(path)

    monkeypatch.setattr(stamps, "digest", late)
    assert not list(stamps.damaged(tmp_path))


def test_a_deleted_image_is_damage_because_its_folder_stands(study: Path, tmp_path: Path) -> None:
    shutil.copytree(study / "base_set/images", tmp_path / "images")
    listed, image = (
        tmp_path / "truth.coco.json.stamp",
        sorted((tmp_path / "images").rglob("*.jpg"))[0],
    )
    for single in (tmp_path / "images").rglob("*.stamp"):
        single.unlink()
    listed.write_text(stamps.made(listed, "the test", [tmp_path / "images"]).text())
    assert not list(stamps.damaged(tmp_path))
    image.unlink()
    assert list(stamps.damaged(tmp_path)) == [(image, listed)]
    shutil.rmtree(tmp_path / "images")  # Snakemake misses the folder itself.
    assert not list(stamps.damaged(tmp_path))


def test_weights_without_a_stamp_are_compared_with_their_card(study: Path, tmp_path: Path) -> None:
    for name in ("weights.safetensors", "model.json"):
        shutil.copy(study / "models/base" / name, tmp_path)
    load_weights(tmp_path / "weights.safetensors")
    (tmp_path / "weights.safetensors").write_bytes(
        flipped((tmp_path / "weights.safetensors").read_bytes(), -9)
    )
    with pytest.raises(InputError, match=r"weights\.safetensors: damaged or of another version"):
        load_weights(tmp_path / "weights.safetensors")


def test_tables_without_a_stamp_check_their_pages(study: Path, tmp_path: Path) -> None:
    """The first half of these files is data; the footer after it has no checksum of its own."""
    shutil.copy(of_kind(study, "signals.parquet"), tmp_path)
    path = tmp_path / "signals.parquet"
    whole, read_before = path.read_bytes(), read_signals(path)
    for bit in np.random.default_rng(0).integers(32, 4 * len(whole), size=40):
        path.write_bytes(flipped(whole, int(bit)))
        try:
            found = read_signals(path)
        except InputError:
            continue
        pd.testing.assert_frame_equal(
            found, read_before
        )  # A page's header holds statistics that no reader uses.


def test_shipped_detectors_are_as_they_were_shipped() -> None:
    """A detector that is shipped anew brings the stamp of its training along."""
    for version in ("uniform", "long_tailed"):
        known = stamps.read(ROOT / "models" / version / "model.json.stamp")
        assert (
            known is not None
            and {"model.json", "weights.safetensors", "curve.csv"} <= known.digests.keys()
        )
    assert not list(stamps.damaged(ROOT / "models"))


def _noting(call: Callable[..., object], name: str, calls: list[str], *arguments: object) -> object:
    calls.append(name)
    return call(*arguments)


def test_a_file_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    for name in ("fsync", "replace"):
        monkeypatch.setattr(os, name, partial(_noting, getattr(os, name), name, order))
    files.write_bytes(tmp_path / "file", b"content")
    assert order == ["fsync", "replace", "fsync"]


@pytest.mark.parametrize("name", DAMAGE)
def test_what_an_unfinished_job_left_names_its_damage(tmp_path: Path, name: str) -> None:
    path = tmp_path / "checkpoint.pt"
    write_sealed(path, bytes(range(256)))
    assert read_sealed(path) == bytes(range(256))
    DAMAGE[name](path)
    with pytest.raises(InputError, match=r"checkpoint\.pt"):
        read_sealed(path)


def test_damaged_entries_of_a_journal_are_executed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = analytic_study(tmp_path, "campaign.tests=8")
    write = campaign.write

    def stopped(plan: campaign.CampaignPlan, done: list[campaign.Executed], out: Path) -> None:
        write(plan, done, tmp_path / "undamaged" / out.name)
        raise InputError("stopped")

    monkeypatch.setattr(campaign, "write", stopped)
    assert whole.run("campaign", **key()) == 2
    monkeypatch.setattr(campaign, "write", write)
    entries = sorted(journal_of(whole).glob("*.npz"))
    for damage, entry in zip(DAMAGE.values(), entries, strict=False):
        damage(entry)
    assert whole.run("campaign", **key()) == 0
    said = capsys.readouterr().err
    assert [
        f"{entry.name} was damaged; its test is executed again" in said for entry in entries
    ] == [True] * 5 + [False] * 3
    assert same(folder(whole), tmp_path / "undamaged")


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_identity_names_the_command_that_mends_it(tmp_path: Path, name: str) -> None:
    with Progress("test") as progress, chdir(tmp_path):
        log = Journal(Path("journal"), "mine", progress)
        journal.write(log.path(0), Outcome.error("broke"), {"fog": 1.0})
        assert 0 in Journal(Path("journal"), "mine", progress)
        assert log.holds(0, {"fog": 1.0}) and not log.holds(1, {"fog": 1.0})
        DAMAGE[name](Path("journal/identity"))
        with pytest.raises(
            InputError, match=r"^journal/identity: damaged, .* type: rm -r journal$"
        ):
            Journal(Path("journal"), "mine", progress)
        shutil.rmtree("journal")
        assert 0 not in Journal(Path("journal"), "mine", progress)


def test_the_outcome_of_another_point_is_executed_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A strategy of the user's own may change between two calls; no digest covers its code."""
    with Progress("test") as progress:
        log = Journal(tmp_path / "journal", "mine", progress)
        for index in (0, 1):
            journal.write(
                log.path(index), Outcome.error("broke"), {"fog": 0.1 + 0.2, "blueprint": "W 17"}
            )
        assert log.holds(0, {"blueprint": "W 17", "fog": 0.1 + 0.2}) and not log.holds(
            1, {"fog": 0.3, "blueprint": "W 17"}
        )
        assert 0 in log and 1 not in log
    assert (
        "the strategy now asks for another test 1; it is executed again" in capsys.readouterr().err
    )


@pytest.mark.parametrize("name", ["cut", "garbage", "folder"])
def test_a_damaged_database_names_the_way_to_a_new_one(tmp_path: Path, name: str) -> None:
    """An empty file is a new database for SQLite; and no checksum covers its rows."""
    store = tmp_path / "mlflow.db"
    with closing(sqlite3.connect(store)) as database:
        database.execute("CREATE TABLE runs (name TEXT)")
        database.executemany("INSERT INTO runs VALUES (?)", [("x" * 100,)] * 500)
        database.commit()
    DAMAGE[name](store)
    with pytest.raises(
        InputError,
        match=rf"^{store}: damaged \(.*type: mv {store} {store}\.damaged"
        r" && \./run --forcerun track$",
    ):
        connect(store)


def test_a_database_whose_migration_was_broken_off_names_the_way_to_a_new_one(
    tmp_path: Path,
) -> None:
    store = tmp_path / "mlflow.db"
    with closing(sqlite3.connect(store)) as database:
        database.execute("CREATE TABLE _alembic_tmp_metrics (key TEXT)")
    with pytest.raises(
        InputError,
        match=r"damaged \(a migration was interrupted at _alembic_tmp_metrics\); .*"
        rf" type: mv {store} ",
    ):
        connect(store)


@pytest.mark.parametrize("below", ["", "a/b"])
def test_what_is_in_the_way_of_a_folder_is_named(below: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("/nowhere/data")
    for name, got in {
        "file": "a file; move it away",
        "link": "a link to /nowhere/data, which is missing",
    }.items():
        with pytest.raises(
            InputError, match=f"^{tmp_path / name}: expected a folder to write in, got {got}$"
        ):
            write_json(tmp_path / name / below / "made.json", {})
