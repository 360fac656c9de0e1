"""Effects from a user's file: what loads, and the one line that each mistake gets."""

from __future__ import annotations

import hashlib
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.core.errors import ConfigError
from rigctl.core.units import known_unit
from rigctl.effects.catalogue import catalogue, chosen
from rigctl.effects.plugins import Plugin, load

GOOD = '''
import numpy as np

from rigctl.effects import effect


@effect("magnetic", on="specific_force_m_s2", parameters={"b": "m/s2"}, typical={"b": 1e-6})
def magnetic(run, b):
    """A current in the linear motor pulls at the proof mass."""
    return b * np.cos(run.theta) * run.x / run.amplitude
'''

Write = Callable[[str], Path]


@pytest.fixture(autouse=True)
def _without_rehearsal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other process, which takes a tenth of a second of processor, has tests of its own."""
    monkeypatch.setattr("rigctl.effects.plugins.rehearse", lambda path, source: None)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(text: str) -> Path:
        path = tmp_path / "my_effects.py"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def declared(
    on: str = '"specific_force_m_s2"',
    parameters: str = '{"b": "m/s2"}',
    typical: str = '{"b": 1e-6}',
    body: str = "return b * run.x",
    arguments: str = "run, b",
    name: str = "magnetic",
    more: str = "",
) -> str:
    return (
        "import numpy as np\nfrom rigctl.effects import effect\n\n"
        f'@effect("{name}", on={on}, parameters={parameters}, typical={typical}{more})\n'
        f'def pull({arguments}):\n    """A pull."""\n    {body}\n'
    )


def test_a_file_of_a_few_lines_gives_its_effects_and_what_it_held(write: Write) -> None:
    path = write(GOOD)
    plugin = load(path)
    assert isinstance(plugin, Plugin)
    assert plugin.path == path
    assert plugin.sha256 == hashlib.sha256(GOOD.encode()).hexdigest()
    assert list(plugin.effects) == ["magnetic"]
    assert plugin.effects["magnetic"].summary == "A current in the linear motor pulls at the proof mass."


def test_nothing_of_it_stays_behind(write: Write) -> None:
    before = set(sys.modules)
    load(write(GOOD))
    assert not {name for name in set(sys.modules) - before if "plugin_" in name}
    assert "magnetic" not in catalogue("sensing-axis")


def test_a_plugins_effects_come_after_the_catalogues(write: Write) -> None:
    effects = tuple(load(write(GOOD)).effects.values())
    assert list(catalogue("sensing-axis", effects))[-1] == "magnetic"
    named = chosen("sensing-axis", ["magnetic", "quadratic", "roll-gravity"], effects)
    assert [each.id for each in named] == ["roll-gravity", "quadratic", "magnetic"]


def test_an_effect_of_a_table_is_none_of_the_sensing_axis(write: Write) -> None:
    text = declared('"response"', '{"b": "in/lb"}', '{"b": 1e-6}', 'return b * run.column("load_lb") ** 2')
    plugin = load(write(text))
    assert list(plugin.effects) == ["magnetic"]
    assert "magnetic" not in catalogue("sensing-axis", tuple(plugin.effects.values()))
    assert "magnetic" in catalogue("table", tuple(plugin.effects.values()))


@pytest.mark.parametrize(
    ("on", "body"),
    [
        ("motion_m", "return b * run.x**2"),
        ("angle_rad", "return b * run.column('humidity')"),
        ("null_rad", "return b * run.temperature"),
        ("sensor_output_v", "return run.filtered(lambda s: 1 / (1 + b * s)) - run.signal"),
        ("laser_m", "return np.where(run.axis == 'X', b * run.signal**3, 0.0)"),
    ],
)
def test_effects_at_every_point_of_the_chain_are_taken(write: Write, on: str, body: str) -> None:
    assert load(write(declared(f'"{on}"', body=body))).effects["magnetic"].on == on


STEPS = {
    "a jump after all made-up runs": "return b * (run.start > 1e7)",
    "chosen, not multiplied": "return np.where(run.start > 1e7, b, 0.0)",
    "on one day": "return b * (run.column('day') == 3)",
    "above a pressure": "return np.where(run.column('pressure_hpa') > 1000.0, b, 0.0)",
    "a root that is none at room temperature": "return b * np.sqrt(run.temperature - 40.0)",
    "a logarithm of a column": "return b * np.log(run.column('pressure_hpa') - 900.0)",
    "since the beginning": "return b / run.start",
    "in a filter that does nothing here": "return run.filtered(lambda s: 1 + b * 0.0) - run.signal",
    "by a table": "return np.array([0.0, b, b])[run.column('bench').astype(int)]",
}


@pytest.mark.parametrize("body", STEPS.values(), ids=STEPS)
def test_what_made_up_runs_cannot_tell_is_left_to_the_recording(write: Write, body: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(load(write(declared('"sensor_output_v"', body=body))).effects) == ["magnetic"]


MISTAKES = {
    "syntax": ("def f(:\n", r"my_effects\.py, line 1: "),
    "import": ("import numpy\nimport no_such_module\n", r"my_effects\.py, line 2: ModuleNotFoundError"),
    "nothing in it": ("x = 1\n", "no effect in it"),
    "an id of ours": (declared(name="roll-gravity"), "rigctl has an effect of this id"),
    "an id twice": (declared() + declared().replace("pull", "push"), "two of this id"),
    "point": (declared('"voltage"'), "on = 'voltage' is no point of the chain; use one of: motion_m"),
    "scope": (declared(more=', scope="mounting"'), "scope = 'mounting' is none"),
    "scope of a head": (declared(more=', scope="head"'), "goes with on = 'laser_m'"),
    "no parameters": (declared(parameters="{}", typical="{}"), "it has no parameters"),
    "no typical size": (declared(typical="{}"), "typical has no size for b"),
    "typical size zero": (declared(typical='{"b": 0.0}'), "typical size 0.0 of b"),
    "a name misspelt": (
        declared(typical='{"b": 1.0, "bb": 1.0}'),
        "names bb, which is no parameter; is it b?",
    ),
    "unit": (declared(parameters='{"b": "furlong"}'), "unit 'furlong' of b is not known"),
    "arguments": (declared(arguments="run"), r"does not take run and its parameters .*write def pull\(run, b\)"),
    "exception": (declared(body="return b / 0 * run.nothing"), r"fails, line 7: "),
    "nan": (declared(body="return b * run.x * np.nan"), "at zero it returns nan or inf"),
    "inf": (declared(body="return b / (b - 1e-6) * run.x"), "at its typical size it returns nan or inf"),
    "inf in every run": (declared(body="return b / run.x"), "nan or inf in every run"),
    "shape": (declared(body="return b * np.ones(7)"), r"shape \(7,\), which does not fit run\.signal's"),
    "no numbers": (declared(body="return None"), "nan or inf|not an array"),
    "not zero at zero": (declared(body="return run.x * (1 + b)"), "zero means absent"),
    "no dependence": (declared(body="return 0.0 * run.x"), "does not depend on b"),
    "one of two unused": (
        declared(parameters='{"b": "m/s2", "c": "m"}', typical='{"b": 1e-6, "c": 1.0}', arguments="run, b, c"),
        "does not depend on c",
    ),
    "complex": (declared(body="return b * run.x * np.exp(1j * run.x)"), "complex numbers, not real ones"),
    "chance": (
        declared(body="return b * np.random.normal(size=run.x.shape)"),
        "other numbers when it is called again",
    ),
    "in place": (declared(body="run.signal *= 1 + b; run.signal += 1; return b * run.x"), "changes run.signal"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_gets_one_clear_line(write: Write, mistake: str) -> None:
    text, message = MISTAKES[mistake]
    with pytest.raises(ConfigError) as raised:
        load(write(text))
    said = str(raised.value)
    assert re.search(message, said), said
    assert "my_effects.py" in said
    assert "\n" not in said


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.py: cannot be read: No such file"):
        load(tmp_path / "nowhere.py")


def test_a_directory_of_bytes_is_no_plugin(tmp_path: Path) -> None:
    path = tmp_path / "my_effects.py"
    path.write_bytes(b"\x00\xff\x00")
    with pytest.raises(ConfigError, match=r"my_effects\.py"):
        load(path)


@pytest.mark.parametrize(
    "unit", ["1", "V/K", "rad s2/m", "s2", "V/(m/s2)", "mV", "1/s", "m/s^2", "in/lb", "%", "um", "degC"]
)
def test_units_of_the_trade_are_known(unit: str) -> None:
    assert known_unit(unit)


@pytest.mark.parametrize("unit", ["", "furlong", "V//", "Q/s", "metres per second", 3])
def test_other_words_are_no_units(unit: object) -> None:
    assert known_unit(unit) == (unit == "V//")


def test_all_units_of_the_catalogue_are_known() -> None:
    units = [unit for each in catalogue("sensing-axis").values() for unit in each.parameters.values()]
    assert len(units) > 20
    assert all(known_unit(unit) for unit in units)


def test_every_effect_of_the_catalogue_passes_the_trial_of_a_plugin() -> None:
    from rigctl.effects.plugins import flaw_of_declaration
    from rigctl.effects.trial import flaw_of_function

    for each in catalogue("sensing-axis").values():
        assert each.source
        assert flaw_of_function(each) is None, each.id
        if not each.needs and not each.scanned:
            assert flaw_of_declaration(each) is None, each.id
        assert np.isfinite(list(each.typical.values())).all()
