"""Dialogs. STOP works in all of them; Escape leaves without doing anything."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Literal, TypeVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Checkbox, Input, OptionList, Static
from textual.widgets.option_list import Option

from rigctl.console.messages import Launch

Answer = TypeVar("Answer")


class Dialog(ModalScreen[Answer | None], Generic[Answer]):
    """A box in the middle of the screen."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "Leave")]
    HINT = "Esc leaves  F8 STOP"

    def __init__(self, title: str) -> None:
        super().__init__()
        self.title = title

    def ask(self, app: App[Any], then: Callable[[Answer], object]) -> None:
        """Show it; `then` is called with the answer, and not at all when the operator leaves it."""

        def go(answer: Answer | None) -> None:
            if answer is not None:
                then(answer)

        app.push_screen(self, go)

    def compose(self) -> ComposeResult:
        """Title, what the dialog is about, hints."""
        with Vertical(classes="dialog"):
            # Text, as brackets in a string would be taken for markup.
            yield Static(Text(self.title or ""), classes="dialog-title")
            yield from self.contents()
            yield Static(Text(self.HINT), classes="hint")

    def contents(self) -> ComposeResult:
        """What is between title and hints."""
        yield from ()

    def action_leave(self) -> None:
        """Do nothing."""
        self.dismiss(None)


class Tick(Checkbox, inherit_bindings=False):
    """A box whose mark is there or not: no colour is the only sign. Space ticks it, Enter is the dialog's."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("space", "toggle_button", "Tick", show=False)]

    @property
    def BUTTON_INNER(self) -> str:  # type: ignore[override]  # noqa: N802 - textual's name
        """What is in the box."""
        return "x" if self.value else " "


_LONG = 30
"""Of 72 characters, for names with an explanation in the same line."""


class PickDialog(Dialog[str]):
    """One of a list; typing makes it shorter."""

    HINT = "type to search  ↓ list  Enter picks  Esc leaves  F8 STOP"

    PLACEHOLDER = "search"

    def __init__(self, title: str, options: Sequence[tuple[str, str]]) -> None:
        super().__init__(title)
        self._options = list(options)

    def contents(self) -> ComposeResult:
        """Search, refusal, list."""
        yield Input(placeholder=self.PLACEHOLDER, compact=True)
        yield Static("", classes="refusal")
        yield OptionList(*self._shown(""), compact=True)

    def _shown(self, typed: str) -> list[Option]:
        width = max((len(name) for name, _ in self._options), default=0)
        matching = [each for each in self._options if typed.lower() in " ".join(each).lower()]
        # Beside long names there is no room.
        between = "\n    " if width > _LONG else "  "
        return [
            Option(
                Text(
                    f"{name:{width}}{between if explanation else ''}{explanation}", no_wrap=True, overflow="ellipsis"
                ),
                id=name,
            )
            for name, explanation in matching
        ]

    def on_input_changed(self, event: Input.Changed) -> None:
        """Shorten the list."""
        self.query_one(OptionList).set_options(self._shown(event.value))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter in the search."""
        event.stop()
        self.accept(event.value)

    def accept(self, typed: str) -> None:
        """The first that is left."""
        if shown := self._shown(typed):
            self.dismiss(shown[0].id)

    def on_key(self, event: object) -> None:
        """Down goes from the search into the list."""
        if getattr(event, "key", "") == "down" and isinstance(self.focused, Input):
            self.query_one(OptionList).focus()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """The one that was chosen."""
        self.dismiss(event.option.id)


class OpenDialog(PickDialog):
    """Which file to open: one that is near, or any by its path."""

    HINT = "Enter opens  ↓ list  Esc leaves  F8 STOP"
    PLACEHOLDER = "path of a file"

    def accept(self, typed: str) -> None:
        """The path, or the only one that matches."""
        path, matching = Path(typed).expanduser(), self._shown(typed)
        if path.is_file():
            self.dismiss(str(path))
        elif typed and len(matching) == 1:
            self.dismiss(matching[0].id)
        else:
            self.query_one(".refusal", Static).update(Text(f"✗ {typed or 'nothing'}: no such file"))


