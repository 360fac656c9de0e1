"""The controller's parameters: by number or by name, changed at once, kept over a restart when committed."""

from __future__ import annotations

from enum import IntEnum

from simulators.aerotech_ensemble.grammar import Invalid, number, whole
from simulators.aerotech_ensemble.settings import StageSimulatorSettings

NUMBER_MAX = 400
"""Of a parameter; chosen, above all that sources name."""
WAIT_MODES = ("nowait", "movedone", "inpos")


class Parameter(IntEnum):
    """Numbers from EnsembleParameterId.h; on the wire the names have no underscores."""

    REVERSE_MOTION_DIRECTION = 1
    COUNTS_PER_UNIT = 2
    FAULT_MASK = 26
    POSITION_ERROR_THRESHOLD = 32
    VELOCITY_COMMAND_THRESHOLD = 35
    SOFTWARE_LIMIT_LOW = 37
    SOFTWARE_LIMIT_HIGH = 38
    IN_POSITION_DISTANCE = 40
    POSITION_FEEDBACK_TYPE = 47
    END_OF_TRAVEL_LIMIT_SETUP = 61
    DEFAULT_SPEED = 71
    DEFAULT_RAMP_RATE = 72
    ABORT_DECEL_RATE = 73
    HOME_SETUP = 75
    HOME_SPEED = 76
    HOME_OFFSET = 77
    HOME_RAMP_RATE = 78
    DEFAULT_WAIT_MODE = 79
    GLOBAL_INTEGERS = 124
    GLOBAL_DOUBLES = 125
    UNITS_NAME = 129
    SOCKET2_PORT = 131
    SOCKET2_TIMEOUT = 138
    AXIS_NAME = 140
    COMMAND_SETUP = 150
    COMMAND_TERMINATING_CHARACTER = 177
    COMMAND_SUCCESS_CHARACTER = 178
    COMMAND_INVALID_CHARACTER = 179
    COMMAND_FAULT_CHARACTER = 180
    COMMAND_TIMEOUT = 202
    COMMAND_TIMEOUT_CHARACTER = 203
    SOFTWARE_LIMIT_SETUP = 210
    IN_POSITION_TIME = 319


_BY_NAME = {parameter.name.replace("_", ""): parameter for parameter in Parameter}

MUST_BE_POSITIVE = frozenset(
    {
        Parameter.DEFAULT_SPEED,
        Parameter.DEFAULT_RAMP_RATE,
        Parameter.ABORT_DECEL_RATE,
        Parameter.HOME_SPEED,
        Parameter.HOME_RAMP_RATE,
    }
)

FIXED = frozenset(
    {
        Parameter.COUNTS_PER_UNIT,
        Parameter.GLOBAL_INTEGERS,
        Parameter.GLOBAL_DOUBLES,
        Parameter.UNITS_NAME,
        Parameter.AXIS_NAME,
    }
)
"""What only Aerotech's own configuration tool changes here."""


def named(word: str) -> Parameter:
    """The parameter of this number or name."""
    if word in _BY_NAME:
        return _BY_NAME[word]
    try:
        return Parameter(int(word))
    except ValueError:
        raise Invalid from None


class Parameters:
    """One axis' parameters."""

    def __init__(self, settings: StageSimulatorSettings) -> None:
        self._texts = {Parameter.UNITS_NAME: settings.units, Parameter.AXIS_NAME: settings.axis}
        self._numbers = {str(number): Parameter[name] for number, name in settings.parameter_numbers.items()}
        self._committed = _factory(settings)
        self._values = dict(self._committed)

    def __getitem__(self, parameter: Parameter) -> float:
        return self._values[parameter]

    def named(self, word: str) -> Parameter:
        """The parameter of this number or name."""
        if not self._numbers:
            return named(word)
        if word not in self._numbers:
            raise Invalid
        return self._numbers[word]

    def read(self, word: str) -> str:
        """The value of this number or name; 0 for a number that means something else here."""
        if self._numbers and word not in self._numbers and whole(word, 0, NUMBER_MAX) >= 0:
            return "0.000"
        return self.text(self.named(word))

    def text(self, parameter: Parameter) -> str:
        """The value as it is sent."""
        return self._texts[parameter] if parameter in self._texts else f"{self._values[parameter]:.3f}"

    def change(self, parameter: Parameter, word: str) -> None:
        """Set a number; `Invalid` for what cannot be set."""
        value = number(word)
        if parameter in FIXED or (parameter in MUST_BE_POSITIVE and value <= 0):
            raise Invalid
        self._values[parameter] = value

    def name_unit(self, name: str) -> None:
        """Another UnitsName."""
        self._texts[Parameter.UNITS_NAME] = name

    def commit(self) -> None:
        """Keep the present values over a restart."""
        self._committed = dict(self._values)

    def restart(self) -> None:
        """Go back to the kept values."""
        self._values = dict(self._committed)


def _factory(settings: StageSimulatorSettings) -> dict[Parameter, float]:
    return {
        Parameter.REVERSE_MOTION_DIRECTION: 0,
        Parameter.COUNTS_PER_UNIT: settings.counts_per_mm,
        Parameter.FAULT_MASK: 0xFFFFFF,
        Parameter.POSITION_ERROR_THRESHOLD: 1.0,
        Parameter.VELOCITY_COMMAND_THRESHOLD: settings.speed_max_mm_s,
        Parameter.SOFTWARE_LIMIT_LOW: settings.position_min_mm,
        Parameter.SOFTWARE_LIMIT_HIGH: settings.position_max_mm,
        Parameter.IN_POSITION_DISTANCE: 0.001,
        Parameter.POSITION_FEEDBACK_TYPE: 2,
        Parameter.END_OF_TRAVEL_LIMIT_SETUP: 6,
        Parameter.DEFAULT_SPEED: settings.speed_mm_s,
        Parameter.DEFAULT_RAMP_RATE: settings.ramp_rate_mm_s2,
        Parameter.ABORT_DECEL_RATE: settings.abort_deceleration_mm_s2,
        Parameter.HOME_SETUP: 0,
        Parameter.HOME_SPEED: settings.home_speed_mm_s,
        Parameter.HOME_OFFSET: 0,
        Parameter.HOME_RAMP_RATE: settings.ramp_rate_mm_s2,
        Parameter.DEFAULT_WAIT_MODE: WAIT_MODES.index(settings.wait_mode),
        Parameter.GLOBAL_INTEGERS: settings.integer_registers,
        Parameter.GLOBAL_DOUBLES: settings.double_registers,
        Parameter.SOCKET2_PORT: 8000,
        Parameter.SOCKET2_TIMEOUT: settings.socket_timeout_s * 1000.0,
        Parameter.COMMAND_SETUP: int(settings.dialect.always_send_eos),
        Parameter.COMMAND_TERMINATING_CHARACTER: ord("\n"),
        Parameter.COMMAND_SUCCESS_CHARACTER: ord("%"),
        Parameter.COMMAND_INVALID_CHARACTER: ord("!"),
        Parameter.COMMAND_FAULT_CHARACTER: ord("#"),
        Parameter.COMMAND_TIMEOUT: settings.command_timeout_s * 1000.0,
        Parameter.COMMAND_TIMEOUT_CHARACTER: ord("$"),
        Parameter.SOFTWARE_LIMIT_SETUP: 0,
        Parameter.IN_POSITION_TIME: settings.settle_s * 1000.0,
    }
