"""Aerotech Soloist: the Ensemble's language for a controller with a single axis, which is never named.

Facts from drivers that run on real Soloists: EPICS motorAerotech (drvSoloist.cc and devSoloist.cc, by Aerotech among
others), the microscope program cockpit (a SoloistCP), a NASA profilometer. They differ in two things, which are asked
when the driver connects: whether a question ends in `()`, and which numbers parameters have. A controller with the
numbers of EPICS has no known one for its unit or its registers: the operator says the unit (`unit`), the registers
are counted. None of the three oscillates or captures; that is believed to be as the Ensemble's, in a program without
an axis (`aerobasic/soloist.ab`).
"""

from __future__ import annotations

from drivers.aerotech_ascii import INVALID, SUCCESS
from drivers.aerotech_ensemble import AerotechEnsemble
from drivers.aerotech_settings import SoloistSettings
from drivers.aerotech_setup import ControllerSetup
from drivers.aerotech_words import ENSEMBLE_NUMBERS, FIRST_SOLOIST_NUMBERS, ParameterNumbers, SoleAxis
from drivers.numbers import decimal
from rigctl.core.declarations import DriverDeclaration, Use


class SoloistSetup(ControllerSetup):
    """Finds out by harmless questions which of the two sources it follows."""

    _learned, _calls = False, "()"

    def learn_questions(self) -> None:
        """Whether they end in `()`."""
        if self._learned:
            return
        # Nothing only where `()` is not understood: EPICS, to which the maker contributed, sends it.
        self._calls = "" if self._link.ask("AXISSTATUS()").status == INVALID else "()"
        self._wire.words = SoleAxis(self._calls)
        self._learned = True

    def learn_words(self) -> None:
        """`WrongInstrument` when its parameters have the numbers of neither source."""
        # In one piece: a stop of another thread learns how to ask, and nothing of numbers.
        with self._link.lock:
            # Another controller may stand at the address by now.
            self._learned = False
            self.learn_questions()
            self._wire.words = SoleAxis(self._calls, self._numbers())

    def _numbers(self) -> ParameterNumbers:
        named = [numbers for numbers in (FIRST_SOLOIST_NUMBERS, ENSEMBLE_NUMBERS) if self._is_name(numbers)]
        if len(named) != 1:
            numbers = f"{FIRST_SOLOIST_NUMBERS.axis_name} and {ENSEMBLE_NUMBERS.axis_name}"
            raise self._wrong(
                f"its parameters {numbers} are {'both' if named else 'neither'} a name: look up AxisName in "
                f"{SoleAxis.manual}, and tell us its number"
            )
        return named[0]

    def _is_name(self, numbers: ParameterNumbers) -> bool:
        """True when the parameter that should be AxisName is no number: others are."""
        answer = self._link.ask(f"GETPARM({numbers.axis_name})")
        if answer.status != SUCCESS or not answer.value.strip('"'):
            return False
        try:
            decimal(answer.value)
        except ValueError:
            return True
        return False


class AerotechSoloist(AerotechEnsemble):
    """The axis of a Soloist as a linear stage that records its own position at trigger edges."""

    _set_up_as = SoloistSetup


DRIVER = DriverDeclaration(
    "aerotech-soloist",
    contract=1,
    roles=dict.fromkeys(("linear", "spare"), Use(SoloistSettings, AerotechSoloist)),
    simulator="simulators.aerotech_soloist.declaration:SIMULATOR",
    port=8000,
)
