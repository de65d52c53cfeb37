"""Mutates the config of a study and tells what becomes of it: refused with the key's name, accepted, or a traceback.

A mutation is judged by the schema's own annotations, not by its validation: `fits` says whether a value is in a key's range.
"""

from __future__ import annotations

import copy
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import yaml
from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from benchmarks.faults.report import Row
from pipeline.config.components import check_components
from pipeline.config.composing import compose, load, validate
from pipeline.config.schema import Config
from pipeline.core.samplers.coverage import CoverageSampler
from pipeline.core.samplers.evolutionary import EvolutionarySampler
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.gaussian_process import GaussianProcessSampler
from pipeline.core.samplers.mixed import MixedSampler
from pipeline.detectors.onnx import OnnxDetector
from pipeline.errors import LONGEST_MESSAGE, InputError, one_line
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.simulator import MujocoSimulator
from pipeline.workflow.jobs import Jobs, step_names

Keys = tuple[str | int, ...]
HOSTILE: tuple[str, ...] = (
    *(
        "`id`",
        "$(id)",
        "../../x",
        "a/b/../../..",
        "x\ny",
        "-rf",
        "a b",
        "",
        "caf\u00e9",
        "{x}",
        "x" * 10_000,
        ".*",
        "a;b",
        "\x00",
    ),
)
ODD: tuple[Any, ...] = (
    "abc",
    "12",
    True,
    None,
    [],
    {},
    -1,
    1.5,
    [[1]],
    {"a": 1},
    10**30,
    float("nan"),
    float("inf"),
    -(10**9),
    *HOSTILE,
)
TARGETS = (
    "builtins.type",
    "os.system",
    "pipeline.protocols.Detector",
    "nowhere.X",
    "x",
    "",
    ".",
    "pipeline.core.car.Car",
    "json",
)
SAMPLERS: dict[str, tuple[Any, ...]] = {
    "batch_size": (-3, 0, 1001, 2.5, True, "20"), "k": (0, 99, -1), "explore": (1.5, -0.1, "x"), "step": (0, 2), "initial": (0, -1),
    "parents": (0,), "impact": (2,), "kappa": (-1, float("nan")), "epsilon": (0, -1), "omega_threshold": (0, 5), "uniform": (7,),
    "failure_threshold_s": (0, -1, 99), "trees": (0, 10**6), "candidates": (0, 10**9), "diverse": (1, "yes"), "seed": (1,), "space": ({},),
}  # fmt: skip
VARIABLES: dict[str, tuple[Any, ...]] = {
    "kind": ("continous", 3, None), "low": ("x", 1e6, True, float("nan")), "high": (-1e6, None, float("inf")), "step": (0, -1, "1", 1e6),
    "cyclic": ("yes", 1), "unit": (3,), "cuts": ([5], "x", [50, 20]), "values": ([], "a", [1]), "weights": ([1], "x"), "stp": (1,),
}  # fmt: skip
CLASSES = (
    CoverageSampler,
    ForestSampler,
    EvolutionarySampler,
    GaussianProcessSampler,
    MixedSampler,
)
HINTS = {name: hint for made in CLASSES for name, hint in get_type_hints(made).items()}
HINTS |= get_type_hints(OnnxDetector.__init__, include_extras=True)
"""The annotations of the parameters of strategies and of the default detector, which agree on the names that they share."""
NEEDED = tuple(name for name in MujocoSimulator.needs if name != "blueprint")
"""Variables of a scenario that no study can miss."""
CRITERIA = (Ge, Gt, Le, Lt, MinLen, MultipleOf)


@dataclass(frozen=True)
class Mutation:
    """A changed config. content: plain data, or the bytes of a file. key: what a message must name. valid: by the schema's annotations;
    None where they do not decide."""

    what: str
    key: str
    content: Any
    valid: bool | None


