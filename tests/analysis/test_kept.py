"""What is kept is read back as it was, and made again whenever it cannot be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from rigctl.analysis.kept import Kept, Packed, Recipe
from rigctl.core.errors import DataError

VALUE = Packed({"name": "one", "size": 0.1}, {"table": np.arange(6.0).reshape(2, 3), "none": np.zeros(0)})
RECIPE = Recipe("sines", 3, (0.5, "fast"))


@dataclass
class Shelf:
    """A store's reductions in memory."""

    readonly: bool = False
    blobs: dict[tuple[str, str], bytes] = field(default_factory=dict)

    def reduction(self, recipe: str, name: str) -> bytes | None:
        """What is kept."""
        return self.blobs.get((recipe, name))

    def keep_reductions(self, recipe: str, blobs: Mapping[str, bytes]) -> None:
        """Keep."""
        self.blobs.update({(recipe, name): data for name, data in blobs.items()})


def unpacked(packed: Packed) -> tuple[str, list[float]]:
    return packed.head["name"], packed.arrays["table"].ravel().tolist()


def never() -> Packed:
    raise AssertionError("made a second time")


@pytest.mark.parametrize("compressed", [False, True])
def test_a_second_look_makes_nothing(compressed: bool) -> None:
    shelf = Shelf()
    recipe = Recipe("sines", 3, (0.5, "fast"), compressed=compressed)
    first = Kept(shelf, recipe).once("run", lambda: VALUE, unpacked)
    assert Kept(shelf, recipe).once("run", never, unpacked) == first == ("one", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert list(shelf.blobs) == [("sines 3 0.5 fast", "run")]


def test_arrays_of_any_kind_come_back_bit_for_bit_and_may_be_written_to() -> None:
    arrays = {
        "a": np.array([[1.0, -0.0], [np.nan, 5e-324]]).T,
        "b": np.arange(3, dtype=np.float32),
        "c": np.array([1 + 2j]),
        "d": np.zeros((0, 4), dtype=bool),
        "e": np.array(7),
        "f": np.array(["x", "longer"]),
    }
    found = Packed.from_bytes(Packed({"of": "ä"}, arrays).to_bytes())
    assert found.head == {"of": "ä"}
    assert list(found.arrays) == list(arrays)
    for name, each in arrays.items():
        assert (found.arrays[name].dtype, found.arrays[name].shape) == (each.dtype, each.shape)
        assert found.arrays[name].tobytes() == np.ascontiguousarray(each).tobytes()
        assert found.arrays[name].flags.writeable


def test_what_was_kept_as_a_file_of_numpys_is_read() -> None:
    assert unpacked(Packed.from_bytes(VALUE.to_bytes(compressed=True))) == ("one", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])


GOOD = VALUE.to_bytes()


@pytest.mark.parametrize(
    "bad",
    [b"", b"!too short", b'{"frequency_hz": 0.5}\n\0\0', GOOD[:-30], GOOD[:100] + b"\xff" + GOOD[101:], GOOD[:40],
     Packed({"name": "two"}, {}).to_bytes(), Packed({}, VALUE.arrays).to_bytes()],
)  # fmt: skip
def test_what_cannot_be_read_is_made_again_and_kept(bad: bytes) -> None:
    shelf = Shelf(blobs={(str(RECIPE), "run"): bad})
    kept = Kept(shelf, RECIPE)
    assert kept.once("run", lambda: VALUE, unpacked)[0] == "one"
    assert kept.added
    assert shelf.blobs[str(RECIPE), "run"] == GOOD


def test_a_disk_that_is_full_keeps_nobody_from_the_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def full(self: Shelf, recipe: str, blobs: Mapping[str, bytes]) -> None:
        asked.extend(blobs)
        raise DataError("the disk is full")

    monkeypatch.setattr(Shelf, "keep_reductions", full)
    kept = Kept(Shelf(), RECIPE)
    assert [kept.once(name, lambda: VALUE, unpacked)[0] for name in ("run", "another")] == ["one", "one"]
    assert asked == ["run"]
    assert not kept.added


def test_nothing_is_kept_in_a_store_that_is_only_read() -> None:
    shelf = Shelf(readonly=True)
    assert Kept(shelf, RECIPE).once("run", lambda: VALUE, unpacked)[0] == "one"
    assert not shelf.blobs
