"""Replays: one test execution as a film, laid out as in thesis Fig. 5.8.

It shows the frame with the true box (blue) and the detections (red, with score), the concrete
scenario, the result, and the signals with a cursor at the frame's time. The still parts are drawn
once; each frame adds its image, boxes and cursor.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from pipeline.artefacts.files import check_output, make_folder
from pipeline.core.episode import Episode, KeptFrame
from pipeline.core.kpi import Kpi, evaluate, running_adj_ttc
from pipeline.core.space import Value
from pipeline.errors import InputError
from pipeline.report.kept_frames import most_telling
from pipeline.report.style import GRID, INK, data_uri, styled

Pixels = NDArray[np.uint8]
TRUTH, DETECTION, CURSOR = (70, 140, 255), (235, 60, 50), (214, 40, 40)
CONFIDENCE_COLOUR, SPEED_COLOUR, TTC_COLOUR = "#2f6fd0", "#2a8f5c", "#7d55b8"
FRAME_HEIGHT, SIDE_WIDTH, SIGNALS_HEIGHT, MARGIN = 480, 410, 350, 14
BELOW_SIGNALS = 132
"""Pixels. The time axis takes 62 of them; a browser's controls cover the rest."""
SIDE_CHARACTERS = 36
DPI = 100
LABEL_SCALE = 0.6
FARTHEST = 2.0**15
"""Pixels from a view's corner at which a box may be drawn."""
TTC_SHOWN_S = 4.0


@dataclass(frozen=True)
class Replay:
    """One test execution to show, with the text beside its frames.

    Attributes:
        episode: The test with its frames (`execute(..., keep_every=1)`).
        title: The executed test, in one or more lines.
        concrete: Variable -> value.
        failure_threshold_s: Adj. TTC at or below which a test fails.
        units: Variable -> unit.

    Raises:
        ValueError: The episode kept no frame.
    """

    episode: Episode
    title: str
    concrete: Mapping[str, Value]
    failure_threshold_s: float
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.episode.frames:
            raise ValueError(
                "a replay needs the frames of the episode; execute it with keep_every=1"
            )

    @property
    def frames_per_second(self) -> int:
        """The rate that plays the test in real time."""
        times = [kept.frame.time_s for kept in self.episode.frames]
        if len(times) == 1:
            return 1
        return max(1, round((len(times) - 1) / (times[-1] - times[0])))


@dataclass(frozen=True)
class Layout:
    """The still parts, and the places of the moving ones in pixels from the top left.

    Attributes:
        canvas: (height, width, 3) RGB.
        last_s: Time of the last signal.
    """

    canvas: Pixels
    frame_width: int
    signal_left: float
    signal_right: float
    signal_top: int
    signal_bottom: int
    last_s: float


def check_replay(path: Path) -> None:
    """Make the folder of a replay, before its frames are drawn.

    Raises:
        InputError: The replay cannot be written there.
    """
    if path.suffix not in (".mp4", ".gif"):
        raise InputError(f"--out: a replay must be an .mp4 or a .gif, got {path.name}")
    make_folder(path.parent)
    check_output(path)


def render_replay(replay: Replay, path: Path, frames_per_second: int = 5) -> None:
    """Write a replay atomically, as .mp4 (H.264, yuv420p: any browser) or .gif.

    Raises:
        ValueError: The path has another suffix.
    """
    images = draw_replay(replay)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"partial-{path.name}")
    if path.suffix == ".mp4":
        write_mp4(images, partial, frames_per_second)
    elif path.suffix == ".gif":
        first, *rest = map(Image.fromarray, images)
        duration_ms = 1000 // frames_per_second
        first.save(partial, save_all=True, append_images=rest, duration=duration_ms, loop=0)
    else:
        raise ValueError(f"a replay must be an .mp4 or a .gif, got {path.name}")
    partial.replace(path)


def draw_replay(replay: Replay) -> list[Pixels]:
    """The frames of a replay, each (height, width, 3) uint8 RGB with even height and width."""
    kpi = evaluate(replay.episode.signals, replay.failure_threshold_s)
    layout = _layout(replay.episode, _side_text(replay, kpi), kpi, replay.failure_threshold_s)
    images = []
    for kept in replay.episode.frames:
        canvas = layout.canvas.copy()
        view = canvas[:FRAME_HEIGHT, : layout.frame_width]
        view[:] = draw_view(kept)
        share = min(1.0, kept.frame.time_s / layout.last_s) if layout.last_s > 0 else 0.0
        column = round(layout.signal_left + share * (layout.signal_right - layout.signal_left))
        canvas[layout.signal_top : layout.signal_bottom, column - 1 : column + 1] = CURSOR
        _label(view, f"{kept.frame.time_s:.1f} s", 10, FRAME_HEIGHT - 8, colour=(60, 66, 74))
        images.append(canvas)
    return images


