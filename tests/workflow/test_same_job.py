"""A job that another process is doing already waits, and keeps what the other made."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from threading import Thread

from pipeline.artefacts import stamps
from pipeline.artefacts.job_lock import held
from pipeline.config.composing import compose
from pipeline.contract import order_of, perform


def test_a_job_keeps_what_the_process_before_it_made(tmp_path: Path) -> None:
    config = compose("smoke", [])
    order = order_of("define_space", config, {"scenario": "F1"}, "today")
    space, lock = Path(str(order.writes["space"])), Path("data/smoke/journal/define_space/F1.lock")
    with chdir(tmp_path):
        with held(lock, lambda: None):
            second = Thread(target=perform, args=(order, config))
            second.start()
            second.join(2)
            assert second.is_alive() and not space.exists()
            space.parent.mkdir(parents=True)
            space.write_text("by the first")
            stamp = Path(str(order.writes["stamp"]))
            stamp.write_text(stamps.made(stamp, order.stamp, [space]).text())
        second.join(30)
        assert space.read_text() == "by the first"
        perform(order, config)
        assert space.read_text() != "by the first"
