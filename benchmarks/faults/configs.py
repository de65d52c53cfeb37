"""Mutates the config of a study: each mutation is rejected by the key's name, or accepted.

A mutation is judged by the schema's own annotations, not by its validation: `fits` tests whether a
value is in a key's range.
"""

from __future__ import annotations

import copy
import json
import operator
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
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
from pipeline.simulators.mujoco.world import MujocoWorld
from pipeline.workflow.jobs import Jobs, step_names

Keys = tuple[str | int, ...]
HOSTILE: tuple[str, ...] = (
    *("`id`", "$(id)", "../../x", "a/b/../../..", "x\ny", "-rf", "a b", "", "caf\u00e9", "{x}"),
    *("x" * 10_000, ".*", "a;b", "\x00"),
)
ODD: tuple[Any, ...] = (
    *("abc", "12", True, None, [], {}, -1, 1.5, [[1]], {"a": 1}),
    *(10**30, float("nan"), float("inf"), -(10**9), *HOSTILE),
)
TARGETS = (
    *("builtins.type", "os.system", "pipeline.protocols.Detector", "nowhere.X", "x", "", "."),
    *("pipeline.core.car.Car", "json"),
)
SAMPLERS: dict[str, tuple[Any, ...]] = {
    "batch_size": (-3, 0, 1001, 2.5, True, "20"),
    "k": (0, 99, -1),
    "explore": (1.5, -0.1, "x"),
    "step": (0, 2),
    "initial": (0, -1),
    "parents": (0,),
    "impact": (2,),
    "kappa": (-1, float("nan")),
    "epsilon": (0, -1),
    "omega_threshold": (0, 5),
    "uniform": (7,),
    "failure_threshold_s": (0, -1, 99),
    "trees": (0, 10**6),
    "candidates": (0, 10**9),
    "diverse": (1, "yes"),
    "seed": (1,),
    "space": ({},),
}
VARIABLES: dict[str, tuple[Any, ...]] = {
    "kind": ("continous", 3, None),
    "low": ("x", 1e6, True, float("nan")),
    "high": (-1e6, None, float("inf")),
    "step": (0, -1, "1", 1e6),
    "cyclic": ("yes", 1),
    "unit": (3,),
    "cuts": ([5], "x", [50, 20]),
    "values": ([], "a", [1]),
    "weights": ([1], "x"),
    "stp": (1,),
}
CLASSES = (
    CoverageSampler,
    ForestSampler,
    EvolutionarySampler,
    GaussianProcessSampler,
    MixedSampler,
)
HINTS = {name: hint for sampler in CLASSES for name, hint in get_type_hints(sampler).items()}
HINTS |= get_type_hints(OnnxDetector.__init__, include_extras=True)
"""The annotations of the settings of strategies and of the default detector."""
NEEDED = tuple(name for name in MujocoWorld.needs if name != "blueprint")
"""Variables of a scenario that no study can miss."""
TABLES: tuple[Keys, ...] = (
    ("scenarios",),
    ("samplers",),
    ("arms",),
    ("scenarios", "F1", "actors"),
    ("scenarios", "F1", "space"),
    ("tested",),
)
"""Tables whose keys are names that a user chooses."""
SIGNS = (b":", b"{", b"]", b"&", b"*a", b"!", b"%", b"\t", b"\x00", b"?")
COMPARED: Mapping[type, Callable[[Any, Any], bool]] = {
    Ge: operator.ge,
    Gt: operator.gt,
    Le: operator.le,
    Lt: operator.lt,
    MultipleOf: lambda value, step: value % step == 0,
}


@dataclass(frozen=True)
class Mutation:
    """A changed config.

    content: plain data, or the bytes of a file. key: what a message must name. valid: by the
    schema's annotations; None where they do not decide.
    """

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
        answers = [fits(value, each) for each in arguments]
        undecided = None if None in answers else False
        return True if True in answers else undecided
    if origin is Literal:
        return isinstance(value, str) and value in arguments
    if origin is tuple:
        if not isinstance(value, list):
            return False
        each = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else list(arguments)
        return len(each) == len(value) and _all(list(map(fits, value, each)))
    if origin is dict or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        return None if isinstance(value, dict) else False
    if hint in (bool, str, NoneType):
        return isinstance(value, hint)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return None


def _all(answers: list[bool | None]) -> bool | None:
    if False in answers:
        return False
    return None if None in answers else True


