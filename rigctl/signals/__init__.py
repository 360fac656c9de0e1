"""From samples to amplitudes with honest noise: sine fits and spectra of what they leave."""

from rigctl.signals.noise import DcNoise, NoiseLevel, NoisePool, Spectrum, pooled_psd, spectrum
from rigctl.signals.sine_fit import (
    FrequencyFit,
    HarmonicBasis,
    HarmonicFit,
    find_frequency,
    referred_to,
    refine_frequency,
)

__all__ = [
    "DcNoise",
    "FrequencyFit",
    "HarmonicBasis",
    "HarmonicFit",
    "NoiseLevel",
    "NoisePool",
    "Spectrum",
    "find_frequency",
    "pooled_psd",
    "referred_to",
    "refine_frequency",
    "spectrum",
]
