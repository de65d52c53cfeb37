"""Composes `conf/` into params.yaml with Hydra, once; everything else reads that file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from pipeline.config.components import check_components
from pipeline.config.messages import message
from pipeline.config.schema import Config
from pipeline.config.yaml_text import read_yaml
from pipeline.core.names import nearest
from pipeline.errors import InputError, shown
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.scenarios.people import FIRST_RANDOM

CONF = Path(__file__).resolve().parents[1] / "conf"
PARAMS = Path("params.yaml")
NOBODY = FIRST_RANDOM - 1
"""A population that no scenario and no base set uses."""


def compose(study: str, overrides: Sequence[str]) -> Config:
    """Compose a study from conf/ with Hydra's overrides and check it."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    check_study(study)
    for word in overrides:
        if word.endswith("={}") and not word.startswith("+"):
            raise InputError(
                f"{word} changes nothing, because an override only adds keys; "
                f"~{word[:-3]}.KEY removes one"
            )

    def with_scenarios(words: Sequence[str]) -> Any:
        # The overrides of a study decide which scenarios it needs; the scenarios' own overrides
        # come last, and the study comes after the scenarios, because it may change them.
        chosen = [word for word in words if not word.lstrip("+~").startswith("scenario")]
        scenarios = _scenarios(_composed(CONF, (f"+study={study}", *chosen)))
        return _composed(CONF, (*scenarios, f"+study={study}", *words))

    try:
        plain = with_scenarios(overrides)
    except InputError:
        raise
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(_unreadable() or f"{CONF}: {error}") from error
    # ValueError: a number for a file, as in `camera=640`.
    except (HydraException, OmegaConfBaseException, ValueError) as error:
        try:
            shipped = with_scenarios([])
        except (HydraException, OmegaConfBaseException, ValueError) as fault:
            first_line = str(fault).splitlines()[0]
            raise InputError(f"conf/study/{study}.yaml: {first_line}") from fault
        problem = _override_message(shipped, overrides)
        raise InputError(problem or f"overrides: {str(error).splitlines()[0]}") from error
    config = validate(plain, "conf/")
    check_components(config)
    return config


@cache
def _composed(folder: Path, words: tuple[str, ...]) -> Any:
    """conf/ composed by Hydra, as plain values; remembered, because that takes half a second."""
    from hydra import compose, initialize_config_dir
    from omegaconf import OmegaConf

    samplers = [f"+sampler@samplers.{name}={name}" for name in _choices("sampler")]
    with initialize_config_dir(str(folder), version_base="1.3"):
        config = compose("config", overrides=[*samplers, *words])
        return OmegaConf.to_container(config, resolve=True, throw_on_missing=True)


def check_study(name: str) -> None:
    """InputError unless conf/study/ has a study of this name."""
    if name not in (names := _choices("study")):
        raise InputError(f"there is no study {shown(name)}{nearest(name, names)}")


def _unreadable() -> str:
    """The message for the first file of conf/ that is not YAML."""
    for path in sorted(CONF.rglob("*.yaml")):
        try:
            read_yaml(path)
        except InputError as error:
            return str(error)
    return ""


def _choices(group: str) -> list[str]:
    """The files of a folder of conf/ by name, without files that others include."""
    return sorted(path.stem for path in (CONF / group).glob("[!_]*.yaml"))


def _scenarios(plain: Any) -> list[str]:
    """Overrides that load the scenarios of the lists `search` and `held_out` from conf/scenario."""
    files = _choices("scenario")
    words = []
    for key in ("search", "held_out"):
        named = plain.get(key)
        for name in named if isinstance(named, list) else []:
            if name not in files:
                raise InputError(
                    f"{key}: there is no conf/scenario/{name}.yaml{nearest(str(name), files)}"
                )
            words.append(f"+scenario@scenarios.{name}={name}")
    return list(dict.fromkeys(words))


