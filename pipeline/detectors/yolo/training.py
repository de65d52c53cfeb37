"""Training: AdamW or Muon, cosine schedule, averaged weights, bfloat16; crops, then full frames.

The budget counts pixels, not seconds, and a batch depends only on its number. So if a run is
killed, it resumes from its checkpoint and reaches the same weights: to the last bit with the same
number of threads on the same kind of processor.
"""

from __future__ import annotations

import copy
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from pipeline.artefacts.files import program_sha256
from pipeline.artefacts.model_card import CurvePoint
from pipeline.detectors.yolo.checkpoint import State, resume, save
from pipeline.detectors.yolo.forward import Forward
from pipeline.detectors.yolo.loss import Loss, detection_loss
from pipeline.detectors.yolo.memory import keep_freed_memory
from pipeline.detectors.yolo.network import Yolo, cells, decode
from pipeline.detectors.yolo.optimiser import Optimiser
from pipeline.detectors.yolo.threads import end_idle_threads, use_threads
from pipeline.errors import InputError
from pipeline.progress import OnProgress

Batch = tuple[NDArray[np.uint8], NDArray[np.float32]]
Feed = Callable[[int], Batch]
CHECKPOINT_SECONDS = 45.0
WEIGHT_DECAY = 0.03
FINAL_SHARE = 0.01
"""The last learning rate as a share of the peak."""
FINITE_EVERY = 10
"""Iterations between reads of the loss, because each read makes a GPU wait.

Every checkpoint also reads it."""
AHEAD = 4
"""Batches that workers prepare ahead of a GPU."""


@dataclass(frozen=True)
class Schedule:
    """Length and learning rate of a training.

    Args:
        crop_iterations, frame_iterations: number of batches of crops, then of full frames.
        learning_rate: its peak, in (0, 1), after `warm_up` iterations; it falls as a cosine of the
            pixels shown to `FINAL_SHARE` of it.
        warm_up: number of iterations in which the learning rate rises.
        averaging: limit of the decay of the averaged weights, in [0, 1).
        frozen_statistics: keep the normalisation's statistics, which short runs on few images would
            spoil.
        muon: whether Muon changes the hidden kernels, instead of AdamW.
        crop_share: a crop's pixels as a share of a frame's.

    Raises:
        ValueError: if a value is out of range.
    """

    crop_iterations: int
    frame_iterations: int
    learning_rate: float
    warm_up: int = 200
    averaging: float = 0.9985
    frozen_statistics: bool = False
    muon: bool = False
    crop_share: float = 0.25

    def __post_init__(self) -> None:
        if min(self.crop_iterations, self.frame_iterations) < 0 or self.iterations < 1:
            raise ValueError(
                f"iterations must be at least 1 in all, got {self.crop_iterations}"
                f" and {self.frame_iterations}"
            )
        if not 0 < self.learning_rate < 1:
            raise ValueError(f"learning_rate must be in (0, 1), got {self.learning_rate}")
        if not 0 <= self.averaging < 1:
            raise ValueError(f"averaging must be in [0, 1), got {self.averaging}")

    @property
    def iterations(self) -> int:
        """Number of all batches."""
        return self.crop_iterations + self.frame_iterations

    def phase(self, iteration: int) -> str:
        """What the iteration, counted from 1, shows; empty if all iterations show the same."""
        if not self.crop_iterations or not self.frame_iterations:
            return ""
        return "crops, " if iteration <= self.crop_iterations else "full frames, "

    def rate(self, iteration: int) -> float:
        """Learning rate of an iteration, counted from 0."""
        crops = min(iteration, self.crop_iterations)
        frames = max(0, iteration - self.crop_iterations)
        pixels = self.crop_iterations * self.crop_share + self.frame_iterations
        share = (crops * self.crop_share + frames) / pixels
        cosine = FINAL_SHARE + (1 - FINAL_SHARE) * 0.5 * (1 + math.cos(math.pi * share))
        return self.learning_rate * cosine * min(1.0, (iteration + 1) / max(self.warm_up, 1))


