"""filter/<strategy>/<version>.csv: every kept frame of a strategy's campaigns against a version,
whether training may use it, and why.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import pandas as pd

from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.errors import InputError

COLUMNS = ("test_id", "step", "kept", "reason", "visible_pixels", "contrast", "confidence")
OVERRULES = ("test_id", "step", "keep")
TRUE, FALSE = {"true", "1", "yes"}, {"false", "0", "no"}


def write_filter(path: Path, rows: pd.DataFrame) -> None:
    """Write the verdict on every frame: columns as `COLUMNS`, kept as true or false."""
    if tuple(rows.columns) != COLUMNS:
        raise ValueError(f"columns must be {COLUMNS}, got {tuple(rows.columns)}")
    table = rows.assign(kept=rows["kept"].map({True: "true", False: "false"}))
    write_bytes(path, table.to_csv(index=False, lineterminator="\n", float_format="%.4g").encode())


def read_filter(path: Path) -> pd.DataFrame:
    """Read a file of `write_filter`, `kept` as bool.

    Raises:
        InputError: naming the file and the row if it is anything else.
    """
    return _read(path, COLUMNS, "kept")


def read_overrules(path: Path) -> pd.DataFrame:
    """Read a person's table `test_id,step,keep`, `keep` as bool.

    Raises:
        InputError: naming the file and the row.
    """
    return _read(path, OVERRULES, "keep")


def _read(path: Path, columns: tuple[str, ...], flag: str) -> pd.DataFrame:
    try:
        table = pd.read_csv(
            io.BytesIO(read_bytes(path)),
            dtype={"test_id": str, "step": str, flag: str},
            skipinitialspace=True,
        )
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: expected a table with columns {','.join(columns)}, got {error}"
        ) from error
    if tuple(table.columns) != columns:
        raise InputError(
            f"{path}: columns must be {','.join(columns)}, got {','.join(table.columns)}"
        )
    for row, (value, step) in enumerate(zip(table[flag], table["step"], strict=True), 2):
        if str(value).strip().lower() not in TRUE | FALSE:
            raise InputError(f"{path}, line {row}: {flag} must be true or false, got {value!r}")
        if not re.fullmatch("[0-9]{1,18}", str(step).strip()):
            raise InputError(f"{path}, line {row}: step must be a whole number, got {step!r}")
    if table["test_id"].isna().any():
        raise InputError(
            f"{path}, line {int(table['test_id'].isna().argmax()) + 2}: test_id is missing"
        )
    return table.assign(
        **{
            flag: table[flag].str.strip().str.lower().isin(TRUE),
            "step": table["step"].astype("int64"),
        }
    )