def draw_view(kept: KeptFrame) -> Pixels:
    """A camera frame with the true box and the reported detections.

    Returns:
        (FRAME_HEIGHT, width, 3) uint8 RGB.
    """
    image = kept.frame.image
    scale = FRAME_HEIGHT / image.shape[0]
    size = (_frame_width(image), FRAME_HEIGHT)
    view: Pixels = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC))
    if kept.frame.truth.visible_box is not None:
        _rectangle(view, kept.frame.truth.visible_box, scale, 5, TRUTH)
    detections, outcomes = kept.detections, kept.matching.outcomes
    for box, score, outcome in zip(detections.boxes, detections.scores, outcomes, strict=True):
        if outcome != "unreported":
            left, top = _rectangle(view, tuple(map(float, box)), scale, 2, DETECTION)
            _label(view, f"{score:.2f}", left, top)
    return view


def _frame_width(image: Pixels) -> int:
    """Even width of an image that is scaled to `FRAME_HEIGHT`."""
    height, width = image.shape[:2]
    return 2 * round(float(FRAME_HEIGHT * width / height / 2))


def outcome_text(kpi: Kpi) -> str:
    """How a test ended, in a few words."""
    return {
        "none": "no failure",
        "contact": f"contact at {kpi.impact_speed_mps:.1f} m/s",
        "late": "late",
        "false_positives": "false positives alone",
        "false_activation": "unnecessary braking",
    }[kpi.failure_mode]


