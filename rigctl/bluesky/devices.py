"""The instruments of a rig as devices of a `RunEngine`: the protocols of `bluesky.protocols`.

Every data key has its unit in its name and as `units`. Timestamps are the rig's time, counted from the time of day at
which the devices were made: on a real rig the time of day, on a virtual clock as far ahead of it as the rig is.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.pace import Pace
from rigctl.bluesky.action_status import ActionStatus
from rigctl.campaign.session.recovery import require_homed
from rigctl.core import interfaces
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import InstrumentError, LimitError, MotionStopped, RigError
from rigctl.core.making_safe import DEADLINE_S, bring_to_rest, require_rest
from rigctl.core.units import name_and_unit

if TYPE_CHECKING:
    from bluesky.protocols import Hints, Location, Reading
    from event_model.documents.event_descriptor import DataKey

    from rigctl.rig import Rig

FETCH_EVERY_S = 1.0
"""So often a record is fetched while it comes, on the rig's clock: no memory overflows, and an abort is heeded."""

LOOK_EVERY_S = 0.5
"""So often a stage that settles looks whether it was stopped, on the rig's clock."""


def devices_of(
    rig: Rig, *, record_s: float = 1.0, period_s: float = 0.01, settle_s: float = 0.0
) -> dict[str, Device]:
    """The instruments of an open rig that a plan can move or read, by name.

    Stages can be set [deg, mm] and read; a motion is done `settle_s` after the stage has arrived. An instrument that
    records on its own timer gives mean and standard deviation of a record of `record_s` with a sample every
    `period_s`; laser heads, voltmeters and thermometers give one reading. Voltage sources and satellites have no
    device. Times are the rig's. `LimitError` for a record that cannot be made.
    """
    bench = _Bench(rig, time.time() - rig.clock.now_s(), settle_s)
    made = {name: _device(bench, name, each, record_s, period_s) for name, each in rig.instruments.items()}
    return {name: device for name, device in made.items() if device is not None}


@dataclass(frozen=True)
class _Bench:
    """What the devices of a rig share; the rig's clock began at `epoch_s`, UNIX time."""

    rig: Rig
    epoch_s: float
    settle_s: float
    stages: list[StageDevice] = field(default_factory=list)

    def reading(self, value: float, rig_time_s: float) -> Reading[float]:
        return {"value": value, "timestamp": self.epoch_s + rig_time_s}

    def doing(self, name: str, action: Callable[[], None]) -> ActionStatus:
        """`action` begun."""
        return ActionStatus(name, action, self._make_safe)

    def _make_safe(self, error: Exception) -> None:
        """The whole rig at rest, all at once: an engine stops one by one, and waits for one that is lost."""
        if isinstance(error, MotionStopped):
            return
        for stage in self.stages:
            stage.stopped_as_planned = True
        # Who has not confirmed is told when the engine stops it, and when the rig is left.
        with suppress(RigError):
            self.rig.stop()


class Instrument:
    """What every device has (`Configurable`, `HasHints`): name, data keys, and who answered as configuration.

    `quantities` are the data keys with their units, of which the first `interest` are worth a plot.
    """

    parent: None = None

    def __init__(self, bench: _Bench, name: str, quantities: dict[str, str], interest: int) -> None:
        self.name = name
        self._bench = bench
        self._quantities = quantities
        self._interest = interest

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name})"

    @property
    def hints(self) -> Hints:
        """The keys to plot."""
        return {"fields": list(self._quantities)[: self._interest]}

    def describe(self) -> dict[str, DataKey]:
        """The keys of `read`."""
        return {key: self._data_key("number", unit) for key, unit in self._quantities.items()}

    def read_configuration(self) -> dict[str, Reading[Any]]:
        """Who answers at its address; asked once."""
        identity, asked_s = self._identified
        told = {"model": identity.model, "serial": identity.serial, "firmware": identity.firmware}
        return {f"{self.name}_{what}": {"value": text, "timestamp": asked_s} for what, text in told.items()}

    def describe_configuration(self) -> dict[str, DataKey]:
        """The keys of `read_configuration`."""
        return {key: self._data_key("string", "") for key in self.read_configuration()}

    def _confirm(self) -> None:
        """`RigError` where what was just read is not to be believed; a run of a campaign is held to the same."""
        self._bench.rig.instruments[self.name].confirm_in_step()

    @cached_property
    def _identified(self) -> tuple[interfaces.Identity, float]:
        return self._bench.rig.instruments[self.name].identify(), time.time()

    def _data_key(self, dtype: Any, unit: str) -> DataKey:
        table = self._bench.rig.file.instruments[self.name]
        key: DataKey = {"source": f"{table.driver} {table.address}", "dtype": dtype, "shape": []}
        if dtype == "number":
            key["dtype_numpy"] = "<f8"
        if unit:
            key["units"] = unit
        return key