def functional_scenario(name: str) -> FunctionalScenario:
    """A scenario of conf/scenario/ by its file name; InputError if there is none."""
    if name not in (files := _choices("scenario")):
        raise InputError(f"scenario: there is no conf/scenario/{name}.yaml{nearest(name, files)}")
    return compose("default", [*_alone(name), "aeb.gate=detections"]).scenarios[name]


def study_of(name: str, overrides: Sequence[str] = ()) -> Config:
    """The default study with a single searched scenario of conf/scenario/ and a gate that fits."""
    gate = [] if functional_scenario(name).asks_to_brake else ["aeb.gate=detections"]
    return compose("default", [*_alone(name), *gate, *overrides])


def _alone(name: str) -> list[str]:
    other = "F1" if name == "F1star" else "F1star"
    # The other scenario's people are of no population that a scenario uses: both must differ.
    return [f"search=[{name}]", f"held_out=[{other}]", f"scenarios.{other}.people={NOBODY}"]


def _override_message(plain: Any, overrides: Sequence[str]) -> str:
    """The message for the first wrong override; empty if there is none.

    Wrong are an unknown key or file, and a value that Hydra cannot read.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    for override in overrides:
        key, equals, value = override.partition("=")
        if not key or not (equals or key.startswith("~")):
            return f"expected key=value, got {shown(override)}"
        try:
            OverridesParser.create().parse_override(override)
        except HydraException:
            return (
                f"{key}: expected a value that Hydra reads, got {shown(value)}; "
                "is a bracket or a quotation mark missing?"
            )
        if override.startswith("+"):  # Its key may be new.
            continue
        if (CONF / key).is_dir() and value not in (files := _choices(key)):
            return f"there is no conf/{key}/{value}.yaml{nearest(value, files)}"
        section, path = plain, [] if (CONF / key).is_dir() else key.lstrip("~").split(".")
        for depth, part in enumerate(path):
            if not isinstance(section, dict) or part not in section:
                above = "".join(f"{name}." for name in path[:depth])
                names = section if isinstance(section, dict) else []
                hint = nearest(above + part, [above + name for name in names])
                return f"unknown key '{'.'.join(path)}'{hint}"
            section = section[part]
    return ""


def dump(config: Config, command: str) -> str:
    """The text of params.yaml."""
    body = yaml.safe_dump(
        config.model_dump(mode="json"), sort_keys=False, width=120, default_flow_style=None
    )
    return f"# Made by `{command}`; change conf/ or the overrides, not this file.\n{body}"


def load(path: Path = PARAMS) -> Config:
    """Read params.yaml and check its schema; `check_components` checks the rest.

    Raises:
        InputError: no such file, or a wrong key; the message names both.
    """
    try:
        plain = read_yaml(path)
    except FileNotFoundError as error:
        where = f" in {Path.cwd()}" if path == PARAMS else ""
        raise InputError(
            f"{path}: no such file{where}; make it with `python -m pipeline compose study=default`"
        ) from error
    return validate(plain, str(path))


def of_snakemake(config: Mapping[str, Any], source: Path = PARAMS) -> Config:
    """The config that Snakemake hands over.

    source: the file that Snakemake read, for messages. Its command line leaves the numbers of a
    list, as in `seeds=[0,1]`, as text.
    """
    plain = dict(config)
    if isinstance(plain.get("seeds"), list):
        plain["seeds"] = [
            int(seed) if isinstance(seed, str) and seed.isdecimal() else seed
            for seed in plain["seeds"]
        ]
    return validate(plain, str(source))


def validate(plain: Any, source: str) -> Config:
    """Check plain data against the schema.

    Raises:
        InputError: names the source and the first wrong key.
    """
    try:
        # As JSON, because only then does the strict schema take lists for tuples.
        return Config.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        problem = message(error, Config)
        if source == "conf/" and (scenario := re.match(r"scenarios\.(\w+)", problem)):
            source = f"conf/scenario/{scenario[1]}.yaml"
        raise InputError(f"{source}: {problem}") from error
    # Such as a date or a number of 5,000 digits.
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: expected text, numbers, lists and mappings alone ({error})"
        ) from error
