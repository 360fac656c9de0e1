"""What is stated of instruments and constants goes with a bundle, and counts the same there."""

from pathlib import Path

import pytest

from rigctl.campaign.bundle.place import Place
from rigctl.campaign.bundle.recording_toml import header_to_toml, read_header
from rigctl.campaign.recording import Header, LaserInfo
from rigctl.campaign.stated import certificates_of, heads_of, uncertainties_of
from rigctl.core.errors import DataError
from rigctl.files.rig_file import read_rig

CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


@pytest.mark.parametrize("name", ["isa-rig", "one-axis.rig", "bias-rejection-rig", "frequency-response-rig"])
def test_a_bundle_states_what_the_rig_file_did(name):
    rig = read_rig(CAMPAIGNS / f"{name}.toml")
    here = Header(
        "sensing-axis",
        rig_toml=rig.text_without_world,
        world_sha256=rig.world_sha256,
        constants={name: constant.value for name, constant in rig.constants.items()},
        lasers={name: LaserInfo("x", head.tilt_deg) for name, head in rig.lasers.items()},
        extra={"certificates": {name: each.model_dump(mode="json") for name, each in rig.certificates.items()}},
    )
    there = read_header(Place("bundle/recording.toml"), header_to_toml(here).encode())
    assert there.rig_toml is None
    assert there.world_sha256 == here.world_sha256 is not None
    assert certificates_of(there) == certificates_of(here)
    stated, known = uncertainties_of(here), uncertainties_of(there)
    assert any(stated.values())
    stated["constants"] = {name: u for name, u in stated["constants"].items() if u > 0.0}
    assert known == stated
    assert {name: head.u_scale for name, head in heads_of(there).items()} == {
        name: head.u_scale for name, head in heads_of(here).items()
    }


def test_a_quantity_that_no_budget_knows_is_refused_as_in_a_rig_file():
    text = 'format = 1\nexperiment = "sensing-axis"\n[certificates.cube.uncertainty]\northogonality_arcmin = 1.0\n'
    with pytest.raises(DataError, match="orthogonality_arcmin; known there: orthogonality_arcsec"):
        read_header(Place("bundle/recording.toml"), text.encode())


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("[certificates.cube.uncertainty]\northogonality_arcsec = -1.0\n", 4, "orthogonality_arcsec cannot be"),
        ("[certificates.cube]\nuncertainty = 1.0\n", 4, "certificates.cube.uncertainty cannot be"),
        ("certificates = 3\n", 3, "certificates is no table"),
        ('[constants_u]\ng_m_s2 = "small"\n', 4, "constants_u.g_m_s2 is 'small'"),
        ("[constants_u]\ng_m_s2 = -0.1\n", 4, "constants_u.g_m_s2 is -0.1"),
        ("[constants_u]\ng_m_s2 = nan\n", 4, "constants_u.g_m_s2 is nan"),
        ("[constants_u]\ng_m_s2 = true\n", 4, "constants_u.g_m_s2 is True"),
    ],
)
def test_what_cannot_be_stated_is_refused_with_its_line(text, line, said):
    with pytest.raises(DataError, match=f"recording.toml, line {line}: .*{said}"):
        read_header(Place("bundle/recording.toml"), f'format = 1\nexperiment = "sensing-axis"\n{text}'.encode())