class StageDevice(Instrument):
    """A stage (`Locatable`, `Checkable`, `Stoppable`); it has to be homed before it is set."""

    def __init__(
        self,
        bench: _Bench,
        stage: interfaces.Stage,
        unit: str,
        range_: tuple[float, float],
        require: Callable[[str, float], None],
        move: Callable[[float], None],
        where: Callable[[], interfaces.Reading],
    ) -> None:
        self._readback_key, self._setpoint_key = f"{stage.name}_{unit}", f"{stage.name}_setpoint_{unit}"
        super().__init__(bench, stage.name, {self._readback_key: unit, self._setpoint_key: unit}, interest=1)
        self._stage = stage
        self._unit = unit
        self._range = range_
        self._require = require
        self._move = move
        self._where = where
        self._setpoint: float | None = None
        self._status: ActionStatus | None = None
        self._stopped = threading.Event()
        self.stopped_as_planned = False
        """Whether who stops it knows: its motion then ends without an error."""
        bench.stages.append(self)

    def check_value(self, value: float) -> None:
        """`LimitError` when it must not go there, or it is no place; sends nothing."""
        # Plans are not checked for types: a word comes as it is, and a truth value would be a position.
        if not isinstance(value, Real) or isinstance(value, bool):
            raise LimitError(f"{self.name}: {value!r} is no position; give a number [{self._unit}]")
        self._require(self.name, value)

    def set(self, value: float) -> ActionStatus:
        """Move; done when it has arrived and settled.

        `LimitError` at once and before a byte is sent when it must not go there, `RigError` while it moves already.
        """
        self.check_value(value)
        if self._status is not None and not self._status.done:
            raise RigError(f"{self.name}: still on its way to {self._setpoint:g}; wait until it is there, or stop it")
        self._setpoint, self.stopped_as_planned = float(value), False
        self._stopped.clear()
        self._status = self._bench.doing(self.name, lambda: self._go(float(value)))
        return self._status

    def _go(self, value: float) -> None:
        clock = self._bench.rig.clock
        try:
            self._move(value)
            settled_s = clock.now_s() + self._bench.settle_s
            while not self._stopped.is_set() and (left_s := settled_s - clock.now_s()) > 0.0:
                clock.sleep_s(min(left_s, LOOK_EVERY_S))
        except MotionStopped:
            # An engine that pauses stops what moves; a motion that fails then would end the plan.
            if not self.stopped_as_planned:
                raise

    def stop(self, success: bool = True) -> None:
        """Returns when the stage has confirmed that it is at rest; `RigError` otherwise.

        A motion that this stops ends as a `success` or with `MotionStopped`.
        """
        self.stopped_as_planned = success
        self._stopped.set()
        require_rest(bring_to_rest([self._stage]))
        if self._status is not None:
            self._status.wait(DEADLINE_S)

    def locate(self) -> Location[float]:
        """Where it was told to go and where it is; before it was told, where it is."""
        readback = self._here().value
        return {"setpoint": readback if self._setpoint is None else self._setpoint, "readback": readback}

    def read(self) -> dict[str, Reading[float]]:
        """The encoder, and the set-point as `locate` has it.

        `InstrumentError` for a stage without a reference, `SafetyStop` where a safety device took it.
        """
        here = self._here()
        setpoint = here.value if self._setpoint is None else self._setpoint
        values = {self._readback_key: here.value, self._setpoint_key: setpoint}
        return {key: self._bench.reading(value, here.time_s) for key, value in values.items()}

    def _here(self) -> interfaces.Reading:
        here = self._where()
        self._confirm()
        return here

    def _confirm(self) -> None:
        # What moves ends in an error of its own, and a controller may not call it ready meanwhile.
        if (self._status is None or self._status.done) and not self._stage.is_moving():
            require_homed(self._stage)
        super()._confirm()

    def describe(self) -> dict[str, DataKey]:
        """The keys of `read`, with the limits of the rig file."""
        keys = super().describe()
        low, high = self._range
        keys[self._setpoint_key]["limits"] = {"control": {"low": low, "high": high}}
        return keys


class MeterDevice(Instrument):
    """An instrument that gives one reading of each channel when it is read."""

    def __init__(
        self, bench: _Bench, name: str, channels: dict[str, str], take: Callable[[], Sequence[interfaces.Reading]]
    ) -> None:
        super().__init__(bench, name, channels, interest=len(channels))
        self._take = take

    def read(self) -> dict[str, Reading[float]]:
        """Readings of now, NaN where the instrument has no valid value."""
        readings = zip(self._quantities, self._take(), strict=True)
        self._confirm()
        return {key: self._bench.reading(each.value, each.time_s) for key, each in readings}