@dataclass(frozen=True)
class Validation:
    """Evaluates the averaged network at intervals, so that a training without progress stops early.

    Attributes:
        ap50: of a network in evaluation mode.
        every: iterations between evaluations.
        patience: number of evaluations without a new best after which training stops.
    """

    ap50: Callable[[Yolo], float]
    every: int
    patience: int


@dataclass(frozen=True)
class Lesson:
    """The content of a training.

    Attributes:
        schedule: length and learning rate.
        feed: from an iteration to (n, h, w, 3) uint8 RGB images and (n, 4) boxes in pixels, zeros
            without a pedestrian.
        identity: digest of everything that determines the batches.
        validation: None for a training without evaluations.
    """

    schedule: Schedule
    feed: Feed
    identity: str = ""
    validation: Validation | None = None


@dataclass(frozen=True)
class Run:
    """How a training is executed.

    Attributes:
        checkpoint: file, written every 45 s and at the end, and read at the start. Checkpoints of
            another lesson or another code version are ignored.
        threads: of PyTorch; None leaves OMP_NUM_THREADS in force.
        progress: called with iterations done, their total and a text.
    """

    checkpoint: Path | None = None
    threads: int | None = None
    progress: OnProgress | None = None


@dataclass(frozen=True)
class Fitted:
    """The result of a training.

    Attributes:
        model: the network, on the CPU in evaluation mode.
        curve: empty without validation.
    """

    model: Yolo
    curve: tuple[CurvePoint, ...]


