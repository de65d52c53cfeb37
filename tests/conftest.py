"""Fixtures that several folders share."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from pipeline.core.coverage import arrays

if TYPE_CHECKING:
    from tests.studies import StudyFolder

# A busy machine takes longer than Hypothesis' deadline of 200 ms now and then.
settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell's background job ignores Ctrl-C,
    # and so would every program that a test starts and interrupts.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of modules that open pages: `./run test` leaves them out without a browser."""
    for item in items:
        if hasattr(getattr(item, "module", None), "open_browser"):
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="class")  # Hypothesis rejects function-scoped fixtures.
def short_annealing() -> Iterator[None]:
    """Stop quick covering arrays after a hundredth of their steps.

    For tests that do not depend on the array's size.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "QUICK_OPERATIONS", arrays.QUICK_OPERATIONS / 100)
        yield


@pytest.fixture(scope="module")
def one_worker(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    """A study whose campaign one worker has executed without an interruption."""
    # Imported here: the tests of the core run without the workflow's packages.
    from tests.campaigns import analytic_study, key

    study = analytic_study(tmp_path_factory.mktemp("one"))
    assert study.run("campaign", **key()) == 0
    return study