def _meets(value: Any, limit: Any) -> bool | None:
    if isinstance(limit, FieldInfo):
        return _all([_meets(value, each) for each in limit.metadata])
    if isinstance(limit, MinLen):
        return isinstance(value, list | dict | str) and len(value) >= limit.min_length
    if type(limit) not in COMPARED:
        return False if isinstance(value, str) and value in HOSTILE else None
    if not isinstance(value, int | float):
        return None if value is None else False
    return bool(COMPARED[type(limit)](value, getattr(limit, fields(limit)[0].name)))


def hint_at(path: Keys) -> Any:
    """The annotation of a key, with its limits; Any outside the schema."""
    if path[:2] == ("simulator", "camera"):
        return _hint(CameraSettings, path[2:])
    if path[0] in ("samplers", "detector") and len(path) == (3 if path[0] == "samplers" else 2):
        return HINTS.get(str(path[-1]), Any)
    return _hint(Config, path)


def _hint(hint: Any, path: Keys) -> Any:
    for part in path:
        models = [
            each
            for each in (hint, *get_args(hint))
            if isinstance(each, type) and issubclass(each, BaseModel)
        ]
        if models and part in models[0].model_fields:
            field = models[0].model_fields[str(part)]
            hint = field.annotation
            if field.metadata:
                hint = Annotated[field.annotation, *field.metadata]
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
    rng, paths = np.random.default_rng(seed), list(keys(plain))
    while count:
        mutate = MUTATIONS[rng.integers(len(MUTATIONS))]
        mutation = mutate(copy.deepcopy(plain), paths, rng)
        if mutation is not None:
            count -= 1
            yield mutation


def _at(plain: Any, path: Keys) -> Any:
    for part in path:
        plain = plain[part]
    return plain


def _put(plain: Any, path: Keys, value: Any) -> Any:
    _at(plain, path[:-1])[path[-1]] = value
    return plain


def _pick(choices: Any, rng: np.random.Generator) -> Any:
    return choices[int(rng.integers(len(choices)))]


