"""Replay films of the analytic simulator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence

from pipeline.config.composing import compose
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode
from pipeline.core.loop import run_test
from pipeline.core.matching import Matching
from pipeline.core.space import Space, Value
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.report.replays import (
    Replay,
    draw_replay,
    draw_view,
    most_telling_frame,
    render_replay,
)
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR


@pytest.fixture(scope="module")
def space() -> Space:
    return compose("default", []).space("F1")


@pytest.fixture(scope="module")
def episode(space: Space) -> Episode:
    concrete = {
        **space.decode(space.sample(1, np.random.default_rng(0))[0]),
        "fog": 90.0,
        "sun_altitude": -15.0,
    }
    return run_test(AnalyticWorld(), VisiblePixelOracle(), CAR, concrete, keep_every=1)


CONCRETE: dict[str, Value] = {"fog": 90.0, "animation": "walking"}


def test_a_film_has_every_frame_in_a_portable_format(tmp_path: Path, episode: Episode) -> None:
    path = tmp_path / "films" / "replay.mp4"
    render_replay(Replay(episode, "F1 · random · 00001", CONCRETE, 0.1, {"fog": "%"}), path)
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    assert meta["codec"] == "h264"
    assert meta["pix_fmt"].startswith("yuv420p")
    assert meta["size"][0] % 2 == meta["size"][1] % 2 == 0
    assert sum(1 for _ in reader) == len(episode.frames)
    assert [p.name for p in path.parent.iterdir()] == ["replay.mp4"]


@pytest.mark.parametrize("rate_hz", [5, 10, 28.57])
def test_a_replay_plays_as_fast_as_it_happened(episode: Episode, rate_hz: float) -> None:
    frames = tuple(
        replace(kept, frame=replace(kept.frame, time_s=i / rate_hz))
        for i, kept in enumerate(episode.frames)
    )
    assert Replay(
        replace(episode, frames=frames), "title", CONCRETE, 0.1
    ).frames_per_second == round(rate_hz)


def test_a_box_far_beyond_the_image_is_drawn(episode: Episode) -> None:
    kept = episode.frames[0]
    far = Detections(np.array([[-1e30, 10, 1e30, 60]], np.float32), np.array([0.9], np.float32))
    view = draw_view(replace(kept, detections=far, matching=Matching(("far",))))
    assert view.shape == draw_view(kept).shape


def test_same_episode_gives_the_same_file(tmp_path: Path, episode: Episode) -> None:
    for name in ("a.mp4", "b.mp4"):
        render_replay(Replay(episode, "title", CONCRETE, 0.1), tmp_path / name)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_gif_and_unknown_suffix(tmp_path: Path, episode: Episode) -> None:
    short = Replay(Episode(episode.signals, episode.frames[:3]), "title", CONCRETE, 0.1)
    render_replay(short, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        assert sum(1 for _ in ImageSequence.Iterator(image)) == 3
    with pytest.raises(ValueError, match=r"^a replay must be an \.mp4 or a \.gif, got a\.avi$"):
        render_replay(short, tmp_path / "a.avi")


def test_cursor_moves_and_boxes_are_drawn(episode: Episode) -> None:
    images = draw_replay(Replay(episode, "title", CONCRETE, 0.1))
    # The threshold's dashes share the cursor's colour but have no height.
    below = [
        np.flatnonzero((image[490:] == (214, 40, 40)).all(axis=2).sum(axis=0) > 100)
        for image in images
    ]
    assert all(len(columns) == 2 for columns in below)
    assert np.all(np.diff([columns[0] for columns in below]) > 0)
    blue = (images[most_telling_frame(episode)] == (70, 140, 255)).all(axis=2)
    assert blue.any()


def test_episode_without_frames_is_refused(episode: Episode) -> None:
    with pytest.raises(
        ValueError, match="^a replay needs the frames of the episode; execute it with keep_every=1$"
    ):
        Replay(Episode(episode.signals), "title", CONCRETE, 0.1)