class RecordDevice(Instrument):
    """An instrument that records on its own timer (`Triggerable`, `Stageable`): mean and standard deviation."""

    def __init__(self, bench: _Bench, recorder: interfaces.PacingRecorder, record_s: float, period_s: float) -> None:
        self._samples, self._period_s = round(record_s / period_s), period_s
        longest = recorder.longest_record(period_s)
        if not 2 <= self._samples <= longest:
            raise LimitError(
                f"{recorder.name}: record_s = {record_s:g} with a sample every {period_s:g} s are {self._samples} "
                f"samples; 2 to {longest} are possible"
            )
        channels = [(name_and_unit(each.name)[0], each.name, each.unit) for each in recorder.channels()]
        statistics = ("mean", "std")
        quantities = {
            plain + "_" + what + name.removeprefix(plain): unit
            for what in statistics
            for plain, name, unit in channels
        }
        super().__init__(bench, recorder.name, quantities, interest=len(channels))
        self._recorder = recorder
        self._ended = threading.Event()
        self._status: ActionStatus | None = None
        self._last: dict[str, Reading[float]] = {}

    def trigger(self) -> ActionStatus:
        """Make a record; done when it is there. `InstrumentError` in the status where samples do not come."""
        self._ended.clear()
        self._status = self._bench.doing(self.name, self._record)
        return self._status

    def _record(self) -> None:
        try:
            start_s, rows = self._recorded()
            self._confirm()
        except RigError:
            # Ended by `unstage`, after an error of the plan: that is to be heard, not this.
            if self._ended.is_set():
                return
            raise
        middle_s = start_s + self._recorder.first_sample_after_s + 0.5 * (self._samples - 1) * self._period_s
        values = [*np.mean(rows, axis=0), *np.std(rows, axis=0, ddof=1)]
        readings = zip(self._quantities, values, strict=True)
        self._last = {key: self._bench.reading(float(value), middle_s) for key, value in readings}

    def _recorded(self) -> tuple[float, FloatArray]:
        """When the record began [rig s], and its rows, shape (samples, channels)."""
        recorder, clock, samples, period_s = self._recorder, self._bench.rig.clock, self._samples, self._period_s
        start_s = recorder.start(samples, period_s)
        pace = Pace.of_record(clock, start_s, recorder.first_sample_after_s, period_s, samples)
        parts: list[FloatArray] = []
        received = 0
        while received < samples:
            clock.sleep_s(min(FETCH_EVERY_S, (samples - received) * period_s) + period_s)
            # Else this would fetch from a later record.
            if self._ended.is_set():
                raise InstrumentError(f"{self.name}: its record was ended before its time", instrument=self.name)
            asked_s = clock.now_s()
            parts.append(recorder.fetch())
            received += len(parts[-1])
            pace.require(self.name, received, asked_s, clock.now_s())
        return start_s, np.concatenate(parts)

    def read(self) -> dict[str, Reading[float]]:
        """Mean and standard deviation of a sample in the last record, NaN where a sample was; at its middle."""
        if not self._last:
            raise InstrumentError(f"{self.name}: nothing is recorded yet; trigger it first", instrument=self.name)
        return dict(self._last)

    def stage(self) -> list[Any]:
        """Forget the last record."""
        self._last = {}
        return [self]

    def unstage(self) -> list[Any]:
        """End a record that is under way, as a plan that fails leaves it."""
        if self._status is not None and not self._status.done:
            self._ended.set()
            require_rest(bring_to_rest([self._bench.rig.instruments[self.name]]))
            self._status.wait(DEADLINE_S)
        return [self]

    def read_configuration(self) -> dict[str, Reading[Any]]:
        """Who answers, and what a record is."""
        told = {f"{self.name}_samples": self._samples, f"{self.name}_period_s": self._period_s}
        at_s = self._identified[1]
        return {
            **super().read_configuration(),
            **{key: {"value": value, "timestamp": at_s} for key, value in told.items()},
        }

    def describe_configuration(self) -> dict[str, DataKey]:
        """The keys of `read_configuration`."""
        keys = {
            f"{self.name}_samples": self._data_key("integer", ""),
            f"{self.name}_period_s": self._data_key("number", "s"),
        }
        return {**super().describe_configuration(), **keys}


Device = StageDevice | MeterDevice | RecordDevice


def _device(
    bench: _Bench, name: str, instrument: interfaces.Instrument, record_s: float, period_s: float
) -> Device | None:
    match instrument:
        case interfaces.RotationStage(limits=limits, move_to=move, angle=where):
            angles_deg = limits.angle_min_deg, limits.angle_max_deg
            return StageDevice(bench, instrument, "deg", angles_deg, limits.require_angle, move, where)
        case interfaces.LinearStage(limits=limits, move_to=move, position=where):
            positions_mm = limits.position_min_mm, limits.position_max_mm
            return StageDevice(bench, instrument, "mm", positions_mm, limits.require_position, move, where)
        case interfaces.PacingRecorder():
            return RecordDevice(bench, instrument, record_s, period_s)
        case interfaces.DisplacementMeter():
            heads = {channel.name: channel.unit for channel in instrument.channels()}
            return MeterDevice(bench, name, heads, instrument.displacements)
        case interfaces.Voltmeter():
            return MeterDevice(bench, name, {f"{name}_v": "V"}, lambda: [instrument.voltage()])
        case interfaces.Thermometer():
            return MeterDevice(bench, name, {f"{name}_c": "degC"}, lambda: [instrument.temperature()])
    return None