def initial_model(seed: int, model: Callable[[], Yolo] = Yolo) -> Yolo:
    """A network with random weights that depend on the seed alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return model()


def fit(model: Yolo, lesson: Lesson, run: Run) -> Fitted:
    """Train a network.

    Args:
        model: changed in place.
        lesson: what to train on.
        run: how the training is executed.

    Returns:
        The averaged weights: the last ones, or the best ones if validation stopped the training
        early.

    Raises:
        InputError: if the loss is not finite.
    """
    schedule, validation, checkpoint = lesson.schedule, lesson.validation, run.checkpoint
    if run.threads is not None:
        use_threads(run.threads)
    cv2.setNumThreads(1)
    keep_freed_memory()
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    state = _start(model, schedule, device)
    identity = lesson.identity + program_sha256("core", "detectors")
    if checkpoint is not None:
        resume(checkpoint, identity, state, device)
    saved, resumed = time.monotonic(), state.iteration
    losses: deque[Loss] = deque(maxlen=20)
    stop = schedule.iterations
    if validation is not None and state.exhausted(validation.patience):
        stop = state.iteration
    forward = Forward(state.model, device)
    for images, boxes in _batches(lesson.feed, state.iteration, stop, device):
        losses.append(_step(state, schedule, forward, images, boxes))
        last = state.iteration == schedule.iterations
        if state.iteration % FINITE_EVERY == 0 or last:
            _check_finite(losses, state.iteration, schedule)
        if run.progress is not None and (state.iteration % 10 == 0 or last):
            text = schedule.phase(state.iteration) + _text(losses, state.curve)
            run.progress(state.iteration, schedule.iterations, text)
        if validation is not None and (state.iteration % validation.every == 0 or last):
            _check_finite(losses, state.iteration, schedule)
            _evaluate(state, schedule, validation)
            if state.exhausted(validation.patience):
                break
        # Save after the evaluation: a kill must not lose it.
        if checkpoint is not None and time.monotonic() - saved > CHECKPOINT_SECONDS:
            _check_finite(losses, state.iteration, schedule)
            save(checkpoint, identity, state)
            saved = time.monotonic()
    if checkpoint is not None and state.iteration > resumed:
        save(checkpoint, identity, state)
    if validation is not None and state.exhausted(validation.patience):
        state.average.load_state_dict(state.best)
    return Fitted(state.average.cpu().eval(), tuple(state.curve))


def _evaluate(state: State, schedule: Schedule, validation: Validation) -> None:
    """Add a point to the curve, and keep the averaged weights if they are the best so far."""
    since = state.iteration - (state.curve[-1].iteration if state.curve else 0)
    scores, boxes = (float(total) / since for total in state.sums)
    ap50 = validation.ap50(state.average)
    if all(ap50 > point.ap50 for point in state.curve):
        weights = state.average.state_dict()
        state.best = {name: value.detach().clone() for name, value in weights.items()}
    rate = schedule.rate(state.iteration - 1)
    state.curve.append(CurvePoint(state.iteration, rate, scores, boxes, ap50))
    state.sums.zero_()


def _check_finite(losses: deque[Loss], iteration: int, schedule: Schedule) -> None:
    """Stop a training with a non-finite loss before its weights are saved."""
    if not all(math.isfinite(float(loss.total.detach())) for loss in losses):
        raise InputError(
            f"the loss is not finite at iteration {iteration}: lower learning_rate, now"
            f" {schedule.learning_rate:g}, or check the labels"
        )


def _start(model: Yolo, schedule: Schedule, device: torch.device) -> State:
    model = model.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    model.train()
    if schedule.frozen_statistics:
        for module in model.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
    optimiser = Optimiser(model, WEIGHT_DECAY, schedule.muon)
    average, sums = copy.deepcopy(model).eval(), torch.zeros(2, device=device)
    return State(0, model, average, optimiser, {}, sums, [])


def _step(
    state: State, schedule: Schedule, forward: Forward, images: Tensor, boxes: Tensor
) -> Loss:
    centres, strides = _grid(images.shape[3], images.shape[2], images.device)
    loss = detection_loss(*decode(forward(images), centres, strides), boxes, centres, strides)
    loss.total.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(state.parameters, 10.0)
    state.optimiser.step(schedule.rate(state.iteration))
    state.iteration += 1
    state.sums += torch.stack([loss.scores, loss.boxes])
    if state.iteration % 2 == 0 or state.iteration == schedule.iterations:
        decay = min(schedule.averaging, (1 + state.iteration) / (12 + state.iteration)) ** 2
        get_ema_multi_avg_fn(decay)(*state.averaging, None)  # type: ignore[no-untyped-call]
    return loss


@cache
def _grid(width: int, height: int, device: torch.device) -> tuple[Tensor, Tensor]:
    centres, strides = cells(width, height)
    return centres.to(device), strides.to(device)


def _batches(
    feed: Feed, start: int, stop: int, device: torch.device
) -> Iterator[tuple[Tensor, Tensor]]:
    """The batches of iterations; for a GPU, workers prepare them ahead."""
    if device.type == "cpu":  # The network needs all cores.
        for iteration in range(start, stop):
            end_idle_threads()  # The batch needs their cores.
            yield _tensors(feed(iteration), device)
        return
    with ThreadPoolExecutor(AHEAD) as pool:
        waiting: deque[Future[Batch]] = deque(
            pool.submit(feed, i) for i in range(start, min(start + AHEAD, stop))
        )
        for iteration in range(start, stop):
            batch = waiting.popleft().result()
            if iteration + AHEAD < stop:
                waiting.append(pool.submit(feed, iteration + AHEAD))
            yield _tensors(batch, device)


def _tensors(batch: Batch, device: torch.device) -> tuple[Tensor, Tensor]:
    """Images (n, 3, h, w) uint8 in the channels-last format, and boxes (n, 4)."""
    images, boxes = (torch.from_numpy(part).to(device) for part in batch)
    return images.permute(0, 3, 1, 2), boxes


def _text(losses: deque[Loss], curve: list[CurvePoint]) -> str:
    scores = sum(float(loss.scores) for loss in losses) / len(losses)
    boxes = sum(float(loss.boxes) for loss in losses) / len(losses)
    validated = f", AP50 {curve[-1].ap50:.3f}" if curve else ""
    return f"loss: scores {scores:.2f}, boxes {boxes:.3f}{validated}"