def value_changed(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """Another value, of another type or size."""
    path, value = _pick(paths, rng), copy.deepcopy(_pick(ODD, rng))
    return Mutation("value", str(path[-1]), _put(plain, path, value), fits(value, hint_at(path)))


def at_limit(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """A value at or beside a limit of its range."""
    path = _pick(paths, rng)
    while not (bounds := _bounds(hint_at(path))):
        path = _pick(paths, rng)
    bound = _pick(bounds, rng)
    near = [bound, bound - 1, bound + 1, bound + 0.001, bound - 0.001, -bound, bound * 1000]
    value = _pick(near, rng)
    return Mutation("limit", str(path[-1]), _put(plain, path, value), fits(value, hint_at(path)))


def _bounds(hint: Any) -> list[Any]:
    """The numbers that limit an annotation, wherever in it they stand."""
    limits = [getattr(hint, name, None) for name in ("ge", "gt", "le", "lt")]
    bounds = [limit for limit in limits if limit is not None]
    for each in (*get_args(hint), *getattr(hint, "metadata", ())):
        bounds += _bounds(each)
    return bounds


def key_added(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """A misspelt key beside the right one."""
    path = _pick(paths, rng)
    name = str(path[-1]) + _pick(("s", "_", "2"), rng)
    hint = hint_at(path[:-1]) if len(path) > 1 else Config
    closed = isinstance(hint, type) and issubclass(hint, BaseModel)
    content = _put(plain, (*path[:-1], name), 1)
    return Mutation("unknown key", name, content, False if closed else None)


def key_dropped(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """A key less."""
    path = _pick(paths, rng)
    del _at(plain, path[:-1])[path[-1]]
    variable = path[2:3] == ("space",) and (len(path) == 3 or path[3:] in [(n,) for n in NEEDED])
    needed = len(path) == 1 or variable
    return Mutation("missing key", str(path[-1]), plain, False if needed else None)


def name_hostile(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """A name that a shell or a path would read as something else."""
    table = _pick(TABLES, rng)
    inner = _at(plain, table)
    inner[_pick(HOSTILE, rng)] = copy.deepcopy(next(iter(inner.values()), "x.onnx"))
    return Mutation("hostile name", str(table[-1]), plain, False)


def component(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """Another class, or a wrong setting of a strategy."""
    samplers = [f"samplers.{name}" for name in plain["samplers"]]
    section = _pick(("simulator", "detector", *samplers), rng)
    path = tuple(section.split("."))
    if rng.random() < 0.4 or section in ("simulator", "detector"):
        content = _put(plain, (*path, "_target_"), _pick(TARGETS, rng))
        return Mutation("class", path[0], content, False)
    settings = [name for name in plain["samplers"][path[1]] if name in SAMPLERS]
    name = _pick([*settings, "seed", "space"], rng)
    return Mutation("setting", name, _put(plain, (*path, name), _pick(SAMPLERS[name], rng)), False)


def variable(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation | None:
    """A wrong field of a scenario's variable; None if it would not be wrong."""
    name, key = _pick(("rain", "sun_azimuth", "animation"), rng), _pick(list(VARIABLES), rng)
    if (name == "animation") != (key == "values"):
        return None
    path = ("scenarios", "F1", "space", name, key)
    return Mutation("variable", key, _put(plain, path, _pick(VARIABLES[key], rng)), False)


def text_changed(plain: Any, paths: list[Keys], rng: np.random.Generator) -> Mutation:
    """A damaged file."""
    text = yaml.safe_dump(plain, sort_keys=False).encode()
    at = int(rng.integers(len(text)))
    lines = text.split(b"\n")
    line = int(rng.integers(len(lines) - 1))
    choice = int(rng.integers(5))
    if choice == 0:
        odd = bytes([_pick((0xFF, 0xE9, 0xC3), rng)])
        return Mutation("not UTF-8", "UTF-8", text[:at] + odd + text[at:], False)
    if choice == 1:
        twice = next(i for i in range(line, -1, -1) if lines[i][:1].isalpha())
        name = lines[twice].split(b":")[0]
        return Mutation("key twice", name.decode(), text + name + b": 1\n", False)
    if choice == 2:
        return Mutation("cut", "", text[:at], None)
    if choice == 3:
        return Mutation("line gone", "", b"\n".join([*lines[:line], *lines[line + 1 :]]), None)
    return Mutation("one sign", "", text[:at] + _pick(SIGNS, rng) + text[at + 1 :], None)


MUTATIONS: tuple[Callable[..., Mutation | None], ...] = (
    *(value_changed, value_changed, value_changed, at_limit, key_added, key_dropped),
    *(name_hostile, component, variable, text_changed, text_changed),
)
"""How often each way is chosen."""


def outcome(mutation: Mutation, folder: Path) -> str:
    """How a mutation ends.

    One of `refused`, `refused, key not named`, `refused by another key's rule` (the value is in its
    own range), `accepted`, `wrongly accepted`, or the last line of a traceback.
    """
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
        message = one_line(error)
        if mutation.key[:40] in str(error) and len(message) <= LONGEST_MESSAGE + 1:
            return "refused"
        if mutation.valid is False:
            return f"refused, key not named: {message}"
        return f"refused by another key's rule: {message}"
    except Exception as error:
        return f"traceback: {type(error).__name__}: {str(error)[:200]}"
    return "wrongly accepted" if mutation.valid is False else "accepted"


def counted(count: int, seed: int) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Outcomes of mutations of the default study by kind; the lines of the unusual ones."""
    plain = json.loads(compose("default", []).model_dump_json())
    outcomes: Counter[tuple[str, str]] = Counter()
    unusual = []
    with tempfile.TemporaryDirectory() as folder:
        for mutation in mutations(plain, count, seed):
            result = outcome(mutation, Path(folder))
            outcomes[mutation.what, result.split(":")[0]] += 1
            if result not in ("refused", "accepted"):
                unusual.append(f"{mutation.what} {mutation.key[:40]!r}: {result}")
    return outcomes, unusual


def configs(count: int, seed: int) -> list[Row]:
    """A row for each kind of mutation; prints those that are neither refused nor accepted."""
    outcomes, lines = counted(count, seed)
    print("\n".join(lines), file=sys.stderr)
    rows = []
    for what in sorted({what for what, _ in outcomes}):
        ways = {way: number for (kind, way), number in sorted(outcomes.items()) if kind == what}
        wrong = sum(n for way, n in ways.items() if way.startswith(("traceback", "wrongly")))
        rows.append(Row("config", what, sum(ways.values()), wrong, ways))
    return rows
