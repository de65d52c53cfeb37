"""The sections of params.yaml: every key with its range and meaning."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, model_validator

from pipeline.core.braking import CruiseKind, GateKind, LawKind
from pipeline.core.names import check_name
from pipeline.errors import shown
from pipeline.scenarios.parts import MOST, STRICT, Seed

Share = Annotated[float, Field(gt=0, lt=1)]
Title = Annotated[str, AfterValidator(partial(check_name, joints="-"))]
"""A name that no other name is made from."""


def _in_project(path: str) -> str:
    # A link in the project may lead elsewhere: its author meant it.
    if not path or Path(os.path.relpath(path)).parts[:1] == ("..",):
        raise ValueError(
            f"expected a path inside the project (link outside files into it), got {shown(path)}"
        )
    return path


def _plain(path: str) -> str:
    if {"{", "}"} & set(path):
        raise ValueError(
            f"expected a path without braces, which are Snakemake's wildcards, got {shown(path)}"
        )
    return path


Plain = Annotated[str, AfterValidator(_plain)]
InProject = Annotated[Plain, AfterValidator(_in_project)]


class Section(BaseModel):
    model_config = STRICT

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError: only keys that `declared` left out are missing."""
            if name in type(self).model_fields:
                raise AttributeError(
                    f"'{name}' of {type(self).__name__} is read but not declared; "
                    "add it to the step's sections"
                )
            return super().__getattr__(name)


class Campaign(Section):
    """One search campaign: a strategy, a scenario, a model version, a seed."""

    tests: int = Field(ge=1, le=100_000)
    """Test budget."""
    keep_every: int = Field(ge=0, le=1000)
    """Keep every n-th frame for retraining; 0 keeps none."""
    failure_threshold_s: float = Field(gt=0, le=10)
    """A test with an adjusted TTC at or below it is a failure (Eq. 6.1)."""
    match_iou: float = Field(ge=0.1, lt=1)
    """A detection matches the pedestrian if it overlaps the visible box by more than this IoU."""
    transfer: tuple[str, ...]
    """Strategies that learn from their campaigns on earlier scenarios in `search`; these campaigns
    run one after another."""
    audit: int = Field(ge=0, le=100_000)
    """Random tests of each scenario in addition to its searches, for an unbiased failure rate, if
    no strategy of the search is random; 0 for none. No search sees or counts them."""
    shards: int = Field(ge=1, le=10_000)
    """Number of cluster jobs that share a campaign; it changes no result. Strategies that learn
    from results use one job."""


class Limits(Section):
    """Limits of a process that executes tests; a test over a limit is an error, without a KPI."""

    test_s: float = Field(gt=0, le=86_400)
    """Time limit of a test, in seconds: many times the usual, so that a slow machine changes no
    result."""
    frame_s: float = Field(gt=0, le=86_400)
    """Time limit of the detector for one frame of a test, in seconds."""
    memory_mb: int = Field(ge=100, le=10_000_000)
    """Limit of a process's resident memory."""


class VehicleSection(Section):
    """The ego's brakes and cruise control."""

    dry_friction: float = Field(gt=0, le=1.5)
    """Peak friction between tyre and dry road."""
    wet_friction: float = Field(gt=0, le=1.5)
    """The same on a fully wet road, from 60 % rain; in between, it falls linearly."""
    build_up_s: float = Field(ge=0, le=2)
    """Time constant of the lag between demand and deceleration; 90 % is reached after 2.3 time
    constants."""
    latency_s: float = Field(ge=0, le=2)
    """Time from a frame's exposure to the brake demand that it causes."""
    cruise: CruiseKind
    """While nothing asks to brake, `keep` keeps the present speed; `hold` returns to the first one,
    as in the thesis."""
    acceleration_mps2: float = Field(gt=0, le=5)
    """Highest acceleration of `hold`."""
    jerk_mps3: float = Field(gt=0, le=10)
    """Highest rise of that acceleration, per second."""


class AebSection(Section):
    """The law of the automatic emergency brake."""

    gate: GateKind
    """`truth` follows the detections that match the true pedestrian, as the thesis does;
    `detections` follows any in the ego's path."""
    law: LawKind
    """`confidence` brakes in proportion to the best score, as the thesis does; `threshold` brakes
    fully."""
    brakes_from: float | None = Field(ge=0, le=1)
    """Lowest score that brakes; null means the detector's own threshold; at 0.05, every stored
    detection brakes."""
    why_below_threshold: str = ""
    """The reason, where `brakes_from` is below `detector.threshold`: such boxes brake, and are no
    false positives."""
    votes: int = Field(ge=1, le=20)
    """The brake acts if the newest frame asks for it, and at least this many of the last `window`
    frames do."""
    window: int = Field(ge=1, le=20)
    """Number of frames that vote."""
    margin_m: float = Field(ge=0, le=5)
    """Metres on each side of the ego that still belong to its path, for gate `detections`."""

    @model_validator(mode="after")
    def _can_vote(self) -> AebSection:
        if self.votes > self.window:
            raise ValueError(f"votes must be at most window, got {self.votes} of {self.window}")
        return self


