"""Do the exports follow the standards? Checks all scenarios and a curved street against ASAM's schemas.

    python benchmarks/exports.py [--frames frames.parquet]

The schemas of OpenSCENARIO 1.1 and OpenDRIVE 1.6 come with ASAM's checkers, that of OpenLABEL 1.0 with Vicomtech's VCD. uv installs
them into a separate environment, because they need older packages than ours. The command therefore needs a package index.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGES = ("asam-qc-opendrive==1.0.0", "asam-qc-openscenarioxml==1.0.0", "vcd==6.0.3")


def export(folder: Path, frames: Path | None) -> None:
    """Write what is to be checked."""
    from pipeline.artefacts.frame_export import export_frames
    from pipeline.artefacts.openscenario import open_drive, write_openscenario, xml_bytes
    from pipeline.commands.simulate import concrete_scenario
    from pipeline.config.composing import CONF, functional_scenario
    from pipeline.scenarios.streets import Town

    for path in sorted((CONF / "scenario").glob("[!_]*.yaml")):
        scenario = functional_scenario(path.stem)
        words = ["fog=30", "rain=40", "pedestrian_shift=0.2"]
        write_openscenario(
            scenario, concrete_scenario(scenario.logical_space(), words), folder / path.stem
        )
    (folder / "curved.xodr").write_bytes(
        xml_bytes(open_drive(Town(seed=0, lanes_ahead=2, curvature_1pm=-0.01)))
    )
    if frames:
        export_frames(frames, folder / "frames", 60.0, 0.0)


def validate(folder: Path) -> int:
    """Check every file of a folder against its schema; returns how many are wrong. Runs where the schemas are installed."""
    import json

    import jsonschema
    import qc_opendrive
    import qc_openscenario
    import vcd.schema
    import xmlschema

    scenario = xmlschema.XMLSchema11(
        Path(qc_openscenario.__file__).parent / "schema" / "1.1.0" / "OpenSCENARIO.xsd"
    )
    road = xmlschema.XMLSchema11(
        Path(qc_opendrive.__file__).parent / "schema" / "1.6.1" / "opendrive_16_core.xsd"
    )
    label = jsonschema.Draft7Validator(vcd.schema.openlabel_schema)
    wrong = 0
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".xosc", ".xodr"):
            errors = [
                f"{e.path}: {e.reason}"
                for e in (scenario if path.suffix == ".xosc" else road).iter_errors(str(path))
            ]
        elif path.parent.name == "openlabel":
            errors = [
                f"{e.json_path}: {e.message[:200]}"
                for e in label.iter_errors(json.loads(path.read_text()))
            ]
        else:
            continue
        wrong += bool(errors)
        print(
            f"{path.name}: {'valid' if not errors else f'{len(errors)} errors, the first: {errors[0]}'}",
            flush=True,
        )
    return wrong


def main() -> int:
    """Export, then validate in another environment."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=Path, help="frames.parquet of a campaign, for OpenLABEL")
    parser.add_argument("--validate", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.validate:
        return int(validate(options.validate) > 0)
    with tempfile.TemporaryDirectory() as folder:
        export(Path(folder), options.frames)
        with_packages = [word for package in PACKAGES for word in ("--with", package)]
        uv: list[str | Path] = [
            Path(sys.executable).with_name("uv"),
            "run",
            "--isolated",
            "--no-project",
            *with_packages,
        ]
        return subprocess.run(
            [*uv, "python", Path(__file__).resolve(), "--validate", folder], check=False
        ).returncode


if __name__ == "__main__":
    sys.exit(main())