class TextDialog(Dialog[str]):
    """A line of text; `refusal` says what is wrong with it."""

    HINT = "Enter accepts   Esc leaves  F8 STOP"

    def __init__(self, title: str, prompt: str, value: str, refusal: Callable[[str], str]) -> None:
        super().__init__(title)
        self._prompt = prompt
        self._value = value
        self._refusal = refusal

    def contents(self) -> ComposeResult:
        """What it is for, entry, refusal."""
        yield Static(Text(self._prompt))
        yield Input(self._value, compact=True)
        yield Static("", classes="refusal")

    def on_input_changed(self, event: Input.Changed) -> None:
        """Say at once what is wrong."""
        self._judge(event.value)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Accept what is not refused."""
        if not self._judge(event.value):
            self.dismiss(event.value)

    def _judge(self, value: str) -> str:
        why = self._refusal(value)
        self.query_one(".refusal", Static).update(Text(f"✗ {why}" if why else ""))
        return why


@dataclass(frozen=True)
class Fault:
    """What is wrong with a launch, and which entry has to be changed."""

    entry: Literal["campaign", "store", "rig", "seed", "max-runs"]
    why: str


_NUMBERS: Mapping[Literal["seed", "max-runs"], str] = {"seed": "seed", "max-runs": "most runs"}
"""Entries that take a whole number, as a refusal calls them."""


class StartDialog(Dialog[Launch]):
    """How a campaign is started; `fault` says what is wrong with a launch. The entry to change has the focus."""

    HINT = "Enter starts  Tab next entry  Space ticks  Esc leaves  F8 STOP"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "start", "Start")]

    def __init__(self, launch: Launch, fault: Callable[[Launch], Fault | None]) -> None:
        super().__init__("Start a campaign")
        self._launch = launch
        self._fault = fault
        wrong = fault(launch)
        self.AUTO_FOCUS = f"#{wrong.entry if wrong else 'campaign'}"  # type: ignore[misc]  # textual reads it so

    def contents(self) -> ComposeResult:
        """The options of `rigctl run`."""
        launch = self._launch
        entries = (
            ("campaign", "campaign file", launch.campaign),
            ("store", "store to make", launch.store),
            ("rig", "rig file (empty: as the campaign file says)", launch.rig or ""),
            ("seed", "seed of a simulated world (empty: as its file says)", ""),
        )
        for name, label, value in entries:
            yield from self._entry(name, label, str(value))
        yield Tick("the simulated operator answers (nobody is asked)", compact=True, id="unattended")
        yield Tick("investigate: diagnose, add what is found, measure what decides", compact=True, id="investigate")
        yield from self._entry("max-runs", "at most so many runs of it (empty: those of a full scan)", "")
        yield Static("", classes="refusal")

    @staticmethod
    def _entry(name: str, label: str, value: str) -> ComposeResult:
        yield Static(label)
        # Not selected: the first key would take the place of what stands there.
        yield Input(value, compact=True, select_on_focus=False, id=name)

    def on_mount(self) -> None:
        """What is wrong from the start?"""
        self._judge()

    def on_input_changed(self) -> None:
        """Say at once what is wrong."""
        self._judge()

    def on_checkbox_changed(self) -> None:
        """What may be started changes with what is ticked."""
        self._judge()

    def on_input_submitted(self) -> None:
        """Enter in an entry."""
        self.action_start()

    def action_start(self) -> None:
        """Start, unless something is wrong."""
        if not self._judge():
            self.dismiss(self._entered())

    def _judge(self) -> Fault | None:
        fault = self._fault(self._entered()) or self._no_number()
        self.query_one(".refusal", Static).update(Text(f"✗ {fault.why}" if fault else ""))
        return fault

    def _text(self, name: str) -> str:
        return self.query_one(f"#{name}", Input).value.strip()

    def _number(self, name: str) -> int | None:
        # Digits of other scripts are none here.
        return int(self._text(name)) if self._text(name).isascii() and self._text(name).isdigit() else None

    def _no_number(self) -> Fault | None:
        """What was typed where a number belongs is kept as it is and refused, never read as another number."""
        for name, label in _NUMBERS.items():
            if self._text(name) and self._number(name) is None:
                return Fault(name, f"{label}: '{self._text(name)}' is no whole number of 0 or more")
        return None

    def _entered(self) -> Launch:
        text = self._text
        return Launch(
            campaign=Path(text("campaign")),
            store=Path(text("store")),
            rig=Path(text("rig")) if text("rig") else None,
            unattended=self.query_one("#unattended", Tick).value,
            investigate=self.query_one("#investigate", Tick).value,
            seed=self._number("seed"),
            max_runs=self._number("max-runs"),
        )


class QuestionDialog(Dialog[str]):
    """What the campaign asks the operator: answered by writing the word, never by a key alone."""

    HINT = "write the answer, then Enter  Esc: later, F9 comes back  F8 STOP"

    def __init__(self, text: str, choices: Sequence[str]) -> None:
        super().__init__("THE CAMPAIGN WAITS FOR YOU")
        self._text = text
        self._choices = choices

    def contents(self) -> ComposeResult:
        """The question, the words, the entry."""
        # The campaign's own prompt ends in how to answer at its terminal.
        yield Static(Text(self._text.partition(" Type '")[0].removesuffix(" [y/n] ")), classes="question")
        yield Static(Text(f"Write {' or '.join(self._choices)}:"))
        yield Input(compact=True)
        yield Static("", classes="refusal")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Only one of the words is an answer."""
        typed = event.value.strip().lower()
        if typed in self._choices:
            self.dismiss(typed)
        else:
            refusal = f"✗ '{event.value}' is no answer; write {' or '.join(self._choices)}"
            self.query_one(".refusal", Static).update(Text(refusal))


class ConfirmDialog(Dialog[bool]):
    """Yes or no."""

    HINT = "y yes   n or Esc no  F8 STOP"
    BINDINGS: ClassVar[list[BindingType]] = [Binding("y", "agree", "Yes"), Binding("n", "leave", "No")]

    def __init__(self, title: str, text: str) -> None:
        super().__init__(title)
        self._text = text

    def contents(self) -> ComposeResult:
        """What would happen."""
        yield Static(Text(self._text), classes="question")

    def action_agree(self) -> None:
        """Do it."""
        self.dismiss(True)


class HelpDialog(Dialog[bool]):
    """Keys and what they do."""

    HINT = "Esc leaves   ↑ ↓ scroll  F8 STOP"

    def __init__(self, text: str) -> None:
        super().__init__("Help")
        self._text = text

    def contents(self) -> ComposeResult:
        """The text, which can be scrolled."""
        with VerticalScroll(classes="help"):
            yield Static(Text(self._text))
