"""How far a run lies from a model."""

from __future__ import annotations

from dataclasses import dataclass

FAR_SIGMA = 5.0
"""Of ten thousand data that fit, one lies farther in one recording out of two hundred."""


@dataclass(frozen=True)
class RunMisfit:
    """The datum of a run that lies farthest from the fitted model, `sigma` of its noise above or below it."""

    run_id: str
    sigma: float
    channel: str
    component: str

    @property
    def far(self) -> bool:
        """Whether that is more than chance makes of a whole recording."""
        return abs(self.sigma) > FAR_SIGMA


def said_of_misfit(version: int, chi2_per_dof: float, where: str, off_sigma: float, data: str = "") -> str:
    """The line that says so, with the datum that is farthest off.

    `data` says of which data chi2/dof is where it is not of all: "at nu alone ".
    """
    return (
        f"the model, version {version}, does not describe these data, and no sigma holds: chi2/dof {data}is "
        f"{chi2_per_dof:.3g}, and {where} is {off_sigma:+.1f} sigma off; look with `rigctl "
        "compare`, then extend the model or, of an imported recording, correct its runs.csv"
    )
