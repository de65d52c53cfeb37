"""What the first screen shows beside the verdict: one fix, with its person, its place, and how both versions drive."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline.artefacts.comparison_results import VersionResult
from pipeline.core.episode import Episode, KeptFrame
from pipeline.core.kpi import evaluate, running_adj_ttc
from pipeline.core.space import Space, Value
from pipeline.core.words import meanings
from pipeline.report import texts
from pipeline.report.page import BeforeAfter, Film, FirstScreen
from pipeline.report.replays import (
    Pixels,
    draw_view,
    jpeg_uri,
    most_telling_frame,
    outcome_text,
    write_mp4,
)
from pipeline.report.style import data_uri
from pipeline.scenarios import people

CLOTHES = 2
"""Words for what a person wears or carries."""
STRIP_HEIGHT = 44
FRAMES_PER_SECOND = 5


def first_screen(
    place: str,
    concrete: Mapping[str, Value],
    space: Space,
    films: Sequence[Film] = (),
    stills: BeforeAfter | None = None,
) -> FirstScreen:
    """A fix. place: of its scenario, in words. films: of the earlier and the later version; stills: instead of them."""
    return FirstScreen(
        f"{person(concrete, space)}. {place}", conditions(concrete, space), tuple(films), stills
    )


def no_fix(base: VersionResult) -> FirstScreen:
    """Why there is no fix to show. base: the comparison's first version."""
    return FirstScreen(
        (texts.NO_FIX if base.failures else texts.NO_FAILURE).format(base=base.version)
    )


def person(concrete: Mapping[str, Value], space: Space) -> str:
    """`A crouching child under an umbrella`, of a concrete scenario."""
    held = [
        (space.names[word.variable], word.text)
        for word in meanings(space, people.WORDS)
        if int(space.variables[word.variable].encode(concrete[space.names[word.variable]]))
        in word.values
    ]
    poses = [text for variable, text in held if variable == people.POSE]
    others = [text for variable, text in held if variable != people.POSE]
    noun = next((text for text in others if text in ("child", "adult")), "person")
    worn = [text for text in others if text != noun and not text.startswith("without")][:CLOTHES]
    phrase = " ".join([*poses, noun, *_together(worn)])
    return f"{'An' if phrase[0] in 'aeiou' else 'A'} {phrase}"


def _together(worn: Sequence[str]) -> list[str]:
    """`with a hat`, `with a bag` as `with a hat`, `and a bag`."""
    prepositions = [text.split()[0] for text in worn]
    repeated = [i > 0 and word == prepositions[i - 1] for i, word in enumerate(prepositions)]
    return [
        text.replace(word, "and", 1) if again else text
        for text, word, again in zip(worn, prepositions, repeated, strict=True)
    ]


def conditions(concrete: Mapping[str, Value], space: Space) -> str:
    """The numbers of a concrete scenario: `Rain 12 %, fog 55.5 %.`."""
    numbers = [(variable, concrete[variable.name]) for variable in space.variables]
    shown = (
        f"{v.name.replace('_', ' ')} {value:.3g} {v.unit}".rstrip()
        for v, value in numbers
        if not isinstance(value, str)
    )
    text = ", ".join(shown)
    return f"{text[:1].upper()}{text[1:]}."


def drive(test_id: str, version: str, episode: Episode, threshold_s: float) -> Film:
    """What a version's camera sees during a test, with the true box, the detections, speed, brake and adj. TTC. All frames kept."""
    images = draw_drive(episode)
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "drive.mp4"
        write_mp4(images, video, FRAMES_PER_SECOND)
        content = data_uri(video.read_bytes(), "video/mp4")
    outcome = outcome_text(evaluate(episode.signals, threshold_s))
    return Film(test_id, version, outcome, content, jpeg_uri(images[most_telling_frame(episode)]))


def draw_drive(episode: Episode) -> list[Pixels]:
    """The frames of `drive`, each (height, width, 3) uint8 RGB with even height and width."""
    adjusted = running_adj_ttc(episode.signals)
    views = [(kept, draw_view(kept)) for kept in episode.frames]
    return [
        np.concatenate([_strip(episode, kept, float(adjusted[kept.step]), view.shape[1]), view])
        for kept, view in views
    ]


def _strip(episode: Episode, kept: KeptFrame, adjusted_s: float, width: int) -> Pixels:
    """A line above a view, where no controls cover it: time, speed, brake and adj. TTC."""
    strip: Pixels = np.full((STRIP_HEIGHT, width, 3), (32, 38, 46), np.uint8)
    speed, brake = (float(episode.signals[name][kept.step]) for name in ("ego_speed_mps", "brake"))
    remaining = "no collision path" if np.isnan(adjusted_s) else f"adj. TTC {adjusted_s:.1f} s"
    text = (
        f"{kept.frame.time_s:.1f} s    {speed:.1f} m/s    brake {100 * brake:.0f} %    {remaining}"
    )
    cv2.putText(
        strip,
        text,
        (14, 30),
        cv2.FONT_HERSHEY_SIMPLEX,
        width / 1000,
        (255, 255, 255),
        1,
        cv2.LINE_AA,
    )
    return strip
