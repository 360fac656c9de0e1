"""The gain follows the barometer: gas around the proof mass takes part in its motion."""

from rigctl.effects import effect

STANDARD_HPA = 1013.25


@effect("pressure-gain", on="sensor_output_v", parameters={"kP": "1/hPa"}, typical={"kP": 1e-5})
def pressure_gain(run, kP):
    """The output, static level and all, is multiplied by 1 + kP (p - 1013.25 hPa)."""
    return kP * (run.column("pressure_hpa") - STANDARD_HPA) * run.signal
