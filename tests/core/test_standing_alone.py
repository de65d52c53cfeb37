"""The core and the coverage command need no extra; code that needs one names it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import errors
from pipeline.errors import missing_extra

EXTRAS = (
    *("cv2", "dvc", "faster_coco_eval", "grimp", "hydra", "imageio_ffmpeg", "jinja2", "mlflow"),
    *(
        "mujoco",
        "onnx",
        "onnxruntime",
        "omegaconf",
        "safetensors",
        "snakemake",
        "torch",
        "transformers",
    ),
)
WITHOUT_THEM = f"""
import sys

class Missing:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing)
"""
SPACE = "variables: {weather: {values: [sunny, rainy]}, lanes: {values: [1, 2]}}"


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a process in which no extra can be imported."""
    script = folder / "script.py"
    script.write_text(f"{WITHOUT_THEM}\n{code}")
    return subprocess.run(
        [sys.executable, script],
        env={"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("package", ["pipeline.core", "pipeline.config", "pipeline.scenarios"])
def test_every_module_of_the_lower_layers_can_be_imported(package: str, tmp_path: Path) -> None:
    code = f"""
from importlib import import_module
from pkgutil import walk_packages
package = import_module("{package}")
for module in walk_packages(package.__path__, "{package}."):
    import_module(module.name)
import pipeline.protocols, pipeline.testing
"""
    done = python(code, tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_help_names_every_command(tmp_path: Path) -> None:
    done = python("from pipeline.__main__ import main; main(['--help'])", tmp_path)
    assert done.returncode == 0, done.stderr
    assert all(command in done.stdout for command in ("coverage", "simulate", "campaign"))


def test_coverage_is_scored_and_drawn(tmp_path: Path) -> None:
    (tmp_path / "space.yaml").write_text(SPACE)
    (tmp_path / "points.csv").write_text("weather,lanes\nsunny,1\nrainy,2\n")
    words = [
        "coverage",
        "score",
        "--space",
        "space.yaml",
        "--points",
        "points.csv",
        "--figures",
        "figures",
    ]
    done = python(
        f"import os; os.chdir({str(tmp_path)!r}); from pipeline.__main__ import main; "
        f"sys.exit(main({words}))",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "2  2        4       50.00 %" in done.stdout
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == [
        "growth.png",
        "planes.png",
    ]


@pytest.mark.parametrize(
    ("module", "extra"),
    [
        ("cv2", "simulation"),
        ("mujoco", "simulation"),
        ("hydra.utils", "simulation"),
        ("torch", "detectors"),
        ("onnx", "detectors"),
        ("onnxruntime.capi", "detectors"),
        ("snakemake", "workflow"),
        ("jinja2", "workflow"),
        ("transformers", "hugging-face"),
    ],
)
def test_a_missing_module_names_its_extra(module: str, extra: str) -> None:
    error = missing_extra(ModuleNotFoundError(name=module))
    name = module.partition(".")[0]
    assert (
        str(error)
        == f"needs {name}, which is not installed; type: pip install 'blindspot[{extra}]'"
    )


@pytest.mark.parametrize("module", ["numpy", "onn", "pipeline.nowhere", None])
def test_a_module_without_extra_raises_the_original_error(module: str | None) -> None:
    with pytest.raises(ModuleNotFoundError, match="^as it was$"):
        missing_extra(ModuleNotFoundError("as it was", name=module))


def test_a_forgotten_environment_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".venv").mkdir()
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "pipeline/errors.py"))
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    assert (
        str(missing_extra(ModuleNotFoundError(name="numpy")))
        == "needs numpy, which this Python lacks; type: source .venv/bin/activate"
    )


@pytest.mark.parametrize(
    ("command", "module", "extra"),
    [("simulate", "cv2", "simulation"), ("compose", "hydra", "simulation")],
)
def test_a_command_without_its_extra_ends_with_one_line(
    command: str, module: str, extra: str, tmp_path: Path
) -> None:
    words = [command, "F1" if command == "simulate" else "study=smoke"]
    done = python(f"from pipeline.__main__ import main; sys.exit(main({words}))", tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr
        == f"blindspot {command}: needs {module}, which is not installed; type: pip install "
        f"'blindspot[{extra}]'\n"
    )
