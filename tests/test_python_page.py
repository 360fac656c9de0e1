"""docs/python.md: every example runs, one after the other as a reader would, and finds what its text promises."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")

Names = dict[str, Any]


@dataclass(frozen=True)
class Example:
    """A block of code, by the heading above it and its number below that."""

    heading: str
    code: str


def _examples() -> dict[str, Example]:
    found: dict[str, Example] = {}
    for section in PAGE.split("\n## ")[1:]:
        heading = section.partition("\n")[0]
        blocks = re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)
        found |= {f"{heading} {number}": Example(heading, code) for number, code in enumerate(blocks, 1)}
    return found


EXAMPLES = _examples()


@dataclass
class Notebook:
    """Names that examples leave behind, and what each printed; each is run once, after those above it."""

    names: Names = field(default_factory=dict)
    printed: dict[str, str] = field(default_factory=dict)

    def run_to(self, wanted: str) -> str:
        """What an example printed."""
        for name, example in EXAMPLES.items():
            if name not in self.printed:
                out = io.StringIO()
                with contextlib.redirect_stdout(out):
                    exec(compile(example.code, f"docs/python.md, {name}", "exec"), self.names)
                self.printed[name] = out.getvalue()
            if name == wanted:
                return self.printed[name]
        raise KeyError(wanted)


@pytest.fixture(scope="module")
def notebook(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Notebook]:
    """A reader's, in a directory with what is shipped."""
    directory = tmp_path_factory.mktemp("notebook")
    for name in ("campaigns", "examples"):
        (directory / name).symlink_to(ROOT / name)
    with contextlib.chdir(directory):
        yield Notebook()


def rig(names: Names, printed: str) -> None:
    assert re.search(r"Reading\(value=(2\.99|3\.0)\d*, unit='deg', time_s=", printed)
    assert "rotation" in printed
    assert names["stage"].name in names["rig"].instruments


def campaign(names: Names, printed: str) -> None:
    axis = names["axis"]
    assert axis.passed
    assert axis.plane.normal[1] == pytest.approx(1.0, abs=1e-3)
    assert axis.plane.covariance.shape == (3, 3)
    assert "True" in printed


def store(names: Names, printed: str) -> None:
    assert "theta_deg" in printed
    assert len({column.shape for column in names["columns"].values()}) == 1
    assert printed.splitlines()[-1].endswith("done")


def two_models(names: Names, printed: str) -> None:
    with_roll, without = (found.fit.result for found in names["fits"].values())
    assert without.chi2 - with_roll.chi2 > 5.0**2
    assert (without.chi2 - with_roll.chi2) == pytest.approx(
        (with_roll.value("rho1") / with_roll.sigma("rho1")) ** 2, rel=0.1
    )
    assert "converged" in printed


def missing(names: Names, printed: str) -> None:
    assert names["diagnosis"].verdict == "effect"
    assert set(names["missing"]) == {"quadratic", "cable-hysteresis"}
    assert "Estimate(value=" in printed
    *_, last = printed.splitlines()
    assert float(last.split()[-1]) == pytest.approx(1.0, abs=0.05)


def residuals(names: Names, printed: str) -> None:
    below, above = (float(line.split()[-1]) for line in printed.splitlines())
    assert abs(below) > 1.5
    assert above == pytest.approx(-below, rel=0.3)


def table(names: Names, printed: str) -> None:
    # NIST's certified values and standard deviations; ours come from a noise that allows for more than the model.
    estimates = names["cell"].parameters.values()
    values = [6.73565789473684e-04, 7.32059160401003e-07, -3.16081871345029e-15]
    sigmas = [1.07938612033077e-04, 1.57817399981659e-10, 4.86652849992036e-17]
    assert [each.value for each in estimates] == pytest.approx(values, rel=1e-6)
    assert [each.sigma for each in estimates] == pytest.approx(sigmas, rel=0.05)
    assert "power2[load_lb]" in printed


def own(names: Names, printed: str) -> None:
    assert float(printed) == pytest.approx(1.0, abs=0.05)


