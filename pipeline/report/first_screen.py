"""The fix beside the verdict on the first screen: its person, its place, both versions' drives."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline.artefacts.comparison_results import VersionResult
from pipeline.core.episode import Episode
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
"""Largest number of words for clothes and things that a person carries."""
STRIP_HEIGHT = 44
FRAMES_PER_SECOND = 5


def first_screen(
    place: str,
    concrete: Mapping[str, Value],
    space: Space,
    films: Sequence[Film] = (),
    stills: BeforeAfter | None = None,
) -> FirstScreen:
    """A fix.

    Args:
        place: Place of its scenario, in words.
        concrete: Variable -> value.
        space: The scenario space.
        films: Of the earlier and the later version.
        stills: Instead of films.
    """
    title = f"{person(concrete, space)}. {place}"
    return FirstScreen(title, conditions(concrete, space), tuple(films), stills)


def no_fix(base: VersionResult) -> FirstScreen:
    """Why there is no fix to show. base: the comparison's first version."""
    text = texts.NO_FIX if base.failures else texts.NO_FAILURE
    return FirstScreen(text.format(base=base.version))


def person(concrete: Mapping[str, Value], space: Space) -> str:
    """`A crouching child under an umbrella`, of a concrete scenario."""
    poses: list[str] = []
    others: list[str] = []
    for word in meanings(space, people.WORDS):
        variable = space.variables[word.variable]
        if int(variable.encode(concrete[variable.name])) in word.values:
            (poses if variable.name == people.POSE else others).append(word.text)
    noun = next((text for text in others if text in ("child", "adult")), "person")
    worn = [text for text in others if text != noun and not text.startswith("without")][:CLOTHES]
    clothes, before = [], ""
    for text in worn:
        preposition, _, noun_phrase = text.partition(" ")
        # `with a hat`, `with a bag` becomes `with a hat`, `and a bag`.
        clothes.append(f"and {noun_phrase}" if preposition == before else text)
        before = preposition
    phrase = " ".join([*poses, noun, *clothes])
    return f"{'An' if phrase[0] in 'aeiou' else 'A'} {phrase}"


def conditions(concrete: Mapping[str, Value], space: Space) -> str:
    """The numbers of a concrete scenario: `Rain 12 %, fog 55.5 %.`."""
    numbers = []
    for variable in space.variables:
        value = concrete[variable.name]
        if not isinstance(value, str):
            name = variable.name.replace("_", " ")
            numbers.append(f"{name} {value:.3g} {variable.unit}".rstrip())
    text = ", ".join(numbers)
    return f"{text[:1].upper()}{text[1:]}."


def drive(test_id: str, version: str, episode: Episode, threshold_s: float) -> Film:
    """The camera's view during a test, with true box, detections, speed, brake and adj. TTC.

    Args:
        test_id: Id of the test.
        version: The model version.
        episode: The test, all frames kept.
        threshold_s: Adj. TTC at or below which a test fails.
    """
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
    images = []
    for kept in episode.frames:
        view = draw_view(kept)
        # A line above a view, where no controls cover it: time, speed, brake and adj. TTC.
        adjusted_s = float(adjusted[kept.step])
        width = view.shape[1]
        strip: Pixels = np.full((STRIP_HEIGHT, width, 3), (32, 38, 46), np.uint8)
        speed, brake = (
            float(episode.signals[name][kept.step]) for name in ("ego_speed_mps", "brake")
        )
        remaining = "no collision path" if np.isnan(adjusted_s) else f"adj. TTC {adjusted_s:.1f} s"
        driving = f"{speed:.1f} m/s    brake {100 * brake:.0f} %"
        text = f"{kept.frame.time_s:.1f} s    {driving}    {remaining}"
        font, white = cv2.FONT_HERSHEY_SIMPLEX, (255, 255, 255)
        cv2.putText(strip, text, (14, 30), font, width / 1000, white, 1, cv2.LINE_AA)
        images.append(np.concatenate([strip, view]))
    return images
