"""Wire logs in `tests/data/wire`, each with its rig file beside it: the drivers of today say what was said then."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest

from drivers.wire.reading import read_wire_log
from rigctl.core.errors import DataError, LinkLost, RigError
from rigctl.files.rig_file import read_rig
from rigctl.replay import follow, replayed

LOGS = sorted((Path(__file__).parents[1] / "data" / "wire").glob("*.wire"))


@pytest.mark.parametrize("log", LOGS, ids=[log.stem for log in LOGS])
def test_the_beginning_of_a_log_is_followed(log: Path) -> None:
    assert follow(log, read_rig(log.with_suffix(".toml"))).replayed > 0


def test_a_move_of_an_xps_to_its_end() -> None:
    (log,) = [log for log in LOGS if log.stem == "xps-move"]
    with replayed(log, read_rig(log.with_suffix(".toml"))) as each:
        stage = each.instrument
        stage.open()
        stage.is_moving()
        stage.stop()
        stage.home()
        stage.move_to(5.0)
        assert stage.angle().value == pytest.approx(5.0, abs=1e-3)
        stage.stop()
    assert each.replay.replayed == len(read_wire_log(log).records)


@pytest.mark.parametrize("end", [None, LinkLost("what was made of it")])
def test_what_was_done_differently_is_told_whatever_is_made_of_it(end: RigError | None) -> None:
    (log,) = [log for log in LOGS if log.stem == "xps-move"]

    def work() -> None:
        with replayed(log, read_rig(log.with_suffix(".toml"))) as each:
            each.instrument.open()
            with suppress(RigError):
                each.instrument.move_to(7.0)
            if end is not None:
                raise end

    with pytest.raises(DataError, match=r"record 5 .*expected b'GroupStatusGet.*; b'PositionerUser.* was sent"):
        work()
