"""Small campaigns, one of each procedure, on the shipped rigs: at most some seconds of processor each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SHIPPED = Path(__file__).parents[2] / "campaigns"

SCAN = """\
axes = ["X"]
frequencies_hz = [0.3, 0.6]
amplitude_mm = 5.0
dwell_s = 6.0
"""


@dataclass(frozen=True)
class SmallCampaign:
    """A campaign file's text and the shipped rig that carries it out."""

    name: str
    rig: str
    text: str

    @property
    def rig_text(self) -> str:
        """The rig file, to be changed at will."""
        return (SHIPPED / self.rig).read_text(encoding="utf-8")

    def write(self, work: Path, rig_text: str | None = None) -> Path:
        """`rig.toml` and `campaign.toml` in `work`; returns the path of the second."""
        (work / "rig.toml").write_text(self.rig_text if rig_text is None else rig_text, encoding="utf-8")
        path = work / "campaign.toml"
        path.write_text(self.text, encoding="utf-8")
        return path


def _sensing_axis(name: str, procedure: str, *, rig: str = "isa-rig.toml", targets: str = "") -> SmallCampaign:
    effects = "" if name == "quick-check" else '\n[model]\neffects = ["roll-gravity", "resonance"]\n'
    text = f'experiment = "sensing-axis"\nrig = "rig.toml"\n\n[procedure]\n{procedure}\n{targets}'
    return SmallCampaign(name, rig, text + effects)


def _platform(name: str, runs: str) -> SmallCampaign:
    top = 'experiment = "rotating-platform"\nrig = "rig.toml"\n\n[procedure]\nname = "bias-rejection"\n'
    return SmallCampaign(name, "bias-rejection-rig.toml", top + runs)


def _inflight(name: str, procedure: str) -> SmallCampaign:
    top = 'experiment = "inflight-calibration"\nrig = "rig.toml"\n\n[procedure]\n'
    return SmallCampaign(name, "microscope-rig.toml", top + procedure)


SMALL_CAMPAIGNS = {
    small.name: small
    for small in (
        _sensing_axis(
            "null-search",
            'name = "null-search"\naxes = ["X"]\nconfigurations = ["pendulum"]\nfrequencies_hz = [0.3, 0.6]\n'
            "amplitude_mm = 5.0\ncoarse_s = 4.0\nnoise_check_s = 10.0\n",
            targets="\n[targets]\ntheta0_sigma_arcsec = 15.0\nnoise_m_s2_rthz = 1e-5\n",
        ),
        _sensing_axis(
            "six-mountings",
            'name = "six-mountings"\naxes = ["Y"]\nconfigurations = ["pendulum", "flag"]\n'
            "frequencies_hz = [0.25, 0.5]\n"
            "amplitude_mm = 4.0\ncoarse_s = 4.0\nnoise_check_s = 0.0\n",
            rig="one-axis.rig.toml",
            targets="\n[targets]\ntheta0_sigma_arcsec = 20.0\nnoise_m_s2_rthz = 1e-5\n",
        ),
        _sensing_axis(
            "scan",
            f'name = "scan"\nconfigurations = ["flag"]\nangles_deg = [-10.0, -1.0]\napproaches = [1, -1]\n{SCAN}',
            rig="hidden-effect-rig.toml",
        ),
        _sensing_axis(
            "angle-scan",
            f'name = "angle-scan"\nconfigurations = ["pendulum"]\nangles_deg = [-1.0, 0.0, 1.0]\n{SCAN}',
            rig="all-instruments.rig.toml",
        ),
        _sensing_axis(
            "quick-check",
            'name = "quick-check"\naxes = ["X"]\nconfigurations = ["pendulum"]\nfrequencies_hz = [0.6]\n'
            "amplitude_mm = 5.0\n",
        ),
        _platform(
            "bias-rejection",
            "\n[[procedure.runs]]\npattern = 'scan'\nstep_deg = 60.0\ndwell_s = 20.0\n"
            "\n[[procedure.runs]]\npattern = 'noise'\nduration_s = 60.0\n"
            "\n[[procedure.runs]]\npattern = 'c'\nmodulation_period_s = 60.0\nperiods = 2\nv_z_v = [0.0, 1.0]\n",
        ),
        _platform(
            "tilted",
            "\n[[procedure.runs]]\npattern = 'flip'\nduration_s = 20.0\n"
            "\n[[procedure.runs]]\npattern = 'a'\nmodulation_period_s = 60.0\nperiods = 2\n"
            "external = 'sine'\nv_z_v = 0.5\nexternal_period_s = 100.0\n",
        ),
        _inflight("calibration", 'sessions = ["dx", "ad11"]\norbits = 6.0\n'),
        _inflight("monte-carlo", 'name = "monte-carlo"\ndraws = 2\nworkers = 1\norbits = 5.0\norbits_ac12 = 5.0\n'),
    )
}
"""By name: one of each procedure, on every instrument the shipped rigs have."""