def fits(value: Any, hint: Any) -> bool | None:
    """Whether a value is in the range of an annotation; None if the annotation does not decide."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _all([fits(value, arguments[0]), *(_meets(value, each) for each in arguments[1:])])
    if origin in (Union, UnionType):
        found = [fits(value, each) for each in arguments]
        return True if True in found else None if None in found else False
    if origin is Literal:
        return isinstance(value, str) and value in arguments
    if origin is tuple:
        if not isinstance(value, list):
            return False
        each = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else list(arguments)
        return len(each) == len(value) and _all(
            [fits(*pair) for pair in zip(value, each, strict=True)]
        )
    if origin is dict or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        return None if isinstance(value, dict) else False
    if hint in (bool, str, NoneType):
        return isinstance(value, hint)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return None


def _all(found: list[bool | None]) -> bool | None:
    return False if False in found else None if None in found else True


def _meets(value: Any, limit: Any) -> bool | None:
    if isinstance(limit, FieldInfo):
        return _all([_meets(value, each) for each in limit.metadata])
    if not isinstance(limit, CRITERIA):
        return False if isinstance(value, str) and value in HOSTILE else None
    if isinstance(limit, MinLen):
        return isinstance(value, list | dict | str) and len(value) >= limit.min_length
    if not isinstance(value, int | float):
        return None if value is None else False
    signs: dict[type, Any] = {
        Ge: lambda a, b: a >= b,
        Gt: lambda a, b: a > b,
        Le: lambda a, b: a <= b,
        Lt: lambda a, b: a < b,
    }
    bound = (
        next(iter(vars(limit).values()))
        if hasattr(limit, "__dict__")
        else getattr(limit, limit.__slots__[0])
    )
    return bool(
        value % bound == 0 if isinstance(limit, MultipleOf) else signs[type(limit)](value, bound)
    )


def hint_at(path: Keys) -> Any:
    """The annotation of a key, with its limits; Any outside the schema."""
    if path[:2] == ("simulator", "camera"):
        return _hint(CameraSettings, path[2:])
    if path[0] in ("samplers", "detector") and len(path) == (3 if path[0] == "samplers" else 2):
        return HINTS.get(str(path[-1]), Any)
    return _hint(Config, path)


def _hint(hint: Any, path: Keys) -> Any:
    for part in path:
        inner = next(
            (
                a
                for a in (hint, *get_args(hint))
                if isinstance(a, type) and issubclass(a, BaseModel)
            ),
            None,
        )
        if inner is not None and part in inner.model_fields:
            field = inner.model_fields[str(part)]
            hint = (
                Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
            )
        elif get_origin(hint) is dict:
            hint = get_args(hint)[1]
        else:
            return Any
    return hint


def keys(plain: Any, path: Keys = ()) -> Iterator[Keys]:
    """Every key of nested mappings."""
    for name, value in plain.items() if isinstance(plain, dict) else ():
        yield (*path, name)
        yield from keys(value, (*path, name))


def mutations(plain: dict[str, Any], count: int, seed: int) -> Iterator[Mutation]:
    """Seeded mutations of a valid config."""
    rng = np.random.default_rng(seed)
    paths, makers = (
        list(keys(plain)),
        (
            _value,
            _value,
            _value,
            _bound,
            _misspelt,
            _dropped,
            _renamed,
            _component,
            _variable,
            _text,
            _text,
        ),
    )
    while count:
        made = makers[rng.integers(len(makers))](copy.deepcopy(plain), paths, rng)
        if made is not None:
            count -= 1
            yield made


def _put(plain: Any, path: Keys, value: Any) -> Any:
    inner = plain
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = value
    return plain


def _pick(choices: Any, rng: np.random.Generator) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _value(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    path, value = _pick(paths, rng), copy.deepcopy(_pick(ODD, rng))
    return Mutation("value", str(path[-1]), _put(plain, path, value), fits(value, hint_at(path)))


def _bound(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    path = _pick(paths, rng)
    while not (bounds := _bounds(hint_at(path))):
        path = _pick(paths, rng)
    bound = _pick(bounds, rng)
    value = _pick(
        [bound, bound - 1, bound + 1, bound + 0.001, bound - 0.001, -bound, bound * 1000], rng
    )
    return Mutation("limit", str(path[-1]), _put(plain, path, value), fits(value, hint_at(path)))


def _bounds(hint: Any) -> list[Any]:
    """The numbers that limit an annotation, wherever in it they stand."""
    found = [
        getattr(hint, name)
        for name in ("ge", "gt", "le", "lt")
        if getattr(hint, name, None) is not None
    ]
    return found + [
        bound
        for each in (*get_args(hint), *getattr(hint, "metadata", ()))
        for bound in _bounds(each)
    ]


def _misspelt(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    path = _pick(paths, rng)
    name = str(path[-1]) + _pick(("s", "_", "2"), rng)
    hint = hint_at(path[:-1]) if len(path) > 1 else Config
    known = isinstance(hint, type) and issubclass(hint, BaseModel)
    return Mutation(
        "unknown key", name, _put(plain, (*path[:-1], name), 1), False if known else None
    )


def _dropped(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    path = _pick(paths, rng)
    inner = plain
    for part in path[:-1]:
        inner = inner[part]
    del inner[path[-1]]
    return Mutation(
        "missing key",
        str(path[-1]),
        plain,
        False
        if len(path) == 1
        or (path[2:3] == ("space",) and path[3:] in ((), *((name,) for name in NEEDED)))
        else None,
    )


def _renamed(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    table = _pick(
        (
            ("scenarios",),
            ("samplers",),
            ("arms",),
            ("scenarios", "F1", "actors"),
            ("scenarios", "F1", "space"),
            ("tested",),
        ),
        rng,
    )
    inner = plain
    for part in table:
        inner = inner[part]
    inner[_pick(HOSTILE, rng)] = copy.deepcopy(next(iter(inner.values()), "x.onnx"))
    return Mutation("hostile name", table[-1], plain, False)


def _component(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    section = _pick(
        ("simulator", "detector", *(f"samplers.{name}" for name in plain["samplers"])), rng
    )
    path = tuple(section.split("."))
    if rng.random() < 0.4 or section in ("simulator", "detector"):
        return Mutation(
            "class", path[0], _put(plain, (*path, "_target_"), _pick(TARGETS, rng)), False
        )
    name = _pick(
        [name for name in plain["samplers"][path[1]] if name in SAMPLERS] + ["seed", "space"], rng
    )
    return Mutation("setting", name, _put(plain, (*path, name), _pick(SAMPLERS[name], rng)), False)


def _variable(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    name, key = _pick(("rain", "sun_azimuth", "animation"), rng), _pick(list(VARIABLES), rng)
    if (name == "animation") != (key == "values"):
        return None
    return Mutation(
        "variable",
        key,
        _put(plain, ("scenarios", "F1", "space", name, key), _pick(VARIABLES[key], rng)),
        False,
    )


def _text(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    text = yaml.safe_dump(plain, sort_keys=False).encode()
    at = int(rng.integers(len(text)))
    lines = text.split(b"\n")
    line = int(rng.integers(len(lines) - 1))
    choice = int(rng.integers(5))
    if choice == 0:
        return Mutation(
            "not UTF-8",
            "UTF-8",
            text[:at] + bytes([_pick((0xFF, 0xE9, 0xC3), rng)]) + text[at:],
            False,
        )
    if choice == 1:
        twice = next(i for i in range(line, -1, -1) if lines[i][:1].isalpha())
        name = lines[twice].split(b":")[0]
        return Mutation("key twice", name.decode(), text + name + b": 1\n", False)
    if choice == 2:
        return Mutation("cut", "", text[:at], None)
    if choice == 3:
        return Mutation("line gone", "", b"\n".join([*lines[:line], *lines[line + 1 :]]), None)
    return Mutation(
        "one sign",
        "",
        text[:at]
        + _pick((b":", b"{", b"]", b"&", b"*a", b"!", b"%", b"\t", b"\x00", b"?"), rng)
        + text[at + 1 :],
        None,
    )


def outcome(mutation: Mutation, folder: Path) -> str:
    """What becomes of a mutation: `refused`, `refused, key not named`, `refused by another key's rule` (its own range holds), `accepted`,
    `wrongly accepted`, or the traceback's last line."""
    try:
        if isinstance(mutation.content, bytes):
            (folder / "params.yaml").write_bytes(mutation.content)
            config = load(folder / "params.yaml")
        else:
            config = validate(mutation.content, "params.yaml")
        check_components(config)
        jobs = Jobs(config, step_names())
        sum(1 for _ in jobs.in_order())
    except InputError as error:
        said = one_line(error)
        if mutation.key[:40] in str(error) and len(said) <= LONGEST_MESSAGE + 1:
            return "refused"
        return (
            f"refused, key not named: {said}"
            if mutation.valid is False
            else f"refused by another key's rule: {said}"
        )
    except Exception as error:
        return f"traceback: {type(error).__name__}: {str(error)[:200]}"
    return "wrongly accepted" if mutation.valid is False else "accepted"


def counted(count: int, seed: int) -> tuple[Counter[tuple[str, str]], list[str]]:
    """The outcomes of mutations of the default study by kind, and a line for each that is neither refused nor accepted."""
    plain = json.loads(compose("default", []).model_dump_json())
    found: Counter[tuple[str, str]] = Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        for mutation in mutations(plain, count, seed):
            result = outcome(mutation, Path(folder))
            found[mutation.what, result.split(":")[0]] += 1
            if result not in ("refused", "accepted"):
                wrong.append(f"{mutation.what} {mutation.key[:40]!r}: {result}")
    return found, wrong


def configs(count: int, seed: int) -> list[Row]:
    """A row for each kind of mutation; prints those that are neither refused by name nor accepted."""
    found, lines = counted(count, seed)
    print("\n".join(lines), file=sys.stderr)
    rows = []
    for what in sorted({what for what, _ in found}):
        ways = {result: number for (kind, result), number in sorted(found.items()) if kind == what}
        wrong = sum(
            number for result, number in ways.items() if result.startswith(("traceback", "wrongly"))
        )
        rows.append(Row("config", what, sum(ways.values()), wrong, ways))
    return rows