class HeldOutSequence(Section):
    """The frozen held-out sequence on which all model versions are compared."""

    tests: int = Field(ge=1, le=100_000)
    """Number of tests of the pair-wise sequence to execute."""
    strategy: str
    """The test strategy that makes the sequence; it must not learn from results."""
    seed: Seed
    """Seed of the sequences; each held-out scenario has its own sequence."""
    alpha: Share
    """Significance level of each paired test; only the gate corrects for multiple testing."""
    confidence: Share
    """Confidence level of all intervals and limits."""
    margin: Share
    """Largest rise of the failure rate that a champion may have in a held-out scenario or a named
    group, such as children or night: a share of the base's failure rate on the whole sequence. The
    rise's upper confidence limit must not exceed it."""
    second_iou: float | None = Field(ge=0.1, lt=1)
    """Another IoU at which held-out tests are judged again, to show whether a verdict depends on
    `campaign.match_iou`; null: none."""


class Rarity(Section):
    """How often a base set shows certain people and poses, relative to others; 1 is equally
    often."""

    children: float = Field(gt=0, le=1)
    """Frequency of a child relative to an adult."""
    crouching: float = Field(gt=0, le=1)
    """Frequency of the pose `crouching` relative to any other."""


class BaseSet(Section):
    """The random base training set."""

    images: int = Field(ge=10, le=1_000_000)
    """Number of images, training and validation together."""
    validation_share: float = Field(gt=0, lt=0.9)
    """Share of each town's images used for validation."""
    seed: Seed
    """Seed of towns, people, scenes and weather."""
    rare: Rarity


class Base(Section):
    """The origin of the model version `base`."""

    source: Literal["shipped", "trained"]
    """`shipped` takes `weights`, `trained` trains from scratch on the base set."""
    weights: InProject
    """Folder of the shipped detector."""


class Training(Section):
    """Training from scratch."""

    size: Literal["nano", "small"]
    """Size of the network: 1.1 or 2.6 million parameters."""
    seed: Seed
    """Seed of weights, order and augmentation."""
    batch_size: int = Field(ge=1, le=4096)
    """Images per step."""
    crop_iterations: int = Field(ge=0, le=MOST)
    """Batches of crops, each with a quarter of a frame's pixels."""
    frame_iterations: int = Field(ge=0, le=MOST)
    """Batches of full frames after the crops: only full frames show near pedestrians whole."""
    learning_rate: float = Field(gt=0, lt=1)
    """Peak learning rate of the schedule."""
    oversampling: int = Field(ge=1, le=20)
    """How often an epoch shows an image with a hard-to-find pedestrian."""
    validate_every: int = Field(ge=1, le=MOST)
    """Iterations between evaluations on 500 validation images."""
    patience: int = Field(ge=1, le=MOST)
    """Training stops with the best weights after this many evaluations without a better AP50."""


class Retraining(Section):
    """Retraining of the versions of all arms, each with the same number of steps."""

    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Seeds of frame selection, order and augmentation; each gives one version of each arm."""
    searches: Literal["all", "own"]
    """`all`: each version learns from the campaigns of all `seeds` of the study; `own`: only from
    those of its own seed, so that versions of an arm differ by their search, too."""
    rounds: int = Field(ge=1, le=20)
    """Number of rounds; each repeats search, filter and retraining on the newest versions."""
    start: Literal["parent", "scratch"]
    """`parent` continues from the version before, `scratch` trains a new network as in `training`,
    on the base set and the added frames."""
    selection: Literal["all", "failures", "regions", "causes", "unsure", "missed"]
    """Kept frames to add. `all`: from all tests. `failures`: from failures. `regions`: from
    failures, equally many from each region. `causes`: from all tests, equally many from each cause
    and from passing tests. `unsure`, `missed`: from all tests, more often where the detector was
    unsure of the pedestrian or missed it."""
    batch_size: int = Field(ge=2, le=4096)
    """Images per step."""
    iterations: int = Field(ge=1, le=MOST)
    """Steps."""
    learning_rate: float = Field(gt=0, lt=1)
    """Peak learning rate of the schedule."""
    added_share: Share
    """Share of a batch that comes from the added frames; the rest, and all of a control's batch,
    comes from the base set."""
    added_frames: int = Field(ge=1, le=MOST)
    """Maximum number of added frames per round; never more than the smallest source has."""
    empty_share: Share
    """Share of the added frames without a visible pedestrian; the same for all sources."""


class Filter(Section):
    """Filter of campaign frames for training."""

    min_visible_pixels: int = Field(ge=0, le=MOST)
    """A pedestrian with fewer visible pixels is not a fair label."""
    min_detectability: float = Field(ge=0, le=MOST)
    """Contrast to the surroundings in grey levels times the square root of the visible pixels;
    below it, a person can hardly see the pedestrian."""
    overrules: InProject | None
    """CSV of a person's decisions: test_id, step, keep."""


class Regions(Section):
    """Failure regions."""

    chance_neighbours: float = Field(gt=0, le=10)
    """Sets the radius of the density clusters: if failures were spread evenly over the space, each
    would have this many neighbours within it."""
    min_failures: int = Field(ge=2, le=MOST)
    """Minimum number of failures within the radius to form a region."""
    confirm: int = Field(ge=0, le=1000)
    """Number of fresh random tests inside each rule, and as many just outside, to confirm it; 0 for
    none. They count in no campaign."""
    explain: int = Field(ge=0, le=1000)
    """Maximum number of a region's failures to execute again with each single change, such as no
    rain or another person, to see which change repairs them; 0 for none. They count in no
    campaign."""


class Report(Section):
    """The report."""

    replays: int = Field(ge=0, le=100)
    """Maximum number of replay videos."""


class Tracking(Section):
    """MLflow."""

    experiment: Annotated[str, AfterValidator(partial(check_name, joints="-/"))]
    """Name of the MLflow experiment."""
    model_name: Title
    """Name of the registered model."""