def jpeg_uri(image: Pixels) -> str:
    """An image, (height, width, 3) RGB, as a data: address."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, content = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 80])
    return data_uri(content.tobytes(), "image/jpeg")


def most_telling_frame(episode: Episode) -> int:
    """Index of the decisive frame among the kept ones."""
    return most_telling(kept.frame.truth.visible_box is not None for kept in episode.frames)


def _side_text(replay: Replay, kpi: Kpi) -> str:
    result = outcome_text(kpi) if kpi.failure_mode == "none" else f"FAILURE: {outcome_text(kpi)}"
    seen = "never" if np.isnan(kpi.first_detection_m) else f"{kpi.first_detection_m:.1f} m away"
    lines = []
    for line in replay.title.splitlines():
        lines += textwrap.wrap(line, SIDE_CHARACTERS)
    lines += [
        "",
        f"adj. TTC {kpi.adj_ttc_s:.2f} s (TTC alone {kpi.ttc_s:.2f} s)",
        *textwrap.wrap(result, SIDE_CHARACTERS),
    ]
    lines += [f"first detected  {seen}", f"false positives {kpi.false_positives}", ""]
    for name, value in replay.concrete.items():
        if not isinstance(value, str):
            value = f"{value:.3g} {replay.units.get(name, '')}".rstrip()
        lines.append(f"{name.replace('_', ' '):<17} {value}")
    return "\n".join(lines)


def _layout(episode: Episode, text: str, kpi: Kpi, threshold_s: float) -> Layout:
    frame_width = _frame_width(episode.frames[0].frame.image)
    total_width, total_height = frame_width + SIDE_WIDTH, FRAME_HEIGHT + SIGNALS_HEIGHT
    with styled({"font.size": 12}):
        figure = Figure(figsize=(total_width / DPI, total_height / DPI), dpi=DPI, facecolor="white")
        figure.set_layout_engine("none")
        left, top = (frame_width + 1.5 * MARGIN) / total_width, 1 - MARGIN / total_height
        figure.text(left, top, text, **_TEXT)
        signals_height = (SIGNALS_HEIGHT - BELOW_SIGNALS - 40) / total_height
        axis = figure.add_axes((0.065, BELOW_SIGNALS / total_height, 0.765, signals_height))
        _draw_signals(axis, episode, kpi, threshold_s)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        box = axis.get_window_extent()
        start, end = (axis.transData.transform((value, 0))[0] for value in axis.get_xlim())
    pixels: Pixels = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    return Layout(
        canvas=pixels,
        frame_width=frame_width,
        signal_left=start,
        signal_right=end,
        signal_top=total_height - int(box.y1),
        signal_bottom=total_height - int(box.y0),
        last_s=float(episode.signals["time_s"][-1]),
    )


_TEXT: dict[str, Any] = {
    "va": "top",
    "ha": "left",
    "fontsize": 12.5,
    "family": "DejaVu Sans Mono",
    "color": INK,
    "linespacing": 1.3,
}


def _draw_signals(axis: Axes, episode: Episode, kpi: Kpi, threshold_s: float) -> None:
    time_s = np.asarray(episode.signals["time_s"], dtype=float)
    speed, remaining = axis.twinx(), axis.twinx()
    remaining.spines["right"].set_position(("outward", 62))
    axis.plot(time_s, episode.signals["confidence"], color=CONFIDENCE_COLOUR, linewidth=1.8)
    speed.plot(time_s, episode.signals["ego_speed_mps"], color=SPEED_COLOUR, linewidth=1.8)
    shown = running_adj_ttc(episode.signals)
    remaining.plot(time_s, shown, color=TTC_COLOUR, linewidth=1.8)
    failed = shown <= threshold_s
    remaining.plot(time_s[failed], shown[failed], "o", color="#d62828", markersize=6)
    remaining.axhline(threshold_s, color="#d62828", linestyle="--", linewidth=1)
    top = float(np.max(np.asarray(episode.signals["ego_speed_mps"], dtype=float)))
    for target, low, high, name, colour in (
        (axis, -0.03, 1.05, "confidence", CONFIDENCE_COLOUR),
        (speed, -0.03 * top, max(1.0, 1.05 * top), "ego speed (m/s)", SPEED_COLOUR),
        (remaining, -0.03 * TTC_SHOWN_S, TTC_SHOWN_S, "adj. TTC (s)", TTC_COLOUR),
    ):
        target.set_ylim(low, high)
        target.set_ylabel(name, color=colour)
        target.tick_params(axis="y", colors=colour)
        target.grid(target is axis)
        target.spines["right"].set_visible(target is not axis)
        target.spines["right"].set_color(GRID)
    axis.set(xlim=(0, max(float(time_s[-1]), 0.1)), xlabel="time (s)")
    smallest = f"smallest adj. TTC {kpi.adj_ttc_s:.2f} s"
    axis.set_title("no collision path" if np.isnan(shown).all() else smallest, fontsize=12)


def _rectangle(
    view: Pixels, box: tuple[float, ...], scale: float, aside: int, colour: tuple[int, int, int]
) -> tuple[int, int]:
    # A detector may report a box far beyond the image, which OpenCV rejects.
    left, top, right, bottom = (
        round(min(max(value * scale, -FARTHEST), FARTHEST)) for value in box
    )
    # Drawn outside: a small pedestrian stays visible, and so does the true box under a detection.
    corner, opposite = (left - aside, top - aside), (right + aside - 1, bottom + aside - 1)
    cv2.rectangle(view, corner, opposite, colour, 2)
    return left, top


def _label(
    view: Pixels, text: str, left: int, bottom: int, colour: tuple[int, int, int] = DETECTION
) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, LABEL_SCALE, 1)
    left = int(np.clip(left, 4, view.shape[1] - width - 4))
    bottom = int(np.clip(bottom - 5, height + 4, view.shape[0] - 4))
    cv2.rectangle(view, (left - 3, bottom - height - 3), (left + width + 3, bottom + 4), colour, -1)
    font, white = cv2.FONT_HERSHEY_SIMPLEX, (255, 255, 255)
    cv2.putText(view, text, (left, bottom), font, LABEL_SCALE, white, 1, cv2.LINE_AA)


def write_mp4(images: list[Pixels], path: Path, frames_per_second: int) -> None:
    """Write images as H.264; the same images give the same file.

    Args:
        images: (height, width, 3) uint8 RGB each, of even height and width.
        path: The file to write.
        frames_per_second: Rate of the film.
    """
    height, width = images[0].shape[:2]
    # Bit-exact and on one thread, so that the file is the same.
    options = "-crf 27 -preset slow -threads 1 -movflags +faststart -fflags +bitexact"
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=frames_per_second,
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=2,
        output_params=[*options.split(), "-flags:v", "+bitexact"],
        ffmpeg_log_level="error",
    )
    writer.send(None)
    for image in images:
        writer.send(np.ascontiguousarray(image))
    writer.close()
