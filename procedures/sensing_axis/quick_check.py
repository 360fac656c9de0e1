"""The evening before: does one axis answer as it should, and do lasers and encoder agree? Under ten minutes.

Reversal: a quarter turn to either side of the null the sensor looks along the motion, forwards and backwards, so
S(theta0 + 90 deg) = -S(theta0 - 90 deg). The main head looks along the motion: its scale against the encoder is 1.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from procedures.sensing_axis.bench import ANGLE_RESOLUTION_DEG, Bench, SetPoint
from procedures.sensing_axis.mounting import Fixture, Mounting
from rigctl.campaign.session.session import Session
from rigctl.core.errors import ProcedureError
from rigctl.experiments.sensing_axis.model.fit import fit_recording
from rigctl.experiments.sensing_axis.model.model import RecordingModel
from rigctl.experiments.sensing_axis.observe.observables import RunObservables
from rigctl.experiments.sensing_axis.observe.reduction import observables, reduce_run

DWELL_S = 20.0
REVERSAL_AMPLITUDE_MM = 1.0
REVERSAL_TOLERANCE = 0.005
SCALE_TOLERANCE = 0.002


@dataclass(frozen=True)
class QuickCheck:
    """What was found. `reversal` is (S+ + S-) / (S+ - S-), zero when equal and opposite.

    `laser_scale` is the main head's reading over what encoder and beam tilt predict, None without that head.
    """

    theta0_deg: float
    gain_v_per_m_s2: float
    reversal: float
    reversal_sigma: float
    laser_scale: float | None

    @property
    def passed(self) -> bool:
        """True when the sensor reverses and the main head agrees with the encoder."""
        reverses = abs(self.reversal) <= REVERSAL_TOLERANCE
        agrees = self.laser_scale is None or abs(self.laser_scale - 1.0) <= SCALE_TOLERANCE
        return reverses and agrees


def quick_check(session: Session, bench: Bench, fixture: Fixture, start: SetPoint) -> QuickCheck:
    """Measure near the null and a quarter turn to either side; the finding is kept with the campaign."""
    mounting = Mounting(start.axis, start.configuration, start.mounting)

    def measure(name: str, point: SetPoint, *, lasers: bool) -> RunObservables:
        key = f"{mounting.key} {name}"
        record = bench.run(session, key, point, before=lambda: fixture.confirm(mounting), lasers=lasers)
        if not record.valid:
            raise ProcedureError(f"{key}: {record.reason}; reduce the amplitude or level the package")
        samples = session.store.samples(record.run_id)
        return observables(
            [reduce_run(record.run_id, record.conditions, samples, channels=session.store.header.channels)]
        )[0]

    near = measure("near null", replace(start, dwell_s=DWELL_S), lasers=True)
    fit = fit_recording(RecordingModel([near], bench.package, bench.heads, bench.g_m_s2))
    null = fit.null(mounting.axis, mounting.configuration, mounting.number)
    theta0_deg = round(math.degrees(null.theta0_rad) / ANGLE_RESOLUTION_DEG) * ANGLE_RESOLUTION_DEG
    plus, minus = (
        # A quarter turn away the spots have left the cube.
        measure(f"reversal {point.theta_deg - theta0_deg:+.0f} deg", point, lasers=False)
        for point in reversal_points(replace(start, theta_deg=theta0_deg))
    )
    check = _compare(theta0_deg, plus, minus, _main_head_scale(near, bench))
    session.once("quick check", lambda: {**asdict(check), "passed": check.passed})
    return check


def reversal_points(null: SetPoint) -> tuple[SetPoint, SetPoint]:
    """A quarter turn to either side of a null."""
    aside = replace(null, dwell_s=DWELL_S, amplitude_mm=REVERSAL_AMPLITUDE_MM)
    return replace(aside, theta_deg=null.theta_deg + 90.0), replace(aside, theta_deg=null.theta_deg - 90.0)


def _compare(theta0_deg: float, plus: RunObservables, minus: RunObservables, laser_scale: float | None) -> QuickCheck:
    # Over the acceleration that the encoder shows: the two amplitudes need not be equal.
    forwards, backwards = (run.accel_v.value[1] / run.peak_acceleration_m_s2 for run in (plus, minus))
    sigma = np.hypot(*(run.accel_v.sigma[1] / run.peak_acceleration_m_s2 for run in (plus, minus)))
    difference = forwards - backwards
    return QuickCheck(
        theta0_deg=theta0_deg,
        gain_v_per_m_s2=float(abs(difference) / 2.0),
        reversal=float(((forwards + backwards) / difference).real),
        reversal_sigma=float(sigma / abs(difference)),
        laser_scale=laser_scale,
    )


def _main_head_scale(run: RunObservables, bench: Bench) -> float | None:
    """The main head looks along the motion: it reads A / cos(tilt) but for the mounting's small rotation."""
    for name, head in bench.heads.items():
        if head.position[-1] == "x" and name in run.lasers_m:
            return float(run.lasers_m[name].value[1].real * math.cos(head.tilt_rad) / run.amplitude_m)
    return None