def frames(names: Names, printed: str) -> None:
    assert len(names["runs"]) == 18
    assert names["readings"].shape == (40, 2)
    assert "V " in printed
    # Of a parabola through 40 readings: far better known in the middle than its terms, which share their errors.
    at, terms = names["at_1e6_lb"], names["number"]
    assert at.nominal_value == pytest.approx(0.72957, abs=1e-5)
    assert at.std_dev < 0.5 * terms["b1"].std_dev * 1e6
    assert printed.endswith("0.00000073206(16)\n")


def constants(names: Names, printed: str) -> None:
    # gain = slope / (gravity * (1 - buoyancy)): the constants' relative uncertainties are the gain's.
    _, gravity, buoyancy = names["Campaign"].measured("masses.rig.sqlite").sources
    gain = names["Campaign"].fit("masses.rig.sqlite").parameters["gain"]
    assert gain.value == pytest.approx(0.1961 / 9.8127, rel=1e-3)
    assert gravity.standard_uncertainty[1] == pytest.approx(gain.value * 0.0002 / 9.8127, rel=1e-6)
    known = names["constants"]["buoyancy"]
    assert buoyancy.standard_uncertainty[1] == pytest.approx(gain.value * known.u / (1.0 - known.value), rel=1e-6)
    assert printed.startswith("noise of output_mv [")


def nulls(names: Names, printed: str) -> None:
    assert len(names["result"].fit.nulls()) == 6
    assert names["budget"].expanded.shape == (2,)
    assert " V\n" in printed


def figures(names: Names, printed: str) -> None:
    assert printed == f"{len(names['paths'])} files\n"
    assert all(path.is_file() for path in names["paths"])


def bundle(names: Names, printed: str) -> None:
    assert Path("notebook-bundle/runs.csv").is_file()


def scanned(names: Names, printed: str) -> None:
    volts = [float(line.split()[2]) for line in printed.splitlines()]
    assert volts == pytest.approx([2.11 * abs(sin) for sin in (0.866, 0.5, 0.0, 0.5, 0.866)], abs=0.03)


def streamed(names: Names, printed: str) -> None:
    first, *_, last = printed.splitlines()
    assert first.startswith("stream runs with ")
    assert last.startswith("success {'runs")
    events = names["document"]["num_events"]
    assert sum(count for name, count in events.items() if name.startswith("runs")) == 18
    assert printed.count(" True\n") == 18


PROMISES: dict[str, Callable[[Names, str], None]] = {
    "A rig by hand 1": rig,
    "A campaign 1": campaign,
    "A store 1": store,
    "Fitting again, with another model 1": two_models,
    "Which effect is missing 1": missing,
    "Which effect is missing 2": residuals,
    "A table, and an effect of your own 1": table,
    "A table, and an effect of your own 2": own,
    "Frames, datasets, uncertain numbers 1": frames,
    "Frames, datasets, uncertain numbers 2": constants,
    "Nulls, observables, budget 1": nulls,
    "Nulls, observables, budget 2": figures,
    "Bundles 1": bundle,
    "Bluesky 1": scanned,
    "Bluesky 2": streamed,
}


def test_every_example_is_held_to_what_it_promises() -> None:
    assert list(PROMISES) == list(EXAMPLES)


@pytest.mark.parametrize("example", PROMISES)
def test_an_example_runs_and_finds_what_it_promises(notebook: Notebook, example: str) -> None:
    printed = notebook.run_to(example)
    PROMISES[example](notebook.names, printed)


@pytest.mark.parametrize("name", re.findall(r"`(Campaign\.\w+|\w+_bundle|rigctl\.\w+)[(`]", PAGE))
def test_what_the_text_names_is_there(name: str) -> None:
    import rigctl
    from rigctl.campaign.bundle import bundle

    owner, _, attribute = name.rpartition(".")
    homes: dict[str, Any] = {"Campaign": rigctl.Campaign, "rigctl": rigctl, "": bundle}
    assert hasattr(homes[owner], attribute)
