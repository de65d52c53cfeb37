"""Nothing of a held-out scenario can be learnt."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.protocols import InputError
from pipeline.steps.retrain import _added


def test_frames_of_a_held_out_scenario_are_refused_by_name() -> None:
    judged = pd.DataFrame({"test_id": ["F1-random-base-0-00000", "F1star-pairwise-base-0-00003"], "step": [0, 4], "kept": [True, False]})
    with pytest.raises(InputError, match="frames of held-out scenarios must not be learnt: F1star-pairwise-base-0-00003"):
        _added(judged, [], 1, 0, ("F1star",))
