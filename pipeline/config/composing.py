"""Composes `conf/` into params.yaml with Hydra, once; everything else reads that file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError

from pipeline.config.components import check_targets
from pipeline.config.schema import Config
from pipeline.core.names import nearest
from pipeline.errors import InputError
from pipeline.scenarios.functional import FunctionalScenario

CONF = Path(__file__).resolve().parents[1] / "conf"
PARAMS = Path("params.yaml")
NOBODY = 999
"""A population that no scenario and no base set uses."""


def compose(study: str, overrides: Sequence[str]) -> Config:
    """Compose a study from conf/ with Hydra's overrides and check it."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    if study not in (studies := _choices("study")):
        raise InputError(f"there is no study '{study}'{nearest(study, studies)}")
    samplers = [f"+sampler@samplers.{name}={name}" for name in _choices("sampler")]
    with initialize_config_dir(str(CONF), version_base="1.3"):

        def composed(words: Sequence[str], scenarios: Sequence[str] = ()) -> Any:
            # The study comes after strategies and scenarios, because it may change them.
            return OmegaConf.to_container(
                hydra_compose("config", overrides=[*samplers, *scenarios, f"+study={study}", *words]), resolve=True
            )

        try:
            # The overrides of a study decide which scenarios it needs; the scenarios' overrides come last.
            chosen = [word for word in overrides if not word.lstrip("+~").startswith("scenario")]
            plain = composed(overrides, _scenarios(composed(chosen)))
        except (HydraException, OmegaConfBaseException) as error:
            shipped = composed([], _scenarios(composed([])))
            raise InputError(_override_message(shipped, overrides) or f"overrides: {str(error).splitlines()[0]}") from error
    config = validate(plain, "conf/")
    check_targets(config)
    return config


def _choices(group: str) -> list[str]:
    """The files of a folder of conf/ by name, without files that others include."""
    return sorted(path.stem for path in (CONF / group).glob("[!_]*.yaml"))


def _scenarios(plain: Any) -> list[str]:
    """Overrides that load the scenarios of the lists `search` and `held_out` from conf/scenario."""
    files = _choices("scenario")
    words = []
    for key in ("search", "held_out"):
        for name in plain[key] if isinstance(plain[key], list) else []:
            if name not in files:
                raise InputError(f"{key}: there is no conf/scenario/{name}.yaml{nearest(str(name), files)}")
            words.append(f"+scenario@scenarios.{name}={name}")
    return list(dict.fromkeys(words))


def functional_scenario(name: str) -> FunctionalScenario:
    """A scenario of conf/scenario/ by its file name."""
    other = "F1" if name == "F1star" else "F1star"
    # The other scenario's people are of no population that a scenario uses: the two must differ.
    others = [f"held_out=[{other}]", f"scenarios.{other}.people={NOBODY}"]
    return compose("default", [f"search=[{name}]", *others, "aeb.gate=detections"]).scenarios[name]


def _override_message(plain: Any, overrides: Sequence[str]) -> str:
    """Message for an override with an unknown key or file; empty if there is none."""
    for override in overrides:
        key, _, value = override.partition("=")
        if (CONF / key).is_dir() and value not in (files := _choices(key)):
            return f"there is no conf/{key}/{value}.yaml{nearest(value, files)}"
        section, path = plain, [] if (CONF / key).is_dir() else key.lstrip("+~").split(".")
        for part in path:
            if not isinstance(section, dict) or part not in section:
                known = section if isinstance(section, dict) else []
                return f"unknown key '{'.'.join(path)}'{nearest(part, known)}"
            section = section[part]
    return ""


def dump(config: Config, command: str) -> str:
    """The text of params.yaml."""
    body = yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, width=120, default_flow_style=None)
    return f"# Made by `{command}`; change conf/ or the overrides, not this file.\n{body}"


def load(path: Path = PARAMS) -> Config:
    """Read params.yaml; InputError that names the file and key."""
    try:
        plain = yaml.safe_load(path.read_text())
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; make it with `python -m pipeline compose study=default`") from error
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{path}{f', line {mark.line + 1}' if mark else ''}: not valid YAML ({problem})") from error
    return validate(plain, str(path))


def validate(plain: Any, source: str) -> Config:
    """Check plain data against the schema; InputError that names the source and the first wrong key."""
    try:
        return Config.model_validate(plain)
    except ValidationError as error:
        message = _message(error)
        if source == "conf/" and (scenario := re.match(r"scenarios\.(\w+)", message)):
            source = f"conf/scenario/{scenario[1]}.yaml"
        raise InputError(f"{source}: {message}") from error


def _message(error: ValidationError) -> str:
    # An unknown key often explains a missing one, so it comes first.
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"]]
    if first["type"] == "extra_forbidden":
        return f"unknown key '{'.'.join(path)}'{nearest(path[-1], _keys(path[:-1]))}"
    key, text = ".".join(path), first["msg"].removeprefix("Value error, ")
    if first["type"] == "missing":
        return f"key '{key}' is missing"
    got = "" if isinstance(first["input"], dict) else f", got {first['input']!r}"
    return f"{key}: {text}{got}" if key else text


def _keys(path: Sequence[str]) -> list[str]:
    """Known keys of the section at a path of the schema."""
    model: Any = Config
    for part in path:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        if get_args(model):
            model = next((a for a in get_args(model) if isinstance(a, type) and issubclass(a, BaseModel)), model)
    return list(getattr(model, "model_fields", {}))
